//! How fast a long recording is read, beside a plain sequential read of the same file in the same run.
//!
//! `cargo bench -p recording --bench read [-- --bytes 1000000000] [--rounds 5]`. The file is made once, in
//! the target folder, with the mix of topics of an arena with four vehicles: some 2 400 messages a second, a
//! chunk each 100 ms.

#![allow(clippy::unwrap_used, reason = "a benchmark that cannot go on says so by panicking")]

use std::fs::File;
use std::hint::black_box;
use std::io::{BufWriter, Read as _, Write};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use quantity::{Span, Time};
use recording::{About, Definition, Ending, Entry, Message, Recording, Selection, WriteOptions, Writer};
use wire::{Domain, Header, Kind};

/// Topic, senders, messages a second of each sender, bytes of a body.
const TOPICS: [(&str, u32, u32, usize); 12] = [
    ("vicon/rx", 1, 200, 610),
    ("mocap/frame", 1, 200, 420),
    ("vehicle/state", 1, 800, 190),
    ("vehicle/command", 1, 800, 72),
    ("vehicle/command-sent", 1, 50, 88),
    ("radio/tx", 1, 100, 60),
    ("radio/rx", 1, 100, 60),
    ("vehicle/telemetry", 1, 50, 96),
    ("node/journal", 6, 10, 1100),
    ("node/health", 8, 2, 120),
    ("maneuver/status", 1, 20, 80),
    ("plotter/point", 1, 10, 40),
];
/// What is taken out: 200 000 points or so in the full file.
const FIELD_TOPIC: &str = "vicon/rx";
const SEEKS: usize = 20;

fn main() {
    let argument = |name: &str, default: u64| {
        let mut arguments = std::env::args().skip_while(|argument| argument != name).skip(1);
        arguments.next().map_or(default, |value| value.parse().expect("a number"))
    };
    let (bytes, rounds) = (argument("--bytes", 1_000_000_000), argument("--rounds", 5) as usize);
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("read-{bytes}.mcap"));
    if !path.exists() {
        eprintln!("making {} …", path.display());
        let part = path.with_extension("making");
        make(&part, bytes);
        std::fs::rename(&part, &path).unwrap();
    }
    let length = std::fs::metadata(&path).unwrap().len();
    let recording = Recording::open(&path).unwrap();
    println!(
        "{} bytes, {} messages, {} chunks, {} cores",
        length,
        recording.message_count(),
        recording.segments()[0].chunks,
        std::thread::available_parallelism().unwrap(),
    );
    let plain = best(rounds, || plain_read(&path));
    report("plain sequential read", plain, plain, "");
    let mut seeks: Vec<Took> = (0..SEEKS).map(|seek| timed(|| seek_to(&path, seek)).0).collect();
    seeks.sort_unstable();
    report("open and first message at T, median", seeks[SEEKS / 2], plain, "");
    report("open and first message at T, slowest", seeks[SEEKS - 1], plain, "");
    let (field, points) = best_with(rounds, || one_field(&path));
    report("one field of one topic", field, plain, &format!("{points} points"));
    let (csv, points) = best_with(rounds, || csv_of(&path));
    report("the same, as CSV", csv, plain, &format!("{points} lines"));
    let (all, messages) = best_with(rounds, || all_messages(&path));
    report("all messages in order", all, plain, &format!("{messages} messages"));
    let (gaps, messages) =
        best_with(rounds, || Recording::open(&path).unwrap().gaps(&Selection::all(), |_| ()).messages);
    report("all checksums and numbers, all cores", gaps, plain, &format!("{messages} messages"));
}

/// How long something took: by the clock, and in time of all cores together, which other programs disturb
/// less.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Took {
    wall: Duration,
    cpu: Duration,
}

fn report(what: &str, took: Took, plain: Took, note: &str) {
    let ratio = |of: Duration, to: Duration| of.as_secs_f64() / to.as_secs_f64();
    println!(
        "{what:<38} {:>9.2} ms, {:>9.2} ms of cores; {:>6.3} and {:>6.3} of the plain read; {note}",
        took.wall.as_secs_f64() * 1e3,
        took.cpu.as_secs_f64() * 1e3,
        ratio(took.wall, plain.wall),
        ratio(took.cpu, plain.cpu),
    );
}

fn cpu() -> Duration {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    Duration::new(time.tv_sec as u64, time.tv_nsec as u32)
}

fn timed<T>(work: impl FnOnce() -> T) -> (Took, T) {
    let (started, cpu_before) = (Instant::now(), cpu());
    let done = black_box(work());
    (Took { wall: started.elapsed(), cpu: cpu() - cpu_before }, done)
}

fn best_with<T>(rounds: usize, work: impl Fn() -> T) -> (Took, T) {
    let runs = (0..rounds.max(1)).map(|_| timed(&work));
    runs.min_by_key(|(took, _)| *took).expect("at least one round")
}

fn best<T>(rounds: usize, work: impl Fn() -> T) -> Took {
    best_with(rounds, work).0
}

