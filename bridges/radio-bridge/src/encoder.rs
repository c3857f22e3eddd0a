//! The command link's encoder: channels into the bytes its vendor's box takes, and what the box says.

use device::vehicle_link::ChannelMap;
use device::{crsf, sbus};
use settings::{ChannelBits, CommandProtocol};

/// How a vehicle's command frames become bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Encoder {
    protocol: CommandProtocol,
    /// How frames lie on the channels.
    pub(crate) map: ChannelMap,
}

impl Encoder {
    /// As set.
    pub(crate) const fn new(settings: &settings::CommandLink) -> Self {
        let map = match settings.channel_bits {
            ChannelBits::Ten => ChannelMap::Compact,
            ChannelBits::Eleven => ChannelMap::Full,
        };
        Self { protocol: settings.protocol, map }
    }

    /// The bytes that have the encoder send these channels.
    pub(crate) fn bytes(self, channels: [u16; 16]) -> Vec<u8> {
        match self.protocol {
            CommandProtocol::Sbus => sbus::Frame::new(channels).encode().to_vec(),
            CommandProtocol::Crsf => {
                let mut bytes = [0; crsf::FRAME_BYTES_MAX];
                let frame = crsf::Frame::Channels(channels);
                let length = frame.encode(crsf::ADDRESS_MODULE, &mut bytes).expect("channels always fit");
                bytes[..length].to_vec()
            }
        }
    }
}

/// What comes back on the encoder's line: a CRSF module tells how its link fares.
#[derive(Clone, Debug)]
pub(crate) struct EncoderLine(crsf::Decoder);

impl EncoderLine {
    /// A line on which nothing came yet.
    pub(crate) const fn new() -> Self {
        Self(crsf::Decoder::new())
    }

    /// The shares of packets that the vehicle received, in percent, which these bytes tell; any portions do.
    pub(crate) fn qualities_percent(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut qualities = Vec::new();
        self.0.receive(bytes, |frame| {
            if let crsf::Frame::LinkStatistics(statistics) = frame {
                qualities.push(statistics.uplink_quality_percent);
            }
        });
        qualities
    }
}
