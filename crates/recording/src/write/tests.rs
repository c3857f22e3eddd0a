//! What the format's own library reads of what was written.

use std::collections::BTreeSet;

use mcap::{MessageStream, Summary};
use quantity::Time;
use service_core::Observed;
use wire::{Domain, Kind, TopicName};

use super::*;
use crate::Stream;
use crate::segment::testing::{about, at, header, observed};

fn writer(options: WriteOptions) -> Writer<Vec<u8>> {
    Writer::new(Vec::new(), options, &about(), None).unwrap()
}

fn definition_body(name: &str, text: &str) -> (u64, Vec<u8>) {
    let body = [name.as_bytes(), b"\0", text.as_bytes()].concat();
    (reflect::fnv1a_64(&[&body]), body)
}

#[test]
fn every_compression_gives_the_same_messages_back() {
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        let mut writer = writer(WriteOptions { compression, chunk_bytes: 10_000 });
        for number in 0..1000 {
            assert_eq!(
                observed(number, |at, observed| writer.observe(at, observed)).unwrap(),
                Taken::Message
            );
        }
        let file = writer.finish(&Ending::default(), &[]).unwrap();
        let numbers = crate::segment::testing::numbers_in(&file);
        assert_eq!(numbers, (0..1000).collect::<Vec<_>>(), "{compression:?}");
        let summary = Summary::read(&file).unwrap().unwrap();
        assert!(summary.chunk_indexes.len() > 10);
        assert_eq!(summary.stats.unwrap().message_count, 1000);
        let compressed = file.len() as f64 / writer_bytes() as f64;
        assert!(compression == Compression::None || compressed < 1.0, "{compression:?}: {compressed}");
    }
}

fn writer_bytes() -> usize {
    (0..1000).map(|number| crate::segment::testing::body(number).len() + MESSAGE_OVERHEAD_BYTES).sum()
}

#[test]
fn a_file_says_what_it_is_before_its_first_message() {
    let file = writer(WriteOptions::default()).sink().clone();
    let text = String::from_utf8_lossy(&file);
    assert!(text.contains(ABOUT_RECORD) && text.contains("double-flip"), "{text}");
}

#[test]
fn a_definition_that_comes_late_gives_a_new_channel_and_stands_once() {
    let mut writer = writer(WriteOptions::default());
    let (id, text) = definition_body("flyarena/Late", "uint8 x\n");
    let topic = TopicName::new("a/late").unwrap();
    let header = wire::Header { schema_id: id, ..header(1) };
    let message = Observed { header, topic, body: &[1], verified: false };
    let announced = Observed {
        header: wire::Header { kind: Kind::Schema, ..header },
        topic,
        body: &text,
        verified: true,
    };
    let wrong = Observed { header: wire::Header { schema_id: id + 1, ..announced.header }, ..announced };
    let request = Observed { header: wire::Header { kind: Kind::SchemaRequest, ..header }, ..message };
    for (at_ms, observed, taken) in [
        (0, &message, Taken::Message),
        (1, &request, Taken::Neither),
        (2, &wrong, Taken::Neither),
        (3, &announced, Taken::Definition),
        (4, &message, Taken::Message),
        (5, &announced, Taken::Definition),
        (6, &message, Taken::Message),
    ] {
        assert_eq!(writer.observe(at(at_ms), observed).unwrap(), taken);
    }
    let file = writer.finish(&Ending::default(), &[]).unwrap();
    let messages: Vec<_> = MessageStream::new(&file).unwrap().map(|message| message.unwrap()).collect();
    let schemas: Vec<_> = messages.iter().map(|message| message.channel.schema.is_some()).collect();
    assert_eq!(schemas, [false, true, true]);
    assert_eq!(messages[1].channel.id, messages[2].channel.id);
    assert_eq!(messages[1].channel.schema.as_ref().unwrap().name, "flyarena/Late");
    let summary = Summary::read(&file).unwrap().unwrap();
    assert_eq!((summary.schemas.len(), summary.channels.len()), (1, 2));
    for message in &messages {
        let stream = Stream::from_metadata(&message.channel.topic, &message.channel.metadata).unwrap();
        assert_eq!((stream.schema_id, stream.verified, stream.source), (id, false, header.source));
    }
}

