//! Sensor readings made fit for use: what is no number is replaced by the last that was.

use quantity::{Body, Span, Time, Vector};

use crate::settings::LOOP_HZ;

/// What the sensors read at one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImuSample {
    /// Angular rate as the gyros read it.
    pub rate_rad_s: Vector<Body>,
    /// Specific force as the accelerometer reads it: at rest, gravity upward.
    pub acceleration_m_s2: Vector<Body>,
    /// Battery voltage under the present load.
    pub battery_v: f64,
}

/// No gyro or accelerometer reads more: beyond it a number is no reading.
const RATE_RAD_S_CREDIBLE: f64 = 100.0;
const ACCELERATION_M_S2_CREDIBLE: f64 = 2_000.0;
const BATTERY_V_CREDIBLE: f64 = 100.0;

/// Battery voltage is averaged over about this long.
const BATTERY_AVERAGE_S: f64 = 1.0;

/// How long a refused reading keeps being reported.
const FAULT_SHOWN: Span = Span::from_secs(1);

/// The readings in use.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sensors {
    /// Last usable gyro reading.
    pub rate_rad_s: Vector<Body>,
    /// Last usable accelerometer reading.
    pub acceleration_m_s2: Vector<Body>,
    battery_v: Option<f64>,
    gyro_lost_since: Option<Time>,
    refused_at: Option<Time>,
}

impl Sensors {
    /// Takes a sample; the battery's average leaves out maneuvers, whose load says nothing of its charge.
    pub fn update(&mut self, now: Time, sample: &ImuSample, in_maneuver: bool) {
        let mut refused = false;
        if credible(sample.rate_rad_s, RATE_RAD_S_CREDIBLE) {
            self.rate_rad_s = sample.rate_rad_s;
            self.gyro_lost_since = None;
        } else {
            refused = true;
            self.gyro_lost_since.get_or_insert(now);
        }
        if credible(sample.acceleration_m_s2, ACCELERATION_M_S2_CREDIBLE) {
            self.acceleration_m_s2 = sample.acceleration_m_s2;
        } else {
            refused = true;
        }
        if (0.0..BATTERY_V_CREDIBLE).contains(&sample.battery_v) {
            if !in_maneuver {
                let average = self.battery_v.get_or_insert(sample.battery_v);
                *average += (sample.battery_v - *average) / (BATTERY_AVERAGE_S * LOOP_HZ);
            }
        } else {
            refused = true;
        }
        if refused {
            self.refused_at = Some(now);
        }
    }

    /// Averaged battery voltage; zero before the first reading.
    pub fn battery_v(&self) -> f64 {
        self.battery_v.unwrap_or(0.0)
    }

    /// For how long the gyros have given nothing usable.
    pub fn gyro_lost_for(&self, now: Time) -> Option<Span> {
        self.gyro_lost_since.map(|since| elapsed(since, now))
    }

    /// Whether a reading was refused of late.
    pub fn faulty(&self, now: Time) -> bool {
        self.refused_at.is_some_and(|at| elapsed(at, now) < FAULT_SHOWN)
    }
}

fn credible(vector: Vector<Body>, greatest: f64) -> bool {
    // A comparison with what is not a number is false.
    [vector.x, vector.y, vector.z].iter().all(|component| component.abs() <= greatest)
}

/// From `earlier` to `later`, at the ends of the range instead of beyond them.
pub(crate) const fn elapsed(earlier: Time, later: Time) -> Span {
    Span::from_nanos(later.as_nanos().saturating_sub(earlier.as_nanos()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_number_leaves_the_last_reading() {
        let good = ImuSample {
            rate_rad_s: Vector::new(1.0, 2.0, 3.0),
            acceleration_m_s2: Vector::new(0.0, 0.0, 9.8),
            battery_v: 11.1,
        };
        let bad = ImuSample {
            rate_rad_s: Vector::new(f64::NAN, 0.0, 0.0),
            acceleration_m_s2: Vector::new(0.0, f64::INFINITY, 0.0),
            battery_v: f64::NAN,
        };
        let mut sensors = Sensors::default();
        sensors.update(Time::ZERO, &good, false);
        assert!(!sensors.faulty(Time::ZERO));
        let later = Time::ZERO + Span::from_millis(10);
        sensors.update(later, &bad, false);
        assert_eq!(sensors.rate_rad_s, good.rate_rad_s);
        assert_eq!(sensors.acceleration_m_s2, good.acceleration_m_s2);
        assert_eq!(sensors.battery_v(), 11.1);
        assert!(sensors.faulty(later));
        assert_eq!(sensors.gyro_lost_for(later + Span::from_millis(5)), Some(Span::from_millis(5)));
        sensors.update(later + Span::from_millis(5), &good, false);
        assert_eq!(sensors.gyro_lost_for(later + Span::from_millis(6)), None);
        assert!(sensors.faulty(later + Span::from_millis(6)), "shown a while longer");
    }

    #[test]
    fn the_battery_is_averaged_outside_maneuvers() {
        let mut sensors = Sensors::default();
        let sample = |battery_v| ImuSample { battery_v, ..ImuSample::default() };
        sensors.update(Time::ZERO, &sample(12.0), false);
        for _ in 0..800 {
            sensors.update(Time::ZERO, &sample(9.0), true);
        }
        assert_eq!(sensors.battery_v(), 12.0);
        for _ in 0..800 {
            sensors.update(Time::ZERO, &sample(9.0), false);
        }
        assert!((sensors.battery_v() - (9.0 + 3.0 * 0.367_65)).abs() < 1e-3);
    }
}
