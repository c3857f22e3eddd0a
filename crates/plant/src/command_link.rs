//! The command link of one vehicle: an encoder fed with SBUS or CRSF bytes, sixteen channels through the air, a
//! receiver.
//!
//! A CRSF module answers: every tenth frame of channels with how its link fares. One whose air carries ten bits
//! leaves of the channels what ExpressLRS does (see [`device::vehicle_link::ChannelMap::Compact`]).

use device::crsf;
use device::sbus::{FRAME_BYTES, Frame, FrameFinder};
use quantity::{Span, Time};
use settings::{ChannelBits, CommandProtocol, LinkSettings};

use crate::faults::{Fault, Schedule};
use crate::output::{Device, Outputs};
use crate::queue::DelayQueue;
use crate::random::{Purpose, Stream};

/// A silence on the encoder's serial line by which a frame must be over: frames last 3 ms.
const LINE_SILENCE: Span = Span::from_millis(5);

/// Frames under way at most; a faster sender's are lost.
const UNDER_WAY_MAX: usize = 64;

/// Frames of channels to one of link statistics.
const STATISTICS_EVERY: u64 = 10;
/// Frames over which a module reckons the quality of its link.
const QUALITY_FRAMES: u32 = 100;
/// What ExpressLRS makes of a channel of two states, and where they part.
const TWO_STATES: [u16; 2] = [172, 1811];
const MIDDLE: u16 = 992;

/// What has become of a link's frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkCounts {
    /// Handed to the transmitter.
    pub sent: u64,
    /// Lost in the air.
    pub lost: u64,
    /// Arrived with flipped bits.
    pub corrupted: u64,
    /// Handed to the receiver, corrupted ones included.
    pub delivered: u64,
}

/// One vehicle's command link.
#[derive(Clone, Debug)]
pub struct CommandLink {
    vehicle: u8,
    settings: LinkSettings,
    encoder: Encoder,
    channel_bits: ChannelBits,
    /// One bit for each of the last frames, set where it was lost.
    lost: u128,
    fed_at: Time,
    stream: Stream,
    air: DelayQueue<[u8; FRAME_BYTES]>,
    last_due: Time,
    counts: LinkCounts,
}

/// What finds frames of channels on the encoder's line.
#[derive(Clone, Debug)]
enum Encoder {
    Sbus(FrameFinder),
    Crsf(crsf::Decoder),
}

impl Encoder {
    /// The line was silent: what has not come will not.
    fn gap(&mut self) {
        match self {
            Self::Sbus(finder) => finder.gap(),
            // A frame may end just before the silence, behind a false start.
            Self::Crsf(decoder) => decoder.gap(|_| {}),
        }
    }

    /// The channels of each frame that these bytes complete.
    fn feed(&mut self, bytes: &[u8]) -> Vec<Frame> {
        let mut found = Vec::new();
        match self {
            Self::Sbus(finder) => found.extend(bytes.iter().filter_map(|byte| finder.push(*byte))),
            Self::Crsf(decoder) => decoder.receive(bytes, |frame| {
                if let crsf::Frame::Channels(channels) = frame {
                    found.push(Frame::new(channels));
                }
            }),
        }
        found
    }
}

impl CommandLink {
    /// The link of a vehicle.
    #[must_use]
    pub fn new(vehicle: u8, encoder: &settings::CommandLink, settings: &LinkSettings, seed: u64) -> Self {
        Self {
            vehicle,
            settings: settings.clone(),
            encoder: match encoder.protocol {
                CommandProtocol::Sbus => Encoder::Sbus(FrameFinder::new()),
                CommandProtocol::Crsf => Encoder::Crsf(crsf::Decoder::new()),
            },
            channel_bits: encoder.channel_bits,
            lost: 0,
            fed_at: Time::ZERO,
            stream: Stream::new(seed, Purpose::CommandLink, vehicle),
            air: DelayQueue::new(),
            last_due: Time::ZERO,
            counts: LinkCounts::default(),
        }
    }

