//! The physics of one vehicle: body, rotors, battery, air and floor, stepped once per firmware tick.
//!
//! A tick is one Runge-Kutta step with motor commands held. Between ticks the state is that of the last tick;
//! [`Airframe::ahead`] looks at any instant before the next without disturbing it.

use quantity::{Body, GRAVITY_M_S2, Rotation, Span, Vector, World};
use settings::{FleetVehicle, Hall};

use crate::air::{Air, Gusts};
use crate::battery::Battery;
use crate::floor::{Contact, Floor, Touchdown};
use crate::random::{Purpose, Stream};
use crate::rigid_body::{Inertia, Load, Motion, Stage};
use crate::rotor::{Course, Lag, ROTORS, Rotors};

/// The floor stops a vehicle within a tick; no accelerometer of its kind reads more than 16 g.
const IMPACT_M_S2_MAX: f64 = 16.0 * GRAVITY_M_S2;

/// One vehicle's body in the hall.
#[derive(Clone, Debug)]
pub struct Airframe {
    /// One by the mass.
    inverse_mass_1_kg: f64,
    inertia: Inertia,
    rotors: Rotors,
    air: Air,
    gusts: Gusts,
    ticks_to_gust: u32,
    battery: Battery,
    floor: Floor,
    contact: Contact,
    /// Acceleration at which the floor stops the vehicle at this tick.
    impact_m_s2: Vector<World>,
    step_s: f64,
    lag: Lag,
    motion: Motion,
    /// Static thrusts, and their square roots.
    thrust_n: [f64; ROTORS],
    roots: [f64; ROTORS],
    asked_n: [f64; ROTORS],
    /// What is left of each rotor's thrust: a fault's doing.
    health_ratio: [f64; ROTORS],
    power_ratio: f64,
    /// Load at the present instant, but for the torque of rotors changing speed.
    load: Load,
}

/// What the rotors' own rotation does to the body within a step, at its beginning, middle and end.
#[derive(Clone, Copy)]
struct Spin {
    momentum: [f64; 3],
    reaction_n_m: [f64; 3],
}

impl Airframe {
    /// A vehicle standing at its start, motors off; `step_s` is the length of its firmware's tick.
    #[must_use]
    pub fn new(member: &FleetVehicle, seed: u64, step_s: f64, build: &mut Stream) -> Self {
        let (vehicle, truth) = (&member.vehicle, &member.vehicle.plant);
        let mass_kg = vehicle.airframe.mass_kg * truth.body.mass_ratio;
        let rotors = Rotors::new(member, core::array::from_fn(|_| build.gaussian()));
        let hover_n = vehicle.airframe.mass_kg * GRAVITY_M_S2 / ROTORS as f64;
        let floor = Floor::new(&truth.floor);
        let place = Vector::new(member.part.start_x_m, member.part.start_y_m, floor.gear_height_m());
        let gust_stream = Stream::new(seed, Purpose::Gust, vehicle.id);
        let mut airframe = Self {
            inverse_mass_1_kg: 1.0 / mass_kg,
            inertia: Inertia::new(vehicle.airframe.inertia_kg_m2.map(|i| i * truth.body.inertia_ratio)),
            rotors,
            air: Air::new(truth),
            gusts: Gusts::new(truth.air.gust_m_s2, truth.air.gust_time_s, gust_stream),
            ticks_to_gust: 0,
            battery: Battery::new(&truth.battery, hover_n / vehicle.rotor.thrust_n_max),
            floor,
            contact: Contact::Standing,
            impact_m_s2: Vector::ZERO,
            step_s,
            lag: rotors.lag(step_s),
            motion: Motion::at_rest(place, member.part.heading_rad),
            thrust_n: [0.0; ROTORS],
            roots: [0.0; ROTORS],
            asked_n: [0.0; ROTORS],
            health_ratio: [1.0; ROTORS],
            power_ratio: 0.0,
            load: Load::default(),
        };
        airframe.refresh();
        airframe
    }

    /// Motion at the last tick.
    #[must_use]
    pub fn motion(&self) -> &Motion {
        &self.motion
    }

    /// Static thrust of each rotor at the last tick.
    #[must_use]
    pub fn thrust_n(&self) -> [f64; ROTORS] {
        self.thrust_n
    }

