//! A flip's numbers as the vehicle stores them.

use crate::crc::fnv1a64;

/// Items in a [`FlipSet`].
pub const FLIP_SET_LEN: usize = 10;

/// Everything the vehicle's command generator needs to fly a flip, in the order of its items.
///
/// The vehicle computes what follows from these (Lupashin 2010, eqs. (15) to (22)) itself, so that a set
/// cannot contradict itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FlipSet {
    /// Collective acceleration of the first step, U1.
    pub u1_m_s2: f32,
    /// Duration of the first step, T1.
    pub t1_s: f32,
    /// Duration of the coast, T3.
    pub t3_s: f32,
    /// Collective acceleration of the last step, U5.
    pub u5_m_s2: f32,
    /// Duration of the last step, T5.
    pub t5_s: f32,
    /// Rate of the coast.
    pub rate_rad_s_max: f32,
    /// Lower end of the reduced control envelope.
    pub envelope_low_m_s2: f32,
    /// Upper end of the reduced control envelope.
    pub envelope_high_m_s2: f32,
    /// alpha times L: collective acceleration by angular acceleration.
    pub lever_m: f32,
    /// Whole turns; the command generator does not need them, whoever reads the store does.
    pub flips: f32,
}

impl FlipSet {
    /// The items as the link carries them.
    #[must_use]
    pub const fn to_items(&self) -> [f32; FLIP_SET_LEN] {
        [
            self.u1_m_s2,
            self.t1_s,
            self.t3_s,
            self.u5_m_s2,
            self.t5_s,
            self.rate_rad_s_max,
            self.envelope_low_m_s2,
            self.envelope_high_m_s2,
            self.lever_m,
            self.flips,
        ]
    }

    /// The set the items stand for.
    #[must_use]
    pub const fn from_items(items: &[f32; FLIP_SET_LEN]) -> Self {
        let [
            u1_m_s2,
            t1_s,
            t3_s,
            u5_m_s2,
            t5_s,
            rate_rad_s_max,
            envelope_low_m_s2,
            envelope_high_m_s2,
            lever_m,
            flips,
        ] = *items;
        Self {
            u1_m_s2,
            t1_s,
            t3_s,
            u5_m_s2,
            t5_s,
            rate_rad_s_max,
            envelope_low_m_s2,
            envelope_high_m_s2,
            lever_m,
            flips,
        }
    }

    /// What names this very set in uploads, starts and reports.
    #[must_use]
    pub fn digest(&self) -> u64 {
        digest_of(&self.to_items())
    }
}

/// FNV-1a-64 over the items' bytes, little-endian, as the link carries them.
#[must_use]
pub fn digest_of(items: &[f32]) -> u64 {
    fnv1a64(items.iter().flat_map(|item| item.to_le_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Worked out with a separate program.
    #[test]
    fn digest_of_a_double_flip_is_golden() {
        let set = FlipSet {
            u1_m_s2: 20.39544,
            t1_s: 0.16092,
            t3_s: 0.27833,
            u5_m_s2: 20.30911,
            t5_s: 0.18268,
            rate_rad_s_max: 27.925268,
            envelope_low_m_s2: 3.589744,
            envelope_high_m_s2: 21.025_64,
            lever_m: 0.057818,
            flips: 2.0,
        };
        assert_eq!(set.digest(), 0x38BE_C55C_D4C6_E0A3);
    }

    proptest! {
        #[test]
        fn items_round_trip(items: [f32; FLIP_SET_LEN]) {
            let back = FlipSet::from_items(&items).to_items();
            prop_assert_eq!(back.map(f32::to_bits), items.map(f32::to_bits));
        }
    }
}
