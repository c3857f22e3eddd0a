//! Recordings on disks that fail in every way there is.

use std::io;

use quantity::{Span, Time};

use super::sealable::Sealable;
use super::testing::{FakeDisk, about, at, ending_of, numbers_in, observed, plan};
use super::{Limits, Segments, Standing, StoredFile};
use crate::write::{Compression, WriteOptions, Writer};
use crate::{Ending, write::Gap};

const EIO: i32 = 5;
const EFBIG: i32 = 27;

/// Writes messages at their times, ticking as the logger does.
fn write(segments: &mut Segments<FakeDisk>, numbers: std::ops::Range<u64>) {
    for number in numbers {
        let now = at(number);
        observed(number, |at, observed| segments.observe(now, at, observed));
        if number % 20 == 0 {
            segments.tick(now);
        }
    }
}

/// All messages in sealed files, in the files' order; each file has to be whole.
fn sealed(disk: &FakeDisk) -> Vec<u64> {
    let names = disk.names();
    let number = |name: &String| -> u32 {
        name.trim_start_matches("flight").trim_matches(|c: char| !c.is_ascii_digit()).parse().unwrap_or(0)
    };
    let mut files: Vec<&String> = names.iter().filter(|name| name.ends_with(".mcap")).collect();
    files.sort_by_key(|name| number(name));
    files.iter().flat_map(|name| numbers_in(&disk.file(name))).collect()
}

/// What must hold after any failure: nothing is lost uncounted, and what is there is in order.
fn assert_accounted(disk: &FakeDisk, segments: &Segments<FakeDisk>, accepted: u64, what: &str) {
    let totals = segments.totals();
    let found = sealed(disk);
    assert_eq!(totals.recorded, found.len() as u64, "{what}: recorded, of {:?}", disk.names());
    assert_eq!(totals.recorded + totals.dropped, accepted, "{what}: recorded and dropped");
    assert!(found.is_sorted_by(|one, other| one < other), "{what}: order");
    let names = disk.names();
    assert!(names.iter().all(|name| name.ends_with(".mcap")), "{what}: left behind {names:?}");
}

#[test]
fn a_recording_is_one_sealed_file() {
    let disk = FakeDisk::default();
    let mut segments = Segments::begin(disk.clone(), plan(Limits::one_file()), at(0)).unwrap();
    write(&mut segments, 0..500);
    assert_eq!(disk.names(), ["flight.mcap.part", "flight.mcap.reserve"]);
    segments.finish(at(500), "stopped");
    assert_eq!(disk.names(), ["flight.mcap"]);
    assert_eq!(sealed(&disk), (0..500).collect::<Vec<_>>());
    let ending = ending_of(&disk.file("flight.mcap"));
    assert_eq!((ending.reason.as_str(), ending.recorded), ("stopped", 500));
    assert!(segments.take_notices().is_empty());
}

#[test]
fn segments_end_by_time_and_by_size_and_lose_nothing_between_them() {
    for limits in [
        Limits { segment_span: Some(Span::from_millis(100)), ..Limits::one_file() },
        Limits { segment_bytes: Some(20_000), ..Limits::one_file() },
    ] {
        let disk = FakeDisk::default();
        let mut segments = Segments::begin(disk.clone(), plan(limits), at(0)).unwrap();
        write(&mut segments, 0..1000);
        segments.finish(at(1000), "stopped");
        assert_accounted(&disk, &segments, 1000, "rotation");
        assert_eq!(sealed(&disk), (0..1000).collect::<Vec<_>>());
        assert!(segments.totals().segments >= 5, "{} segments", segments.totals().segments);
        assert_eq!(ending_of(&disk.file("flight.0001.mcap")).reason, "segment full");
    }
}