    /// The battery.
    #[must_use]
    pub fn battery(&self) -> &Battery {
        &self.battery
    }

    /// The battery, to change its charge.
    pub fn battery_mut(&mut self) -> &mut Battery {
        &mut self.battery
    }

    /// Voltage at the battery's terminals.
    #[must_use]
    pub fn voltage_v(&self) -> f64 {
        self.battery.voltage_v(self.power_ratio)
    }

    /// Whether and how it stands on the floor.
    #[must_use]
    pub fn contact(&self) -> Contact {
        self.contact
    }

    /// Whether it is inside the hall.
    #[must_use]
    pub fn inside(&self, hall: &Hall) -> bool {
        let place = self.motion.position_m;
        hall.contains(place.x, place.y, place.z)
    }

    /// Puts the vehicle somewhere, its rotors at the given static thrusts.
    pub fn place(&mut self, motion: Motion, thrust_n: [f64; ROTORS]) {
        self.motion = motion;
        self.thrust_n = thrust_n;
        self.asked_n = thrust_n;
        self.roots = Rotors::roots(&thrust_n);
        self.power_ratio = self.rotors.power_ratio(&thrust_n, &self.roots);
        let standing = motion.position_m.z <= self.floor.gear_height_m();
        self.contact = if standing { Contact::Settling } else { Contact::Free };
        self.refresh();
    }

    /// What is left of each rotor's thrust, from the next command on.
    pub fn set_health_ratio(&mut self, health_ratio: [f64; ROTORS]) {
        self.health_ratio = health_ratio;
    }

    /// Height of the centre of mass of the vehicle standing.
    #[must_use]
    pub fn gear_height_m(&self) -> f64 {
        self.floor.gear_height_m()
    }

    /// Specific force at the last tick: what accelerometers feel.
    #[must_use]
    pub fn specific_force_m_s2(&self) -> Vector<Body> {
        let up = Vector::new(0.0, 0.0, GRAVITY_M_S2);
        let felt = if self.contact == Contact::Free {
            self.load.acceleration_m_s2 + up
        } else {
            up + self.impact_m_s2
        };
        self.motion.orientation.inverse() * felt
    }

    /// Gives the motors their commands, held until the next tick.
    pub fn command(&mut self, commands: [u8; ROTORS]) {
        let asked = self.rotors.asked_n(commands, self.battery.thrust_limit_ratio());
        self.asked_n = core::array::from_fn(|i| asked[i] * self.health_ratio[i]);
    }

    /// Goes on to the next tick; tells if the vehicle met the floor.
    pub fn step(&mut self) -> Option<Touchdown> {
        let idle = self.asked_n == [0.0; ROTORS] && self.thrust_n == [0.0; ROTORS];
        if matches!(self.contact, Contact::Standing | Contact::Broken) && idle {
            self.battery.draw(0.0, self.step_s);
            return None;
        }
        let course = Rotors::course(&self.lag, &self.thrust_n, &self.asked_n);
        let mut touchdown = None;
        self.impact_m_s2 = Vector::ZERO;
        let lifts = self.load.acceleration_m_s2.z > 0.0;
        match self.contact {
            Contact::Broken => {}
            Contact::Settling | Contact::Standing if !lifts => {
                self.contact = self.floor.settle(&mut self.motion, self.step_s);
            }
            _ => {
                self.contact = Contact::Free;
                self.motion = self.flown(self.step_s, &course);
                if self.floor.reached(&self.motion) {
                    let before = self.motion.velocity_m_s;
                    let met = self.floor.touch(&mut self.motion);
                    let change = self.motion.velocity_m_s - before;
                    self.impact_m_s2 = (change / self.step_s).limited(IMPACT_M_S2_MAX);
                    self.contact = if met.crashed { Contact::Broken } else { Contact::Settling };
                    touchdown = Some(met);
                }
            }
        }
        self.thrust_n = course.end_n;
        self.roots = course.end_roots;
        self.power_ratio = self.rotors.power_ratio(&self.thrust_n, &self.roots);
        self.battery.draw(self.power_ratio, self.step_s);
        self.blow();
        self.refresh();
        touchdown
    }

