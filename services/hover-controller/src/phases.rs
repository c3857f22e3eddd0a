//! On the ground, taking off, flying, landing: which phase a vehicle is in, and what it aims at there.

use quantity::{Span, Time, Vector, World};
use schemas::{Kinematics, VehicleGoal};

use crate::tuning::PhaseTuning;

/// What is wanted of a vehicle just now.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Wish {
    /// Nothing was said yet: hold where it is.
    Hold,
    /// On the floor, motors off; in the air, land.
    Ground,
    /// At a goal.
    Hover(VehicleGoal),
    /// Down, above this spot; above where it is where there is none.
    Land(Option<Vector<World>>),
}

/// Where a vehicle is between floor and sky.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Phase {
    /// Not yet seen: nothing is said to it.
    Unknown,
    /// On the floor, motors off.
    Ground {
        /// Since when.
        since: Time,
        /// No take-off before.
        ready_at: Time,
    },
    /// Collective rising, still on the floor.
    SpinUp {
        /// Since when.
        since: Time,
        /// Where it stood.
        from: Vector<World>,
    },
    /// Climbing straight up.
    Climb {
        /// Since when.
        since: Time,
        /// Where it stood.
        from: Vector<World>,
    },
    /// At or on its way to a place.
    Fly {
        /// Where it was when this began: held while there is no goal.
        hold: Vector<World>,
        /// Heading then.
        heading_rad: f64,
    },
    /// On its way down.
    Land {
        /// Above which spot.
        spot: Vector<World>,
        /// Standing still low down since.
        standing_since: Option<Time>,
    },
}

/// A change of phase worth telling.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Turn {
    /// The motors start.
    TookOff,
    /// The motors turned, but the vehicle stayed on the floor.
    TakeOffFailed,
    /// A landing begins.
    Landing,
    /// The motors stop on the floor.
    Landed,
    /// The vehicle stopped its motors by itself.
    MotorsOff,
}

impl Turn {
    /// The name of its event.
    pub fn name(self) -> &'static str {
        match self {
            Self::TookOff => "take-off",
            Self::TakeOffFailed => "take-off-failed",
            Self::Landing => "landing",
            Self::Landed => "landed",
            Self::MotorsOff => "motors-off",
        }
    }
}

/// What a phase must know to go on to the next.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Situation<'a> {
    /// Now.
    pub now: Time,
    /// The vehicle.
    pub state: &'a Kinematics,
    /// What is wanted.
    pub wish: &'a Wish,
    /// Whether a take-off may begin.
    pub may_take_off: bool,
    /// Whether the motors turn, if the vehicle said so lately.
    pub motors_on: Option<bool>,
}

/// A vehicle that moves faster does not stand.
const STANDING_SPEED_M_S: f64 = 0.15;

impl Phase {
    /// Goes on to the phase the situation asks for; what that turn was, if it is worth telling.
    pub fn advance(&mut self, tuning: &PhaseTuning, situation: &Situation<'_>) -> Option<Turn> {
        let before = *self;
        let (next, turn) = before.next(tuning, situation);
        *self = next;
        turn
    }

    fn next(self, tuning: &PhaseTuning, situation: &Situation<'_>) -> (Self, Option<Turn>) {
        let Situation { now, state, wish, .. } = *situation;
        let position = state.position_m;
        let flying = Self::Fly { hold: position, heading_rad: state.orientation.yaw_rad() };
        match self {
            Self::Unknown if position.z > tuning.airborne_height_m => (flying, None),
            Self::Unknown => (Self::ground(now, now), None),
            Self::Ground { since, ready_at } => {
                let rested = now - since >= Span::from_secs_f64(tuning.ground_s_min);
                let still = state.velocity_m_s.norm() < 0.2 && state.orientation.z_axis().z > 0.9;
                if matches!(wish, Wish::Hover(_))
                    && situation.may_take_off
                    && rested
                    && still
                    && now >= ready_at
                {
                    (Self::SpinUp { since: now, from: position }, Some(Turn::TookOff))
                } else if position.z > tuning.airborne_height_m && situation.motors_on == Some(true) {
                    // Not on the ground after all. Without the vehicle's word for it, somebody is carrying
                    // it.
                    (flying, None)
                } else {
                    (self, None)
                }
            }
            Self::SpinUp { since, from } => {
                if position.z > from.z + tuning.lift_off_m {
                    (Self::Climb { since: now, from }, None)
                } else if !matches!(wish, Wish::Hover(_)) {
                    (Self::ground(now, now), Some(Turn::Landed))
                } else if now - since > Span::from_secs_f64(tuning.spin_up_s_max) {
                    (Self::ground(now, now + Span::from_secs_f64(tuning.retry_s)), Some(Turn::TakeOffFailed))
                } else {
                    (self, None)
                }
            }
            _ if situation.motors_on == Some(false) => (Self::ground(now, now), Some(Turn::MotorsOff)),
            Self::Climb { from, .. } => match Self::landing(wish, position) {
                Some(landing) => (landing, Some(Turn::Landing)),
                None if position.z > from.z + tuning.take_off_height_m => (flying, None),
                None => (self, None),
            },
            Self::Fly { .. } => match Self::landing(wish, position) {
                Some(landing) => (landing, Some(Turn::Landing)),
                None => (self, None),
            },
            Self::Land { spot, standing_since } => {
                Self::land(tuning, situation, spot, standing_since, flying)
            }
        }
    }

    fn ground(since: Time, ready_at: Time) -> Self {
        Self::Ground { since, ready_at }
    }

