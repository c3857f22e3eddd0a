//! What is written is read; damage is told.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on says so by panicking")]

mod damage;
mod files;
mod foreign;

use std::ops::ControlFlow;

use quantity::{Span, Time};

use files::{File, Said, about, read_all, said, sealed, torn, without_summary};
use recording::{About, Compression, Condition, Ending, Recording, Selection, StreamGaps, WriteOptions};

#[test]
fn every_way_to_read_gives_what_was_written() {
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        let said = said(4000);
        for bytes in
            [sealed(&said, compression), torn(&said, compression), without_summary(&said, compression)]
        {
            let recording = Recording::from_bytes("a", bytes).unwrap();
            assert_eq!(recording.about(), Some(&about()));
            assert_eq!(recording.message_count(), said.len() as u64);
            assert_eq!(recording.damage().len(), 0);
            assert_eq!(read_all(&recording, &Selection::all()).0, files::in_order(&said));
            let visited = visit_all(&recording, &Selection::all());
            assert_eq!(visited, files::in_order(&said));
        }
    }
}

fn visit_all(recording: &Recording, selection: &Selection) -> Vec<Said> {
    let mut all = Vec::new();
    recording.visit(
        selection,
        Vec::new,
        |rows, message| rows.push(Said::of(&message)),
        |rows| {
            all.extend(rows.unwrap());
            ControlFlow::Continue(())
        },
    );
    all
}

#[test]
fn the_condition_of_a_file_is_told() {
    let said = said(300);
    let whole = sealed(&said, Compression::Lz4);
    let condition =
        |bytes: Vec<u8>| Recording::from_bytes("a", bytes).unwrap().segments()[0].condition.clone();
    assert_eq!(condition(whole.clone()), Condition::Sealed);
    assert_eq!(condition(without_summary(&said, Compression::Lz4)), Condition::WithoutSummary);
    let torn = torn(&said, Compression::Lz4);
    let whole_bytes = torn.len() as u64;
    assert_eq!(condition(torn.clone()), Condition::Torn { whole_bytes, lost_bytes: 0 });
    let shorter = torn[..torn.len() - 3].to_vec();
    let Condition::Torn { whole_bytes, lost_bytes } = condition(shorter) else { panic!("not torn") };
    assert_eq!(whole_bytes + lost_bytes, torn.len() as u64 - 3);
    assert!(lost_bytes > 0);
}

#[test]
fn a_selection_gives_its_part_and_nothing_else() {
    let said = said(4000);
    let recording = Recording::from_bytes("a", sealed(&said, Compression::Lz4)).unwrap();
    let (from, to) = (files::time(1200), files::time(2900));
    type Wanted = fn(&Said) -> bool;
    let selections: [(Selection, Wanted); 4] = [
        (Selection::topic("vehicle/state"), |said| said.topic == "vehicle/state"),
        (Selection { topics: vec!["vehicle/*".to_owned()], ..Selection::all() }, |said| {
            said.topic.starts_with("vehicle/")
        }),
        (Selection { exclude: vec!["mocap/frame".to_owned()], ..Selection::all() }, |said| {
            said.topic != "mocap/frame"
        }),
        (Selection::topic("nothing/such"), |_| false),
    ];
    for (selection, wanted) in selections {
        let expected = files::in_order(&said);
        let mut expected: Vec<Said> = expected.into_iter().filter(wanted).collect();
        assert_eq!(read_all(&recording, &selection).0, expected);
        expected.retain(|said| said.at >= from && said.at <= to);
        let within = selection.from(from).to(to);
        assert_eq!(read_all(&recording, &within).0, expected);
        assert_eq!(visit_all(&recording, &within), expected);
    }
}

#[test]
fn a_visit_ends_where_its_caller_breaks_off() {
    let said = said(4000);
    let recording = Recording::from_bytes("a", sealed(&said, Compression::Lz4)).unwrap();
    let mut joined = 0;
    recording.visit(
        &Selection::all(),
        || (),
        |(), _| (),
        |_| {
            joined += 1;
            if joined == 2 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        },
    );
    assert_eq!(joined, 2);
}

#[test]
fn missing_numbers_are_found_exactly() {
    let mut said = said(3000);
    let lost: Vec<Said> = said.extract_if(40..60, |said| said.topic == "vehicle/state").collect();
    let recording = Recording::from_bytes("a", sealed(&said, Compression::Lz4)).unwrap();
    let gaps = recording.gaps(&Selection::all(), |_| ());
    assert_eq!(gaps.messages, said.len() as u64);
    let missing: u64 = gaps.streams.iter().map(StreamGaps::missing).sum();
    assert_eq!(missing, lost.len() as u64);
    let of_state: Vec<&StreamGaps> =
        gaps.streams.iter().filter(|stream| stream.stream.topic == "vehicle/state").collect();
    assert_eq!(of_state.iter().map(|stream| stream.missing()).sum::<u64>(), lost.len() as u64);
}

