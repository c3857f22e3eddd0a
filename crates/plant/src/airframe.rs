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

/// One vehicle's body in the hall.
#[derive(Clone, Debug)]
pub struct Airframe {
    mass_kg: f64,
    inertia: Inertia,
    rotors: Rotors,
    air: Air,
    gusts: Gusts,
    ticks_to_gust: u32,
    battery: Battery,
    floor: Floor,
    contact: Contact,
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

/// What the rotors' own rotation does to the body within a step.
#[derive(Clone, Copy)]
struct Spin {
    momentum: f64,
    reaction_n_m: f64,
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
            mass_kg,
            inertia: Inertia::new(vehicle.airframe.inertia_kg_m2.map(|i| i * truth.body.inertia_ratio)),
            rotors,
            air: Air::new(truth),
            gusts: Gusts::new(truth.air.gust_m_s2, truth.air.gust_time_s, gust_stream),
            ticks_to_gust: 0,
            battery: Battery::new(&truth.battery, hover_n / vehicle.rotor.thrust_n_max),
            floor,
            contact: Contact::Standing,
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

    /// Weakens (or restores) a rotor, front, back, left or right.
    pub fn set_health_ratio(&mut self, rotor: usize, ratio: f64) {
        if let Some(health) = self.health_ratio.get_mut(rotor) {
            *health = ratio;
        }
    }

    /// Specific force at the last tick: what accelerometers feel.
    #[must_use]
    pub fn specific_force_m_s2(&self) -> Vector<Body> {
        let up = Vector::new(0.0, 0.0, GRAVITY_M_S2);
        let felt = if self.contact == Contact::Free { self.load.acceleration_m_s2 + up } else { up };
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
                    let met = self.floor.touch(&mut self.motion);
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
        let begin = self.rotors.spin_momentum(&self.roots);
        let end = self.rotors.spin_momentum(&course.end_roots);
        let spin = Spin { momentum: 0.5 * (begin + end), reaction_n_m: (begin - end) / step_s };
        let ground = self.ground_ratio();
        let mut first = self.load;
        first.torque_n_m += spin.torque_n_m(self.motion.rate_rad_s);
        self.motion.stepped(&self.inertia, step_s, first, |stage, motion| {
            let thrust_n = if stage == Stage::Middle { &course.middle_n } else { &course.end_n };
            let mut load = self.load_at(motion, thrust_n, ground);
            load.torque_n_m += spin.torque_n_m(motion.rate_rad_s);
            load
        })
    }

    fn load_at(&self, motion: &Motion, static_n: &[f64; ROTORS], ground: f64) -> Load {
        let up = z_axis(motion.orientation);
        let axial_m_s = self.rotors.axial_m_s(up.dot(motion.velocity_m_s), motion.rate_rad_s);
        let actual_n: [f64; ROTORS] =
            core::array::from_fn(|i| static_n[i] * ground * self.air.inflow_ratio(axial_m_s[i]));
        let collective_m_s2 = actual_n.iter().sum::<f64>() / self.mass_kg;
        let gravity = Vector::new(0.0, 0.0, -GRAVITY_M_S2);
        Load {
            acceleration_m_s2: up * collective_m_s2
                + gravity
                + self.air.drag_m_s2(motion.velocity_m_s)
                + self.gusts.acceleration_m_s2(),
            torque_n_m: self.rotors.torque_n_m(static_n, &actual_n) + self.air.rate_drag_n_m(motion.rate_rad_s),
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
    /// Gyroscopic torque of the rotors' momentum, and the reaction to its change.
    fn torque_n_m(self, rate_rad_s: Vector<Body>) -> Vector<Body> {
        Vector::new(-rate_rad_s.y * self.momentum, rate_rad_s.x * self.momentum, self.reaction_n_m)
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
