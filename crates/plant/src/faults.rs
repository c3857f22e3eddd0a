//! What can be made to go wrong in the simulated arena, from when until when.

use quantity::{Body, Span, Time, Vector};

/// How the motion-capture system shows an object it cannot see.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Occlusion {
    /// Not at all.
    Absent,
    /// At the origin, all six numbers zero.
    ZeroPose,
    /// Where it was last, bit by bit.
    FrozenPose,
}

/// A fault.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// The cameras do not see a vehicle.
    Occluded {
        /// Which.
        vehicle: u8,
        /// How that looks.
        shown: Occlusion,
    },
    /// Two vehicles' markers are taken for each other's.
    SwappedMarkers {
        /// One.
        vehicle: u8,
        /// The other.
        other: u8,
    },
    /// The marker pattern is matched the wrong way round: the pose is turned by this rotation vector.
    FlippedPose {
        /// Which vehicle's.
        vehicle: u8,
        /// The turn, axis times angle.
        turn_rad: Vector<Body>,
    },
    /// A vehicle's pose is not a number.
    PoseNotANumber {
        /// Which vehicle's.
        vehicle: u8,
    },
    /// A vehicle's position is infinite.
    PoseInfinite {
        /// Which vehicle's.
        vehicle: u8,
    },
    /// A vehicle's position is told in metres where millimetres are due.
    PoseInMetres {
        /// Which vehicle's.
        vehicle: u8,
    },
    /// No datagram leaves the cameras' computer.
    CamerasSilent,
    /// Poses go on, the frame number does not.
    FrozenFrameNumber,
    /// Frames are numbered from elsewhere, as after the vendor's software was restarted.
    RenumberedFrames {
        /// Added to the true number, wrapping.
        offset: u32,
    },
    /// Only every so many frames is taken, and numbered.
    SlowFrames {
        /// One frame of so many.
        one_of: u32,
    },
    /// Datagrams are late; what comes on time again afterwards overtakes them.
    LateFrames {
        /// By so much.
        delay: Span,
    },
    /// The command link loses frames.
    CommandLoss {
        /// Which vehicle's.
        vehicle: u8,
        /// That many; one for silence.
        loss_ratio: f64,
    },
    /// The command link delivers late.
    CommandDelay {
        /// Which vehicle's.
        vehicle: u8,
        /// By so much more.
        delay: Span,
    },
    /// The command link flips bits.
    CommandCorruption {
        /// Which vehicle's.
        vehicle: u8,
        /// In that many frames.
        corruption_ratio: f64,
    },
    /// The data link loses frames, each way.
    DataLoss {
        /// Which vehicle's.
        vehicle: u8,
        /// That many; one for silence.
        loss_ratio: f64,
    },
    /// The data link loses what comes from the vehicle, acknowledgements included; what goes to it arrives.
    DataDownlinkLoss {
        /// Which vehicle's.
        vehicle: u8,
        /// That many; one for silence.
        loss_ratio: f64,
    },
    /// The data link brings frames twice, the second some other delay after they were sent: a radio that missed
    /// an acknowledgement repeats.
    DataDuplication {
        /// Which vehicle's.
        vehicle: u8,
        /// That many, each way.
        duplicate_ratio: f64,
    },
    /// Two vehicles' data-link radios answer to each other's address.
    SwappedAddresses {
        /// One.
        vehicle: u8,
        /// The other.
        other: u8,
    },
    /// A rotor gives less.
    WeakRotor {
        /// Whose.
        vehicle: u8,
        /// Front, back, left, right: 0 to 3.
        rotor: u8,
        /// What is left of its thrust.
        thrust_ratio: f64,
    },
    /// The gyros read wrong by that much.
    GyroBias {
        /// Whose.
        vehicle: u8,
        /// By so much.
        bias_rad_s: Vector<Body>,
    },
    /// The gyros read nothing but "not a number".
    GyroNotANumber {
        /// Whose.
        vehicle: u8,
    },
}

/// A fault with its time.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Scheduled {
    fault: Fault,
    begins: Time,
    ends: Time,
}

/// The faults of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Schedule {
    faults: Vec<Scheduled>,
}

impl Schedule {
    /// Adds a fault that holds from `begins` until just before `ends`.
    pub fn add(&mut self, fault: Fault, begins: Time, ends: Time) {
        self.faults.push(Scheduled { fault, begins, ends });
    }

    /// Ends every fault that is not over at `now`, and forgets those to come.
    pub fn clear(&mut self, now: Time) {
        self.faults.retain(|scheduled| scheduled.begins <= now);
        for scheduled in &mut self.faults {
            scheduled.ends = scheduled.ends.min(now);
        }
    }

    /// Forgets faults that were over well before `now`.
    pub(crate) fn prune(&mut self, now: Time) {
        if !self.faults.is_empty() {
            self.faults.retain(|scheduled| scheduled.ends.saturating_add(Span::from_secs(10)) > now);
        }
    }

    /// The faults at an instant.
    pub(crate) fn at(&self, now: Time) -> impl Iterator<Item = Fault> + '_ {
        self.faults
            .iter()
            .filter(move |scheduled| scheduled.begins <= now && now < scheduled.ends)
            .map(|scheduled| scheduled.fault)
    }

    /// Whether no fault was ever added, or all are long over: the hot path's short cut.
    pub(crate) fn is_empty(&self) -> bool {
        self.faults.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(seconds: i64) -> Time {
        Time::ZERO + Span::from_secs(seconds)
    }

    #[test]
    fn a_fault_holds_from_its_begin_until_before_its_end() {
        let mut schedule = Schedule::default();
        schedule.add(Fault::CamerasSilent, at(2), at(4));
        schedule.add(Fault::FrozenFrameNumber, at(3), Time::FAR_FUTURE);
        let count = |schedule: &Schedule, now| schedule.at(now).count();
        assert_eq!([1, 2, 3, 4].map(|now| count(&schedule, at(now))), [0, 1, 2, 1]);
        schedule.clear(at(5));
        assert_eq!([4, 5, 6].map(|now| count(&schedule, at(now))), [1, 0, 0]);
        schedule.prune(at(60));
        assert!(schedule.is_empty());
    }
}
