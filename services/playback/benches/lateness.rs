//! How late playback's messages are, beside a bare loop on the same absolute schedule, in one run.
//!
//! The bare loop sleeps until each instant and sends a datagram of the same length; it reads nothing, seals nothing and
//! waits asleep to the end, as `clock_nanosleep` on an absolute schedule does.

use std::net::UdpSocket;
use std::time::Duration;

use playback::{Kept, Lateness, Place, Plan, Playback, Rate, Tape};
use quantity::{Span, Time};
use recording::Stream;
use rustix::thread::clock_nanosleep_absolute;
use rustix::time::{ClockId, Timespec};
use schemas::topics;
use service_shell::clock;
use settings::{Arena, Endpoint, Network};
use wire::{Domain, Kind, Secret};

/// An arena of one vehicle says about so much.
const RATE_HZ: i64 = 1_000;
const SECONDS: i64 = 10;
const BODY_BYTES: usize = 200;

fn network() -> Network {
    let config = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
    let network = Arena::load(&config, "double-flip").expect("the shipped settings").network;
    let process = std::process::id().to_le_bytes();
    let group = std::net::Ipv4Addr::new(239, 194, process[0], process[1]);
    Network { replay: Endpoint { group, port: 23_900 }, ..network }
}

fn tape() -> Tape {
    let mut tape = Tape::default();
    let stream = Stream {
        topic: topics::VEHICLE_STATE.name.to_owned(),
        kind: Kind::Data,
        source: 1,
        incarnation: 1,
        domain: Domain::Live,
        run: 1,
        schema_id: topics::VEHICLE_STATE.schema_id(),
        latched: false,
        verified: true,
    };
    for index in 0..RATE_HZ * SECONDS {
        let at = Time::from_nanos(1_000_000_000_000 + index * 1_000_000_000 / RATE_HZ);
        let sequence = index as u32;
        tape.push(
            &stream,
            None,
            Kept { channel: 0, sequence, at, published_at: at, body: vec![7; BODY_BYTES] },
        );
    }
    tape
}

fn bare() -> (Lateness, Span) {
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let listener = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    socket.connect(listener.local_addr().expect("its address")).expect("a route");
    let begin = clock::now() + Span::from_millis(10);
    let (mut lateness, mut first, mut last) = (Lateness::default(), None, Span::ZERO);
    for index in 0..RATE_HZ * SECONDS {
        let due = begin + Span::from_nanos(index * 1_000_000_000 / RATE_HZ);
        let nanos = due.as_nanos();
        let at = Timespec { tv_sec: nanos / 1_000_000_000, tv_nsec: nanos % 1_000_000_000 };
        let _ = clock_nanosleep_absolute(ClockId::Monotonic, &at);
        let _ = socket.send(&[7; BODY_BYTES]);
        let late = clock::now() - due;
        lateness.note(late);
        last = late - *first.get_or_insert(late);
    }
    (lateness, last)
}

fn main() {
    let place = Place { network: network(), secret: Secret::new([1; 32]), run: 1, incarnation: 1 };
    let (bare, bare_drift) = bare();
    let plan = Plan { rate: Rate::REAL_TIME, ..Plan::default() };
    let summary = Playback::start(Box::new(tape()), place, plan)
        .and_then(Playback::join)
        .expect("what is in memory can be played");
    std::thread::sleep(Duration::from_millis(10));
    let ms = |span: Span| span.as_secs_f64() * 1e3;
    println!("{RATE_HZ} messages/s of {BODY_BYTES} bytes for {SECONDS} s");
    println!(
        "bare loop  median {:.4} ms, 99 % {:.4} ms, most {:.3} ms, drift {:+.4} ms",
        ms(bare.quantile(0.5)),
        ms(bare.quantile(0.99)),
        ms(bare.max()),
        ms(bare_drift)
    );
    println!(
        "playback   median {:.4} ms, 99 % {:.4} ms, most {:.3} ms, drift {:+.4} ms",
        ms(summary.lateness_median),
        ms(summary.lateness_p99),
        ms(summary.lateness_max),
        ms(summary.drift)
    );
    let ratio = summary.lateness_median.as_secs_f64() / bare.quantile(0.5).as_secs_f64().max(1e-9);
    println!("ratio of medians {ratio:.2}");
}
