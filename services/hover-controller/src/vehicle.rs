//! Everything the controller knows of one vehicle, and what it commands.

use quantity::{Body, Rotation, Span, Time, Vector, World};
use schemas::{
    CommandMode, GoalKind, Kinematics, Severity, Tracking, VehicleCommand, VehicleGoal, VehicleState,
    VehicleTelemetry,
};
use service_core::Outbox;
use settings::{Arena, FleetVehicle, Hall};

use crate::Output;
use crate::attitude::rates;
use crate::phases::{Phase, Situation, Wish};
use crate::position::{Manner, PositionLoop, Target, Thrust, thrust};
use crate::reports::Reports;
use crate::safety::{DeadReckoning, Trust, Watch, is_within};
use crate::tuning::Tuning;

/// A report counts as one of the flight only if it came so long after the flight began.
const REPORT_LAG: Span = Span::from_millis(200);
/// Longest time between two states that the loops integrate over.
const STEP_S_MAX: f64 = 0.05;
/// A vehicle being caught counts as caught below these parts of the limits above which it must be.
const CAUGHT_RATIO: f64 = 0.5;
/// Tilt allowed close to the floor.
const LOW_TILT_RAD: f64 = 0.25;
/// Descent by itself: what is sent along is flown by nobody.
const DESCENT_RATIO: f64 = 0.95;
/// A goal with a greater number in it is a mistake.
const GOAL_MAX: f64 = 1e3;
/// Places are kept so far from the floor.
const FLOOR_MARGIN_M: f64 = 0.3;

/// What one command asks, apart from whom and for how long.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Ask {
    mode: CommandMode,
    collective_m_s2: f64,
    rate_rad_s: Vector<Body>,
}

/// One vehicle's controller.
#[derive(Clone, Debug)]
pub(crate) struct VehicleController {
    id: u8,
    lease_epoch: u32,
    tuning: Tuning,
    hall: Hall,
    phase: Phase,
    airborne_since: Time,
    goal: Option<(VehicleGoal, Time)>,
    reports: Reports,
    watch: Watch,
    trust: Trust,
    position: PositionLoop,
    reckoning: Option<DeadReckoning>,
    recovering: bool,
    stepped_at: Time,
    /// The newest of the states that commands rest on.
    frame_received_at: Time,
    blind_at: Option<Time>,
}

impl VehicleController {
    /// Knows nothing of the vehicle but its settings; commands under the lease `lease_epoch`.
    pub fn new(arena: &Arena, member: &FleetVehicle, tuning: &Tuning, lease_epoch: u32, now: Time) -> Self {
        let safety = &tuning.safety;
        Self {
            id: member.vehicle.id,
            lease_epoch,
            hall: arena.hall.clone(),
            phase: Phase::Unknown,
            airborne_since: now,
            goal: None,
            reports: Reports::new(
                Span::from_secs_f64(safety.telemetry_s_max),
                Span::from_secs_f64(safety.maneuver_s_max),
                tuning.phases.battery_time_s,
                member.vehicle.battery.hover_sag_v,
                member.vehicle.battery.land_v_min,
            ),
            watch: Watch::new(safety),
            trust: Trust::State,
            position: PositionLoop::default(),
            reckoning: None,
            recovering: false,
            stepped_at: now,
            frame_received_at: Time::ZERO,
            blind_at: None,
            tuning: tuning.clone(),
        }
    }

    /// When a command is due although no state has come.
    pub fn blind_at(&self) -> Option<Time> {
        self.blind_at
    }

    /// Takes note of where the vehicle shall be.
    pub fn goal(&mut self, now: Time, goal: &VehicleGoal) {
        let usable = is_within(goal.position_m, GOAL_MAX)
            && is_within(goal.velocity_m_s, GOAL_MAX)
            && is_within(goal.acceleration_m_s2, GOAL_MAX)
            && goal.heading_rad.abs() <= GOAL_MAX;
        if usable {
            self.goal = Some((*goal, now));
        }
    }

    /// Takes note of the vehicle's report.
    pub fn telemetry(&mut self, now: Time, telemetry: &VehicleTelemetry, out: &mut Outbox<Output>) {
        let low_before = self.reports.battery_low();
        self.reports.take(now, telemetry);
        if self.reports.battery_low() && !low_before {
            let detail = format!("{:.2} V under load", telemetry.battery_v);
            out.event(now, Severity::Warning, self.id, "battery-low", &detail);
        }
    }

