//! The command link of one vehicle: an encoder fed with SBUS bytes, 25 bytes through the air, a receiver.

use device::sbus::{FRAME_BYTES, Frame, FrameFinder};
use quantity::{Span, Time};
use settings::LinkSettings;

use crate::faults::{Fault, Schedule};
use crate::queue::DelayQueue;
use crate::random::{Purpose, Stream};

/// A silence on the encoder's serial line by which a frame must be over: frames last 3 ms.
const LINE_SILENCE: Span = Span::from_millis(5);

/// Frames under way at most; a faster sender's are lost.
const UNDER_WAY_MAX: usize = 64;

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
    finder: FrameFinder,
    fed_at: Time,
    stream: Stream,
    air: DelayQueue<[u8; FRAME_BYTES]>,
    last_due: Time,
    counts: LinkCounts,
}

impl CommandLink {
    /// The link of a vehicle.
    #[must_use]
    pub fn new(vehicle: u8, settings: &LinkSettings, seed: u64) -> Self {
        Self {
            vehicle,
            settings: settings.clone(),
            finder: FrameFinder::new(),
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
    pub fn feed(&mut self, now: Time, bytes: &[u8], faults: &Schedule) {
        if now - self.fed_at > LINE_SILENCE {
            self.finder.gap();
        }
        self.fed_at = now;
        for byte in bytes {
            if let Some(frame) = self.finder.push(*byte) {
                self.transmit(now, frame.encode(), faults);
            }
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
        if lost || self.air.len() >= UNDER_WAY_MAX {
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
        CommandLink::new(1, &settings, 11)
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
            link.feed(slot(n), &frame(n as u16).encode(), &Schedule::default());
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
            link.feed(slot(k), &frame(k as u16).encode(), &Schedule::default());
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
            link.feed(slot(k), &frame(1).encode(), &faults);
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
        link.feed(slot(0), &bytes[..13], &Schedule::default());
        link.feed(slot(1), &bytes[..9], &Schedule::default());
        link.feed(slot(1) + Span::from_millis(1), &bytes[9..], &Schedule::default());
        assert_eq!(link.arrived(Time::FAR_FUTURE).unwrap().1, Some(frame(7)));
        assert_eq!(link.arrived(Time::FAR_FUTURE), None);
    }
}
