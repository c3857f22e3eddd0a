//! What the simulated devices send, on its way to the bridges.

use quantity::Time;
use settings::Ports;

use crate::queue::DelayQueue;

/// A device that sends to a bridge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Device {
    /// The motion-capture system; each output is one datagram, to the vicon bridge.
    MotionCapture,
    /// The same, to the group it streams to.
    MotionCaptureGroup,
    /// The coordinator of the data link; outputs are pieces of its serial stream.
    DataLink,
    /// The command-link encoder of that vehicle, outputs being pieces of its serial stream; or the vehicle, where it is a
    /// Crazyflie, each output being a packet.
    CommandLink(u8),
}

impl Device {
    /// Its number among the endpoints of its bridge.
    #[must_use]
    pub const fn port(self) -> u16 {
        match self {
            Self::MotionCapture => Ports::MOTION_CAPTURE,
            Self::MotionCaptureGroup => Ports::MOTION_CAPTURE_GROUP,
            Self::DataLink => Ports::DATA_LINK,
            Self::CommandLink(vehicle) => Ports::command_link(vehicle),
        }
    }
}

/// Bytes from a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceOutput<'a> {
    /// Which.
    pub device: Device,
    /// When they leave it.
    pub at: Time,
    /// The bytes.
    pub bytes: &'a [u8],
}

/// Outputs in the order of their time; used buffers are kept for the next.
#[derive(Clone, Debug)]
pub(crate) struct Outputs {
    queue: DelayQueue<(Device, Vec<u8>)>,
    spare: Vec<Vec<u8>>,
}

impl Outputs {
    pub(crate) fn new() -> Self {
        Self { queue: DelayQueue::new(), spare: Vec::new() }
    }

    pub(crate) fn push(&mut self, device: Device, at: Time, bytes: &[u8]) {
        let mut buffer = self.spare.pop().unwrap_or_default();
        buffer.clear();
        buffer.extend_from_slice(bytes);
        self.queue.push(at, (device, buffer));
    }

    pub(crate) fn next_at(&self) -> Option<Time> {
        self.queue.next_at()
    }

    pub(crate) fn send(&mut self, now: Time, out: &mut impl FnMut(DeviceOutput<'_>)) {
        while let Some((at, (device, buffer))) = self.queue.pop_due(now) {
            out(DeviceOutput { device, at, bytes: &buffer });
            self.spare.push(buffer);
        }
    }
}
