//! The motion-capture system as OptiTrack's: a server that is asked, and streams what it sees.

use device::natnet::{
    FrameHead, PARAM_TRACKED, Request, RigidBody, RigidBodyName, ServerInfo, Timing, UpAxis, Version,
    encode_frame, encode_model_definition,
};
use device::vicon::euler_to_rotation;
use quantity::{Span, Time, Vector};
use settings::{NatNet, NatNetVersion};

use crate::cameras::Shown;
use crate::output::{Device, Outputs};
use crate::random::Stream;

/// Ticks of the server's clock in a second, as of a common motherboard's.
const CLOCK_HZ: u64 = 10_000_000;
const NANOS_PER_TICK: i64 = 100;
/// Motive 3.1 with its NatNet.
const PROGRAM_VERSION: [u8; 4] = [3, 1, 0, 0];
/// A client that is not heard of for longer is forgotten.
const CLIENT_SPAN: Span = Span::from_secs(10);
/// From a request to its answer.
const ANSWER_SPAN: Span = Span::from_micros(300);
/// From the exposure to when the server has the cameras' data; the rest of the latency is its own work.
const CAMERA_SPAN: Span = Span::from_millis(3);
/// A body of the largest fleet takes 38 bytes of a frame, and less than 90 of the description.
const MESSAGE_BYTES_MAX: usize = 32_768;

/// The server.
#[derive(Clone, Debug)]
pub(crate) struct Server {
    version: Version,
    up: UpAxis,
    group: Option<([u8; 4], u16)>,
    /// Ticks of its clock at the arena's zero.
    clock_offset: u64,
    client_until: Time,
    names: Vec<Vec<u8>>,
    buffer: Vec<u8>,
}

impl Server {
    /// A server that tracks bodies of these names, their streaming ids counted from one.
    pub(crate) fn new(settings: &NatNet, names: Vec<Vec<u8>>, stream: &mut Stream) -> Self {
        Self {
            version: settings.version.map_or(Version::V4_1, version),
            up: match settings.up_axis {
                settings::UpAxis::Y => UpAxis::Y,
                settings::UpAxis::Z => UpAxis::Z,
            },
            group: settings.group.map(|group| (group.ip().octets(), group.port())),
            clock_offset: u64::from(stream.below(u32::MAX)) << 8,
            client_until: Time::ZERO,
            names,
            buffer: vec![0; MESSAGE_BYTES_MAX],
        }
    }

    /// A request of a client.
    pub(crate) fn receive(&mut self, now: Time, bytes: &[u8], outputs: &mut Outputs) {
        let Ok(request) = Request::decode(bytes) else { return };
        match request {
            Request::Connect { natnet_version } => {
                // Whoever streams to a group cannot please each of its clients.
                let asked = natnet_version.and_then(|bytes| Version::from_bytes(bytes).ok());
                if let Some(asked) = asked.filter(|_| self.group.is_none()) {
                    self.version = asked;
                }
                self.answer(now, outputs, |server, out| server.info().encode(out));
            }
            Request::ModelDefinition => self.answer(now, outputs, |server, out| {
                let bodies: Vec<_> =
                    server.names.iter().zip(1..).map(|(name, id)| RigidBodyName { id, name }).collect();
                encode_model_definition(server.version, &bodies, out)
            }),
            Request::KeepAlive => {}
            Request::Disconnect => self.client_until = now,
        }
        if request != Request::Disconnect {
            self.client_until = now.saturating_add(CLIENT_SPAN);
        }
    }

    fn answer<E>(
        &mut self,
        now: Time,
        outputs: &mut Outputs,
        write: impl FnOnce(&Self, &mut [u8]) -> Result<usize, E>,
    ) {
        let mut buffer = core::mem::take(&mut self.buffer);
        if let Ok(length) = write(self, &mut buffer) {
            outputs.push(Device::MotionCapture, now.saturating_add(ANSWER_SPAN), &buffer[..length]);
        }
        self.buffer = buffer;
    }

    fn info(&self) -> ServerInfo<'static> {
        let (group, data_port) = self.group.unwrap_or(([0; 4], device::natnet::DATA_PORT));
        ServerInfo {
            name: b"flyarena simulator",
            program_version: PROGRAM_VERSION,
            natnet_version: self.version.to_bytes(),
            clock_hz: CLOCK_HZ,
            data_port,
            multicast: self.group.is_some(),
            group,
        }
    }

    /// Streams an exposure: `shown` has each body, in the order of their names, and whether it was tracked.
    pub(crate) fn stream(
        &mut self,
        number: u32,
        exposed_at: Time,
        sent_at: Time,
        shown: impl Iterator<Item = (Shown, bool)>,
        outputs: &mut Outputs,
    ) {
        let device = match self.group {
            Some(_) => Device::MotionCaptureGroup,
            None if exposed_at <= self.client_until => Device::MotionCapture,
            None => return,
        };
        let bodies: Vec<_> =
            shown.zip(1..).map(|((shown, tracked), id)| self.body(id, shown, tracked)).collect();
        let timing = Timing {
            timestamp_s: exposed_at.as_nanos() as f64 * 1e-9,
            exposed_ticks: self.ticks(exposed_at),
            received_ticks: self.ticks(sent_at.min(exposed_at.saturating_add(CAMERA_SPAN))),
            transmitted_ticks: self.ticks(sent_at),
            ..Timing::default()
        };
        let head = FrameHead { number, timing, flags: 0 };
        if let Ok(length) = encode_frame(self.version, &head, &bodies, &mut self.buffer) {
            outputs.push(device, sent_at, &self.buffer[..length]);
        }
    }

    fn body(&self, id: i32, (translation_mm, rotation_rad): Shown, tracked: bool) -> RigidBody {
        let [x, y, z] = translation_mm;
        let orientation = euler_to_rotation(rotation_rad).unwrap_or(quantity::Rotation::IDENTITY);
        RigidBody {
            id,
            position_m: self.up.streamed_position(Vector::new(x, y, z) * 1e-3),
            orientation_xyzw: self.up.streamed_orientation(orientation),
            marker_error_m: 0.0003,
            params: if tracked { PARAM_TRACKED } else { 0 },
        }
    }

    fn ticks(&self, at: Time) -> u64 {
        self.clock_offset.wrapping_add((at.as_nanos() / NANOS_PER_TICK).cast_unsigned())
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