    /// What has become of its frames.
    #[must_use]
    pub fn counts(&self) -> LinkCounts {
        self.counts
    }

    /// Bytes for the encoder, any number; each frame they complete goes on the air.
    pub(crate) fn feed(&mut self, now: Time, bytes: &[u8], faults: &Schedule, outputs: &mut Outputs) {
        if now - self.fed_at > LINE_SILENCE {
            self.encoder.gap();
        }
        self.fed_at = now;
        for mut frame in self.encoder.feed(bytes) {
            if self.channel_bits == ChannelBits::Ten {
                frame.channels = over_the_air(&frame.channels);
            }
            self.transmit(now, frame.encode(), faults);
            self.report(now, outputs);
        }
    }

    /// What a CRSF module says of its link now and then.
    fn report(&self, now: Time, outputs: &mut Outputs) {
        if matches!(self.encoder, Encoder::Sbus(_)) || !self.counts.sent.is_multiple_of(STATISTICS_EVERY) {
            return;
        }
        let heard = QUALITY_FRAMES - (self.lost & ((1 << QUALITY_FRAMES) - 1)).count_ones();
        let statistics = crsf::LinkStatistics {
            uplink_rssi_1: 40,
            uplink_rssi_2: 43,
            uplink_quality_percent: heard as u8,
            uplink_snr_db: 11,
            downlink_rssi: 45,
            downlink_quality_percent: 100,
            downlink_snr_db: 10,
            ..crsf::LinkStatistics::default()
        };
        let mut bytes = [0; crsf::FRAME_BYTES_MAX];
        if let Ok(length) = crsf::Frame::LinkStatistics(statistics).encode(crsf::ADDRESS_HANDSET, &mut bytes)
        {
            outputs.push(Device::CommandLink(self.vehicle), now, &bytes[..length]);
        }
    }

    fn transmit(&mut self, now: Time, mut bytes: [u8; FRAME_BYTES], faults: &Schedule) {
        let mut chances = self.settings.clone();
        let mut extra = Span::ZERO;
        for fault in faults.at(now) {
            match fault {
                Fault::CommandLoss { vehicle, loss_ratio } if vehicle == self.vehicle => {
                    chances.loss_ratio = chances.loss_ratio.max(loss_ratio);
                }
                Fault::CommandCorruption { vehicle, corruption_ratio } if vehicle == self.vehicle => {
                    chances.corruption_ratio = chances.corruption_ratio.max(corruption_ratio);
                }
                Fault::CommandDelay { vehicle, delay } if vehicle == self.vehicle => extra = delay,
                _ => {}
            }
        }
        self.counts.sent += 1;
        let delay_s = chances.delay_s + self.stream.exponential(chances.jitter_s);
        let lost = self.stream.chance(chances.loss_ratio);
        let corrupted = self.stream.chance(chances.corruption_ratio);
        if corrupted {
            flip_bits(&mut self.stream, &mut bytes);
        }
        let lost = lost || self.air.len() >= UNDER_WAY_MAX;
        self.lost = self.lost << 1 | u128::from(lost);
        if lost {
            self.counts.lost += 1;
            return;
        }
        self.counts.corrupted += u64::from(corrupted);
        // Frames follow each other: none overtakes.
        self.last_due = self.last_due.max(now + extra + Span::from_secs_f64(delay_s));
        self.air.push(self.last_due, bytes);
    }

    /// When the next frame arrives.
    #[must_use]
    pub fn next_at(&self) -> Option<Time> {
        self.air.next_at()
    }

    /// The next frame that has arrived by `now`, with its time; `None` inside for one that the receiver does
    /// not recognise.
    pub fn arrived(&mut self, now: Time) -> Option<(Time, Option<Frame>)> {
        let (at, bytes) = self.air.pop_due(now)?;
        self.counts.delivered += 1;
        Some((at, Frame::decode(&bytes).ok()))
    }
}