    /// The motion `after_s` past the last tick, which must not be later than the next.
    #[must_use]
    pub fn ahead(&self, after_s: f64) -> Motion {
        if self.contact != Contact::Free || after_s <= 0.0 {
            let mut motion = self.motion;
            motion.position_m += motion.velocity_m_s * after_s;
            return motion;
        }
        let course = Rotors::course(&self.rotors.lag(after_s), &self.thrust_n, &self.asked_n);
        let mut motion = self.flown(after_s, &course);
        motion.position_m.z = motion.position_m.z.max(self.floor.gear_height_m());
        motion
    }

    fn flown(&self, step_s: f64, course: &Course) -> Motion {
        let spin = Spin::new(
            [self.roots, course.middle_roots(&self.roots), course.end_roots]
                .map(|roots| self.rotors.spin_momentum(&roots)),
            step_s,
        );
        let ground = self.ground_ratio();
        let mut first = self.load;
        first.torque_n_m += spin.torque_n_m(Stage::Start, self.motion.rate_rad_s);
        self.motion.stepped(&self.inertia, step_s, first, |stage, motion| {
            let thrust_n = if stage == Stage::Middle { &course.middle_n } else { &course.end_n };
            let mut load = self.load_at(motion, thrust_n, ground);
            load.torque_n_m += spin.torque_n_m(stage, motion.rate_rad_s);
            load
        })
    }

    fn load_at(&self, motion: &Motion, static_n: &[f64; ROTORS], ground: f64) -> Load {
        let up = z_axis(motion.orientation);
        let axial_m_s = self.rotors.axial_m_s(up.dot(motion.velocity_m_s), motion.rate_rad_s);
        let actual_n: [f64; ROTORS] =
            core::array::from_fn(|i| static_n[i] * ground * self.air.inflow_ratio(axial_m_s[i]));
        let collective_m_s2 = actual_n.iter().sum::<f64>() * self.inverse_mass_1_kg;
        let gravity = Vector::new(0.0, 0.0, -GRAVITY_M_S2);
        Load {
            acceleration_m_s2: up * collective_m_s2
                + gravity
                + self.air.drag_m_s2(motion.velocity_m_s)
                + self.gusts.acceleration_m_s2(),
            torque_n_m: self.rotors.torque_n_m(static_n, &actual_n)
                + self.air.rate_drag_n_m(motion.rate_rad_s),
        }
    }

    fn ground_ratio(&self) -> f64 {
        self.air.ground_ratio(self.motion.position_m.z)
    }

    fn blow(&mut self) {
        if self.ticks_to_gust == 0 {
            self.gusts.advance();
            self.ticks_to_gust = (Gusts::STEP.as_nanos() / Span::from_micros(1_250).as_nanos()) as u32;
        }
        self.ticks_to_gust -= 1;
    }

    fn refresh(&mut self) {
        self.load = self.load_at(&self.motion, &self.thrust_n, self.ground_ratio());
    }
}

impl Spin {
    /// From the rotors' angular momentum at the three instants; its change follows from the parabola through
    /// them, so that Runge and Kutta's weights give the whole change exactly.
    fn new([begin, middle, end]: [f64; 3], step_s: f64) -> Self {
        let changes = [4.0 * middle - 3.0 * begin - end, end - begin, begin - 4.0 * middle + 3.0 * end];
        Self { momentum: [begin, middle, end], reaction_n_m: changes.map(|change| -change / step_s) }
    }

    /// Gyroscopic torque of the rotors' momentum, and the reaction to its change.
    fn torque_n_m(&self, stage: Stage, rate_rad_s: Vector<Body>) -> Vector<Body> {
        let (momentum, reaction_n_m) = (self.momentum[stage as usize], self.reaction_n_m[stage as usize]);
        Vector::new(-rate_rad_s.y * momentum, rate_rad_s.x * momentum, reaction_n_m)
    }
}

