//! What is known of one vehicle: its fixed points, what was heard of it, and what it is about.

use quantity::{Span, Time, Vector, World};
use schemas::{
    FlightMode, FlipPhase, ManeuverParameters, ManeuverPhase, ManeuverResult, ManeuverUpload, MocapBody,
    Tracking, VehicleState, VehicleTelemetry,
};
use settings::{Battery, FleetVehicle, Hall};

use crate::battery::{Load, RestVoltage};
use crate::gate::{Situation, Unmet, age_s};
use crate::goals::Goals;
use crate::phases::Phase;
use crate::poses::{Pose, Poses};
use crate::tuning::Tuning;
use crate::upload::Identities;

/// A flip that has been uploaded, perhaps started.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Attempt {
    /// What the learner asked for.
    pub(crate) parameters: ManeuverParameters,
    /// The set as the link carries it.
    pub(crate) upload: ManeuverUpload,
    /// The vehicle's identity for it; `None` before a start was sent.
    pub(crate) maneuver_id: Option<u16>,
    /// Battery voltage at rest before it.
    pub(crate) battery_v: f64,
}

/// Everything about one vehicle.
#[derive(Clone, Debug)]
pub(crate) struct Vehicle {
    /// Its number.
    pub(crate) id: u8,
    /// Whether it flies flips: in a scenario without one, and if it is a Crazyflie, it only hovers.
    pub(crate) flips: bool,
    /// Its places.
    pub(crate) goals: Goals,
    /// Its battery's limits.
    pub(crate) battery: Battery,
    /// Newest word of the estimator.
    pub(crate) state: Option<VehicleState>,
    /// Since when it is tracked without a break.
    pub(crate) tracked_since: Option<Time>,
    /// Newest word of the estimator that could be flown on.
    pub(crate) last_valid: Option<VehicleState>,
    /// Newest report of the vehicle.
    pub(crate) telemetry: Option<VehicleTelemetry>,
    /// What the cameras saw.
    pub(crate) poses: Poses,
    /// Its battery.
    pub(crate) rest: RestVoltage,
    /// What is being done with it.
    pub(crate) phase: Phase,
    /// Since when it waits for its next flip.
    pub(crate) waiting_since: Time,
    /// Since when place, speed, tilt, rate and data age hold.
    pub(crate) steady_since: Option<Time>,
    /// What is missing for a flip.
    pub(crate) unmet: Unmet,
    /// Whether it has flown since it last left [`Phase::Idle`].
    pub(crate) has_flown: bool,
    /// The learner's newest parameters.
    pub(crate) next: Option<ManeuverParameters>,
    /// The flip being prepared, flown or measured.
    pub(crate) attempt: Option<Attempt>,
    /// The last result, until the learner has answered it, and when it was last said.
    pub(crate) unanswered: Option<(ManeuverResult, Time)>,
    /// Results with an iteration below this are history.
    pub(crate) iteration_min: u32,
    /// Identities of parameter sets.
    pub(crate) set_ids: Identities,
    /// Identities of maneuvers.
    pub(crate) maneuver_ids: Identities,
    /// When a take-off was last refused.
    pub(crate) refused_at: Option<Time>,
    /// When goal and status were last said, and the phase they said.
    pub(crate) spoke: Option<(Time, FlipPhase)>,
}

/// Two estimates further apart are no unbroken tracking.
const TRACKING_GAP_MAX: Span = Span::from_millis(100);
/// A vehicle lower than this may stand on the floor.
const AIRBORNE_M: f64 = 0.3;

impl Vehicle {
    pub(crate) fn new(
        member: &FleetVehicle,
        flips: bool,
        tuning: &Tuning,
        now: Time,
        incarnation: u32,
    ) -> Self {
        Self {
            id: member.vehicle.id,
            flips,
            goals: Goals::new(member),
            battery: member.vehicle.battery.clone(),
            state: None,
            tracked_since: None,
            last_valid: None,
            telemetry: None,
            poses: Poses::new(tuning.measure.history_s),
            rest: RestVoltage::default(),
            phase: Phase::Idle,
            waiting_since: now,
            steady_since: None,
            unmet: Unmet(u16::MAX),
            has_flown: false,
            next: None,
            attempt: None,
            unanswered: None,
            iteration_min: 0,
            set_ids: Identities::new(incarnation),
            maneuver_ids: Identities::new(incarnation),
            refused_at: None,
            spoke: None,
        }
    }

    pub(crate) fn hear_pose(&mut self, at: Time, body: &MocapBody) {
        if body.position_m.is_finite() && body.orientation.is_finite() {
            self.poses.push(Pose { at, position_m: body.position_m, orientation: body.orientation });
        }
    }