    /// Answers a state with a command.
    pub fn state(&mut self, now: Time, state: &VehicleState, out: &mut Outbox<Output>) {
        let lost = self.watch.trust(now) != Trust::State && self.trust == Trust::Descend;
        if !self.watch.take(now, state) {
            if self.phase.is_known() && self.watch.trust(now) != Trust::State {
                self.blind(now, out);
            }
            return;
        }
        if lost && !self.phase.is_on_ground() {
            // It descended by itself, and may be anywhere by now, even on the floor.
            self.phase = Phase::Unknown;
        }
        self.note_trust(now, Trust::State, out);
        self.frame_received_at = state.frame_received_at;
        let span_s = (now - self.stepped_at).as_secs_f64().clamp(0.0, STEP_S_MAX);
        self.stepped_at = now;
        let k = &state.prediction;
        let wish = self.wish(now);
        let in_maneuver = state.tracking == Tracking::Ballistic || self.reports.in_maneuver(now);
        // A maneuver is no change of phase; but whoever starts anew must first learn that it is in the air.
        if !in_maneuver || !self.phase.is_known() {
            self.advance_phase(now, k, &wish, out);
        }
        let ask = self.fly(now, state, &wish, in_maneuver, span_s);
        let mut reckoning = DeadReckoning::from_state(state);
        reckoning.told(ask.rate_rad_s);
        self.reckoning = Some(reckoning);
        let valid_until = state.valid_until.min(now + Span::from_secs_f64(self.tuning.safety.command_s));
        self.publish(ask, valid_until, k.orientation, (k.position_m.z, k.velocity_m_s.z), out);
        // One nanosecond later the state is too old.
        self.blind_at = self.watch.level_at().map(|at| at + Span::from_nanos(1));
    }

    /// Commands without a state to go by.
    pub fn blind(&mut self, now: Time, out: &mut Outbox<Output>) {
        if self.reports.motors_on(now, self.airborne_since + REPORT_LAG) == Some(false)
            && self.phase.is_known()
        {
            self.phase = match self.phase {
                Phase::Ground { .. } => self.phase,
                _ => Phase::Ground { since: now, ready_at: now },
            };
        }
        let trust = self.watch.trust(now);
        self.note_trust(now, trust, out);
        let ask = match trust {
            _ if self.phase.is_on_ground() => Ask::OFF,
            Trust::State | Trust::Level => self.level(now),
            Trust::Descend => self.descend(now),
        };
        let valid_until = now + Span::from_secs_f64(self.tuning.safety.command_s);
        let (orientation, vertical) = match &self.reckoning {
            Some(r) => (r.orientation, (r.height_m, r.vertical_speed_m_s)),
            None => (Rotation::IDENTITY, (0.0, 0.0)),
        };
        self.publish(ask, valid_until, orientation, vertical, out);
        self.blind_at = Some(now + Span::from_secs_f64(self.tuning.safety.blind_period_s));
    }

    fn note_trust(&mut self, now: Time, trust: Trust, out: &mut Outbox<Output>) {
        if trust == self.trust {
            return;
        }
        self.trust = trust;
        if self.phase.is_on_ground() {
            return;
        }
        let (severity, name, detail) = match trust {
            Trust::State => (Severity::Info, "state-trusted", "flying on the estimate again"),
            Trust::Level => (Severity::Warning, "levelling", "no valid state: level, thrust held"),
            Trust::Descend => {
                (Severity::Fault, "descending", "no valid state for too long: descends by itself")
            }
        };
        out.event(now, severity, self.id, name, detail);
    }

    fn wish(&self, now: Time) -> Wish {
        if self.reports.latched(now) {
            return Wish::Ground;
        }
        let phases = &self.tuning.phases;
        if self.reports.battery_low() {
            return Wish::Land(None);
        }
        match &self.goal {
            None if now - self.airborne_since > Span::from_secs_f64(phases.no_goal_s) => Wish::Land(None),
            None => Wish::Hold,
            Some((_, at)) if now - *at > Span::from_secs_f64(phases.goal_s_max) => Wish::Land(None),
            Some((goal, _)) => match goal.kind {
                GoalKind::Ground => Wish::Ground,
                GoalKind::Hover => Wish::Hover(*goal),
                GoalKind::Land => Wish::Land(Some(self.inside(goal.position_m))),
            },
        }
    }

