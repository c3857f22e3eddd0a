//! The five-step primitive: what a vehicle is told to do, as a function of the time since the start.

use crate::envelope::EnvelopeError;
use crate::parameters::{FlipDesign, Parameters};

/// One of the five steps: constant collective, linearly changing rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Duration T, s.
    pub duration_s: f64,
    /// Collective acceleration U, m/s².
    pub collective_m_s2: f64,
    /// Angular acceleration, rad/s²: the slope of the commanded rate.
    pub angular_acceleration_rad_s2: f64,
}

/// What the vehicle is told at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setpoint {
    /// Collective acceleration, m/s².
    pub collective_m_s2: f64,
    /// Pitch rate, rad/s.
    pub rate_rad_s: f64,
}

/// Why five numbers make no flip.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PrimitiveError {
    /// The named quantity is NaN or infinite.
    #[error("primitive: {quantity} must be finite, got {value}")]
    NotFinite {
        /// Name of the quantity.
        quantity: &'static str,
        /// Its value.
        value: f64,
    },
    /// The named quantity must be above zero.
    #[error("primitive: {quantity} must be above zero, got {value}")]
    NotPositive {
        /// Name of the quantity.
        quantity: &'static str,
        /// Its value.
        value: f64,
    },
    /// A step would have to end before it begins.
    #[error("primitive: step {step} would last {duration_s} s")]
    NegativeDuration {
        /// Number of the step, 1 to 5.
        step: u8,
        /// The duration that follows from the parameters, s.
        duration_s: f64,
    },
    /// Propellers push one way only.
    #[error("primitive: the collective of step {step} would be {collective_m_s2} m/s²")]
    NegativeCollective {
        /// Number of the step, 1 to 5.
        step: u8,
        /// The collective, m/s².
        collective_m_s2: f64,
    },
    /// The whole would last longer than [`Primitive::DURATION_S_MAX`].
    #[error("primitive: would last {duration_s} s, at most {} s are allowed", Primitive::DURATION_S_MAX)]
    TooLong {
        /// Sum of the five durations, s.
        duration_s: f64,
    },
    /// The design turns zero times.
    #[error("primitive: a flip turns at least once")]
    NoFlips,
    /// The envelope is impossible.
    #[error(transparent)]
    Envelope(#[from] EnvelopeError),
}

/// A flip that can be flown: five steps, none of negative length, rate continuous and zero at both ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Primitive {
    steps: [Step; 5],
    /// When each step begins, s.
    starts_s: [f64; 5],
    /// Commanded rate where each step begins, rad/s.
    start_rates_rad_s: [f64; 5],
    duration_s: f64,
}

impl Primitive {
    /// Longest flip accepted, s. A limit so that no set of numbers can keep a simulation or a vehicle busy.
    pub const DURATION_S_MAX: f64 = 10.0;

    /// The five steps of a design with these parameters on a vehicle with the lever αL
    /// ([`Model::alpha_l_m`](crate::Model::alpha_l_m)). U1 and U5 may lie above the envelope: learning needs
    /// that.
    ///
    /// # Errors
    /// [`PrimitiveError`] names what is impossible.
    // Lupashin 2010, eqs. (15) to (22).
    pub fn new(design: &FlipDesign, alpha_l_m: f64, parameters: &Parameters) -> Result<Self, PrimitiveError> {
        design.envelope.check()?;
        if design.flips == 0 {
            return Err(PrimitiveError::NoFlips);
        }
        let Parameters { u1_m_s2, t1_s, t3_s, u5_m_s2, t5_s } = *parameters;
        let rate_rad_s = design.rate_rad_s_max;
        positive("rate_rad_s_max", rate_rad_s)?;
        positive("alpha_l_m", alpha_l_m)?;
        for (quantity, value) in [("U1", u1_m_s2), ("T1", t1_s), ("T3", t3_s), ("U5", u5_m_s2), ("T5", t5_s)]
        {
            finite(quantity, value)?;
        }
        let envelope = &design.envelope;
        let a1 = -(envelope.high_m_s2 - u1_m_s2) / alpha_l_m;
        let a2 = envelope.span_m_s2() / (2.0 * alpha_l_m);
        let t2_s = (rate_rad_s - a1 * t1_s) / a2;
        let a5 = (envelope.high_m_s2 - u5_m_s2) / alpha_l_m;
        let t4_s = (rate_rad_s + a5 * t5_s) / a2;
        let step = |duration_s, collective_m_s2, angular_acceleration_rad_s2| Step {
            duration_s,
            collective_m_s2,
            angular_acceleration_rad_s2,
        };
        Self::from_steps([
            step(t1_s, u1_m_s2, a1),
            step(t2_s, envelope.middle_m_s2(), a2),
            step(t3_s, envelope.low_m_s2, 0.0),
            step(t4_s, envelope.middle_m_s2(), -a2),
            step(t5_s, u5_m_s2, a5),
        ])
    }