    /// Takes an estimate. A stamp from the future counts as of now: nothing is younger than its arrival.
    pub(crate) fn hear_state(&mut self, now: Time, mut state: VehicleState) {
        state.estimated_for = state.estimated_for.min(now);
        let unbroken =
            self.state.is_none_or(|last| state.estimated_for - last.estimated_for <= TRACKING_GAP_MAX);
        self.tracked_since = match state.tracking {
            Tracking::Tracking if unbroken => self.tracked_since.or(Some(now)),
            Tracking::Tracking => Some(now),
            Tracking::Coasting | Tracking::Ballistic | Tracking::Invalid => None,
        };
        if state.tracking != Tracking::Invalid {
            self.last_valid = Some(state);
        }
        self.state = Some(state);
    }

    /// Takes a report; one older than the newest is not taken.
    pub(crate) fn hear_telemetry(&mut self, now: Time, mut report: VehicleTelemetry, tuning: &Tuning) {
        report.received_at = report.received_at.min(now);
        if self.telemetry.is_some_and(|newest| newest.received_at > report.received_at) {
            return;
        }
        let load = Load::of(report.mode, self.hovers());
        self.rest.take(report.received_at, report.battery_v, load, &self.battery, &tuning.battery);
        self.telemetry = Some(report);
    }

    /// Takes the learner's word. Parameters for a flip whose result the learner has yet to hear are history.
    pub(crate) fn hear_parameters(&mut self, parameters: ManeuverParameters) {
        if parameters.iteration < self.iteration_min {
            return;
        }
        self.unanswered = None;
        self.next = Some(parameters);
    }

    /// Slow and level enough for the battery to show a hover's load.
    fn hovers(&self) -> bool {
        self.state.is_some_and(|state| {
            state.tracking == Tracking::Tracking
                && state.estimate.velocity_m_s.norm() < 0.5
                && state.estimate.orientation.tilt_rad() < 0.2
        })
    }

    /// A report young enough to act on.
    pub(crate) fn fresh_telemetry(&self, now: Time, tuning: &Tuning) -> Option<&VehicleTelemetry> {
        self.telemetry
            .as_ref()
            .filter(|report| age_s(now, report.received_at) < tuning.gate.telemetry_age_s_max)
    }

    /// Motors off, by the vehicle's own fresh word.
    pub(crate) fn is_down(&self, now: Time, tuning: &Tuning) -> bool {
        self.fresh_telemetry(now, tuning).is_some_and(|report| {
            matches!(report.mode, FlightMode::Disarmed | FlightMode::Landed | FlightMode::Stopped)
        })
    }

    /// Off the floor, as far as anyone saw.
    pub(crate) fn is_high(&self) -> bool {
        self.last_valid.is_some_and(|state| state.estimate.position_m.z > AIRBORNE_M)
    }

    /// Where it was last seen; `None` for a vehicle that was never seen and is not known to fly.
    ///
    /// One that flies unseen is reported as an error: it may be anywhere.
    pub(crate) fn whereabouts(&self, now: Time, tuning: &Tuning) -> Result<Option<Vector<World>>, Unseen> {
        let seen = self.last_valid.map(|state| (state.estimated_for, state.estimate.position_m));
        let recently = seen.is_some_and(|(at, _)| age_s(now, at) < tuning.gate.telemetry_age_s_max);
        let flies = self.telemetry.is_some() && self.has_flown && !self.is_down(now, tuning);
        if flies && !recently { Err(Unseen) } else { Ok(seen.map(|(_, position_m)| position_m)) }
    }

    /// The last report that speaks of the flip being attempted.
    pub(crate) fn news(&self) -> Option<&VehicleTelemetry> {
        let id = self.attempt.as_ref()?.maneuver_id?;
        self.telemetry
            .as_ref()
            .filter(|report| report.maneuver_id == id && report.maneuver_phase != ManeuverPhase::None)
    }

    /// Looks again at what a flip needs.
    pub(crate) fn assess(&mut self, now: Time, hall: &Hall, nearest_m: f64, tuning: &Tuning) {
        let situation = Situation {
            now,
            state: self.state.as_ref(),
            telemetry: self.telemetry.as_ref(),
            place_m: self.goals.place_m,
            heading_rad: self.goals.heading_rad,
            hall,
            nearest_m,
            rest_v: self.rest.volts(),
            flip_v_min: self.battery.flip_v_min,
            height_loss_m: self.next.as_ref().map(|parameters| parameters.height_loss_m),
        };
        self.unmet = tuning.gate.unmet(&situation);
        self.steady_since =
            if self.unmet.is_steady() { Some(self.steady_since.unwrap_or(now)) } else { None };
    }

    /// Tracked without a break for as long as a take-off asks, up to now.
    pub(crate) fn is_well_tracked(&self, now: Time, tuning: &Tuning) -> bool {
        let span = Span::from_secs_f64(tuning.timing.tracked_s_min);
        let fresh = self.state.is_some_and(|state| now - state.estimated_for <= TRACKING_GAP_MAX);
        fresh && self.tracked_since.is_some_and(|since| now - since >= span)
    }

    /// Steady for as long as the gate asks.
    pub(crate) fn is_settled(&self, now: Time, tuning: &Tuning) -> bool {
        self.steady_since.is_some_and(|since| now - since >= Span::from_secs_f64(tuning.gate.steady_s))
    }
}

/// A vehicle flies and nobody sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Unseen;
