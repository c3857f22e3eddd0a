//! tmp

/// How a vehicle differs from the model it was designed with, as ratios: 1 is no difference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deviation {
    /// Thrust delivered over thrust commanded.
    pub thrust: f64,
    /// Mass over the model's.
    pub mass: f64,
    /// Moment of inertia over the model's.
    pub inertia: f64,
    /// Speed of the rotors' lag over the model's, rising and falling alike.
    pub rotor_gain: f64,
    /// What the gyro reads over the true rate.
    pub gyro: f64,
}

impl Deviation {
    /// The vehicle is the model.
    pub const NONE: Self = Self { thrust: 1.0, mass: 1.0, inertia: 1.0, rotor_gain: 1.0, gyro: 1.0 };
}