    fn from_steps(steps: [Step; 5]) -> Result<Self, PrimitiveError> {
        let mut starts_s = [0.0; 5];
        let mut start_rates_rad_s = [0.0; 5];
        let (mut time_s, mut rate_rad_s) = (0.0, 0.0);
        for (index, step) in steps.iter().enumerate() {
            let number = index as u8 + 1;
            finite("a duration", step.duration_s)?;
            finite("an angular acceleration", step.angular_acceleration_rad_s2)?;
            if step.duration_s < 0.0 {
                return Err(PrimitiveError::NegativeDuration { step: number, duration_s: step.duration_s });
            }
            if step.collective_m_s2 < 0.0 {
                let collective_m_s2 = step.collective_m_s2;
                return Err(PrimitiveError::NegativeCollective { step: number, collective_m_s2 });
            }
            starts_s[index] = time_s;
            start_rates_rad_s[index] = rate_rad_s;
            time_s += step.duration_s;
            rate_rad_s += step.angular_acceleration_rad_s2 * step.duration_s;
        }
        if time_s > Self::DURATION_S_MAX {
            return Err(PrimitiveError::TooLong { duration_s: time_s });
        }
        finite("a rate", rate_rad_s)?;
        Ok(Self { steps, starts_s, start_rates_rad_s, duration_s: time_s })
    }

    /// The five steps in order.
    #[must_use]
    pub fn steps(&self) -> &[Step; 5] {
        &self.steps
    }

    /// T1 + ... + T5, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// When step `index` (0 to 4) begins, s.
    pub(crate) fn start_s(&self, index: usize) -> f64 {
        self.starts_s[index]
    }

    /// Commanded rate where step `index` (0 to 4) begins, rad/s.
    pub(crate) fn start_rate_rad_s(&self, index: usize) -> f64 {
        self.start_rates_rad_s[index]
    }

    /// The command `t_s` seconds after the start. At the instant between two steps the later one holds;
    /// before the start (and at NaN) the first instant's command, after the end the last instant's.
    #[must_use]
    pub fn sample(&self, t_s: f64) -> Setpoint {
        let t_s = if t_s > 0.0 { t_s } else { 0.0 };
        let mut index = 0;
        while index < 4 && t_s >= self.starts_s[index + 1] {
            index += 1;
        }
        let step = &self.steps[index];
        let within_s = (t_s - self.starts_s[index]).min(step.duration_s);
        Setpoint {
            collective_m_s2: step.collective_m_s2,
            rate_rad_s: self.start_rates_rad_s[index] + step.angular_acceleration_rad_s2 * within_s,
        }
    }

    /// Mean collective between two instants, m/s². The instants are first brought into the maneuver; of an
    /// empty interval it is the collective there.
    #[must_use]
    pub fn mean_collective_m_s2(&self, from_s: f64, until_s: f64) -> f64 {
        // Not `clamp`, which panics at a NaN bound.
        let from_s = from_s.max(0.0).min(self.duration_s);
        let until_s = until_s.max(from_s).min(self.duration_s);
        let first = self.sample(from_s).collective_m_s2;
        if until_s <= from_s {
            return first;
        }
        let mut excess = 0.0;
        for (step, start_s) in self.steps.iter().zip(self.starts_s) {
            let overlap_s = until_s.min(start_s + step.duration_s) - from_s.max(start_s);
            if overlap_s > 0.0 {
                // Relative to the first, so that an interval within one step gives that step's value exactly.
                excess += (step.collective_m_s2 - first) * overlap_s;
            }
        }
        first + excess / (until_s - from_s)
    }
}

fn finite(quantity: &'static str, value: f64) -> Result<(), PrimitiveError> {
    if value.is_finite() { Ok(()) } else { Err(PrimitiveError::NotFinite { quantity, value }) }
}

fn positive(quantity: &'static str, value: f64) -> Result<(), PrimitiveError> {
    finite(quantity, value)?;
    if value > 0.0 { Ok(()) } else { Err(PrimitiveError::NotPositive { quantity, value }) }
}
