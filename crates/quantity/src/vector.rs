//! Vectors that know their frame.

use core::marker::PhantomData;
use core::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use serde::{Deserialize, Serialize};

use crate::math;

/// A coordinate frame, named at compile time.
pub trait Frame: Copy + Default + core::fmt::Debug + PartialEq + 'static {
    /// The frame's name in schemas and messages.
    const NAME: &'static str;
}

/// The hall: origin on the floor at its middle, x and y along the walls, z up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct World;

/// The vehicle: origin at its centre of mass, x forward, y left, z up through the rotors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Body;

impl Frame for World {
    const NAME: &'static str = "world";
}

impl Frame for Body {
    const NAME: &'static str = "body";
}

/// Three components along the axes of frame `F`; the unit stands in the name of whatever holds it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(bound = "", deny_unknown_fields)]
pub struct Vector<F: Frame> {
    /// Along the frame's x axis.
    pub x: f64,
    /// Along the frame's y axis.
    pub y: f64,
    /// Along the frame's z axis.
    pub z: f64,
    #[serde(skip)]
    frame: PhantomData<F>,
}

impl<F: Frame> Vector<F> {
    /// No length, no direction.
    pub const ZERO: Self = Self::new(0.0, 0.0, 0.0);
    /// One along z.
    pub const Z: Self = Self::new(0.0, 0.0, 1.0);

    /// A vector from its components.
    #[must_use]
    pub const fn new(x: f64, y: f64, z: f64) -> Self {
        Self { x, y, z, frame: PhantomData }
    }

    /// Scalar product.
    #[must_use]
    pub fn dot(self, other: Self) -> f64 {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    /// Vector product, right-handed.
    #[must_use]
    pub fn cross(self, other: Self) -> Self {
        Self::new(
            self.y * other.z - self.z * other.y,
            self.z * other.x - self.x * other.z,
            self.x * other.y - self.y * other.x,
        )
    }

    /// Euclidean length.
    #[must_use]
    pub fn norm(self) -> f64 {
        math::sqrt(self.dot(self))
    }

    /// The same direction at length one, or `None` for a vector too short to have one.
    #[must_use]
    pub fn direction(self) -> Option<Self> {
        let norm = self.norm();
        (norm > 1e-9).then(|| self * (1.0 / norm))
    }

    /// The same direction, shortened to `length_max` where it is longer.
    #[must_use]
    pub fn limited(self, length_max: f64) -> Self {
        let norm = self.norm();
        if norm > length_max { self * (length_max / norm) } else { self }
    }

    /// The part along x and y alone.
    #[must_use]
    pub fn horizontal(self) -> Self {
        Self::new(self.x, self.y, 0.0)
    }

    /// Whether every component is a finite number.
    #[must_use]
    pub fn is_finite(self) -> bool {
        self.x.is_finite() && self.y.is_finite() && self.z.is_finite()
    }
}

impl<F: Frame> Add for Vector<F> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self::new(self.x + other.x, self.y + other.y, self.z + other.z)
    }
}

impl<F: Frame> AddAssign for Vector<F> {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<F: Frame> Sub for Vector<F> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self::new(self.x - other.x, self.y - other.y, self.z - other.z)
    }
}

impl<F: Frame> SubAssign for Vector<F> {
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl<F: Frame> Neg for Vector<F> {
    type Output = Self;
    fn neg(self) -> Self {
        Self::new(-self.x, -self.y, -self.z)
    }
}

impl<F: Frame> Mul<f64> for Vector<F> {
    type Output = Self;
    fn mul(self, factor: f64) -> Self {
        Self::new(self.x * factor, self.y * factor, self.z * factor)
    }
}

impl<F: Frame> Div<f64> for Vector<F> {
    type Output = Self;
    fn div(self, divisor: f64) -> Self {
        Self::new(self.x / divisor, self.y / divisor, self.z / divisor)
    }
}

impl<F: Frame> From<nalgebra::Vector3<f64>> for Vector<F> {
    fn from(raw: nalgebra::Vector3<f64>) -> Self {
        Self::new(raw.x, raw.y, raw.z)
    }
}

impl<F: Frame> From<Vector<F>> for nalgebra::Vector3<f64> {
    fn from(vector: Vector<F>) -> Self {
        Self::new(vector.x, vector.y, vector.z)
    }
}