#[test]
fn only_so_many_segments_are_kept() {
    let limits = Limits {
        segment_span: Some(Span::from_millis(100)),
        keep: super::Keep::Segments(2),
        ..Limits::one_file()
    };
    let disk = FakeDisk::default();
    let mut segments = Segments::begin(disk.clone(), plan(limits), at(0)).unwrap();
    write(&mut segments, 0..1000);
    assert_eq!(disk.names().iter().filter(|name| name.ends_with(".mcap")).count(), 2);
    segments.finish(at(1000), "stopped");
    assert_eq!(sealed(&disk).last(), Some(&999));
}

#[test]
fn a_chunk_is_on_the_disk_before_it_is_a_tenth_of_a_second_old() {
    let disk = FakeDisk::default();
    let mut segments = Segments::begin(disk.clone(), plan(Limits::one_file()), at(0)).unwrap();
    observed(0, |at, observed| segments.observe(at, at, observed));
    let begun = disk.file("flight.mcap.part").len();
    segments.tick(at(60));
    assert_eq!(disk.file("flight.mcap.part").len(), begun, "it may wait");
    segments.tick(at(80));
    assert!(disk.file("flight.mcap.part").len() > begun, "the next look would be too late");
}

#[test]
fn a_name_that_is_taken_is_refused_and_left_alone() {
    for name in ["flight.mcap", "flight.mcap.part"] {
        let disk = FakeDisk::default();
        disk.inside().files.insert(name.into(), vec![1, 2, 3]);
        disk.inside().files.insert("flight.mcap.reserve".into(), vec![4]);
        let error = Segments::begin(disk.clone(), plan(Limits::one_file()), at(0)).err().unwrap();
        assert!(error.to_string().contains(name), "{error}");
        assert_eq!(disk.file(name), [1, 2, 3]);
        assert_eq!(disk.file("flight.mcap.reserve"), [4], "another recording's reserve");
    }
}

#[test]
fn a_failed_write_at_any_of_many_offsets_costs_one_chunk_and_one_message() {
    let reference = reference(3000);
    let step = 487;
    for errno in [EIO, EFBIG] {
        for offset in (0..reference.bytes.len() as u64).step_by(step) {
            let disk = FakeDisk::default();
            disk.inside().short = Some(1000);
            disk.inside().interrupts = true;
            let begun = {
                disk.inside().fail_after = Some((offset, errno));
                Segments::begin(disk.clone(), plan(Limits::one_file()), at(0))
            };
            let Ok(mut segments) = begun else {
                assert!(disk.names().is_empty(), "offset {offset} left {:?}", disk.names());
                continue;
            };
            write(&mut segments, 0..3000);
            segments.finish(at(3000), "stopped");
            let what = format!("errno {errno} at {offset}");
            assert_accounted(&disk, &segments, 3000, &what);
            let notices = segments.take_notices();
            assert_eq!(notices.len(), 1, "{what}: {notices:?}");
            let dropped = segments.totals().dropped;
            assert!(dropped <= 60, "{what}: {dropped} dropped for one chunk");
        }
    }
}

#[test]
fn a_full_disk_leaves_a_sealed_readable_file_and_one_message() {
    let reference = reference(1000);
    let smallest = super::tail::TAIL_ROOM_BYTES + 2000;
    for capacity in (smallest..smallest + reference.bytes.len() as u64).step_by(211) {
        let disk = FakeDisk::default();
        disk.inside().capacity = Some(capacity);
        let mut segments = Segments::begin(disk.clone(), plan(Limits::one_file()), at(0)).unwrap();
        write(&mut segments, 0..2000);
        segments.finish(at(2000), "stopped");
        let what = format!("capacity {capacity}");
        assert_accounted(&disk, &segments, 2000, &what);
        assert_eq!(segments.standing(), Standing::Stopped);
        let notices = segments.take_notices();
        assert_eq!(notices.len(), 1, "{what}: {notices:?}");
        assert_eq!(notices[0].name, "recording-stopped");
        let found = sealed(&disk);
        assert_eq!(found, (0..found.len() as u64).collect::<Vec<_>>(), "{what}: an exact prefix");
        assert!(ending_of(&disk.file("flight.mcap")).reason.contains("os error 28"));
    }
}

