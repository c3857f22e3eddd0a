//! Rate errors to angular accelerations: PI about roll and pitch, P about yaw.

use maneuver::Integral;
use quantity::{Body, Vector};

use crate::settings::{FirmwareSettings, LOOP_HZ, RateGains};

/// One tick of the loops: what is asked for, and what the vehicle does.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RateError {
    /// Commanded minus measured rate.
    pub error_rad_s: Vector<Body>,
    /// Greatest angular acceleration about roll and pitch that still changes a propeller's command.
    pub room_rad_s2: [f64; 2],
}

/// The loops' memory.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct RateLoop {
    /// Integral of the rate error about roll and pitch, rad.
    integral_rad: [f64; 2],
}

impl RateLoop {
    /// Forgets the past.
    pub fn reset(&mut self) {
        self.integral_rad = [0.0; 2];
    }

    /// One tick in normal flight: whatever the gains' rule, the integral is conditional and limited, and it
    /// stands still while `grounded`.
    pub fn fly(&mut self, tick: RateError, settings: &FirmwareSettings, grounded: bool) -> Vector<Body> {
        let rates = &settings.rates;
        let gains = RateGains { integral: Integral::Conditional, ..rates.flight };
        let before = self.integral_rad;
        let answer = self.step(tick, gains, rates.yaw_p_1_s);
        if grounded {
            self.integral_rad = before;
        }
        let integral_max = rates.integral_rad_s2_max / gains.i_1_s2;
        self.integral_rad = self.integral_rad.map(|integral| integral.clamp(-integral_max, integral_max));
        answer
    }

    /// One tick in a maneuver: as the flip's model has it.
    pub fn flip(&mut self, tick: RateError, settings: &FirmwareSettings) -> Vector<Body> {
        self.step(tick, settings.rates.maneuver, settings.rates.yaw_p_1_s)
    }

    fn step(&mut self, tick: RateError, gains: RateGains, yaw_p_1_s: f64) -> Vector<Body> {
        let error = [tick.error_rad_s.x, tick.error_rad_s.y];
        let mut answer = [0.0; 2];
        for axis in 0..2 {
            let before = self.integral_rad[axis];
            let after = before + error[axis] / LOOP_HZ;
            let integral = admitted(gains, tick.room_rad_s2[axis], error[axis], before, after);
            self.integral_rad[axis] = integral;
            // Lupashin 2010, eq. (9).
            answer[axis] = gains.p_1_s * error[axis] + gains.i_1_s2 * integral;
        }
        Vector::new(answer[0], answer[1], yaw_p_1_s * tick.error_rad_s.z)
    }
}

/// The integral after a tick. The conditional rule admits no more than what brings the command to its limit,
/// and is the rule of the learner's model to the letter: a difference between the two would have to be
/// learned.
fn admitted(gains: RateGains, room_rad_s2: f64, error_rad_s: f64, before: f64, after: f64) -> f64 {
    if gains.integral == Integral::Literal {
        return after;
    }
    let proportional = gains.p_1_s * error_rad_s;
    if error_rad_s > 0.0 {
        after.min(before.max((room_rad_s2 - proportional) / gains.i_1_s2))
    } else {
        after.max(before.min((-room_rad_s2 - proportional) / gains.i_1_s2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tick(error: f64) -> RateError {
        RateError { error_rad_s: Vector::new(0.0, error, 0.5), room_rad_s2: [100.0; 2] }
    }

    #[test]
    fn proportional_and_integral_act_at_once() {
        let settings = FirmwareSettings::table_i(1);
        let mut rates = RateLoop::default();
        let answer = rates.flip(tick(0.1), &settings);
        assert!((answer.y - (240.0 * 0.1 + 3600.0 * 0.1 / 800.0)).abs() < 1e-12);
        assert_eq!((answer.x, answer.z), (0.0, settings.rates.yaw_p_1_s * 0.5));
    }

    #[test]
    fn the_literal_integral_winds_up_and_the_conditional_does_not() {
        let mut settings = FirmwareSettings::table_i(1);
        let mut rates = RateLoop::default();
        for _ in 0..800 {
            rates.flip(tick(1.0), &settings);
        }
        assert!((rates.integral_rad[1] - 1.0).abs() < 1e-9);

        settings.rates.maneuver.integral = Integral::Conditional;
        let mut rates = RateLoop::default();
        for _ in 0..800 {
            rates.flip(tick(1.0), &settings);
        }
        assert_eq!(rates.integral_rad[1], 0.0, "saturated by the proportional part alone");
        for _ in 0..800 {
            rates.flip(tick(0.25), &settings);
        }
        let at_limit = (100.0 - 240.0 * 0.25) / 3600.0;
        assert!((rates.integral_rad[1] - at_limit).abs() < 1e-12);
    }

    #[test]
    fn in_normal_flight_the_integral_is_limited_and_waits_on_the_ground() {
        let settings = FirmwareSettings::table_i(1);
        let mut rates = RateLoop::default();
        for _ in 0..8000 {
            rates.fly(tick(-0.1), &settings, true);
        }
        assert_eq!(rates.integral_rad[1], 0.0);
        for _ in 0..8000 {
            rates.fly(tick(-0.1), &settings, false);
        }
        assert!((rates.integral_rad[1] + 60.0 / 3600.0).abs() < 1e-12);
    }
}
