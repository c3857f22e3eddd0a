//! The vehicle's own sensors: three rate gyros with a range, three accelerometers.

use quantity::{Body, Vector};
use settings::{AccelerometerSettings, GyroSettings};

use crate::random::{Purpose, Stream};

/// The rate gyros.
#[derive(Clone, Debug, PartialEq)]
pub struct Gyro {
    settings: GyroSettings,
    bias_rad_s: Vector<Body>,
    flip_bias_rad_s: Vector<Body>,
    noise: Stream,
    flip: Stream,
}

impl Gyro {
    /// Gyros whose constant bias comes from `build`.
    #[must_use]
    pub fn new(settings: &GyroSettings, seed: u64, vehicle: u8, build: &mut Stream) -> Self {
        Self {
            bias_rad_s: draw(build) * settings.bias_rad_s,
            flip_bias_rad_s: Vector::ZERO,
            noise: Stream::new(seed, Purpose::Gyro, vehicle),
            flip: Stream::new(seed, Purpose::FlipBias, vehicle),
            settings: settings.clone(),
        }
    }

    /// What they read at a true rate: scaled, biased, noisy, and never past their range.
    pub fn read(&mut self, rate_rad_s: Vector<Body>, extra_bias_rad_s: Vector<Body>) -> Vector<Body> {
        let settings = &self.settings;
        let noise = draw(&mut self.noise) * settings.noise_rad_s;
        let bias = self.bias_rad_s + self.flip_bias_rad_s + extra_bias_rad_s;
        let reading = rate_rad_s * settings.scale_ratio + bias + noise;
        let clip = |rate: f64| rate.clamp(-settings.range_rad_s, settings.range_rad_s);
        Vector::new(clip(reading.x), clip(reading.y), clip(reading.z))
    }

    /// A maneuver begins: its bias is drawn, and stays until the next.
    pub fn begin_maneuver(&mut self) {
        self.flip_bias_rad_s = draw(&mut self.flip) * self.settings.flip_bias_rad_s;
    }
}

/// The accelerometers.
#[derive(Clone, Debug, PartialEq)]
pub struct Accelerometer {
    noise_m_s2: f64,
    bias_m_s2: Vector<Body>,
    noise: Stream,
}

impl Accelerometer {
    /// Accelerometers whose bias comes from `build`.
    #[must_use]
    pub fn new(settings: &AccelerometerSettings, seed: u64, vehicle: u8, build: &mut Stream) -> Self {
        Self {
            noise_m_s2: settings.noise_m_s2,
            bias_m_s2: draw(build) * settings.bias_m_s2,
            noise: Stream::new(seed, Purpose::Accelerometer, vehicle),
        }
    }

    /// What they read at a true specific force (acceleration without gravity's).
    pub fn read(&mut self, specific_force_m_s2: Vector<Body>) -> Vector<Body> {
        specific_force_m_s2 + self.bias_m_s2 + draw(&mut self.noise) * self.noise_m_s2
    }
}

fn draw(stream: &mut Stream) -> Vector<Body> {
    let (x, y, z) = (stream.gaussian(), stream.gaussian(), stream.gaussian());
    Vector::new(x, y, z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::member;
    use quantity::math;

    fn gyro(change: impl FnOnce(&mut GyroSettings)) -> Gyro {
        let mut settings = member().vehicle.plant.gyro;
        change(&mut settings);
        Gyro::new(&settings, 5, 1, &mut Stream::new(5, Purpose::Build, 1))
    }

    #[test]
    fn the_reading_stops_at_the_range() {
        let mut gyro = gyro(|_| ());
        for rate in [34.0, 36.0, 1e6] {
            let reading = gyro.read(Vector::new(rate, -rate, 0.0), Vector::ZERO);
            assert_eq!((reading.x, reading.y), (34.906_585, -34.906_585));
            assert!(reading.z.abs() < 1.0);
        }
    }

    #[test]
    fn scale_acts_before_the_range() {
        let mut gyro = gyro(|settings| {
            settings.noise_rad_s = 0.0;
            settings.bias_rad_s = 0.0;
        });
        // 33.5 rad/s read 4.5 % high is past 2000 deg/s.
        assert_eq!(gyro.read(Vector::new(0.0, 33.5, 0.0), Vector::ZERO).y, 34.906_585);
        assert!((gyro.read(Vector::new(0.0, 20.0, 0.0), Vector::ZERO).y - 20.9).abs() < 1e-12);
    }

    #[test]
    fn noise_has_its_strength_and_each_maneuver_its_bias() {
        let mut gyro = gyro(|settings| settings.bias_rad_s = 0.0);
        let mut mean_and_sigma = || {
            let n = 20_000;
            let readings: Vec<f64> = (0..n).map(|_| gyro.read(Vector::ZERO, Vector::ZERO).y).collect();
            let mean = readings.iter().sum::<f64>() / f64::from(n);
            let power = readings.iter().map(|r| (r - mean) * (r - mean)).sum::<f64>() / f64::from(n);
            (mean, math::sqrt(power))
        };
        let (mean, sigma) = mean_and_sigma();
        assert!(mean.abs() < 0.0015 && (sigma - 0.05).abs() < 0.001);
        let flips: Vec<f64> = (0..2_000)
            .map(|_| {
                gyro.begin_maneuver();
                gyro.flip_bias_rad_s.y
            })
            .collect();
        let power = flips.iter().map(|bias| bias * bias).sum::<f64>() / 2_000.0;
        assert!((math::sqrt(power) - 0.02).abs() < 0.001);
    }

    #[test]
    fn the_accelerometer_reads_specific_force() {
        let settings = AccelerometerSettings { noise_m_s2: 0.0, bias_m_s2: 0.0 };
        let mut sensor = Accelerometer::new(&settings, 5, 1, &mut Stream::new(5, Purpose::Build, 1));
        assert_eq!(sensor.read(Vector::new(0.0, 0.0, 9.81)), Vector::new(0.0, 0.0, 9.81));
    }
}
