//! For tests: a small vehicle, its link and an estimator that knows the truth but for noise.

use std::collections::VecDeque;
use std::path::Path;

use quantity::{Body, Rotation, Span, Time, Vector, World, math};
use schemas::{
    CommandMode, FlightMode, GoalKind, Kinematics, ManeuverPhase, Tracking, VehicleCommand, VehicleGoal,
    VehicleState, VehicleTelemetry,
};
use service_core::{Core, Event, Outbox, Seed, Start};
use settings::Arena;

use crate::{HoverController, Input, Output, Tuning};

/// The repository's double-flip arena.
pub(crate) fn arena() -> Arena {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
    Arena::load(&folder, "double-flip").expect("the repository's settings load")
}

pub(crate) const START: Time = Time::from_nanos(1_000_000_000);
const TICK: Span = Span::from_micros(500);
const LINK_DELAY: Span = Span::from_millis(18);
const GEAR_M: f64 = 0.04;

/// Uniform and normal numbers from a seed.
#[derive(Clone, Debug)]
pub(crate) struct Dice(u64);

impl Dice {
    pub fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        let radius = math::sqrt(-2.0 * math::ln(1.0 - self.uniform()));
        radius * math::cos(core::f64::consts::TAU * self.uniform())
    }

    fn vector<F: quantity::Frame>(&mut self, sigma: f64) -> Vector<F> {
        Vector::new(self.normal() * sigma, self.normal() * sigma, self.normal() * sigma)
    }
}

/// The vehicle and what is on its way to it.
#[derive(Clone, Debug)]
pub(crate) struct Craft {
    pub truth: Kinematics,
    pub thrust_n: [f64; 4],
    gust: Vector<World>,
    dice: Dice,
    queue: VecDeque<(Time, VehicleCommand)>,
    flown: VehicleCommand,
    flown_at: Time,
    pub armed: bool,
    pub touchdown_m_s: f64,
    pub thrust_ratio: f64,
}

impl Craft {
    fn tick(&mut self, now: Time) {
        let h = TICK.as_secs_f64();
        while self.queue.front().is_some_and(|(at, _)| *at <= now) {
            let (at, command) = self.queue.pop_front().expect("just seen");
            self.flown = command;
            self.flown_at = at;
            self.armed = match command.mode {
                CommandMode::Disarmed => self.armed && self.truth.position_m.z > 0.5,
                CommandMode::Fly => true,
                CommandMode::Descend => self.armed,
            };
        }
        let (mass, arm, inertia, drag_torque) = (0.468, 0.17, [0.0023, 0.0023, 0.004], 0.0244);
        let (mut collective, mut rate) = (self.flown.collective_m_s2, self.flown.rate_rad_s);
        let t = &mut self.truth;
        if self.flown.mode != CommandMode::Fly || now - self.flown_at > Span::from_millis(100) {
            // By itself: level, sinking at 1 m/s.
            let up = t.orientation.inverse() * Vector::<World>::Z;
            rate = Vector::new(-up.y, up.x, 0.0) * -4.0;
            collective = (9.81 / self.thrust_ratio + 2.0 * (-1.0 - t.velocity_m_s.z)).clamp(7.0, 12.0);
        }
        let error = rate - t.rate_rad_s * 1.045;
        let each = mass * collective / 4.0;
        let roll = inertia[0] * 40.0 * error.x / (2.0 * arm);
        let pitch = inertia[1] * 40.0 * error.y / (2.0 * arm);
        let yaw = (inertia[2] * 8.0 * error.z / (4.0 * drag_torque)).clamp(-0.2, 0.2);
        let wanted = [each - pitch + yaw, each + pitch + yaw, each + roll - yaw, each - roll - yaw];
        for (thrust, wanted) in self.thrust_n.iter_mut().zip(wanted) {
            let wanted = if self.armed { wanted.clamp(0.08, 2.8) } else { 0.0 };
            *thrust += h * if wanted > *thrust { 50.0 } else { 25.0 } * (wanted - *thrust);
        }
        let [front, back, left, right] = self.thrust_n.map(|thrust| thrust * self.thrust_ratio);
        let angular = Vector::new(
            arm * (left - right) / inertia[0],
            arm * (back - front) / inertia[1],
            drag_torque * (front + back - left - right) / inertia[2],
        );
        t.rate_rad_s += angular * h;
        t.orientation = t.orientation.turned(t.rate_rad_s * h);
        self.gust = self.gust * (1.0 - h) + self.dice.vector(0.1 * math::sqrt(2.0 * h));
        let specific = (front + back + left + right) / mass;
        // Inflow: thrust lost with the speed along the axis.
        let axis = t.orientation.z_axis();
        let inflow = (1.0 - 0.04 * axis.dot(t.velocity_m_s)).clamp(0.3, 1.3);
        let acceleration = axis * (specific * inflow) - Vector::Z * 9.81 - t.velocity_m_s * 0.3 + self.gust;
        t.position_m += t.velocity_m_s * h;
        t.velocity_m_s += acceleration * h;
        if t.position_m.z < GEAR_M {
            if t.velocity_m_s.z < -0.05 {
                self.touchdown_m_s = self.touchdown_m_s.max(-t.velocity_m_s.z);
            }
            t.position_m.z = GEAR_M;
            t.velocity_m_s = Vector::ZERO;
            t.rate_rad_s = Vector::ZERO;
            t.orientation = Rotation::from_yaw_pitch_roll(t.orientation.yaw_rad(), 0.0, 0.0);
        }
    }