    fn advance_phase(&mut self, now: Time, state: &Kinematics, wish: &Wish, out: &mut Outbox<Output>) {
        let was_airborne = self.is_airborne();
        let situation = Situation {
            now,
            state,
            wish,
            may_take_off: !self.reports.battery_low() && !self.reports.latched(now),
            motors_on: self.reports.motors_on(now, self.airborne_since + REPORT_LAG),
        };
        if let Some(turn) = self.phase.advance(&self.tuning.phases, &situation) {
            let p = state.position_m;
            let detail = format!("at {:.2} {:.2} {:.2} m", p.x, p.y, p.z);
            out.event(now, Severity::Info, self.id, turn.name(), &detail);
        }
        if self.is_airborne() && !was_airborne {
            self.airborne_since = now;
            self.position.reset_integral();
        }
    }

    fn is_airborne(&self) -> bool {
        matches!(self.phase, Phase::Climb { .. } | Phase::Fly { .. } | Phase::Land { .. })
    }

    /// The command for the state predicted.
    fn fly(&mut self, now: Time, state: &VehicleState, wish: &Wish, in_maneuver: bool, span_s: f64) -> Ask {
        let k = &state.prediction;
        let (target, vertical_m_s) = match self.phase {
            Phase::Unknown | Phase::Ground { .. } => return Ask::OFF,
            Phase::SpinUp { since, .. } => {
                let phases = &self.tuning.phases;
                let risen = phases.spin_up_m_s3 * (now - since).as_secs_f64();
                return Ask {
                    mode: CommandMode::Fly,
                    collective_m_s2: (phases.spin_up_m_s2 + risen)
                        .min(self.tuning.position.collective_m_s2_max),
                    rate_rad_s: Vector::ZERO,
                };
            }
            Phase::Climb { from, .. } => {
                (self.climb_target(from, wish, k), Some(self.tuning.phases.climb_m_s))
            }
            Phase::Fly { hold, heading_rad } => (self.fly_target(state, wish, hold, heading_rad), None),
            Phase::Land { spot, .. } => {
                (still(spot, k.orientation.yaw_rad()), Some(self.landing_speed(k, spot)))
            }
        };
        self.update_recovering(k, &target);
        if in_maneuver {
            self.position.reset_integral();
        } else {
            self.position.learn(&self.tuning.position, state.disturbance_m_s2, span_s);
        }
        let manner = Manner {
            tilt_rad_max: self.tilt_max(k),
            vertical_m_s,
            learning: !in_maneuver && !self.recovering && state.tracking == Tracking::Tracking,
        };
        let acceleration =
            self.position.acceleration_m_s2(&self.tuning.position, k, &target, &manner, span_s);
        let Thrust { axis, collective_m_s2 } =
            thrust(&self.tuning.position, acceleration, k.orientation, manner.tilt_rad_max);
        let rate_rad_s = rates(&self.tuning.attitude, k.orientation, k.rate_rad_s, axis, target.heading_rad);
        Ask { mode: CommandMode::Fly, collective_m_s2, rate_rad_s }
    }

    fn climb_target(&self, from: Vector<World>, wish: &Wish, k: &Kinematics) -> Target {
        let heading_rad =
            if let Wish::Hover(goal) = wish { goal.heading_rad } else { k.orientation.yaw_rad() };
        still(from, heading_rad)
    }

    fn fly_target(&self, state: &VehicleState, wish: &Wish, hold: Vector<World>, heading_rad: f64) -> Target {
        match (wish, &self.goal) {
            (Wish::Hover(goal), Some((_, heard_at))) => {
                let ahead_s = (state.predicted_for - *heard_at).as_secs_f64();
                let ahead_s = ahead_s.clamp(0.0, self.tuning.position.goal_horizon_s);
                let (velocity, acceleration) = (goal.velocity_m_s, goal.acceleration_m_s2);
                let moved = velocity * ahead_s + acceleration * (0.5 * ahead_s * ahead_s);
                Target {
                    position_m: self.inside(goal.position_m + moved),
                    velocity_m_s: velocity + acceleration * ahead_s,
                    acceleration_m_s2: acceleration,
                    heading_rad: goal.heading_rad,
                }
            }
            _ => still(self.inside(hold), heading_rad),
        }
    }

