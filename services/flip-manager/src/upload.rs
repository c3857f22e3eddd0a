//! The parameter set as the link carries it, and the identities of sets and maneuvers.

use device::vehicle_link::digest_of;
use schemas::{ManeuverParameters, ManeuverUpload};

/// No flip lasts longer: a guard against numbers that are none.
const DURATION_S_MAX: f64 = 10.0;

/// The learner's parameters in the link's precision, with their digest; `None` where they are no flip at all.
///
/// Whether they are a *safe* flip is the learner's check before, and the vehicle's own after.
pub(crate) fn upload(parameters: &ManeuverParameters, set_id: u16) -> Option<ManeuverUpload> {
    let flip = &parameters.parameters;
    let items = [
        flip.u1_m_s2,
        flip.t1_s,
        flip.t3_s,
        flip.u5_m_s2,
        flip.t5_s,
        parameters.rate_rad_s_max,
        parameters.envelope_low_m_s2,
        parameters.envelope_high_m_s2,
        parameters.lever_m,
        f64::from(parameters.flips),
    ]
    .map(|item| item as f32);
    let lasts = parameters.duration_s > 0.0 && parameters.duration_s <= DURATION_S_MAX;
    if !lasts || !items.iter().all(|item| item.is_finite() && *item > 0.0) {
        return None;
    }
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
        _,
    ] = items;
    Some(ManeuverUpload {
        vehicle: parameters.vehicle,
        flips: parameters.flips,
        set_id,
        digest: digest_of(&items),
        u1_m_s2,
        t1_s,
        t3_s,
        u5_m_s2,
        t5_s,
        rate_rad_s_max,
        envelope_low_m_s2,
        envelope_high_m_s2,
        lever_m,
    })
}

/// Identities that rise, pass over zero, and stay ahead of what the vehicle reports from before a restart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Identities {
    last: u16,
}

impl Identities {
    /// Each start of this service gets a range of its own.
    pub(crate) fn new(incarnation: u32) -> Self {
        Self { last: (incarnation as u16).wrapping_mul(1024) }
    }

    /// A new identity, later than every one given before and than the one reported.
    pub(crate) fn next(&mut self, reported: Option<u16>) -> u16 {
        if let Some(reported) = reported {
            // Serial-number arithmetic, as the vehicle does it: behind means by less than half the range.
            let ahead_by = reported.wrapping_sub(self.last);
            if (1..=0x8000).contains(&ahead_by) {
                self.last = reported;
            }
        }
        self.last = match self.last.wrapping_add(1) {
            0 => 1,
            id => id,
        };
        self.last
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use schemas::FlipParameters;

    fn parameters() -> ManeuverParameters {
        ManeuverParameters {
            vehicle: 1,
            flips: 2,
            parameters: FlipParameters {
                u1_m_s2: 20.39544,
                t1_s: 0.16092,
                t3_s: 0.27833,
                u5_m_s2: 20.30911,
                t5_s: 0.18268,
            },
            rate_rad_s_max: 27.925268,
            envelope_low_m_s2: 3.589744,
            envelope_high_m_s2: 21.025641,
            lever_m: 0.057818,
            duration_s: 1.019,
            ..ManeuverParameters::default()
        }
    }

    #[test]
    fn the_digest_is_the_links_own() {
        // Computed apart from this code: FNV-1a-64 of struct.pack("<10f", ...).
        assert_eq!(upload(&parameters(), 7).unwrap().digest, 0x38BE_C55C_D4C6_E0A3);
    }

    #[test]
    fn what_is_no_flip_is_not_uploaded() {
        let mut wrong = parameters();
        wrong.parameters.t3_s = f64::NAN;
        assert_eq!(upload(&wrong, 1), None);
        wrong.parameters.t3_s = 1e39;
        assert_eq!(upload(&wrong, 1), None, "finite here, infinite on the link");
        wrong.parameters.t3_s = -0.1;
        assert_eq!(upload(&wrong, 1), None);
        assert_eq!(upload(&ManeuverParameters { flips: 0, ..parameters() }, 1), None);
    }

    #[test]
    fn identities_rise_and_stay_ahead_of_the_vehicle() {
        let mut ids = Identities::new(1);
        assert_eq!(ids.next(None), 1025);
        assert_eq!(ids.next(Some(1000)), 1026);
        assert_eq!(ids.next(Some(2000)), 2001);
        let mut opposite = Identities { last: 0x1000 };
        assert_eq!(opposite.next(Some(0x9000)), 0x9001, "the vehicle must see it as ahead");
        let mut wrapping = Identities { last: 0xFFFF };
        assert_eq!(wrapping.next(None), 1);
        let mut near_the_end = Identities { last: 0xFFF0 };
        assert_eq!(near_the_end.next(Some(3)), 4);
    }
}