    /// What the estimator would call the disturbance.
    fn disturbance(&self) -> Vector<World> {
        if self.truth.position_m.z <= GEAR_M {
            return Vector::ZERO;
        }
        let believed = self.thrust_n.iter().sum::<f64>() / 0.468;
        let axis = self.truth.orientation.z_axis();
        let inflow = (1.0 - 0.04 * axis.dot(self.truth.velocity_m_s)).clamp(0.3, 1.3);
        axis * (believed * (self.thrust_ratio * inflow - 1.0)) - self.truth.velocity_m_s * 0.3 + self.gust
    }
}

/// The controller in a loop with one vehicle.
pub(crate) struct Loop {
    pub now: Time,
    pub craft: Craft,
    pub controller: HoverController,
    pub goal: Option<VehicleGoal>,
    pub commands: Vec<(Time, VehicleCommand)>,
    pub events: Vec<String>,
    pub track: Vec<(Time, Kinematics)>,
    /// Whether states come, and rest on how many frames.
    pub states: bool,
    pub accepted_frames: u16,
    pub telemetry: bool,
    pub battery_v: f64,
    pub maneuver: ManeuverPhase,
    newest: Option<VehicleCommand>,
    dice: Dice,
}

impl Loop {
    /// A vehicle at rest, motors off, at that place.
    pub fn new(place: Vector<World>) -> Self {
        let start = Start { at: START, seed: Seed(1), incarnation: 7 };
        let truth = Kinematics { position_m: place, ..Kinematics::default() };
        Self {
            now: START,
            craft: Craft {
                truth,
                thrust_n: [0.0; 4],
                gust: Vector::ZERO,
                dice: Dice(99),
                queue: VecDeque::new(),
                flown: VehicleCommand::default(),
                flown_at: START,
                armed: false,
                touchdown_m_s: 0.0,
                thrust_ratio: 0.92,
            },
            controller: HoverController::new(&arena(), Tuning::default(), start)
                .expect("the default tuning is sound"),
            goal: None,
            commands: Vec::new(),
            events: Vec::new(),
            track: Vec::new(),
            states: true,
            accepted_frames: 100,
            telemetry: true,
            battery_v: 11.5,
            maneuver: ManeuverPhase::None,
            newest: None,
            dice: Dice(1234),
        }
    }

    /// A vehicle that hovers there.
    pub fn hovering(place: Vector<World>) -> Self {
        let mut arena = Self::new(place);
        arena.craft.armed = true;
        arena.craft.thrust_n = [0.468 * 9.81 / 0.92 / 4.0; 4];
        let hover = VehicleCommand {
            vehicle: 1,
            mode: CommandMode::Fly,
            collective_m_s2: 9.81 / 0.92,
            ..VehicleCommand::default()
        };
        arena.craft.flown = hover;
        arena
    }

    /// Sets a goal of that kind, repeated from now on.
    pub fn order(&mut self, kind: GoalKind, position_m: Vector<World>) {
        self.goal = Some(VehicleGoal { vehicle: 1, kind, position_m, ..VehicleGoal::default() });
        self.repeat_goal();
    }