    fn landing_speed(&self, k: &Kinematics, spot: Vector<World>) -> f64 {
        let phases = &self.tuning.phases;
        let height = k.position_m.z;
        let beside = (k.position_m - spot).horizontal().norm();
        let hurried = self.reports.battery_low();
        if beside > phases.spot_m && height > phases.flare_height_m && !hurried {
            return 0.0;
        }
        let speed = phases.touchdown_m_s + (height - phases.flare_height_m).max(0.0);
        -speed.min(phases.descent_m_s)
    }

    fn tilt_max(&self, k: &Kinematics) -> f64 {
        let position = &self.tuning.position;
        match self.phase {
            Phase::Land { .. } if k.position_m.z < self.tuning.phases.airborne_height_m => LOW_TILT_RAD,
            _ if self.recovering => position.recovery_tilt_rad_max,
            _ => position.tilt_rad_max,
        }
    }

    /// A vehicle far from steady may use more tilt, and its loops learn nothing meanwhile.
    fn update_recovering(&mut self, k: &Kinematics, target: &Target) {
        let phases = &self.tuning.phases;
        let ratio = if self.recovering { CAUGHT_RATIO } else { 1.0 };
        let drift = (k.velocity_m_s - target.velocity_m_s).norm();
        self.recovering = drift > phases.recover_m_s * ratio
            || k.orientation.tilt_rad() > phases.recover_rad * ratio.max(0.8)
            || k.rate_rad_s.horizontal().norm() > phases.recover_rad_s * ratio;
    }

    /// Level, on what is left of the last attitude.
    fn level(&mut self, now: Time) -> Ask {
        let hover_m_s2 = self.position.hover_m_s2();
        self.position.reset_integral();
        let Some(reckoning) = &mut self.reckoning else {
            return Ask::descend(hover_m_s2);
        };
        reckoning.carry_to(now);
        let k = *reckoning;
        let tuning = &self.tuning;
        let upright = k.orientation.z_axis().z;
        let mut rate_rad_s = rates(&tuning.attitude, k.orientation, Vector::ZERO, Vector::Z, 0.0);
        rate_rad_s.z = 0.0;
        reckoning.told(rate_rad_s);
        let lift = (hover_m_s2 / upright.max(0.6)).min(tuning.position.collective_m_s2_max);
        let collective_m_s2 = if upright > 0.0 { lift } else { tuning.position.collective_m_s2_min };
        Ask { mode: CommandMode::Fly, collective_m_s2, rate_rad_s }
    }

    fn descend(&mut self, now: Time) -> Ask {
        self.position.reset_integral();
        if let Some(reckoning) = &mut self.reckoning {
            reckoning.carry_to(now);
        }
        Ask::descend(self.position.hover_m_s2())
    }

    fn inside(&self, place: Vector<World>) -> Vector<World> {
        let hall = &self.hall;
        let (x, y) = (0.5 * hall.width_m - hall.margin_m, 0.5 * hall.depth_m - hall.margin_m);
        Vector::new(
            place.x.clamp(-x, x),
            place.y.clamp(-y, y),
            place.z.clamp(FLOOR_MARGIN_M, hall.height_m - hall.margin_m),
        )
    }

    fn publish(
        &self,
        ask: Ask,
        valid_until: Time,
        orientation: Rotation<Body, World>,
        (height_m, vertical_speed_m_s): (f64, f64),
        out: &mut Outbox<Output>,
    ) {
        out.publish(VehicleCommand {
            vehicle: self.id,
            mode: ask.mode,
            lease_epoch: self.lease_epoch,
            valid_until,
            frame_received_at: self.frame_received_at,
            collective_m_s2: ask.collective_m_s2,
            rate_rad_s: ask.rate_rad_s,
            orientation,
            height_m,
            vertical_speed_m_s,
        });
    }
}

impl Ask {
    const OFF: Self = Self { mode: CommandMode::Disarmed, collective_m_s2: 0.0, rate_rad_s: Vector::ZERO };

    fn descend(hover_m_s2: f64) -> Self {
        Self {
            mode: CommandMode::Descend,
            collective_m_s2: DESCENT_RATIO * hover_m_s2,
            rate_rad_s: Vector::ZERO,
        }
    }
}

fn still(position_m: Vector<World>, heading_rad: f64) -> Target {
    Target { position_m, velocity_m_s: Vector::ZERO, acceleration_m_s2: Vector::ZERO, heading_rad }
}
