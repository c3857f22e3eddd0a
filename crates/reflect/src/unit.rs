//! Units, as they stand at the end of a field's name: `<quantity>_<unit>[_<qualifier>]`.

use core::fmt;

/// A unit that a field's name can carry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unit {
    /// As in a name: `m_s2`.
    pub suffix: &'static str,
    /// As for people: `m/s²`.
    pub symbol: &'static str,
}

const fn unit(suffix: &'static str, symbol: &'static str) -> Unit {
    Unit { suffix, symbol }
}

/// Every known unit. SI only: degrees, g and millimetres end at the bridges.
pub const UNITS: &[Unit] = &[
    unit("m", "m"),
    unit("m2", "m²"),
    unit("m_s", "m/s"),
    unit("m_s2", "m/s²"),
    unit("m_s3", "m/s³"),
    unit("rad", "rad"),
    unit("rad_s", "rad/s"),
    unit("rad_s2", "rad/s²"),
    unit("s", "s"),
    unit("ms", "ms"),
    unit("us", "µs"),
    unit("ns", "ns"),
    unit("hz", "Hz"),
    unit("1_s", "1/s"),
    unit("1_s2", "1/s²"),
    unit("kg", "kg"),
    unit("kg_m2", "kg·m²"),
    unit("n", "N"),
    unit("n_m", "N·m"),
    unit("v", "V"),
    unit("a", "A"),
    unit("ohm", "Ω"),
    unit("w", "W"),
    unit("j", "J"),
    unit("k", "K"),
    unit("pa", "Pa"),
    unit("dbm", "dBm"),
    unit("ratio", "ratio"),
];

/// What may follow the unit.
const QUALIFIERS: &[&str] = &["min", "max", "mean", "median", "std", "rms", "p99"];

/// Units that are not SI: before a unit they make another one (`rate_deg_s`), which is refused.
const FOREIGN: &[&str] = &["deg", "mm", "cm", "km", "g", "rpm", "mah"];

impl Unit {
    /// The unit in a field's name: the longest that fits, so `speed_m_s` is metres per second, not seconds.
    /// `None` too where a further unit stands before it, known or foreign: `rate_deg_s` is no rate in
    /// seconds.
    #[must_use]
    pub const fn of_field(name: &str) -> Option<Self> {
        let name = without_qualifier(name.as_bytes());
        let mut best: Option<(Self, usize)> = None;
        let mut i = 0;
        while i < UNITS.len() {
            if let Some(stem) = stem_length(name, UNITS[i].suffix.as_bytes()) {
                let longer = match best {
                    Some((_, best_stem)) => stem < best_stem,
                    None => true,
                };
                if longer {
                    best = Some((UNITS[i], stem));
                }
            }
            i += 1;
        }
        match best {
            Some((unit, stem)) if !ends_in_unit(name.split_at(stem).0) => Some(unit),
            _ => None,
        }
    }
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.symbol)
    }
}

const fn without_qualifier(name: &[u8]) -> &[u8] {
    let mut i = 0;
    while i < QUALIFIERS.len() {
        if let Some(length) = stem_length(name, QUALIFIERS[i].as_bytes()) {
            return name.split_at(length).0;
        }
        i += 1;
    }
    name
}

const fn ends_in_unit(stem: &[u8]) -> bool {
    let mut i = 0;
    while i < UNITS.len() {
        if stem_length(stem, UNITS[i].suffix.as_bytes()).is_some() {
            return true;
        }
        i += 1;
    }
    let mut i = 0;
    while i < FOREIGN.len() {
        if stem_length(stem, FOREIGN[i].as_bytes()).is_some() {
            return true;
        }
        i += 1;
    }
    false
}

/// The length of what stands before `_` and `suffix` at the end of `name`; nothing before them is no match.
const fn stem_length(name: &[u8], suffix: &[u8]) -> Option<usize> {
    let Some(stem) = name.len().checked_sub(suffix.len() + 1) else {
        return None;
    };
    if stem == 0 || name[stem] != b'_' {
        return None;
    }
    let mut i = 0;
    while i < suffix.len() {
        if name[stem + 1 + i] != suffix[i] {
            return None;
        }
        i += 1;
    }
    Some(stem)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn suffix(name: &str) -> Option<&'static str> {
        Unit::of_field(name).map(|unit| unit.suffix)
    }

    #[test]
    fn the_longest_unit_wins() {
        assert_eq!(suffix("speed_m_s"), Some("m_s"));
        assert_eq!(suffix("torque_n_m"), Some("n_m"));
        assert_eq!(suffix("rotor_gain_up_1_s"), Some("1_s"));
        assert_eq!(suffix("u1_m_s2"), Some("m_s2"));
    }

    #[test]
    fn a_qualifier_may_follow() {
        assert_eq!(suffix("rate_rad_s_max"), Some("rad_s"));
        assert_eq!(suffix("thrust_n_min"), Some("n"));
    }

    #[test]
    fn a_name_without_quantity_or_unit_has_none() {
        for name in ["", "m", "_m", "max", "speed", "speed_kmh", "speed_max", "positionm", "height_mm"] {
            assert_eq!(suffix(name), None, "{name}");
        }
    }

    #[test]
    fn a_unit_before_the_unit_is_refused() {
        for name in ["rate_deg_s", "speed_km_s", "impulse_n_s", "rate_deg_s_max"] {
            assert_eq!(suffix(name), None, "{name}");
        }
        assert_eq!(suffix("m_s"), Some("s"), "a quantity may be called m");
    }
}
