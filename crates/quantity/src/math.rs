//! Elementary functions with the same bits on every machine.
//!
//! Rust's `f64::sin` calls whatever the platform's C library offers; those differ in the last bit. `libm` is one
//! portable implementation. Everything outside this crate calls these; `clippy.toml` bans the methods of `f64`.

use core::f64::consts::{PI, TAU};

/// Sine of an angle in radians.
#[must_use]
pub fn sin(angle_rad: f64) -> f64 {
    libm::sin(angle_rad)
}

/// Cosine of an angle in radians.
#[must_use]
pub fn cos(angle_rad: f64) -> f64 {
    libm::cos(angle_rad)
}

/// Sine and cosine of an angle in radians.
#[must_use]
pub fn sin_cos(angle_rad: f64) -> (f64, f64) {
    libm::sincos(angle_rad)
}

/// Arc sine in radians; the argument is first brought into [-1, 1].
#[must_use]
pub fn asin(ratio: f64) -> f64 {
    libm::asin(ratio.clamp(-1.0, 1.0))
}

/// Arc cosine in radians; the argument is first brought into [-1, 1].
#[must_use]
pub fn acos(ratio: f64) -> f64 {
    libm::acos(ratio.clamp(-1.0, 1.0))
}

/// Angle of the point (x, y), in (-π, π].
#[must_use]
pub fn atan2(y: f64, x: f64) -> f64 {
    libm::atan2(y, x)
}

/// Square root.
#[must_use]
pub fn sqrt(value: f64) -> f64 {
    libm::sqrt(value)
}

/// e to a power.
#[must_use]
pub fn exp(exponent: f64) -> f64 {
    libm::exp(exponent)
}

/// Natural logarithm.
#[must_use]
pub fn ln(value: f64) -> f64 {
    libm::log(value)
}

/// Nearest integer, halves away from zero.
#[must_use]
pub fn round(value: f64) -> f64 {
    libm::round(value)
}

/// Greatest integer not above.
#[must_use]
pub fn floor(value: f64) -> f64 {
    libm::floor(value)
}

/// Least integer not below.
#[must_use]
pub fn ceil(value: f64) -> f64 {
    libm::ceil(value)
}

/// The same angle in (-π, π].
#[must_use]
pub fn wrap_pi(angle_rad: f64) -> f64 {
    let turned = angle_rad - TAU * libm::floor((angle_rad + PI) / TAU);
    if turned <= -PI { turned + TAU } else { turned }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrapping_keeps_the_angle_and_prefers_plus_pi() {
        assert_eq!(wrap_pi(PI), PI);
        assert_eq!(wrap_pi(-PI), PI);
        assert!((wrap_pi(4.0 * PI + 0.25) - 0.25).abs() < 1e-12);
        assert!((wrap_pi(-2.0 * PI - 0.25) + 0.25).abs() < 1e-12);
    }
}
