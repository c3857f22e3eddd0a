//! Messages a second of 200 bytes, written to a file: our recordings beside a plain event log and raw
//! buffered writes, all in the same run.
//!
//! `cargo bench -p recording --bench write [-- MESSAGES]`

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

use quantity::{Span, Time};
use recording::{About, Compression, Ending, WriteOptions, Writer};
use service_core::Observed;
use wire::{Domain, Header, Kind, TopicName};

const BODY_BYTES: usize = 200;
const ROUNDS: usize = 5;

fn main() {
    let messages = std::env::args().find_map(|argument| argument.parse().ok()).unwrap_or(1_000_000_u64);
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("bench-write");
    fs::create_dir_all(&folder).expect("a folder for the files");
    let bodies: Vec<Vec<u8>> = (0..1024).map(body).collect();
    type Run = fn(&Path, u64, &[Vec<u8>]);
    let runs: [(&str, Run); 5] = [
        ("raw buffered", raw),
        ("event log", event_log),
        ("recording, none", |path, messages, bodies| recording(path, messages, bodies, Compression::None)),
        ("recording, lz4", |path, messages, bodies| recording(path, messages, bodies, Compression::Lz4)),
        ("recording, zstd", |path, messages, bodies| recording(path, messages, bodies, Compression::Zstd)),
    ];
    println!("{messages} messages of {BODY_BYTES} bytes, best and median of {ROUNDS} rounds");
    let mut rates: Vec<Vec<f64>> = vec![Vec::new(); runs.len()];
    let mut sizes = vec![0; runs.len()];
    // Round by round, so that whatever else the machine does meets all of them.
    for _ in 0..ROUNDS {
        for (index, (name, run)) in runs.iter().enumerate() {
            let path: PathBuf = folder.join(name.replace([' ', ','], "-"));
            let begin = Instant::now();
            run(&path, messages, &bodies);
            rates[index].push(messages as f64 / begin.elapsed().as_secs_f64());
            sizes[index] = fs::metadata(&path).map_or(0, |file| file.len());
            fs::remove_file(&path).expect("the file was just written");
        }
    }
    let median = |rates: &mut Vec<f64>| {
        rates.sort_by(f64::total_cmp);
        (rates[rates.len() - 1], rates[rates.len() / 2])
    };
    let (_, raw_median) = median(&mut rates[0]);
    for ((name, _), (rates, size)) in runs.iter().zip(rates.iter_mut().zip(sizes)) {
        let (best, middle) = median(rates);
        println!(
            "{name:16} {:6.2} M/s best {:6.2} M/s median {:5.2} of raw {:8.1} MB",
            best / 1e6,
            middle / 1e6,
            middle / raw_median,
            size as f64 / 1e6
        );
    }
}

/// Like a state: most of it changes little from one message to the next.
fn body(number: u64) -> Vec<u8> {
    let mut body = Vec::with_capacity(BODY_BYTES);
    for field in 0..(BODY_BYTES / 8) as u64 {
        let value = if field % 3 == 0 { number as f64 * 0.001 + field as f64 } else { field as f64 };
        body.extend_from_slice(&value.to_le_bytes());
    }
    body
}

fn raw(path: &Path, messages: u64, bodies: &[Vec<u8>]) {
    let mut file = BufWriter::with_capacity(256 * 1024, File::create(path).expect("a file"));
    for number in 0..messages {
        file.write_all(&bodies[number as usize % bodies.len()]).expect("a write");
    }
    file.flush().expect("the last write");
}

/// The layout of an LCM log: sync word, event number, time, channel and data with their lengths.
fn event_log(path: &Path, messages: u64, bodies: &[Vec<u8>]) {
    const CHANNEL: &[u8] = b"vehicle/state";
    let mut file = BufWriter::with_capacity(256 * 1024, File::create(path).expect("a file"));
    for number in 0..messages {
        let body = &bodies[number as usize % bodies.len()];
        let mut write = |bytes: &[u8]| file.write_all(bytes).expect("a write");
        write(&0xeda1_da01_u32.to_be_bytes());
        write(&number.to_be_bytes());
        write(&(number * 50).to_be_bytes());
        write(&(CHANNEL.len() as u32).to_be_bytes());
        write(&(body.len() as u32).to_be_bytes());
        write(CHANNEL);
        write(body);
    }
    file.flush().expect("the last write");
}

fn recording(path: &Path, messages: u64, bodies: &[Vec<u8>], compression: Compression) {
    let about = About {
        recording: 1,
        segment: 0,
        run: 7,
        domain: Domain::Sim,
        scenario: String::new(),
        settings_digest: 0,
        started_at: Time::ZERO,
        started_wall_ns: 0,
        host: String::new(),
        revision: String::new(),
    };
    let options = WriteOptions { compression, ..WriteOptions::default() };
    let mut writer =
        Writer::new(File::create(path).expect("a file"), options, &about, None).expect("a beginning");
    let topic = TopicName::new("vehicle/state").expect("a topic's name");
    for number in 0..messages {
        let at = Time::ZERO + Span::from_micros(50) * number as i64;
        let header = Header {
            kind: Kind::Data,
            domain: Domain::Sim,
            latched: false,
            source: 1 + (number % 20) as u32,
            schema_id: 4,
            run: 7,
            incarnation: 1,
            sequence: number,
            published_at: at,
        };
        let body = &bodies[number as usize % bodies.len()];
        let observed = Observed { header, topic, body, verified: true };
        writer.observe(at, &observed).expect("a message");
        if writer.chunk_due_at().is_some_and(|due| due <= at) {
            writer.close_chunk().expect("a chunk");
        }
    }
    writer.finish(&Ending::default(), &[]).expect("an end");
}
