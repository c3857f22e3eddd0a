//! The state predicted for the execution of a command, against the truth at that instant.

use front_door::experiment::{message, node, services};
use quantity::{Span, Time, Vector, World, math};
use schemas::{FlipStatus, GoalKind, VehicleGoal, VehicleState, topics};
use service_core::{AnyNode, Core, Event, Identity, Node, Outbox, Start};
use settings::{Arena, ConfigError};
use virtual_arena::VirtualArena;
use wire::Secret;

use crate::common::arena;

service_core::inputs! {
    /// The pilot needs no eyes.
    pub enum Input {}
}

service_core::outputs! {
    /// What the pilot wants.
    pub enum Output {
        /// Where the vehicle shall be.
        Goal(VehicleGoal) = topics::VEHICLE_GOAL,
        /// Nothing to tell.
        Status(FlipStatus) = topics::FLIP_STATUS,
    }
}

const RADIUS_M: f64 = 1.5;
const SPEED_M_S: f64 = 2.0;
const HEIGHT_M: f64 = 3.0;

/// Flies circles in the flip manager's place: up for 8 s, then 2 m/s around the middle of the hall.
struct Pilot {
    started_at: Time,
    next_at: Time,
}

impl Core for Pilot {
    const NAME: &'static str = "flip-manager";
    type Tuning = toml::Table;
    type Input = Input;
    type Output = Output;

    fn new(_: &Arena, _: toml::Table, start: Start) -> Result<Self, ConfigError> {
        Ok(Self { started_at: start.at, next_at: start.at })
    }

    fn deadline(&self) -> Option<Time> {
        Some(self.next_at)
    }

    fn step(&mut self, now: Time, _: Event<Input>, out: &mut Outbox<Output>) {
        self.next_at = now + Span::from_millis(10);
        let t = (now - self.started_at).as_secs_f64() - 8.0;
        // The speed rises over two seconds, so that the circle is entered gently.
        let (speed, gain) =
            if t < 2.0 { (SPEED_M_S * t.max(0.0) / 2.0, t.max(0.0) / 2.0) } else { (SPEED_M_S, 1.0) };
        let turned =
            if t < 2.0 { SPEED_M_S * t.max(0.0) * gain / 2.0 } else { SPEED_M_S * (t - 1.0) } / RADIUS_M;
        let (sin, cos) = math::sin_cos(turned);
        out.publish(VehicleGoal {
            vehicle: 1,
            kind: GoalKind::Hover,
            position_m: Vector::new(RADIUS_M * cos - RADIUS_M, RADIUS_M * sin, HEIGHT_M),
            velocity_m_s: Vector::new(-speed * sin, speed * cos, 0.0),
            acceleration_m_s2: Vector::new(-cos, -sin, 0.0) * (speed * speed / RADIUS_M),
            heading_rad: 0.0,
        });
    }
}

fn piloted(
    name: &str,
    arena: &Arena,
    secret: &Secret,
    identity: Identity,
    now: Time,
) -> Result<Box<dyn AnyNode>, ConfigError> {
    if name == Pilot::NAME {
        return Ok(Box::new(Node::<Pilot>::new(arena, secret, identity, now)?));
    }
    node(name, arena, secret, identity, now)
}

/// Root mean squares and medians of the prediction's error in position and speed.
struct Accuracy {
    position_m: Vec<f64>,
    velocity_m_s: Vec<f64>,
}

impl Accuracy {
    fn median(values: &[f64]) -> f64 {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        sorted[sorted.len() / 2]
    }

    fn rms(values: &[f64]) -> f64 {
        math::sqrt(values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64)
    }
}

fn circle(total_delay_s: f64, predict: bool, seed: u64) -> Accuracy {
    let mut settings = arena("double-flip");
    let (mocap_s, command_s) = (0.4 * total_delay_s, 0.6 * total_delay_s);
    for member in &mut settings.fleet {
        member.vehicle.links.mocap_latency_s = mocap_s;
        member.vehicle.links.command_delay_s = command_s;
        member.vehicle.plant.camera.latency_s = mocap_s;
        member.vehicle.plant.command_link.delay_s = command_s;
    }
    if !predict {
        let off: toml::Table = "prediction = false".parse().unwrap();
        settings.services.insert("estimator".to_owned(), toml::Value::Table(off));
    }
    let mut flying = VirtualArena::new(&settings, seed, &services(), &piloted).unwrap();
    let mut truth: Vec<(Time, Vector<World>, Vector<World>)> = Vec::new();
    let mut states: Vec<VehicleState> = Vec::new();
    let start = flying.now();
    let settled = start + Span::from_secs(14);
    while flying.now() < start + Span::from_secs(30) {
        flying.run_for(Span::from_millis(1), &mut |heard| {
            states.extend(
                message::<VehicleState>(&heard, &topics::VEHICLE_STATE)
                    .filter(|state| state.predicted_for > settled),
            );
        });
        let now = flying.plant().truth(1).unwrap();
        truth.push((flying.now(), now.motion.position_m, now.motion.velocity_m_s));
    }
    let mut accuracy = Accuracy { position_m: Vec::new(), velocity_m_s: Vec::new() };
    for state in states {
        let Some(index) = truth.iter().position(|sample| sample.0 >= state.predicted_for) else { continue };
        let (after, before) = (truth[index], truth[index - 1]);
        let part = (state.predicted_for - before.0).as_secs_f64() / (after.0 - before.0).as_secs_f64();
        let position = before.1 + (after.1 - before.1) * part;
        let velocity = before.2 + (after.2 - before.2) * part;
        assert!(velocity.norm() > 1.5, "the circle is not flown: {} m/s", velocity.norm());
        accuracy.position_m.push((state.prediction.position_m - position).norm());
        accuracy.velocity_m_s.push((state.prediction.velocity_m_s - velocity).norm());
    }
    assert!(accuracy.position_m.len() > 2000);
    accuracy
}

#[test]
fn at_2_m_s_the_prediction_is_within_5_mm_and_20_mm_s_and_ten_times_better_than_none() {
    for total_delay_s in [0.030, 0.050] {
        let with = circle(total_delay_s, true, 1);
        let without = circle(total_delay_s, false, 1);
        let (p, v) = (Accuracy::rms(&with.position_m), Accuracy::rms(&with.velocity_m_s));
        let (p_off, v_off) = (Accuracy::rms(&without.position_m), Accuracy::rms(&without.velocity_m_s));
        println!(
            "{:.0} ms: predicted {:.2} mm, {:.1} mm/s RMS (median {:.2} mm, {:.1} mm/s); unpredicted {:.1} mm, {:.0} mm/s",
            total_delay_s * 1e3,
            p * 1e3,
            v * 1e3,
            Accuracy::median(&with.position_m) * 1e3,
            Accuracy::median(&with.velocity_m_s) * 1e3,
            p_off * 1e3,
            v_off * 1e3
        );
        assert!(p <= 0.005, "{total_delay_s} s: position {p} m");
        assert!(v <= 0.020, "{total_delay_s} s: velocity {v} m/s");
        assert!(p_off >= 10.0 * p, "{total_delay_s} s: {p} m against {p_off} m without");
    }
}