#[test]
fn whatever_tells_streams_apart_gives_channels_of_their_own() {
    let mut writer = writer(WriteOptions::default());
    let plain = header(1);
    let headers = [
        plain,
        wire::Header { source: 9, ..plain },
        wire::Header { incarnation: 9, ..plain },
        wire::Header { schema_id: 9, ..plain },
        wire::Header { kind: Kind::Journal, ..plain },
        wire::Header { latched: true, ..plain },
        wire::Header { domain: Domain::Live, ..plain },
        wire::Header { run: 9, ..plain },
    ];
    for _ in 0..2 {
        for header in &headers {
            for (topic, verified) in [("a/b", true), ("a/b", false), ("a/c", true)] {
                let entry = Entry { at: at(1), header, topic, verified, body: &[] };
                writer.write(&entry).unwrap();
            }
        }
    }
    let file = writer.finish(&Ending::default(), &[]).unwrap();
    let streams: BTreeSet<Stream> = MessageStream::new(&file)
        .unwrap()
        .map(|message| message.unwrap().channel)
        .map(|channel| Stream::from_metadata(&channel.topic, &channel.metadata).unwrap())
        .collect();
    assert_eq!(streams.len(), 24);
    assert_eq!(Summary::read(&file).unwrap().unwrap().channels.len(), 24);
}

#[test]
fn pretended_senders_do_not_use_up_the_room_of_others() {
    let mut writer = writer(WriteOptions { compression: Compression::Lz4, ..WriteOptions::default() });
    let mut refused = 0;
    for incarnation in 0..5000 {
        let header = wire::Header { incarnation, ..header(1) };
        let entry = Entry { at: at(1), header: &header, topic: "made/up", verified: false, body: &[] };
        match writer.write(&entry) {
            Ok(()) => {}
            Err(WriteError::NoRoom { topic, .. }) => {
                assert_eq!(topic, "made/up");
                refused += 1;
            }
            Err(other) => panic!("{other}"),
        }
    }
    assert!(refused > 0);
    observed(1, |at, observed| writer.observe(at, observed)).unwrap();
    assert_eq!(writer.messages(), 5001 - refused);
}

#[test]
fn an_instant_before_the_clock_is_refused_for_that_message_only() {
    let mut writer = writer(WriteOptions::default());
    let header = header(1);
    let entry = Entry { at: Time::from_nanos(-5), header: &header, topic: "a/b", verified: true, body: &[] };
    let error = writer.write(&entry).unwrap_err().to_string();
    assert!(error.contains("a/b") && error.contains("-5"), "{error}");
    writer.write(&Entry { at: Time::ZERO, ..entry }).unwrap();
}

#[test]
fn after_a_failed_write_nothing_more_is_written() {
    struct Failing(u32);
    impl Write for Failing {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            assert!(self.0 > 0, "it was written to after its failure");
            self.0 -= 1;
            if self.0 == 0 { Err(io::Error::other("broken")) } else { Ok(bytes.len()) }
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }
    let mut writer = Writer::new(Failing(2), WriteOptions::default(), &about(), None).unwrap();
    observed(1, |at, observed| writer.observe(at, observed)).unwrap();
    assert!(matches!(writer.close_chunk(), Err(WriteError::Sink(_))));
    assert!(matches!(observed(2, |at, observed| writer.observe(at, observed)), Err(WriteError::Latched)));
    assert!(matches!(writer.close_chunk(), Err(WriteError::Latched)));
    assert_eq!((writer.messages(), writer.committed()), (1, 0));
    assert!(matches!(writer.finish(&Ending::default(), &[]), Err(WriteError::Latched)));
}
