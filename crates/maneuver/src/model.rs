//! The numbers of the vertical-plane model: Table I of the paper, and what follows from them.

use quantity::GRAVITY_M_S2;

/// What the rate loop's integral does while a propeller's command is clipped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Integral {
    /// Integrates always, as eq. (9) is printed; winds up during saturation.
    #[default]
    Literal,
    /// Holds while the command saturates in the direction of the error.
    Conditional,
}

/// The vertical-plane model a flip is designed and corrected with. It knows nothing of inflow, drag or
/// battery.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Model {
    /// Mass M, kg.
    pub mass_kg: f64,
    /// Distance L from the centre of mass to a propeller's axis, m.
    pub arm_m: f64,
    /// Moment of inertia about the flip axis, kg m².
    pub inertia_kg_m2: f64,
    /// Rate of the first-order lag of a rising thrust, 1/s.
    pub rotor_gain_up_1_s: f64,
    /// Rate of the first-order lag of a falling thrust, 1/s.
    pub rotor_gain_down_1_s: f64,
    /// Least thrust one propeller is ever commanded, N.
    pub thrust_n_min: f64,
    /// Greatest thrust one propeller is ever commanded, N.
    pub thrust_n_max: f64,
    /// Proportional gain P of the rate loop, 1/s.
    pub rate_gain_p_1_s: f64,
    /// Integral gain I of the rate loop, 1/s².
    pub rate_gain_i_1_s2: f64,
    /// What the rate loop's integral does in saturation.
    pub integral: Integral,
}

/// A number of a [`Model`] that no vehicle can have.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ModelError {
    /// The named field is not a positive finite number.
    #[error("model: {field} must be positive and finite, got {value}")]
    NotPositive {
        /// Name of the field.
        field: &'static str,
        /// Its value.
        value: f64,
    },
    /// Least and greatest thrust are not `0 <= least < hover < greatest`.
    #[error(
        "model: thrust range {min_n} to {max_n} N must not be negative and must contain hover, {hover_n} N"
    )]
    ThrustRange {
        /// Least thrust, N.
        min_n: f64,
        /// Greatest thrust, N.
        max_n: f64,
        /// Thrust per propeller at hover, N.
        hover_n: f64,
    },
}

impl Model {
    /// The paper's vehicle. // Lupashin 2010, Table I.
    pub const TABLE_I: Self = Self {
        mass_kg: 0.468,
        arm_m: 0.17,
        inertia_kg_m2: 0.0023,
        rotor_gain_up_1_s: 50.0,
        rotor_gain_down_1_s: 25.0,
        thrust_n_min: 0.08,
        thrust_n_max: 2.8,
        rate_gain_p_1_s: 240.0,
        rate_gain_i_1_s2: 3600.0,
        integral: Integral::Literal,
    };

    /// Refuses numbers that are not finite, not positive, or leave no room to hover.
    ///
    /// # Errors
    /// [`ModelError`] names the first field at fault.
    pub fn check(&self) -> Result<(), ModelError> {
        let positive = [
            ("mass_kg", self.mass_kg),
            ("arm_m", self.arm_m),
            ("inertia_kg_m2", self.inertia_kg_m2),
            ("rotor_gain_up_1_s", self.rotor_gain_up_1_s),
            ("rotor_gain_down_1_s", self.rotor_gain_down_1_s),
            ("rate_gain_p_1_s", self.rate_gain_p_1_s),
            ("rate_gain_i_1_s2", self.rate_gain_i_1_s2),
            ("thrust_n_max", self.thrust_n_max),
        ];
        for (field, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return Err(ModelError::NotPositive { field, value });
            }
        }
        let hover_n = self.hover_thrust_n();
        if self.thrust_n_min >= 0.0 && self.thrust_n_min < hover_n && hover_n < self.thrust_n_max {
            Ok(())
        } else {
            Err(ModelError::ThrustRange { min_n: self.thrust_n_min, max_n: self.thrust_n_max, hover_n })
        }
    }

    /// The lever αL = 2 Iyy / (M L), m: what converts a difference of collective acceleration into angular
    /// acceleration.
    #[must_use]
    pub fn alpha_l_m(&self) -> f64 {
        2.0 * self.inertia_kg_m2 / (self.mass_kg * self.arm_m)
    }

    /// Collective acceleration with every propeller at its least thrust, m/s².
    #[must_use]
    pub fn collective_m_s2_min(&self) -> f64 {
        4.0 * self.thrust_n_min / self.mass_kg
    }

    /// Collective acceleration with every propeller at its greatest thrust, m/s²: how far learning may raise
    /// U1, U5.
    #[must_use]
    pub fn collective_m_s2_max(&self) -> f64 {
        4.0 * self.thrust_n_max / self.mass_kg
    }

    /// Thrust of one propeller at hover, N.
    #[must_use]
    pub fn hover_thrust_n(&self) -> f64 {
        self.mass_kg * GRAVITY_M_S2 / 4.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_i_is_possible_and_its_lever_is_the_published_one() {
        assert_eq!(Model::TABLE_I.check(), Ok(()));
        assert!((Model::TABLE_I.alpha_l_m() - 0.057_818).abs() < 5e-7);
    }

    #[test]
    fn the_field_at_fault_is_named() {
        let weightless = Model { mass_kg: 0.0, ..Model::TABLE_I };
        assert_eq!(weightless.check(), Err(ModelError::NotPositive { field: "mass_kg", value: 0.0 }));
        let unknown = Model { arm_m: f64::NAN, ..Model::TABLE_I };
        assert!(matches!(unknown.check(), Err(ModelError::NotPositive { field: "arm_m", .. })));
        let weak = Model { thrust_n_max: 1.0, ..Model::TABLE_I };
        assert!(matches!(weak.check(), Err(ModelError::ThrustRange { .. })));
        let sucking = Model { thrust_n_min: f64::NAN, ..Model::TABLE_I };
        assert!(matches!(sucking.check(), Err(ModelError::ThrustRange { .. })));
    }
}
