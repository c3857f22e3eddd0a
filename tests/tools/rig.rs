//! A folder, a sender and what it says: of known values, on a topic of the table and on one that no table
//! knows.

use std::fs::{self, File, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use quantity::{Span, Time, Vector};
use recording::{About, Ending, WriteOptions, Writer};
use reflect::fnv1a_64;
use schemas::{Tracking, VehicleState, topics};
use serde_json::Value;
use service_core::{Observer, Publisher};
use service_shell::identity;
use wire::{Domain, Header, Kind, Role, Secret, SigningKey, TopicName};

use crate::common::{front_door, place};

pub const RUN: u64 = 0xab;
pub const SECRET: [u8; 32] = [7; 32];
/// Before the first message: recordings of a real arena do not begin at its clock's zero.
pub const BEGIN: Time = Time::from_nanos(50_000_000_000);
pub const PERIOD: Span = Span::from_millis(5);
pub const UNKNOWN: &str = "extra/unknown.topic";
const UNKNOWN_TYPE: &str = "extra/Thing";
const UNKNOWN_TEXT: &str = "# [unit V]\nfloat32 level_v\nstring[] names\n";

/// A folder of its own for one test, with a copy of the settings on ports of its own.
pub struct Place(pub PathBuf);

impl Place {
    pub fn new(name: &str, port_offset: u16) -> Self {
        let folder = place(&format!("tools-{name}"), port_offset);
        let secret = folder.join(".flyarena/secret");
        fs::create_dir_all(secret.parent().unwrap()).unwrap();
        fs::write(&secret, SECRET).unwrap();
        fs::set_permissions(&secret, Permissions::from_mode(0o600)).unwrap();
        Self(folder)
    }

    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(front_door());
        command.args(arguments).current_dir(&self.0).stdin(Stdio::null());
        command.env_remove("FLYARENA_SECRET_FILE").env_remove("RUST_LOG");
        command
    }

    pub fn run(&self, arguments: &[&str]) -> Said {
        Said::from(self.command(arguments).output().unwrap())
    }
}

#[derive(Debug)]
pub struct Said {
    pub code: Option<i32>,
    pub out: String,
    pub errors: String,
}

impl From<Output> for Said {
    fn from(output: Output) -> Self {
        let text = |bytes| String::from_utf8(bytes).unwrap();
        Self { code: output.status.code(), out: text(output.stdout), errors: text(output.stderr) }
    }
}

impl Said {
    /// Standard output of a command that succeeded and complained of nothing.
    pub fn fine(&self) -> &str {
        assert_eq!((self.code, self.errors.as_str()), (Some(0), ""), "{self:?}");
        &self.out
    }

    pub fn json_lines(&self) -> Vec<Value> {
        self.fine().lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }

    pub fn assert_refused(&self, words: &[&str]) {
        assert_eq!((self.code, self.out.as_str()), (Some(2), ""), "{self:?}");
        for word in words {
            assert!(self.errors.contains(word), "no {word} in {}", self.errors);
        }
    }
}

/// The state with that number; every float of it needs all its digits.
pub fn state(number: u64) -> VehicleState {
    let mut state = VehicleState {
        vehicle: if number.is_multiple_of(2) { 2 } else { 1 },
        tracking: if number < 10 { Tracking::Coasting } else { Tracking::Tracking },
        accepted_frames: number as u16,
        estimated_for: sent_at(number),
        ..VehicleState::default()
    };
    state.estimate.position_m = Vector::new(number as f64 / 3.0, -1e-7 / number as f64, 1e300);
    state
}

pub fn sent_at(number: u64) -> Time {
    BEGIN + PERIOD * number as i64
}

fn unknown_body(number: u64) -> Vec<u8> {
    let mut body = Vec::from((number as f32 * 0.1).to_le_bytes());
    body.extend([1, 0, 0, 0, 3, 0, 0, 0, b'o', b',', b'"']);
    body
}

/// Says messages, as datagrams.
pub struct Sender {
    publisher: Publisher,
    key: SigningKey,
    header: Header,
}

impl Sender {
    pub fn new() -> Self {
        let secret = Secret::new(SECRET);
        let identity = identity("estimator", Domain::Sim, RUN, 3);
        let schema_id = fnv1a_64(&[UNKNOWN_TYPE.as_bytes(), &[0], UNKNOWN_TEXT.as_bytes()]);
        let header = Header {
            kind: Kind::Data,
            domain: identity.domain,
            latched: false,
            source: identity.source,
            schema_id,
            run: RUN,
            incarnation: identity.incarnation,
            sequence: 0,
            published_at: BEGIN,
        };
        Self {
            publisher: Publisher::new("estimator", &secret, identity),
            key: SigningKey::derive(&secret, Domain::Sim, RUN, Role::NODE),
            header,
        }
    }

    /// The definitions.
    pub fn announce(&mut self, now: Time, send: &mut dyn FnMut(&[u8])) {
        self.publisher.announce(now, &[&topics::VEHICLE_STATE], &mut |published| send(published.datagram));
        self.header.sequence += 1;
        let body = [UNKNOWN_TYPE.as_bytes(), &[0], UNKNOWN_TEXT.as_bytes()].concat();
        self.seal(Header { kind: Kind::Schema, published_at: now, ..self.header }, &body, send);
    }

    /// The messages with that number, which is also their number on the bus if none is left out.
    pub fn say(&mut self, number: u64, now: Time, send: &mut dyn FnMut(&[u8])) {
        let sink = &mut |published: service_core::Published<'_>| send(published.datagram);
        self.publisher.publish(now, &topics::VEHICLE_STATE, &state(number), sink).unwrap();
        let header = Header { sequence: number, published_at: now, ..self.header };
        self.seal(header, &unknown_body(number), send);
    }

    fn seal(&self, header: Header, body: &[u8], send: &mut dyn FnMut(&[u8])) {
        let mut datagram = Vec::new();
        wire::seal(&header, TopicName::new(UNKNOWN).unwrap(), body, &self.key, &mut datagram).unwrap();
        send(&datagram);
    }
}

/// Writes a recording of the first `count` numbers, each message 0.25 ms late. Numbers that `drop` says yes
/// to are said, and never arrive.
pub fn record(path: &Path, count: u64, drop: impl Fn(u64) -> bool) {
    let about = About {
        recording: 1,
        segment: 0,
        run: RUN,
        domain: Domain::Sim,
        scenario: "hover".to_owned(),
        settings_digest: 0,
        started_at: BEGIN,
        started_wall_ns: 0,
        host: "a host".to_owned(),
        revision: String::new(),
    };
    let options = WriteOptions { chunk_bytes: 16 * 1024, ..WriteOptions::default() };
    let mut writer = Writer::new(File::create(path).unwrap(), options, &about, None).unwrap();
    let mut observer = Observer::new(&Secret::new(SECRET), Domain::Sim, RUN);
    let mut sender = Sender::new();
    let mut datagrams: Vec<Vec<u8>> = Vec::new();
    sender.announce(BEGIN, &mut |datagram| datagrams.push(datagram.to_vec()));
    for number in 1..=count {
        sender.say(number, sent_at(number), &mut |datagram| {
            if !drop(number) {
                datagrams.push(datagram.to_vec());
            }
        });
        for datagram in datagrams.drain(..) {
            let observed = observer.observe(&datagram).unwrap();
            let at = observed.header.published_at + Span::from_micros(250);
            writer.observe(at, &observed).unwrap();
        }
    }
    writer.finish(&Ending::default(), &[]).unwrap();
}
