//! Physical quantities on channels of some bits.

use quantity::math;

use super::LinkError;

/// How a physical quantity lies on a channel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale {
    pub(super) low: f64,
    pub(super) high: f64,
    pub(super) step: f64,
    raw_max: u16,
    /// The raw value at which the quantity is `origin`.
    raw_origin: u16,
    origin: f64,
}

impl Scale {
    /// From minus to plus `limit`, zero exactly in the middle of 0 to `raw_max`, rounded up.
    pub(super) const fn two_sided(limit: f64, raw_max: u16) -> Self {
        let half = raw_max / 2;
        Self {
            low: -limit,
            high: limit,
            step: limit / half as f64,
            raw_max,
            raw_origin: half + 1,
            origin: 0.0,
        }
    }

    /// From `low` at raw 0 to `high` at `raw_max`.
    pub(super) const fn range(low: f64, high: f64, raw_max: u16) -> Self {
        Self { low, high, step: (high - low) / raw_max as f64, raw_max, raw_origin: 0, origin: low }
    }

    /// The nearest raw value; what lies outside the range goes to its end.
    pub(super) fn encode(self, value: f64) -> Result<u16, LinkError> {
        if !value.is_finite() {
            return Err(LinkError::NotFinite);
        }
        let steps = math::round((value.clamp(self.low, self.high) - self.origin) / self.step);
        Ok((steps + f64::from(self.raw_origin)).clamp(0.0, f64::from(self.raw_max)) as u16)
    }

    pub(super) fn decode(self, raw: u16) -> f64 {
        (self.origin + (f64::from(raw) - f64::from(self.raw_origin)) * self.step).clamp(self.low, self.high)
    }
}
