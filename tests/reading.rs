//! Recordings as people read them, and as damage or malice makes them: what the fuzz targets promise holds
//! for thousands of hostile inputs, the same each time.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use mcap::records::MessageHeader;
use quantity::{Span, Time};
use recording::{About, Ending, Entry, Recording, Selection, WriteOptions, Writer};
use schemas::topics;
use serde_json::Value;
use settings::Arena;
use wire::{Domain, Header, Kind};

use crate::common::{config, front_door};

#[path = "../fuzz/src/targets.rs"]
mod targets;

/// So many inputs for each target.
const INPUTS: usize = 20_000;

/// Random numbers, the same each time.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        self.0 ^ (self.0 >> 29)
    }

    fn below(&mut self, bound: usize) -> usize {
        (self.next() >> 16) as usize % bound.max(1)
    }
}

/// An input with some things done to it: bytes changed, cut out, doubled, or set to what lengths like to be
/// wrong by.
fn mutated(sample: &[u8], random: &mut Random) -> Vec<u8> {
    let mut input = sample.to_vec();
    for _ in 0..1 + random.below(4) {
        let at = random.below(input.len() + 1);
        match random.below(6) {
            0 => input.truncate(at),
            1 => input.insert(at, random.next() as u8),
            2 if at < input.len() => input[at] ^= 1 << random.below(8),
            3 if at < input.len() => input[at] = [0, 1, 0x7f, 0x80, 0xff][random.below(5)],
            4 => {
                let end = (at + random.below(40)).min(input.len());
                input.drain(at..end);
            }
            _ => {
                let end = (at + random.below(40)).min(input.len());
                let doubled = input[at..end].to_vec();
                input.splice(at..at, doubled);
            }
        }
    }
    input
}

fn throw(samples: &[Vec<u8>], seed: u64, target: fn(&[u8])) {
    let mut random = Random(seed);
    samples.iter().for_each(|sample| target(sample));
    for _ in 0..INPUTS {
        let sample = &samples[random.below(samples.len())];
        target(&mutated(sample, &mut random));
    }
}

#[test]
fn hostile_datagrams_keep_what_the_wire_promises() {
    let mut random = Random(1);
    let samples: Vec<Vec<u8>> = (0..topics::ALL.len() * 8)
        .map(|number| {
            let length = random.below(300);
            let small = number % 3 != 0;
            let byte =
                |random: &mut Random| if small { random.next() as u8 & 1 } else { random.next() as u8 };
            let mut input = vec![number as u8];
            input.extend((0..length).map(|_| byte(&mut random)));
            input
        })
        .collect();
    throw(&samples, 2, targets::datagram);
}

#[test]
fn hostile_definitions_keep_what_the_parser_promises() {
    let samples: Vec<Vec<u8>> = topics::ALL
        .iter()
        .map(|topic| [topic.schema.text().as_bytes(), &[0; 200]].concat())
        .chain([b"uint8[] data\nstring[2] names\n\0\x02\0\0\0\x01\x02\0\0\0\0\0\0\0\0".to_vec()])
        .collect();
    throw(&samples, 3, targets::schema_text);
}

#[test]
fn hostile_files_keep_what_the_reader_promises() {
    let chunked = mcap::WriteOptions::new().chunk_size(Some(300));
    let loose = mcap::WriteOptions::new().use_chunks(false);
    let packed = mcap::WriteOptions::new().compression(None).calculate_chunk_crcs(false);
    let mut samples: Vec<Vec<u8>> = [chunked, loose, packed].into_iter().map(file).collect();
    // What stands in a chunk, for the target to wrap.
    let body = [1, 0, 1, 0, 0, 0, 5, 0, 0, 0, 0, 0, 0, 0, 5, 0, 0, 0, 0, 0, 0, 0, 1, 2, 3];
    let message = [&[5][..], &(body.len() as u64).to_le_bytes(), &body].concat();
    samples.push(message.repeat(3));
    throw(&samples, 4, targets::mcap_reader);
}