    pub fn repeat_goal(&mut self) {
        if let Some(goal) = self.goal {
            self.hear(goal);
        }
    }

    pub fn hear(&mut self, input: impl Into<Input>) {
        self.step(Event::Input(input.into()));
    }

    fn step(&mut self, event: Event<Input>) {
        let mut out = Outbox::default();
        self.controller.step(self.now, event, &mut out);
        self.events.extend(out.take_events().map(|event| event.name.to_string()));
        for Output::Command(command) in out.take_messages() {
            self.commands.push((self.now, command));
            self.newest = Some(command);
        }
    }

    /// Lets time pass.
    pub fn run(&mut self, seconds: f64) {
        let end = self.now + Span::from_secs_f64(seconds);
        while self.now < end {
            let nanos = (self.now - START).as_nanos();
            if nanos % 100_000_000 == 0 {
                self.repeat_goal();
            }
            if nanos % 50_000_000 == 0 && self.telemetry {
                self.report();
            }
            if nanos % 5_000_000 == 0 && self.states {
                let state = self.state();
                self.hear(state);
            }
            if self.controller.deadline().is_some_and(|at| at <= self.now) {
                self.step(Event::Deadline);
            }
            if nanos % 20_000_000 == 0 {
                self.slot();
            }
            self.track.push((self.now, self.craft.truth));
            self.craft.tick(self.now);
            self.now += TICK;
        }
    }

    /// The newest command that is still valid leaves the radio, as the link's resolution lets it.
    fn slot(&mut self) {
        let Some(mut command) = self.newest.filter(|command| command.valid_until >= self.now) else {
            return;
        };
        let step = 12.0 / 1023.0;
        let rate = command.rate_rad_s * (1.0 / step);
        command.rate_rad_s =
            Vector::<Body>::new(math::round(rate.x), math::round(rate.y), math::round(rate.z)) * step;
        command.collective_m_s2 = math::round(command.collective_m_s2 * 2047.0 / 24.0) * 24.0 / 2047.0;
        self.craft.queue.push_back((self.now + LINK_DELAY, command));
    }

    fn report(&mut self) {
        let mode = match (self.craft.armed, self.craft.flown.mode) {
            (false, _) => FlightMode::Disarmed,
            (true, CommandMode::Fly) => FlightMode::Flying,
            (true, _) => FlightMode::Descend,
        };
        self.hear(VehicleTelemetry {
            vehicle: 1,
            mode,
            maneuver_phase: self.maneuver,
            maneuver_id: 1,
            began_at: self.now,
            battery_v: self.battery_v,
            received_at: self.now,
            ..VehicleTelemetry::default()
        });
    }

    /// The truth carried through the commands on their way, plus noise.
    pub fn state(&mut self) -> VehicleState {
        let since_slot = (self.now - START).as_nanos() % 20_000_000;
        let next_slot =
            if since_slot == 0 { self.now } else { self.now + Span::from_nanos(20_000_000 - since_slot) };
        let predicted_for = next_slot + LINK_DELAY;
        let mut ahead = self.craft.clone();
        let mut at = self.now;
        while at < predicted_for {
            ahead.tick(at);
            at += TICK;
        }
        let noisy = |k: &Kinematics, dice: &mut Dice| Kinematics {
            position_m: k.position_m + dice.vector(0.0004),
            velocity_m_s: k.velocity_m_s + dice.vector(0.005),
            orientation: k.orientation.turned(dice.vector(0.0015)),
            rate_rad_s: k.rate_rad_s + dice.vector(0.02),
        };
        VehicleState {
            vehicle: 1,
            tracking: Tracking::Tracking,
            accepted_frames: self.accepted_frames,
            estimated_for: self.now,
            frame_received_at: self.now,
            estimate: noisy(&self.craft.truth, &mut self.dice),
            predicted_for,
            prediction: noisy(&ahead.truth, &mut self.dice),
            disturbance_m_s2: self.craft.disturbance() + self.dice.vector(0.05),
            valid_until: self.now + Span::from_millis(100),
        }
    }

    pub fn position(&self) -> Vector<World> {
        self.craft.truth.position_m
    }
}