/// Where the body's z axis points, for a quaternion that is of unit length but for a stage's rounding.
fn z_axis(q: Rotation<Body, World>) -> Vector<World> {
    Vector::new(
        2.0 * (q.x * q.z + q.w * q.y),
        2.0 * (q.y * q.z - q.w * q.x),
        1.0 - 2.0 * (q.x * q.x + q.y * q.y),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{ideal, member};
    use quantity::math;

    const STEP_S: f64 = 1.25e-3;

    fn airframe_of(member: &FleetVehicle, step_s: f64) -> Airframe {
        Airframe::new(member, 1, step_s, &mut Stream::new(1, Purpose::Build, 1))
    }

    fn flying(member: &FleetVehicle, thrust_n: [f64; 4]) -> Airframe {
        let mut airframe = airframe_of(member, STEP_S);
        airframe.place(Motion::at_rest(Vector::new(0.0, 0.0, 5.0), 0.0), thrust_n);
        airframe
    }

    /// Motor commands with fractions: sets the asked thrusts directly.
    fn ask(airframe: &mut Airframe, thrust_n: [f64; 4]) {
        airframe.asked_n = thrust_n;
    }

    #[test]
    fn hover_thrust_hovers() {
        let hover_n = 0.468 * GRAVITY_M_S2 / 4.0;
        let mut airframe = flying(&ideal(), [hover_n; 4]);
        for _ in 0..8_000 {
            ask(&mut airframe, [hover_n; 4]);
            airframe.step();
        }
        let motion = airframe.motion();
        assert!((motion.position_m - Vector::new(0.0, 0.0, 5.0)).norm() < 1e-9, "{motion:?}");
        assert!(airframe.specific_force_m_s2().z - GRAVITY_M_S2 < 1e-9);
    }

    #[test]
    fn a_dropped_vehicle_falls_freely_and_feels_nothing() {
        let mut airframe = flying(&ideal(), [0.0; 4]);
        for _ in 0..400 {
            airframe.command([0; 4]);
            airframe.step();
        }
        let motion = airframe.motion();
        assert!((motion.position_m.z - (5.0 - 0.5 * GRAVITY_M_S2 * 0.25)).abs() < 1e-9);
        assert!(airframe.specific_force_m_s2().norm() < 1e-9);
    }

    #[test]
    fn terminal_speeds_balance_drag_and_climb_costs_thrust() {
        // Falling flat: gravity against drag, 0.3 1/s, and the rotors' windmilling left out (no thrust).
        let mut member = ideal();
        member.vehicle.plant.body.drag_1_s = 3.0;
        let mut airframe = flying(&member, [0.0; 4]);
        for _ in 0..1_100 {
            airframe.step();
        }
        assert!((airframe.motion().velocity_m_s.z + GRAVITY_M_S2 / 3.0).abs() < 0.06);
        // Climbing under constant command: the speed at which inflow has taken the surplus.
        let mut member = ideal();
        member.vehicle.plant.rotor.inflow_loss_s_m = 0.04;
        let thrust_n = 1.1 * 0.468 * GRAVITY_M_S2 / 4.0;
        let mut airframe = flying(&member, [thrust_n; 4]);
        for _ in 0..16_000 {
            ask(&mut airframe, [thrust_n; 4]);
            airframe.step();
        }
        let climb = (1.0 - 1.0 / 1.1) / 0.04;
        assert!((airframe.motion().velocity_m_s.z - climb).abs() < 0.002, "{:?}", airframe.motion());
    }

    #[test]
    fn more_thrust_behind_pitches_forward_and_flies_forward() {
        let mut airframe = flying(&ideal(), [1.148; 4]);
        for tick in 0..200 {
            ask(&mut airframe, if tick < 100 { [1.1, 1.196, 1.148, 1.148] } else { [1.148; 4] });
            airframe.step();
        }
        assert!(airframe.motion().rate_rad_s.y > 0.1 && airframe.motion().velocity_m_s.x > 0.01);
        // The pitch rate that torque over inertia gives, the lags delaying but not losing any of it.
        let torque_n_m = 0.17 * 0.096;
        let expected = torque_n_m / 0.0023 * 0.125;
        assert!((airframe.motion().rate_rad_s.y / expected - 1.0).abs() < 0.25);
    }

    #[test]
    fn pitching_fast_is_damped_by_the_inflow() {
        let mut member = ideal();
        member.vehicle.plant.rotor.inflow_loss_s_m = 0.04;
        let airframe = {
            let mut airframe = flying(&member, [1.148; 4]);
            let mut motion = *airframe.motion();
            motion.rate_rad_s.y = 27.925;
            airframe.place(motion, [1.148; 4]);
            airframe
        };
        // plant.md has 0.17 Nm from 0.105 N/(m/s) a rotor; here 0.04 of hover thrust is 0.046 N/(m/s).
        let expected = -2.0 * 0.17 * 0.17 * 27.925 * 0.04 * 1.148;
        assert!((airframe.load.torque_n_m.y - expected).abs() < 1e-9, "{:?}", airframe.load);
    }

    #[test]
    fn rotors_changing_speed_turn_the_body_and_together_keep_angular_momentum() {
        let mut member = ideal();
        member.vehicle.plant.rotor.spin_inertia_kg_m2 = 8e-6;
        member.vehicle.rotor.drag_torque_m = 0.0;
        let mut airframe = flying(&member, [1.148; 4]);
        let total = |airframe: &Airframe| {
            0.004 * airframe.motion.rate_rad_s.z + airframe.rotors.spin_momentum(&airframe.roots)
        };
        let before = total(&airframe);
        for _ in 0..80 {
            ask(&mut airframe, [2.5, 2.5, 0.3, 0.3]);
            airframe.step();
        }
        assert!(airframe.motion.rate_rad_s.z > 0.5);
        assert!((total(&airframe) - before).abs() < 1e-9);
    }

    #[test]
    fn a_landed_vehicle_rests_and_lifts_off_when_thrust_exceeds_weight() {
        let mut airframe = airframe_of(&member(), STEP_S);
        for _ in 0..800 {
            airframe.command([100; 4]);
            assert_eq!(airframe.step(), None);
        }
        assert_eq!(airframe.contact(), Contact::Standing);
        assert!((airframe.motion().position_m.z - 0.04).abs() < 1e-12);
        assert!((airframe.specific_force_m_s2().z - GRAVITY_M_S2).abs() < 1e-9);
        for _ in 0..800 {
            airframe.command([150; 4]);
            airframe.step();
        }
        assert_eq!(airframe.contact(), Contact::Free);
        assert!(airframe.motion().position_m.z > 0.3);
        airframe.command([0; 4]);
        let touchdown = (0..4_000).find_map(|_| airframe.step()).expect("it comes down");
        assert!(touchdown.vertical_m_s > 2.0, "{touchdown:?}");
    }

    #[test]
    fn looking_ahead_changes_nothing_and_agrees_with_going_there() {
        let mut airframe = flying(&member(), [1.3, 1.1, 1.2, 1.0]);
        for _ in 0..40 {
            airframe.command([120, 150, 130, 140]);
            airframe.step();
        }
        let before = airframe.motion;
        let whole = airframe.ahead(STEP_S);
        assert_eq!(airframe.motion, before);
        assert_eq!(airframe.ahead(0.0), before);
        airframe.step();
        assert!((airframe.motion.position_m - whole.position_m).norm() < 1e-12);
        assert!(airframe.motion.orientation.angle_to(whole.orientation) < 1e-9);
    }

    /// A flip's worth of hard commands: full on one side, then coasting, then full on the other.
    fn hard_flight(substeps: u32) -> Motion {
        let mut member = member();
        member.vehicle.plant.air.gust_m_s2 = 0.0;
        member.vehicle.plant.battery.droop_ratio = 0.0;
        member.vehicle.plant.battery.fade_ratio = 0.0;
        let mut airframe = airframe_of(&member, STEP_S / f64::from(substeps));
        airframe.place(Motion::at_rest(Vector::new(0.0, 0.0, 5.0), 0.3), [1.15; 4]);
        for tick in 0..800 {
            airframe.command(match tick {
                0..160 => [185, 187, 186, 185],
                160..240 => [40, 195, 136, 140],
                240..460 => [60, 62, 60, 61],
                460..540 => [195, 40, 137, 136],
                _ => [184, 186, 185, 185],
            });
            for _ in 0..substeps {
                airframe.step();
            }
        }
        airframe.motion
    }

    #[test]
    fn one_step_a_tick_is_as_good_as_sixteen() {
        let (coarse, fine) = (hard_flight(1), hard_flight(16));
        let off = (coarse.position_m - fine.position_m).norm()
            + (coarse.velocity_m_s - fine.velocity_m_s).norm()
            + (coarse.rate_rad_s - fine.rate_rad_s).norm()
            + coarse.orientation.angle_to(fine.orientation);
        // plant.md: 4.4e-7 for its own flight.
        assert!(off < 4.4e-7, "{off:e}");
        assert!(math::sqrt(fine.rate_rad_s.dot(fine.rate_rad_s)) > 1.0);
    }
}