#[test]
fn a_failed_sync_gives_up_what_the_disk_has_not_confirmed() {
    for after in 1..5 {
        let disk = FakeDisk::default();
        disk.inside().fail_sync_after = Some(after);
        let mut segments = Segments::begin(disk.clone(), plan(Limits::one_file()), at(0)).unwrap();
        write(&mut segments, 0..3500);
        segments.finish(at(3500), "stopped");
        assert_accounted(&disk, &segments, 3500, "failed sync");
        let first = numbers_in(&disk.file("flight.mcap")).len() as u64;
        // The first sync is the beginning's own.
        assert!(first <= 1000 * u64::from(after - 1) + 100, "{first} kept after {after} good syncs");
        assert_eq!(segments.take_notices().len(), 1);
    }
}

#[test]
fn a_file_that_cannot_get_its_name_is_whole_under_the_other() {
    let disk = FakeDisk::default();
    disk.inside().fail_rename_after = Some(0);
    let mut segments = Segments::begin(disk.clone(), plan(Limits::one_file()), at(0)).unwrap();
    write(&mut segments, 0..100);
    segments.finish(at(100), "stopped");
    // The second attempt to rename, after the failure, succeeds.
    assert_eq!(numbers_in(&disk.file("flight.mcap")).len(), 100);
    assert_eq!(segments.totals().recorded, 100);
}

#[test]
fn two_failures_in_a_row_end_the_recording() {
    let disk = FakeDisk::default();
    let mut segments = Segments::begin(disk.clone(), plan(Limits::one_file()), at(0)).unwrap();
    disk.inside().fail_after = Some((3000, EIO));
    write(&mut segments, 0..100);
    assert_eq!(segments.standing(), Standing::Recording);
    disk.inside().fail_after = Some((3000, EIO));
    write(&mut segments, 100..300);
    assert_eq!(segments.standing(), Standing::Stopped);
    assert_accounted(&disk, &segments, 300, "two failures");
    let names: Vec<_> = segments.take_notices().iter().map(|notice| notice.name).collect();
    assert_eq!(names, ["recording-segment-failed", "recording-stopped"]);
}

#[test]
fn a_disk_that_fills_is_warned_of_once_and_left_its_last_bytes() {
    let limits = Limits { min_free_bytes: 1000, ..Limits::one_file() };
    let disk = FakeDisk::default();
    disk.inside().free = Some(5000);
    let plan = super::Plan { limits, ..plan(limits) };
    let mut segments = Segments::begin(disk.clone(), plan, at(0)).unwrap();
    write(&mut segments, 0..1100);
    assert!(segments.take_notices().is_empty());
    disk.inside().free = Some(1999);
    write(&mut segments, 1100..4000);
    let names: Vec<_> = segments.take_notices().iter().map(|notice| notice.name).collect();
    assert_eq!(names, ["disk-filling"]);
    disk.inside().free = Some(999);
    write(&mut segments, 4000..6000);
    assert_eq!(segments.standing(), Standing::Stopped);
    let names: Vec<_> = segments.take_notices().iter().map(|notice| notice.name).collect();
    assert_eq!(names, ["recording-stopped"]);
    assert_accounted(&disk, &segments, 6000, "filling");
    assert_eq!(ending_of(&disk.file("flight.mcap")).reason, "disk full");
}

#[test]
fn a_gap_is_noted_where_it_was() {
    let disk = FakeDisk::default();
    let mut segments = Segments::begin(disk.clone(), plan(Limits::one_file()), at(0)).unwrap();
    write(&mut segments, 0..10);
    let gap = Gap { from: at(10), until: at(20), dropped: [("vehicle/state".to_owned(), 10)].into() };
    segments.note_gap(at(20), &gap);
    write(&mut segments, 20..30);
    segments.finish(at(30), "stopped");
    let file = disk.file("flight.mcap");
    let found = mcap::read::LinearReader::new(&file).unwrap().find_map(|record| match record.unwrap() {
        mcap::records::Record::Metadata(metadata) if metadata.name == crate::GAP_RECORD => {
            Some(Gap::from_metadata(&metadata.metadata).unwrap())
        }
        _ => None,
    });
    assert_eq!(found, Some(gap));
}

