//! Several numbers that go through the same arithmetic side by side.
//!
//! One simulated flip is a chain of dependent operations and leaves most of a processor idle. Several flips
//! in lanes fill it. No lane sees another, so each gives the same bits as it would alone.

use core::array;
use core::ops::{Add, Mul, Sub};

/// `N` independent numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Lanes<const N: usize>(pub [f64; N]);

impl<const N: usize> Lanes<N> {
    pub const ZERO: Self = Self([0.0; N]);

    pub const fn splat(value: f64) -> Self {
        Self([value; N])
    }

    #[inline(always)]
    pub fn map(self, function: impl Fn(f64) -> f64) -> Self {
        Self(array::from_fn(|lane| function(self.0[lane])))
    }

    #[inline(always)]
    pub fn zip(self, other: Self, function: impl Fn(f64, f64) -> f64) -> Self {
        Self(array::from_fn(|lane| function(self.0[lane], other.0[lane])))
    }

    // Written as comparisons: `f64::min` also decides about NaN, which costs three instructions more.
    #[inline(always)]
    pub fn at_least(self, bound: f64) -> Self {
        self.map(|value| if value < bound { bound } else { value })
    }

    #[inline(always)]
    pub fn at_most(self, bound: f64) -> Self {
        self.map(|value| if value > bound { bound } else { value })
    }
}

impl<const N: usize> Add for Lanes<N> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
}

impl<const N: usize> Sub for Lanes<N> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
}

impl<const N: usize> Mul for Lanes<N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
}

impl<const N: usize> Mul<f64> for Lanes<N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: f64) -> Self {
        self.map(|value| value * factor)
    }
}
