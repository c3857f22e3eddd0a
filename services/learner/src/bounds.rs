//! What parameters may be at all, and how far they may move at once (hazard H14).

use maneuver::{FlipDesign, Model, Parameters, Primitive, PrimitiveError};

use crate::tuning::{BoundsTuning, StepTuning};

/// Why parameters may not be flown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum OutOfBounds {
    /// They make no flip.
    NoFlip(PrimitiveError),
    /// A step is too short.
    Short {
        /// Number of the step, 1 to 5.
        step: usize,
        /// Its duration.
        duration_s: f64,
    },
    /// A step's collective acceleration is too small or too great.
    Collective {
        /// Number of the step, 1 to 5.
        step: usize,
        /// Its collective acceleration.
        collective_m_s2: f64,
    },
    /// A rate that is too high would be commanded.
    Rate {
        /// The rate.
        rate_rad_s: f64,
    },
    /// The whole is too long.
    Long {
        /// Its duration.
        duration_s: f64,
    },
}

impl core::fmt::Display for OutOfBounds {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::NoFlip(error) => write!(f, "{error}"),
            Self::Short { step, duration_s } => write!(f, "step {step} would last {duration_s:.4} s only"),
            Self::Collective { step, collective_m_s2 } => {
                write!(f, "step {step} would ask for {collective_m_s2:.2} m/s²")
            }
            Self::Rate { rate_rad_s } => write!(f, "a rate of {rate_rad_s:.2} rad/s would be asked for"),
            Self::Long { duration_s } => write!(f, "it would last {duration_s:.2} s"),
        }
    }
}

/// Rounding of the primitive's sums and of the link's single precision must not refuse what was cut to a
/// bound.
const ROUNDING_RATIO: f64 = 1e-6;

impl BoundsTuning {
    /// Greatest collective acceleration that may be asked of such a vehicle.
    fn collective_m_s2_max(&self, model: &Model) -> f64 {
        self.collective_m_s2_max.min(model.collective_m_s2_max())
    }

    fn collective_m_s2_min(&self, model: &Model) -> f64 {
        self.collective_m_s2_min.max(model.collective_m_s2_min())
    }

    /// The nearest parameters each of which is inside its bounds, and whether that changed anything. What
    /// follows from them (T2, T4, rates, the sum) is [`BoundsTuning::admit`]'s to judge.
    pub(crate) fn cut(&self, model: &Model, parameters: Parameters) -> (Parameters, bool) {
        let (low, high) = (self.collective_m_s2_min(model), self.collective_m_s2_max(model));
        let shortest = self.duration_s_min;
        let cut = Parameters {
            u1_m_s2: parameters.u1_m_s2.clamp(low, high),
            t1_s: parameters.t1_s.clamp(shortest, self.total_s_max),
            t3_s: parameters.t3_s.clamp(shortest, self.total_s_max),
            u5_m_s2: parameters.u5_m_s2.clamp(low, high),
            t5_s: parameters.t5_s.clamp(shortest, self.total_s_max),
        };
        (cut, cut != parameters)
    }

    /// The flip these parameters make, if everything about it is inside the bounds.
    ///
    /// # Errors
    /// What is not.
    pub(crate) fn admit(
        &self,
        model: &Model,
        design: &FlipDesign,
        parameters: &Parameters,
    ) -> Result<Primitive, OutOfBounds> {
        let primitive = Primitive::new(design, model.alpha_l_m(), parameters).map_err(OutOfBounds::NoFlip)?;
        let (below, above) = (1.0 - ROUNDING_RATIO, 1.0 + ROUNDING_RATIO);
        let low = self.collective_m_s2_min(model) * below;
        let high = self.collective_m_s2_max(model) * above;
        let mut rate_rad_s = 0.0_f64;
        for (index, step) in primitive.steps().iter().enumerate() {
            let (number, duration_s, collective_m_s2) = (index + 1, step.duration_s, step.collective_m_s2);
            if duration_s < self.duration_s_min * below {
                return Err(OutOfBounds::Short { step: number, duration_s });
            }
            if !(low..=high).contains(&collective_m_s2) {
                return Err(OutOfBounds::Collective { step: number, collective_m_s2 });
            }
            rate_rad_s += step.angular_acceleration_rad_s2 * duration_s;
            if rate_rad_s.abs() > self.rate_rad_s_max * above {
                return Err(OutOfBounds::Rate { rate_rad_s });
            }
        }
        let duration_s = primitive.duration_s();
        if duration_s > self.total_s_max * above {
            return Err(OutOfBounds::Long { duration_s });
        }
        Ok(primitive)
    }
}

impl StepTuning {
    /// The step, shortened as a whole where one parameter would move too far, and whether it was.
    pub(crate) fn shorten(&self, step: [f64; 5]) -> ([f64; 5], bool) {
        let (u_max, t_max) = (self.collective_m_s2_max, self.duration_s_max);
        let limits = [u_max, t_max, t_max, u_max, t_max];
        let excess =
            step.iter().zip(limits).fold(1.0_f64, |excess, (part, limit)| excess.max(part.abs() / limit));
        (step.map(|part| part / excess), excess > 1.0)
    }
}