/// What a sound disk gets, and where its blocks end.
struct Reference {
    bytes: Vec<u8>,
    ends: Vec<usize>,
    messages: Vec<usize>,
}

#[derive(Default)]
struct Blocks(Vec<Vec<u8>>);

impl io::Write for Blocks {
    fn write(&mut self, block: &[u8]) -> io::Result<usize> {
        self.0.push(block.to_vec());
        Ok(block.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn reference(messages: u64) -> Reference {
    let options = WriteOptions { compression: Compression::None, chunk_bytes: 64 * 1024 };
    let mut writer = Writer::new(Blocks::default(), options, &about(), None).unwrap();
    let mut counts = vec![0];
    for number in 0..messages {
        observed(number, |at, observed| writer.observe(at, observed)).unwrap();
        if writer.sink().0.len() > counts.len() {
            counts.push(writer.committed() as usize);
        }
    }
    let blocks = writer.finish(&Ending::default(), &[]).unwrap().0;
    counts.resize(blocks.len(), messages as usize);
    let mut reference = Reference { bytes: blocks.concat(), ends: Vec::new(), messages: counts };
    let mut end = 0;
    reference.ends.extend(blocks.iter().map(|block| {
        end += block.len();
        end
    }));
    reference
}

/// A file that takes the reference's bytes up to a limit, fails, and then takes what ends it.
struct Limited<'r> {
    reference: &'r [u8],
    length: usize,
    limit: Option<usize>,
    tail: Vec<u8>,
}

impl StoredFile for Limited<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let Some(limit) = self.limit else {
            self.tail.extend_from_slice(bytes);
            return Ok(bytes.len());
        };
        if self.length == limit {
            self.limit = None;
            return Err(io::Error::from_raw_os_error(EIO));
        }
        // The same memory, not only the same bytes: comparing a million times a megabyte would take too long.
        assert!(std::ptr::eq(bytes.as_ptr(), self.reference[self.length..].as_ptr()));
        let count = bytes.len().min(limit - self.length);
        self.length += count;
        Ok(count)
    }

    fn truncate(&mut self, bytes: u64) -> io::Result<()> {
        assert!(bytes as usize <= self.length);
        self.length = bytes as usize;
        Ok(())
    }

    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_write_that_fails_at_every_offset_of_a_mebibyte_leaves_an_exact_readable_prefix() {
    use io::Write as _;
    let reference = reference(7400);
    assert!(reference.bytes.len() >= 1 << 20, "{} bytes", reference.bytes.len());
    let ending = Ending { stopped_at: Time::ZERO, reason: "EIO".to_owned(), ..Ending::default() };
    let mut checked = None;
    for limit in 0..reference.bytes.len() {
        let file = Limited { reference: &reference.bytes, length: 0, limit: Some(limit), tail: Vec::new() };
        let mut file = Sealable::new(file);
        let mut begin = 0;
        for end in &reference.ends {
            if file.write_all(&reference.bytes[begin..*end]).is_err() {
                break;
            }
            begin = *end;
        }
        file.seal_torn(&ending).unwrap();
        let Limited { length, tail, .. } = file.into_file();
        let whole = reference.ends.partition_point(|end| *end <= limit);
        let expected = if whole == 0 { 0 } else { reference.ends[whole - 1] };
        assert_eq!(length, expected, "limit {limit}");
        // What stands there is the same for all offsets of a block: it is read once.
        if whole > 0 && checked.replace((whole, tail.clone())) != Some((whole, tail.clone())) {
            let bytes = [&reference.bytes[..length], &tail].concat();
            let numbers: Vec<u64> = (0..reference.messages[whole - 1] as u64).collect();
            assert_eq!(numbers_in(&bytes), numbers, "limit {limit}");
        }
    }
}