/// What ExpressLRS leaves of channels in its mode "8ch": ten bits of eight, one of a ninth.
fn over_the_air(sent: &[u16; 16]) -> [u16; 16] {
    core::array::from_fn(|channel| match channel {
        4 => TWO_STATES[usize::from(sent[4] > MIDDLE)],
        0..=8 => sent[channel] & !1,
        _ => 0,
    })
}

/// Flips one to eight bits anywhere.
pub(crate) fn flip_bits(stream: &mut Stream, bytes: &mut [u8]) {
    let bits = bytes.len() as u32 * 8;
    for _ in 0..=stream.below(8) {
        let bit = stream.below(bits) as usize;
        if let Some(byte) = bytes.get_mut(bit / 8) {
            *byte ^= 1 << (bit % 8);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::member;

    fn link(change: impl FnOnce(&mut LinkSettings)) -> CommandLink {
        let mut settings = member().vehicle.plant.command_link;
        change(&mut settings);
        link_of(CommandProtocol::Sbus, ChannelBits::Eleven, &settings)
    }

    fn link_of(protocol: CommandProtocol, channel_bits: ChannelBits, settings: &LinkSettings) -> CommandLink {
        let shipped = crate::testing::fleet().network.devices.command_link;
        CommandLink::new(1, &settings::CommandLink { protocol, channel_bits, ..shipped }, settings, 11)
    }

    fn feed(link: &mut CommandLink, now: Time, bytes: &[u8], faults: &Schedule) {
        link.feed(now, bytes, faults, &mut Outputs::new());
    }

    fn frame(n: u16) -> Frame {
        Frame::new(core::array::from_fn(|i| n.wrapping_mul(37).wrapping_add(i as u16 * 101) & 0x7FF))
    }

    fn slot(n: i64) -> Time {
        Time::ZERO + Span::from_millis(20) * n
    }

    #[test]
    fn frames_come_through_in_order_after_their_delay() {
        let mut link = link(|settings| {
            settings.loss_ratio = 0.0;
            settings.corruption_ratio = 0.0;
            settings.jitter_s = 0.03;
        });
        let mut received = Vec::new();
        for n in 0..500 {
            feed(&mut link, slot(n), &frame(n as u16).encode(), &Schedule::default());
            while let Some((at, arrived)) = link.arrived(slot(n)) {
                received.push((at, arrived.unwrap()));
            }
        }
        while let Some((at, arrived)) = link.arrived(Time::FAR_FUTURE) {
            received.push((at, arrived.unwrap()));
        }
        assert_eq!(received.len(), 500);
        for (n, (at, arrived)) in received.iter().enumerate() {
            assert_eq!(*arrived, frame(n as u16));
            assert!(*at - slot(n as i64) >= Span::from_millis(18));
        }
        assert!(received.is_sorted_by_key(|(at, _)| *at));
    }

    #[test]
    fn loss_and_corruption_have_their_rates() {
        let mut link = link(|settings| {
            settings.loss_ratio = 0.1;
            settings.corruption_ratio = 0.2;
        });
        let n = 20_000;
        let mut wrong = 0;
        for k in 0..n {
            feed(&mut link, slot(k), &frame(k as u16).encode(), &Schedule::default());
            while let Some((_, arrived)) = link.arrived(Time::FAR_FUTURE) {
                wrong += u64::from(arrived != Some(frame(k as u16)));
            }
        }
        let counts = link.counts();
        assert_eq!(counts.sent, n as u64);
        assert_eq!(counts.delivered + counts.lost, counts.sent);
        // Standard deviations: 42 of 2000 and 54 of 3600. Of the corrupted a few flip a bit back.
        assert!(counts.lost.abs_diff(2_000) < 170, "{counts:?}");
        assert!(counts.corrupted.abs_diff(3_600) < 220, "{counts:?}");
        assert!(wrong <= counts.corrupted && wrong > counts.corrupted * 9 / 10, "{wrong} of {counts:?}");
    }

    #[test]
    fn a_silent_link_delivers_nothing_and_recovers() {
        let mut link = link(|settings| settings.loss_ratio = 0.0);
        let mut faults = Schedule::default();
        faults.add(Fault::CommandLoss { vehicle: 1, loss_ratio: 1.0 }, slot(10), slot(20));
        faults.add(Fault::CommandLoss { vehicle: 2, loss_ratio: 1.0 }, slot(0), slot(30));
        for k in 0..30 {
            feed(&mut link, slot(k), &frame(1).encode(), &faults);
        }
        assert_eq!(link.counts().lost, 10);
    }

    #[test]
    fn half_a_frame_does_not_spoil_the_next() {
        let mut link = link(|settings| {
            settings.loss_ratio = 0.0;
            settings.corruption_ratio = 0.0;
        });
        let bytes = frame(7).encode();
        feed(&mut link, slot(0), &bytes[..13], &Schedule::default());
        feed(&mut link, slot(1), &bytes[..9], &Schedule::default());
        feed(&mut link, slot(1) + Span::from_millis(1), &bytes[9..], &Schedule::default());
        assert_eq!(link.arrived(Time::FAR_FUTURE).unwrap().1, Some(frame(7)));
        assert_eq!(link.arrived(Time::FAR_FUTURE), None);
    }

    #[test]
    fn a_crsf_module_carries_the_same_channels_and_says_how_its_link_fares() {
        let mut settings = member().vehicle.plant.command_link;
        (settings.loss_ratio, settings.corruption_ratio) = (0.0, 0.0);
        let mut link = link_of(CommandProtocol::Crsf, ChannelBits::Eleven, &settings);
        let (mut outputs, mut faults) = (Outputs::new(), Schedule::default());
        faults.add(Fault::CommandLoss { vehicle: 1, loss_ratio: 1.0 }, slot(0), slot(50));
        for n in 0..100 {
            let mut bytes = [0; crsf::FRAME_BYTES_MAX];
            let channels = crsf::Frame::Channels(frame(n as u16).channels);
            let length = channels.encode(crsf::ADDRESS_MODULE, &mut bytes).unwrap();
            link.feed(slot(n), &bytes[..length], &faults, &mut outputs);
        }
        for n in 50..100 {
            assert_eq!(link.arrived(Time::FAR_FUTURE).unwrap().1, Some(frame(n)));
        }
        let mut qualities = Vec::new();
        outputs.send(Time::FAR_FUTURE, &mut |output| {
            assert_eq!(output.device, Device::CommandLink(1));
            let crsf::Frame::LinkStatistics(statistics) = crsf::Frame::decode(output.bytes).unwrap() else {
                panic!("{:?}", output.bytes);
            };
            qualities.push(statistics.uplink_quality_percent);
        });
        assert_eq!(qualities, [90, 80, 70, 60, 50, 50, 50, 50, 50, 50]);
    }

    #[test]
    fn ten_bits_in_the_air_bring_a_compact_frame_whole_and_no_full_one() {
        use device::vehicle_link::{ChannelMap, CommandFrame};
        let mut settings = member().vehicle.plant.command_link;
        (settings.loss_ratio, settings.corruption_ratio) = (0.0, 0.0);
        let mut link = link_of(CommandProtocol::Sbus, ChannelBits::Ten, &settings);
        let sent = CommandFrame { collective_m_s2: 9.0, counter: 6, ..CommandFrame::default() };
        for (map, arrives) in [(ChannelMap::Compact, true), (ChannelMap::Full, false)] {
            let channels = map.encode(&sent, 1).unwrap();
            feed(&mut link, slot(1), &Frame::new(channels).encode(), &Schedule::default());
            let arrived = link.arrived(Time::FAR_FUTURE).unwrap().1.unwrap();
            assert_eq!(map.decode(&arrived.channels, 1).is_ok(), arrives, "{map:?}");
        }
    }
}