    fn landing(wish: &Wish, position: Vector<World>) -> Option<Self> {
        match wish {
            Wish::Hold | Wish::Hover(_) => None,
            Wish::Ground | Wish::Land(None) => Some(Self::Land { spot: position, standing_since: None }),
            Wish::Land(Some(spot)) => Some(Self::Land { spot: *spot, standing_since: None }),
        }
    }

    fn land(
        tuning: &PhaseTuning,
        situation: &Situation<'_>,
        spot: Vector<World>,
        standing_since: Option<Time>,
        flying: Self,
    ) -> (Self, Option<Turn>) {
        let Situation { now, state, wish, .. } = *situation;
        let height = state.position_m.z;
        if matches!(wish, Wish::Hover(_)) && height > tuning.airborne_height_m {
            return (flying, None);
        }
        let spot = if let Wish::Land(Some(spot)) = wish { *spot } else { spot };
        let standing = height < tuning.standing_height_m && state.velocity_m_s.norm() < STANDING_SPEED_M_S;
        let standing_since = standing.then(|| standing_since.unwrap_or(now));
        if standing_since.is_some_and(|since| now - since >= Span::from_secs_f64(tuning.touchdown_s)) {
            return (Self::ground(now, now), Some(Turn::Landed));
        }
        (Self::Land { spot, standing_since }, None)
    }

    /// Whether the motors shall be off.
    pub fn is_on_ground(&self) -> bool {
        matches!(self, Self::Ground { .. })
    }

    /// Whether anything may be said to the vehicle at all.
    pub fn is_known(&self) -> bool {
        !matches!(self, Self::Unknown)
    }
}

#[cfg(test)]
mod tests {
    use schemas::GoalKind;

    use super::*;

    fn at(height_m: f64) -> Kinematics {
        Kinematics { position_m: Vector::new(1.0, 0.0, height_m), ..Kinematics::default() }
    }

    fn ms(ms: i64) -> Time {
        Time::from_nanos(ms * 1_000_000)
    }

    fn step(phase: &mut Phase, now_ms: i64, height_m: f64, wish: Wish) -> Option<Turn> {
        let state = at(height_m);
        let situation =
            Situation { now: ms(now_ms), state: &state, wish: &wish, may_take_off: true, motors_on: None };
        phase.advance(&PhaseTuning::default(), &situation)
    }

    const HOVER: Wish = Wish::Hover(VehicleGoal {
        vehicle: 1,
        kind: GoalKind::Hover,
        position_m: Vector::new(0.0, 0.0, 4.0),
        velocity_m_s: Vector::ZERO,
        acceleration_m_s2: Vector::ZERO,
        heading_rad: 0.0,
    });

    #[test]
    fn up_and_down() {
        let mut phase = Phase::Unknown;
        assert_eq!(step(&mut phase, 0, 0.04, Wish::Hold), None);
        assert!(phase.is_on_ground());
        assert_eq!(step(&mut phase, 200, 0.04, HOVER), None, "commands to stay off come first");
        assert_eq!(step(&mut phase, 300, 0.04, HOVER), Some(Turn::TookOff));
        assert_eq!(step(&mut phase, 800, 0.04, HOVER), None);
        step(&mut phase, 900, 0.09, HOVER);
        assert!(matches!(phase, Phase::Climb { .. }));
        step(&mut phase, 1900, 0.9, HOVER);
        assert!(matches!(phase, Phase::Fly { .. }));
        assert_eq!(step(&mut phase, 5000, 4.0, Wish::Land(None)), Some(Turn::Landing));
        assert_eq!(step(&mut phase, 9000, 0.05, Wish::Land(None)), None);
        assert_eq!(step(&mut phase, 9149, 0.05, Wish::Land(None)), None);
        assert_eq!(step(&mut phase, 9150, 0.05, Wish::Land(None)), Some(Turn::Landed));
    }

    #[test]
    fn a_vehicle_that_stays_down_is_left_alone_for_a_while() {
        let mut phase = Phase::Ground { since: ms(0), ready_at: ms(0) };
        step(&mut phase, 300, 0.04, HOVER);
        assert_eq!(step(&mut phase, 1501, 0.04, HOVER), Some(Turn::TakeOffFailed));
        assert_eq!(step(&mut phase, 4500, 0.04, HOVER), None);
        assert_eq!(step(&mut phase, 4501, 0.04, HOVER), Some(Turn::TookOff));
    }

    #[test]
    fn a_restart_in_the_air_holds() {
        let mut phase = Phase::Unknown;
        step(&mut phase, 0, 3.0, Wish::Hold);
        assert!(matches!(phase, Phase::Fly { hold, .. } if hold.z == 3.0));
    }

    #[test]
    fn a_carried_vehicle_stays_off() {
        let mut phase = Phase::Ground { since: ms(0), ready_at: ms(9000) };
        step(&mut phase, 1000, 1.2, HOVER);
        assert!(phase.is_on_ground());
        let state = at(1.2);
        let situation = Situation {
            now: ms(1010),
            state: &state,
            wish: &HOVER,
            may_take_off: true,
            motors_on: Some(true),
        };
        phase.advance(&PhaseTuning::default(), &situation);
        assert!(matches!(phase, Phase::Fly { .. }), "its motors turn: it flies");
    }

    #[test]
    fn a_new_goal_ends_a_landing_only_in_the_air() {
        let landing = Phase::Land { spot: Vector::ZERO, standing_since: None };
        let mut phase = landing;
        step(&mut phase, 0, 2.0, HOVER);
        assert!(matches!(phase, Phase::Fly { .. }));
        let mut phase = landing;
        step(&mut phase, 0, 0.2, HOVER);
        assert!(matches!(phase, Phase::Land { .. }));
    }
}
