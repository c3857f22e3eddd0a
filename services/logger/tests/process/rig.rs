//! A logger as a process on a bus of its own, and somebody who speaks on that bus.

use std::fs::{self, Permissions};
use std::net::Ipv4Addr;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use service_core::source_of;
use service_shell::{BusSender, clock};
use settings::Arena;
use wire::{Domain, Header, Kind, Role, Secret, SigningKey, TopicName};

/// The run of every rig.
pub const RUN: u64 = 0x5eed;
/// The secret of every rig.
pub const SECRET: [u8; 32] = [7; 32];
/// Only how long to wait before giving up.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// Settings, a secret and a folder.
pub struct Rig {
    pub folder: PathBuf,
    pub arena: Arena,
}

/// A logger that runs.
pub struct Logger {
    pub child: Child,
}

/// Somebody who speaks.
pub struct Speaker {
    bus: BusSender,
    key: SigningKey,
    node: SigningKey,
    header: Header,
    datagram: Vec<u8>,
}

impl Rig {
    /// A folder with settings whose bus no other test shares.
    pub fn new(name: &str, bus: u8) -> Self {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("logger-{name}"));
        let _ = fs::remove_dir_all(&folder);
        copy(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config"), &folder.join("config"));
        let network = folder.join("config/network.toml");
        let group = Ipv4Addr::new(239, 255, 72, bus).to_string();
        let port = (47_300 + u16::from(bus)).to_string();
        let text = fs::read_to_string(&network).unwrap();
        fs::write(&network, text.replace("239.255.71.2", &group).replace("47102", &port)).unwrap();
        let secret = folder.join("secret");
        fs::write(&secret, SECRET).unwrap();
        fs::set_permissions(&secret, Permissions::from_mode(0o600)).unwrap();
        let arena = Arena::load(&folder.join("config"), "double-flip").unwrap();
        Self { folder, arena }
    }

    /// The logger's command line with these arguments; it may fill the disk.
    pub fn arguments(&self, line: &str) -> Vec<String> {
        let run = format!("{RUN:x}");
        ["--config", "config", "--run", &run, "--secret-file", "secret", "--log", "warn", "--min-free", "0"]
            .into_iter()
            .chain(line.split_whitespace())
            .map(str::to_owned)
            .collect()
    }

    /// Starts a logger; it hears once this has returned.
    pub fn logger(&self, line: &str) -> Logger {
        let child = Command::new(env!("CARGO_BIN_EXE_logger"))
            .args(self.arguments(line))
            .current_dir(&self.folder)
            .stdin(Stdio::null())
            .spawn()
            .unwrap();
        Logger { child }
    }

    /// Waits until there is a file of that name.
    pub fn wait_for(&self, name: &str) -> PathBuf {
        let path = self.folder.join(name);
        let give_up = Instant::now() + PATIENCE;
        while !path.exists() {
            assert!(Instant::now() < give_up, "no {name} comes to be");
            std::thread::sleep(Duration::from_millis(5));
        }
        path
    }

    /// Somebody who speaks on a topic as the service that writes it.
    pub fn speaker(&self, role: &'static str, schema_id: u64) -> Speaker {
        let secret = Secret::new(SECRET);
        let header = Header {
            kind: Kind::Data,
            domain: Domain::Sim,
            latched: false,
            source: source_of(role),
            schema_id,
            run: RUN,
            incarnation: 1,
            sequence: 0,
            published_at: clock::now(),
        };
        Speaker {
            bus: BusSender::open(&self.arena.network, Domain::Sim).unwrap(),
            key: SigningKey::derive(&secret, Domain::Sim, RUN, Role(role)),
            node: SigningKey::derive(&secret, Domain::Sim, RUN, Role::NODE),
            header,
            datagram: Vec::new(),
        }
    }
}

impl Speaker {
    /// Skips so many numbers, as if the network had lost them.
    #[allow(dead_code, reason = "not everybody who has a rig loses something")]
    pub fn skip(&mut self, numbers: u64) {
        self.header.sequence += numbers;
    }

    /// Says something; no number is used up by what the kernel does not take.
    pub fn say(&mut self, topic: &str, body: &[u8]) {
        self.say_as(Kind::Data, topic, body);
    }

    /// Says something of any kind.
    pub fn say_as(&mut self, kind: Kind, topic: &str, body: &[u8]) {
        self.header.sequence += 1;
        self.header.published_at = clock::now();
        let header = Header { kind, ..self.header };
        let key = if kind == Kind::Data { &self.key } else { &self.node };
        wire::seal(&header, TopicName::new(topic).unwrap(), body, key, &mut self.datagram).unwrap();
        self.bus.send(&self.datagram);
        assert_eq!(self.bus.failed(), 0, "the kernel did not take a datagram");
    }
}

impl Logger {
    /// Sends a signal, by the name that `kill` knows.
    pub fn signal(&self, name: &str) {
        let id = self.child.id().to_string();
        assert!(Command::new("kill").args([&format!("-{name}"), &id]).status().unwrap().success());
    }

    /// Ends it as a supervisor does; whether it ended well.
    pub fn end(mut self) -> bool {
        self.signal("TERM");
        self.child.wait().unwrap().success()
    }
}

impl Drop for Logger {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy(&entry.path(), &target);
        } else {
            fs::copy(entry.path(), target).unwrap();
        }
    }
}