#[test]
fn a_missing_chunk_is_a_gap_although_every_checksum_holds() {
    let said = said(3000);
    let torn = torn(&said, Compression::Lz4);
    let chunks = files::records(&torn, mcap::records::op::CHUNK);
    let hole = chunks[chunks.len() / 2].clone();
    let without = [&torn[..hole.start], &torn[hole.end..]].concat();
    let recording = Recording::from_bytes("a", without).unwrap();
    let gaps = recording.gaps(&Selection::all(), |_| ());
    assert!(gaps.damage.is_empty());
    let missing: u64 = gaps.streams.iter().map(StreamGaps::missing).sum();
    assert_eq!(missing + gaps.messages, said.len() as u64);
    assert!(missing > 0);
}

#[test]
fn the_newest_latched_message_before_an_instant_is_kept() {
    let said = said(4000);
    let recording = Recording::from_bytes("a", sealed(&said, Compression::Lz4)).unwrap();
    let at = files::time(2000);
    let kept = recording.latched_before(at, &Selection::all()).unwrap();
    let expected = files::in_order(&said);
    for source in [1, 2] {
        let newest = expected
            .iter()
            .rev()
            .find(|said| said.topic == "arena/order" && said.source == source && said.at < at);
        let newest = newest.unwrap();
        let found = kept.iter().find(|kept| {
            let stream = recording.channels()[kept.channel as usize].stream.as_ref().unwrap();
            stream.source == source
        });
        let found = found.unwrap();
        assert_eq!((found.at, found.sequence, &found.body), (newest.at, newest.sequence, &newest.body));
    }
    assert_eq!(kept.len(), 2);
}

#[test]
fn segments_are_one_recording_in_order_of_time() {
    let folder = std::env::temp_dir().join(format!("flyarena-segments-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let all = said(3000);
    let parts = [&all[..1000], &all[1000..2000], &all[2000..]];
    let first = folder.join("flight.mcap");
    std::fs::write(&first, sealed(parts[0], Compression::Lz4)).unwrap();
    std::fs::write(folder.join("flight.0001.mcap"), sealed(parts[1], Compression::Lz4)).unwrap();
    std::fs::write(folder.join("flight.0002.mcap.part"), torn(parts[2], Compression::Lz4)).unwrap();
    // Neither of these is a part of it.
    let other = About { recording: 99, ..about() };
    let strange = files::write(File { about: other, ..File::new(parts[0], Compression::Lz4) });
    std::fs::write(folder.join("flight.0003.mcap"), strange).unwrap();
    std::fs::write(folder.join("flights.0001.mcap"), sealed(parts[0], Compression::Lz4)).unwrap();
    let recording = Recording::open(&first).unwrap();
    assert_eq!(recording.segments().len(), 3);
    assert_eq!(recording.ending(), None::<&Ending>);
    assert_eq!(read_all(&recording, &Selection::all()).0, files::in_order(&all));
    let alone = Recording::open_alone(&first).unwrap();
    assert_eq!(alone.message_count(), 1000);
    assert_eq!(alone.channels().len(), recording.channels().len());
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn what_is_no_recording_is_said_so() {
    for (bytes, expected) in [(Vec::new(), "it is empty"), (b"{\"a\": 1}".to_vec(), "7b 22 61")] {
        let error = Recording::from_bytes("a.mcap", bytes).unwrap_err().to_string();
        assert!(error.contains("a.mcap") && error.contains(expected), "{error}");
    }
}

#[test]
fn a_chunk_that_claims_too_much_reserves_nothing() {
    let said = said(400);
    let mut bytes = torn(&said, Compression::Lz4);
    let chunk = files::records(&bytes, mcap::records::op::CHUNK).pop().unwrap();
    let size_at = chunk.start + 9 + 16;
    for claim in [u64::MAX, 1 << 40, 200 << 20] {
        bytes[size_at..size_at + 8].copy_from_slice(&claim.to_le_bytes());
        let recording = Recording::from_bytes("a", bytes.clone()).unwrap();
        let (read, errors) = read_all(&recording, &Selection::all());
        assert_eq!(errors.len(), 1, "{errors:?}");
        assert!(read.len() < said.len());
    }
}

#[test]
fn seconds_count_from_the_recordings_start() {
    let recording = Recording::from_bytes("a", sealed(&said(100), Compression::None)).unwrap();
    assert_eq!(recording.at_seconds(1.5), about().started_at + Span::from_millis(1500));
    assert!((recording.seconds_at(about().started_at + Span::from_millis(1500)) - 1.5).abs() < 1e-12);
    assert_eq!(recording.time_range().unwrap().0, Time::from_nanos(files::time(0).as_nanos()));
}

fn options(compression: Compression) -> WriteOptions {
    WriteOptions { chunk_bytes: 8 << 10, compression }
}