fn plain_read(path: &PathBuf) -> u64 {
    let mut file = File::open(path).unwrap();
    let mut buffer = vec![0; 1 << 20];
    let mut sum = 0;
    loop {
        match file.read(&mut buffer).unwrap() {
            0 => return sum,
            read => sum += read as u64,
        }
    }
}

fn seek_to(path: &Path, seek: usize) -> Time {
    let recording = Recording::open(path).unwrap();
    let (first, last) = recording.time_range().unwrap();
    let share = (seek as i64 * 7919 % SEEKS as i64) * (last - first).as_nanos() / SEEKS as i64;
    let mut messages = recording.messages(&Selection::all().from(first + Span::from_nanos(share)));
    messages.next().unwrap().unwrap().at
}

fn field(message: &Message<'_>) -> (i64, f64) {
    let bytes = message.body[16..24].try_into().unwrap();
    (message.at.as_nanos(), f64::from_le_bytes(bytes))
}

fn one_field(path: &Path) -> usize {
    let recording = Recording::open(path).unwrap();
    let mut points = Vec::new();
    recording.visit(
        &Selection::topic(FIELD_TOPIC),
        Vec::new,
        |rows, message| rows.push(field(&message)),
        |rows| {
            points.extend(rows.unwrap());
            ControlFlow::Continue(())
        },
    );
    points.len()
}

fn csv_of(path: &Path) -> usize {
    let recording = Recording::open(path).unwrap();
    let mut out = BufWriter::new(File::create(path.with_extension("csv")).unwrap());
    let mut lines = 0;
    recording.visit(
        &Selection::topic(FIELD_TOPIC),
        || (Vec::new(), 0),
        |(text, lines), message| {
            let (at, value) = field(&message);
            writeln!(text, "{:.9},{value}", at as f64 * 1e-9).unwrap();
            *lines += 1;
        },
        |rows| {
            let (text, count) = rows.unwrap();
            out.write_all(&text).unwrap();
            lines += count;
            ControlFlow::Continue(())
        },
    );
    lines
}

fn all_messages(path: &Path) -> u64 {
    let recording = Recording::open(path).unwrap();
    let mut messages = recording.messages(&Selection::all());
    let mut count = 0;
    while let Some(message) = messages.next() {
        black_box(message.unwrap().body);
        count += 1;
    }
    count
}

/// A recording of this length at least.
fn make(path: &Path, bytes: u64) {
    let started_at = Time::from_nanos(1_000_000_000);
    let about = About {
        recording: 1,
        segment: 0,
        run: 2,
        domain: Domain::Sim,
        scenario: "benchmark".to_owned(),
        settings_digest: 0,
        started_at,
        started_wall_ns: 0,
        host: String::new(),
        revision: String::new(),
    };
    let sink = Counted { file: File::create(path).unwrap(), bytes: 0 };
    let mut writer = Writer::new(sink, WriteOptions::default(), &about, None).unwrap();
    let text = "uint8[] data\n".to_owned();
    let id = reflect::fnv1a_64(&[b"flyarena/Blob\0", text.as_bytes()]);
    writer.define(&Definition { id, name: "flyarena/Blob".to_owned(), text }).unwrap();
    let mut due: Vec<(Time, usize, u32, u64)> = Vec::new();
    for (topic, (_, senders, ..)) in TOPICS.iter().enumerate() {
        let first = |source| (started_at + Span::from_micros(37 * i64::from(source)), topic, source, 0);
        due.extend((0..*senders).map(first));
    }
    let mut random = 1_u64;
    while writer.sink().bytes < bytes {
        let next = due.iter_mut().min_by_key(|(at, ..)| *at).unwrap();
        let (name, _, rate, length) = TOPICS[next.1];
        let body = body(next.3, length, &mut random);
        let header = Header {
            kind: Kind::Data,
            domain: Domain::Sim,
            latched: false,
            source: next.2 + 100 * next.1 as u32,
            schema_id: id,
            run: 2,
            incarnation: 1,
            sequence: next.3,
            published_at: next.0,
        };
        if writer.chunk_due_at().is_some_and(|at| next.0 >= at) {
            writer.close_chunk().unwrap();
        }
        let entry = Entry { at: next.0, header: &header, topic: name, verified: true, body: &body };
        writer.write(&entry).unwrap();
        next.0 += Span::from_nanos(1_000_000_000 / i64::from(rate));
        next.3 += 1;
    }
    writer.finish(&Ending::default(), &[]).unwrap();
}

/// Floats as a flight has them: the upper bytes alike from message to message, the lower ones noise.
fn body(number: u64, length: usize, random: &mut u64) -> Vec<u8> {
    let mut body = Vec::with_capacity(length + 8);
    while body.len() < length {
        *random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let noise = (*random >> 40) as f64 * 1e-9;
        let value = quantity::math::sin(number as f64 * 1e-3 + body.len() as f64) + noise;
        body.extend((value as f32).to_le_bytes());
        body.extend([0; 4]);
    }
    body.truncate(length);
    body
}

struct Counted {
    file: File,
    bytes: u64,
}

impl Write for Counted {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.flush()
    }
}