fn file(options: mcap::WriteOptions) -> Vec<u8> {
    let mut writer = options.create(std::io::Cursor::new(Vec::new())).unwrap();
    let schema = writer.add_schema("package/Type", "ros1msg", b"uint8 a\n").unwrap();
    let channels =
        ["a", "b"].map(|topic| writer.add_channel(schema, topic, "ros1", &BTreeMap::new()).unwrap());
    for sequence in 0..12_u32 {
        let time = u64::from(sequence * 10 % 70);
        let channel_id = channels[sequence as usize % 2];
        let header = MessageHeader { channel_id, sequence, log_time: time, publish_time: time };
        writer.write_to_known_channel(&header, &[sequence as u8]).unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

/// A recording of ten seconds: a hundred states a second, of which the 400th was lost, and an order at one
/// second and three.
fn write_recording(path: &Path) -> Vec<(u64, Time)> {
    let started_at = Time::from_nanos(7_000_000_000);
    let arena = Arena::load(&config(), "double-flip").unwrap();
    let about = About {
        recording: 5,
        segment: 0,
        run: 6,
        domain: Domain::Sim,
        scenario: "double-flip".to_owned(),
        settings_digest: arena.digest(),
        started_at,
        started_wall_ns: 1_700_000_000_000_000_000,
        host: "host".to_owned(),
        revision: String::new(),
    };
    let file = std::fs::File::create(path).unwrap();
    let mut writer = Writer::new(file, WriteOptions::default(), &about, Some(&arena)).unwrap();
    let mut states = Vec::new();
    for number in (1..=1000).filter(|number| *number != 400) {
        let at = started_at + Span::from_millis(10 * number as i64);
        for (topic, latched) in [("vehicle/state", false), ("arena/order", true)] {
            if latched && number != 100 && number != 300 {
                continue;
            }
            let header = Header {
                kind: Kind::Data,
                domain: Domain::Sim,
                latched,
                source: if latched { 2 } else { service_core::source_of("estimator") },
                schema_id: 1,
                run: 6,
                incarnation: 1,
                sequence: number,
                published_at: at,
            };
            let body = &number.to_le_bytes();
            writer.write(&Entry { at, header: &header, topic, verified: true, body }).unwrap();
        }
        if writer.chunk_due_at().is_some_and(|due| at >= due) {
            writer.close_chunk().unwrap();
        }
        states.push((number, at));
    }
    let ending = Ending { reason: "stopped".to_owned(), ..Ending::default() };
    writer.finish(&ending, &[]).unwrap();
    states
}

fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("reading-{name}"));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn arena(folder: &Path, line: &str) -> (Option<i32>, String, String) {
    let mut command = Command::new(front_door());
    let output = command.args(line.split_whitespace()).current_dir(folder).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (output.status.code(), text(output.stdout), text(output.stderr))
}

#[test]
fn info_says_what_a_recording_is_and_what_is_missing() {
    let folder = folder("info");
    let states = write_recording(&folder.join("flight.mcap"));
    let (code, out, errors) = arena(&folder, "info flight.mcap --json");
    assert_eq!((code, errors.as_str()), (Some(0), ""));
    let info: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(info["scenario"], "double-flip");
    assert_eq!(info["segments"][0]["condition"], "sealed");
    assert_eq!(info["ending"]["reason"], "stopped");
    let topic = |name: &str| {
        let topics = info["topics"].as_array().unwrap();
        topics.iter().find(|topic| topic["topic"] == name).unwrap().clone()
    };
    let state = topic("vehicle/state");
    assert_eq!((&state["messages"], &state["missing"]), (&states.len().into(), &1.into()));
    assert_eq!(state["senders"][0]["name"], "estimator");
    assert!((state["rate_hz"].as_f64().unwrap() - 998.0 / 9.99).abs() < 1e-9, "{state}");
    assert_eq!(topic("arena/order")["messages"], 2);

    let mut bytes = std::fs::read(folder.join("flight.mcap")).unwrap();
    let torn = bytes.len() * 2 / 3;
    std::fs::write(folder.join("torn.mcap.part"), &bytes[..torn]).unwrap();
    let (code, out, _) = arena(&folder, "info torn.mcap.part");
    assert_eq!(code, Some(0));
    assert!(out.contains("torn after byte") && out.contains("not sealed"), "{out}");

    let chunks: Vec<usize> =
        bytes.windows(3).enumerate().filter(|(_, bytes)| *bytes == b"lz4").map(|(at, _)| at).collect();
    bytes[chunks[chunks.len() / 4] + 60] ^= 1;
    std::fs::write(folder.join("damaged.mcap"), &bytes).unwrap();
    let (code, out, _) = arena(&folder, "info damaged.mcap");
    assert_eq!(code, Some(1), "{out}");
    assert!(out.contains("DAMAGED") && out.contains("damaged.mcap"), "{out}");
}

#[test]
fn a_cut_is_a_recording_of_its_own_and_keeps_everything() {
    let folder = folder("cut");
    let states = write_recording(&folder.join("flight.mcap"));
    let (code, out, errors) = arena(&folder, "cut flight.mcap --from 5 --to 8 --output piece.mcap --json");
    assert_eq!(code, Some(0), "{errors}");
    let said: Value = serde_json::from_str(&out).unwrap();
    assert_eq!((&said["latched"], &said["messages"]), (&1.into(), &302.into()));
    let whole = Recording::open(&folder.join("flight.mcap")).unwrap();
    let piece = Recording::open(&folder.join("piece.mcap")).unwrap();
    assert_eq!(piece.about().unwrap().recording, whole.about().unwrap().recording);
    assert_eq!(piece.started_at(), whole.at_seconds(5.0));
    assert_eq!(piece.about().unwrap().started_wall_ns, 1_700_000_005_000_000_000);
    assert_eq!(piece.settings_text().unwrap(), whole.settings_text().unwrap());
    assert_eq!(piece.ending().unwrap().reason, "cut: 5.000 s to 8.000 s of flight.mcap");
    let (from, to) = (whole.at_seconds(5.0), whole.at_seconds(8.0));
    let mut expected: Vec<(u64, Time)> =
        states.iter().copied().filter(|(_, at)| *at >= from && *at <= to).collect();
    // The order of the third second still held.
    expected.insert(0, (300, whole.at_seconds(3.0)));
    let mut found = Vec::new();
    let mut messages = piece.messages(&Selection::all());
    while let Some(message) = messages.next() {
        let message = message.unwrap();
        let number = u64::from_le_bytes(message.body.try_into().unwrap());
        assert_eq!(u64::from(message.sequence), number);
        found.push((number, message.at));
    }
    assert_eq!(found, expected);
    let streams = |recording: &Recording| -> Vec<_> {
        recording.channels().iter().map(|channel| channel.stream.clone()).collect()
    };
    let mut kept = streams(&piece);
    kept.sort();
    let mut all = streams(&whole);
    all.sort();
    assert_eq!(kept, all);

    let (code, _, errors) = arena(&folder, "cut flight.mcap --from 5 --output piece.mcap");
    assert!(code == Some(2) && errors.contains("piece.mcap"), "{errors}");
    let (code, _, errors) = arena(&folder, "cut flight.mcap --from 5 --to 4");
    assert!(code == Some(2) && errors.contains('5') && errors.contains('4'), "{errors}");
    let (code, _, errors) = arena(&folder, "cut flight.mcap --topic no/such");
    assert!(code == Some(2) && errors.contains("no/such"), "{errors}");
}
