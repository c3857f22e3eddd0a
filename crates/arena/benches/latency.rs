//! Ten vehicles live: from the cameras' datagram to the radio's frame, as the arena itself measures it, next to a bare
//! relay of as many datagrams by as many threads in the same run.
//!
//! `cargo bench -p arena --bench latency`; a little over a minute. `FLYARENA_BENCH_S` sets how long it listens.

use std::fs;
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use front_door::tools::budget::{Percentiles, percentiles};
use quantity::Span;

/// Vehicles of the scenario.
const VEHICLES: u64 = 10;
/// Frames a second.
const RATE_HZ: u64 = 200;
/// Bytes of a datagram: about those of a command with its header.
const BYTES: usize = 300;
/// How long the relay runs.
const RELAY_SECONDS: u64 = 5;
/// Long enough for ten vehicles to be in the air.
const TAKE_OFF: Duration = Duration::from_secs(25);
/// How long the arena is listened to, unless said otherwise.
const LISTEN_SECONDS: &str = "30";

fn main() -> ExitCode {
    // `cargo test` runs benches without this, to see that they build.
    if !std::env::args().any(|argument| argument == "--bench") {
        return ExitCode::SUCCESS;
    }
    let bare = relay();
    println!("bare relay, four hops: p50 {:.3} ms, p99 {:.3} ms", bare.p50_ms, bare.p99_ms);
    let Some(arena) = arena() else {
        eprintln!("the arena said nothing of its latency");
        return ExitCode::FAILURE;
    };
    for (name, key) in [("cameras' datagram to radio frame", "way"), ("slot lateness", "slot_lateness")] {
        let figure =
            |which| arena.get(key).and_then(|pair| pair.get(which)).and_then(serde_json::Value::as_f64);
        let (Some(p50), Some(p99)) = (figure("p50_ms"), figure("p99_ms")) else {
            eprintln!("no {name}");
            return ExitCode::FAILURE;
        };
        let (of_p50, of_p99) = (p50 / bare.p50_ms, p99 / bare.p99_ms);
        println!("{name}: p50 {p50:.3} ms ({of_p50:.1} of the relay's), p99 {p99:.3} ms ({of_p99:.1})");
    }
    ExitCode::SUCCESS
}

/// What the same traffic costs without anything done to it: a datagram 200 times a second, passed on, then by the next
/// thread ten times, each of which passes through one more.
fn relay() -> Percentiles {
    let socket = || UdpSocket::bind(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0)).expect("a socket on loopback");
    let sockets: Vec<UdpSocket> = (0..4).map(|_| socket()).collect();
    let addresses: Vec<_> = sockets.iter().map(|socket| socket.local_addr().expect("bound")).collect();
    let begun = Instant::now();
    let frames = RATE_HZ * RELAY_SECONDS;
    let mut ends = sockets.into_iter();
    let mut next = || ends.next().expect("four sockets");
    let (first, second, third, last) = (next(), next(), next(), next());
    for (from, to, times) in
        [(first, addresses[1], 1), (second, addresses[2], VEHICLES), (third, addresses[3], 1)]
    {
        thread::spawn(move || {
            let mut bytes = [0; BYTES];
            while from.recv(&mut bytes).is_ok() {
                for _ in 0..times {
                    let _ = from.send_to(&bytes, to);
                }
            }
        });
    }
    let sink = thread::spawn(move || {
        last.set_read_timeout(Some(Duration::from_secs(2))).expect("a timeout");
        let (mut spans, mut bytes) = (Vec::new(), [0; BYTES]);
        while spans.len() < (frames * VEHICLES) as usize && last.recv(&mut bytes).is_ok() {
            let sent = u64::from_le_bytes(bytes[..8].try_into().expect("eight bytes"));
            spans.push(Span::from_nanos(begun.elapsed().as_nanos() as i64 - sent as i64));
        }
        spans
    });
    let source = socket();
    for frame in 0..frames {
        let due = Duration::from_secs(1) * frame as u32 / RATE_HZ as u32;
        thread::sleep(due.saturating_sub(begun.elapsed()));
        let mut bytes = [0; BYTES];
        bytes[..8].copy_from_slice(&(begun.elapsed().as_nanos() as u64).to_le_bytes());
        source.send_to(&bytes, addresses[0]).expect("loopback takes it");
    }
    percentiles(&sink.join().expect("the sink")).expect("something arrived")
}

/// What `arena hz --budget` says of ten vehicles in hover.
fn arena() -> Option<serde_json::Value> {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("latency-bench");
    let _ = fs::remove_dir_all(&folder);
    copy(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config"), &folder.join("config"));
    let program = env!("CARGO_BIN_EXE_arena");
    let up = Command::new(program)
        .args(["up", "ten"])
        .current_dir(&folder)
        .stdout(Stdio::null())
        .spawn()
        .map(Up)
        .expect("the arena starts");
    thread::sleep(TAKE_OFF);
    let seconds = std::env::var("FLYARENA_BENCH_S").unwrap_or_else(|_| LISTEN_SECONDS.to_owned());
    let said = Command::new(program)
        .args(["hz", "--budget", "--json", "--scenario", "ten", "--duration", &seconds])
        .current_dir(&folder)
        .output()
        .expect("the budget is asked for");
    drop(up);
    serde_json::from_slice(&said.stdout).ok()
}

/// An arena that lands when this is dropped.
struct Up(Child);

impl Drop for Up {
    fn drop(&mut self) {
        let id = i32::try_from(self.0.id()).ok().and_then(rustix::process::Pid::from_raw);
        if let Some(id) = id {
            let _ = rustix::process::kill_process(id, rustix::process::Signal::INT);
        }
        let _ = self.0.wait();
    }
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("a folder can be made");
    for entry in fs::read_dir(from).expect("the settings").flatten() {
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy(&entry.path(), &target);
        } else {
            fs::copy(entry.path(), target).expect("a file can be copied");
        }
    }
}
