//! The client's side of NatNet: who the server is, what it tracks, and that it goes on.
//!
//! ```text
//!   unknown ── Connect ──▶ server info: version, clock ── ModelDefinition ──▶ names of ids
//!      ▲                                                        │ KeepAlive, once a second
//!      └── stream silent ◀── frames, decoded as that version ◀──┘
//! ```
//!
//! Requests are repeated until they are answered. A frame that says that the models have changed has the names
//! asked for again; meanwhile the old ones hold.

use std::collections::BTreeMap;

use device::natnet::{
    FLAG_MODELS_CHANGED, Frame, MESSAGE_FRAME, MESSAGE_MODEL_DEFINITION, MESSAGE_SERVER_INFO,
    ModelDefinition, NatNetError, Request, ServerInfo, UpAxis, Version, message_number,
};
use quantity::{Span, Time};
use settings::{NatNet, NatNetVersion};

use crate::sighting::{Exposure, Shown, Sighting};

/// How often a question is asked until it is answered.
const ASK_PERIOD: Span = Span::from_millis(500);
/// How often a server that knows us is told that we are still there.
const KEEP_ALIVE_PERIOD: Span = Span::from_secs(1);
/// A stream that was silent for longer may have forgotten us.
const FORGOTTEN_SPAN: Span = Span::from_secs(2);
/// No system takes longer from exposure to departure; a stamp that says so is wrong.
const LATENCY_MAX: Span = Span::from_millis(200);

/// A client of one server.
#[derive(Clone, Debug)]
pub(crate) struct Client {
    up: UpAxis,
    asked: Option<Version>,
    server: Option<Server>,
    names: BTreeMap<i32, Vec<u8>>,
    names_wanted: bool,
    frame_at: Time,
    next_at: Time,
}

/// Who the server is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Server {
    version: Version,
    clock_hz: u64,
}

/// What a datagram of the server's was.
#[derive(Debug)]
pub(crate) enum Heard {
    /// Poses.
    Exposure(Exposure),
    /// The server says who it is, for the first time or otherwise than before.
    Server(String),
    /// The server says what it tracks.
    Models(usize),
    /// An answer that changes nothing, or a message that is not for us.
    Nothing,
    /// Poses that cannot be read yet: the server has not said who it is.
    TooEarly,
}

impl Client {
    /// A client that knows nothing yet.
    pub(crate) fn new(settings: &NatNet, now: Time) -> Self {
        Self {
            up: match settings.up_axis {
                settings::UpAxis::Y => UpAxis::Y,
                settings::UpAxis::Z => UpAxis::Z,
            },
            asked: settings.version.map(version),
            server: None,
            names: BTreeMap::new(),
            names_wanted: true,
            frame_at: now,
            next_at: now,
        }
    }

    /// When to speak to the server next.
    pub(crate) const fn due_at(&self) -> Time {
        self.next_at
    }

    /// What to say to the server, if it is time.
    pub(crate) fn ask(&mut self, now: Time) -> Option<Request> {
        if now < self.next_at {
            return None;
        }
        let forgotten = now - self.frame_at > FORGOTTEN_SPAN;
        let connect = Request::Connect { natnet_version: self.asked.map(Version::to_bytes) };
        let (request, period) = match self.server {
            Some(_) if self.names_wanted => (Request::ModelDefinition, ASK_PERIOD),
            Some(_) if !forgotten => (Request::KeepAlive, KEEP_ALIVE_PERIOD),
            _ => (connect, ASK_PERIOD),
        };
        self.next_at = now.saturating_add(period);
        Some(request)
    }

    /// Takes a datagram of the server's.
    ///
    /// # Errors
    /// Bytes that are none of its messages.
    pub(crate) fn hear(&mut self, now: Time, bytes: &[u8]) -> Result<Heard, NatNetError> {
        match message_number(bytes) {
            Some(MESSAGE_FRAME) => self.hear_frame(now, bytes),
            Some(MESSAGE_SERVER_INFO) => self.hear_server(now, &ServerInfo::decode(bytes)?),
            Some(MESSAGE_MODEL_DEFINITION) => {
                let Some(server) = self.server else { return Ok(Heard::TooEarly) };
                let models = ModelDefinition::decode(server.version, bytes)?;
                self.names = models.rigid_bodies().map(|body| (body.id, body.name.to_vec())).collect();
                self.names_wanted = false;
                self.next_at = now.saturating_add(KEEP_ALIVE_PERIOD);
                Ok(Heard::Models(self.names.len()))
            }
            Some(_) => Ok(Heard::Nothing),
            None => Err(NatNetError::Truncated { bytes: bytes.len(), part: "header" }),
        }
    }

    fn hear_server(&mut self, now: Time, info: &ServerInfo<'_>) -> Result<Heard, NatNetError> {
        let spoken = match (self.asked, Version::from_bytes(info.natnet_version)) {
            (Some(asked), _) => asked,
            (None, Ok(spoken)) => spoken,
            (None, Err(unknown)) => {
                // A later server still lays its frames out as the last version known here, if it is asked to.
                self.asked = Some(Version::V4_1);
                self.next_at = now;
                return Err(unknown);
            }
        };
        // Whatever it said before: a server that has just been started says the same.
        self.names_wanted = true;
        self.next_at = now;
        self.frame_at = now;
        let server = Server { version: spoken, clock_hz: info.clock_hz };
        if self.server.replace(server) == Some(server) {
            return Ok(Heard::Nothing);
        }
        let [major, minor, ..] = info.program_version;
        let name = String::from_utf8_lossy(info.name);
        Ok(Heard::Server(format!("{name} {major}.{minor}, NatNet {spoken}, clock of {} Hz", info.clock_hz)))
    }

    fn hear_frame(&mut self, now: Time, bytes: &[u8]) -> Result<Heard, NatNetError> {
        let Some(server) = self.server else { return Ok(Heard::TooEarly) };
        let frame = Frame::decode(server.version, bytes)?;
        self.frame_at = now;
        if frame.head.flags & FLAG_MODELS_CHANGED != 0 && !self.names_wanted {
            self.names_wanted = true;
            self.next_at = now;
        }
        let sightings = frame.rigid_bodies().filter_map(|body| {
            // A body without a name is one of whose model we have not heard yet.
            let name = self.names.get(&body.id)?.clone();
            let shown = body.is_tracked().then_some(Shown::NatNet { body, up: self.up });
            Some(Sighting { name, shown })
        });
        let latency = frame.head.timing.latency(server.clock_hz).filter(|latency| *latency <= LATENCY_MAX);
        Ok(Heard::Exposure(Exposure { number: frame.head.number, latency, sightings: sightings.collect() }))
    }
}

const fn version(setting: NatNetVersion) -> Version {
    match setting {
        NatNetVersion::V3_0 => Version::V3_0,
        NatNetVersion::V3_1 => Version::V3_1,
        NatNetVersion::V4_0 => Version::V4_0,
        NatNetVersion::V4_1 => Version::V4_1,
    }
}
