//! Files that no recorder of ours wrote: they open as far as they can.

use std::collections::BTreeMap;
use std::io::Cursor;

use crate::files;
use recording::{Recording, Selection};

fn foreign(options: mcap::WriteOptions, messages: u32) -> Vec<u8> {
    let mut writer = options.create(Cursor::new(Vec::new())).unwrap();
    let schema = writer.add_schema("std_msgs/String", "ros1msg", b"string data\n").unwrap();
    let text = writer.add_channel(schema, "/chatter", "ros1", &BTreeMap::new()).unwrap();
    let json = writer.add_channel(0, "/json", "json", &BTreeMap::new()).unwrap();
    for number in 0..messages {
        let (log_time, channel_id) = (u64::from(number) * 1000, if number % 2 == 0 { text } else { json });
        let header =
            mcap::records::MessageHeader { channel_id, sequence: number, log_time, publish_time: log_time };
        writer.write_to_known_channel(&header, b"\x02\0\0\0hi").unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

#[test]
fn files_of_others_are_read_whether_chunked_or_not() {
    let chunked = mcap::WriteOptions::new().chunk_size(Some(1024));
    let unchecked = mcap::WriteOptions::new().chunk_size(Some(1024)).calculate_chunk_crcs(false);
    let bare = mcap::WriteOptions::new().chunk_size(Some(1024)).emit_message_indexes(false);
    let loose = mcap::WriteOptions::new().use_chunks(false);
    for options in [chunked, unchecked, bare, loose] {
        let recording = Recording::from_bytes("theirs", foreign(options, 1000)).unwrap();
        assert!(recording.about().is_none());
        assert_eq!(recording.message_count(), 1000);
        let chatter = recording.channels().iter().find(|channel| channel.topic == "/chatter").unwrap();
        assert!(chatter.stream.is_none());
        assert_eq!(chatter.definition.as_ref().unwrap().text, "string data\n");
        let (read, errors) = files::read_all(&recording, &Selection::all());
        assert!(errors.is_empty(), "{errors:?}");
        let sequences: Vec<u32> = read.iter().map(|said| said.sequence).collect();
        assert_eq!(sequences, (0..1000).collect::<Vec<_>>());
        let (of_one, _) = files::read_all(&recording, &Selection::topic("/json"));
        assert_eq!(of_one.len(), 500);
    }
}
