//! The firmware put together: one tick, three ways in, one way out.

use device::sbus;
use device::vehicle_link::{CommandFrame, FlightMode, Reason, Status, StatusFlags, Uplink};
use maneuver::Setpoint;
use quantity::{Body, GRAVITY_M_S2, Span, Time, Vector};

use crate::attitude::{Going, OwnState};
use crate::command_generator::{CommandGenerator, StartOrder, Step, admit};
use crate::drift::ThrustRatio;
use crate::failsafe::{Supervisor, TouchdownDetector};
use crate::gate::Moment;
use crate::mixer::{YawShare, motor_commands, room_rad_s2, thrusts_n};
use crate::parameters::ParameterStore;
use crate::rate_loop::{RateError, RateLoop};
use crate::sensors::{ImuSample, Sensors, elapsed};
use crate::settings::{FirmwareSettings, SettingsError, TICK};
use crate::telemetry::{Telemetry, micros};

/// Below this share of hover thrust the vehicle stands on the ground, and the rate loops' integrals wait.
const GROUNDED_RATIO: f64 = 0.5;

/// Cosine of the greatest tilt at which thrust is raised to make up for it.
const UPRIGHT_RATIO_MIN: f64 = 0.7;
/// Cosine of the tilt beyond which thrust would rather push down, and is taken back to
const OVER_RATIO: f64 = 0.5;
/// this share of hover, enough for the rate loops to right the vehicle.
const OVER_THRUST_RATIO: f64 = 0.4;

/// Above this height a vehicle under the ground's commands is in the air,
const AIRBORNE_HEIGHT_M_MIN: f64 = 0.3;
/// and above this one a vehicle left alone, whose idea of its height is less sure; below, it brakes gently.
const LOW_HEIGHT_M_MAX: f64 = 1.0;

/// A descent has its final speed below this height,
const SLOW_HEIGHT_M_MAX: f64 = 1.2;
/// or this one where a maneuver left the height unsure,
const UNSURE_SLOW_HEIGHT_M_MAX: f64 = 2.2;
/// and slows down to it by this much for each metre.
const SLOWING_1_S: f64 = 0.8;
/// A floor not met this far below where it was thought to be means that the vehicle sinks slower than it thinks,
const OVERDUE_HEIGHT_M: f64 = 0.3;
/// and it sinks faster by this much for each metre more.
const HURRYING_1_S: f64 = 0.5;

/// Least and greatest collective of a descent, by that of hover.
const DESCENT_RATIO_MIN: f64 = 0.7;
const DESCENT_RATIO_MAX: f64 = 1.25;

/// Tilt below which a vehicle has recovered from an aborted maneuver.
const RECOVERED_RAD: f64 = 0.35;

/// A gyro lost for longer than this ends a maneuver; for shorter, its last reading serves.
const GYRO_GAP_MAX: Span = Span::from_millis(20);

/// A tick that comes later than this after the one before is reckoned as this much time.
const TICK_SPAN_MAX: Span = Span::from_millis(10);

/// Frames and payloads received, and why some were not used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReceiveCounters {
    /// Command frames obeyed.
    pub commands_accepted: u64,
    /// Command frames that were no valid frame: checksum, version, range.
    pub commands_damaged: u64,
    /// Command frames that repeated the counter of the one before.
    pub commands_repeated: u64,
    /// Payloads obeyed.
    pub payloads_accepted: u64,
    /// Payloads that were no valid message.
    pub payloads_damaged: u64,
    /// Frames and payloads for another vehicle.
    pub misaddressed: u64,
}

/// What is flown at a tick.
#[derive(Clone, Copy, Debug)]
struct Flown {
    collective_m_s2: f64,
    rate_rad_s: Vector<Body>,
}

/// A vehicle's firmware.
#[derive(Clone, Debug)]
pub struct Firmware {
    settings: FirmwareSettings,
    sensors: Sensors,
    own: OwnState,
    thrust: ThrustRatio,
    supervisor: Supervisor,
    touchdown: TouchdownDetector,
    generator: CommandGenerator,
    store: ParameterStore,
    rate_loop: RateLoop,
    telemetry: Telemetry,
    counters: ReceiveCounters,
    ticked: Option<Time>,
    /// Collective commanded at the last tick.
    collective_m_s2: f64,
}

impl Firmware {
    /// A vehicle that has just been switched on.
    ///
    /// # Errors
    /// [`SettingsError`] names a setting nothing can fly with.
    pub fn new(settings: FirmwareSettings) -> Result<Self, SettingsError> {
        settings.check()?;
        Ok(Self {
            thrust: ThrustRatio::new(&settings.airframe),
            settings,
            sensors: Sensors::default(),
            own: OwnState::default(),
            supervisor: Supervisor::default(),
            touchdown: TouchdownDetector::default(),
            generator: CommandGenerator::default(),
            store: ParameterStore::default(),
            rate_loop: RateLoop::default(),
            telemetry: Telemetry::default(),
            counters: ReceiveCounters::default(),
            ticked: None,
            collective_m_s2: 0.0,
        })
    }

    /// One tick of the rate loop, 800 times a second: sensors in, motor commands out (front, back, left,
    /// right; 0 is off, else from the command of the least thrust to
    /// [`MOTOR_COMMAND_MAX`](crate::MOTOR_COMMAND_MAX)).
    pub fn tick(&mut self, now: Time, imu: &ImuSample) -> [u8; 4] {
        self.commanded_thrusts_n(now, imu)
            .map_or([0; 4], |thrusts| motor_commands(&self.settings.airframe, thrusts))
    }

    /// The tick up to the thrusts, `None` with motors off.
    pub(crate) fn commanded_thrusts_n(&mut self, now: Time, imu: &ImuSample) -> Option<[f64; 4]> {
        let since =
            self.ticked.map_or(TICK, |ticked| elapsed(ticked, now).max(Span::ZERO).min(TICK_SPAN_MAX));
        self.ticked = Some(now);
        let mode_before = self.supervisor.mode();
        self.sensors.update(now, imu, mode_before == FlightMode::Maneuver);
        self.feel_motion(now, since.as_secs_f64());
        self.check_gyros(now);
        self.judge_order(now);
        let setpoint = self.step_maneuver(now);
        self.supervisor.tick(now, &self.own, &self.settings.failsafe);
        if self.supervisor.mode() == FlightMode::Descend {
            self.feel_for_ground(now);
        } else {
            self.touchdown = TouchdownDetector::default();
        }
        if self.supervisor.recovering() && self.own.tilt_rad().is_none_or(|tilt| tilt < RECOVERED_RAD) {
            self.supervisor.recovered();
        }
        self.reset_rate_loop(mode_before);
        let thrusts = match (self.flown(setpoint), setpoint) {
            (None, _) => None,
            (Some(flown), Some(_)) => Some(self.flip(flown)),
            (Some(flown), None) => Some(self.fly(flown)),
        };
        if thrusts.is_none() {
            self.collective_m_s2 = 0.0;
        }
        thrusts
    }

    /// Carries what the vehicle knows of itself through a tick.
    fn feel_motion(&mut self, now: Time, dt_s: f64) {
        let (rate_rad_s, acceleration_m_s2) = (self.sensors.rate_rad_s, self.sensors.acceleration_m_s2);
        let height_m = self.own.vertical().map_or(0.0, |vertical| vertical.height_m);
        let going = match self.supervisor.mode() {
            FlightMode::Flying | FlightMode::LevelHold | FlightMode::Descend if self.hinted(now) => {
                (height_m > AIRBORNE_HEIGHT_M_MIN).then_some(Going::Led)
            }
            FlightMode::Flying => (height_m > AIRBORNE_HEIGHT_M_MIN).then_some(Going::Alone),
            FlightMode::LevelHold | FlightMode::Descend => Some(Going::Alone),
            _ => None,
        };
        let going = going.unwrap_or(Going::Otherwise);
        if going == Going::Led || going == Going::Alone && height_m > LOW_HEIGHT_M_MAX {
            self.thrust.learn(acceleration_m_s2.z, self.collective_m_s2, dt_s);
        }
        self.own.predict(rate_rad_s, acceleration_m_s2, dt_s, going, &self.settings.attitude);
    }

    /// Whether the ground still tells the vehicle of itself.
    fn hinted(&self, now: Time) -> bool {
        self.supervisor.command_fresh(now, &self.settings.failsafe)
            && self
                .supervisor
                .command()
                .is_some_and(|received| received.frame.attitude_valid || received.frame.height_valid)
    }

    /// Nothing flies without gyros: a maneuver ends soon, and if they do not come back the motors stop.
    fn check_gyros(&mut self, now: Time) {
        let Some(lost_for) = self.sensors.gyro_lost_for(now) else {
            return;
        };
        if lost_for > GYRO_GAP_MAX && self.generator.abort(now, Reason::SensorFault) {
            self.abort_maneuver(now);
        }
        if lost_for > self.settings.failsafe.gyro_loss_max && self.supervisor.motors_on() {
            self.supervisor.stop(false);
        }
    }

    fn judge_order(&mut self, now: Time) {
        let Some(order) = self.generator.take_order() else {
            return;
        };
        let moment = Moment {
            now,
            supervisor: &self.supervisor,
            store: &self.store,
            sensors: &self.sensors,
            own: &self.own,
        };
        match moment.judge(&order, &self.settings) {
            Ok(primitive) => {
                self.generator.begin(now, order, primitive);
                let planned_end = self.generator.planned_end().unwrap_or(now);
                self.supervisor.maneuver_began(planned_end, &self.settings.failsafe);
            }
            Err(reason) => self.generator.refuse(now, order, reason),
        }
    }

    fn step_maneuver(&mut self, now: Time) -> Option<Setpoint> {
        match self.generator.step(now, self.sensors.rate_rad_s, &self.settings) {
            Step::Idle => None,
            Step::Fly(setpoint) => Some(setpoint),
            Step::Completed => {
                self.own.maneuver_ended();
                self.supervisor.maneuver_completed();
                None
            }
            Step::Aborted => {
                self.abort_maneuver(now);
                None
            }
        }
    }

    fn abort_maneuver(&mut self, now: Time) {
        self.own.maneuver_ended();
        self.supervisor.maneuver_aborted(now, &self.settings.failsafe);
    }

    fn feel_for_ground(&mut self, now: Time) {
        let hinted = self.hinted(now);
        let force_m_s2 = self.sensors.acceleration_m_s2.z;
        let expected_m_s2 = self.collective_m_s2 * self.thrust.ratio();
        if self.touchdown.tick(now, force_m_s2, expected_m_s2, &self.own, hinted) {
            self.supervisor.touched_down();
        }
    }

    /// Integrals start at zero with the motors, with a maneuver, and with what follows it.
    fn reset_rate_loop(&mut self, mode_before: FlightMode) {
        let mode = self.supervisor.mode();
        let maneuver_edge = (mode == FlightMode::Maneuver) != (mode_before == FlightMode::Maneuver);
        if maneuver_edge || !self.supervisor.motors_on() {
            self.rate_loop.reset();
        }
    }

    /// What to fly in the present mode, `None` with motors off.
    fn flown(&self, setpoint: Option<Setpoint>) -> Option<Flown> {
        match self.supervisor.mode() {
            FlightMode::Disarmed | FlightMode::Landed | FlightMode::Stopped => None,
            FlightMode::Maneuver => setpoint.map(|setpoint| Flown {
                collective_m_s2: setpoint.collective_m_s2,
                rate_rad_s: Vector::new(0.0, setpoint.rate_rad_s, 0.0),
            }),
            FlightMode::Flying => self.supervisor.command().map(|received| Flown {
                collective_m_s2: received.frame.collective_m_s2,
                rate_rad_s: received.frame.rate_rad_s,
            }),
            FlightMode::LevelHold => Some(self.level(GRAVITY_M_S2)),
            FlightMode::Descend => Some(self.level(self.descent_force_m_s2())),
        }
    }

    /// Level, or braking what it feels of its drift, with this force along the vertical.
    fn level(&self, vertical_m_s2: f64) -> Flown {
        let upright = self.own.upright_ratio();
        let force_m_s2 = if upright < OVER_RATIO {
            vertical_m_s2 * OVER_THRUST_RATIO
        } else {
            vertical_m_s2 / upright.max(UPRIGHT_RATIO_MIN)
        };
        let drift = &self.settings.attitude.drift;
        let low = |height_m| height_m < LOW_HEIGHT_M_MAX;
        let brake_rad_max = if self.supervisor.recovering() {
            0.0
        } else if self.own.vertical().is_some_and(|vertical| low(vertical.height_m)) {
            drift.low_brake_rad_max
        } else {
            drift.brake_rad_max
        };
        Flown {
            collective_m_s2: force_m_s2 / self.thrust.ratio(),
            rate_rad_s: self.own.levelling_rate_rad_s(&self.settings.attitude, brake_rad_max),
        }
    }

    fn descent_force_m_s2(&self) -> f64 {
        let failsafe = &self.settings.failsafe;
        self.own.vertical().map_or(GRAVITY_M_S2 * failsafe.blind_descent_ratio, |vertical| {
            let slow_height_m = if self.own.is_sure() { SLOW_HEIGHT_M_MAX } else { UNSURE_SLOW_HEIGHT_M_MAX };
            let high_m = (vertical.height_m - slow_height_m).max(0.0);
            let overdue_m = (-OVERDUE_HEIGHT_M - vertical.height_m).max(0.0);
            let wanted_m_s = (failsafe.descent_m_s + SLOWING_1_S * high_m + HURRYING_1_S * overdue_m)
                .min(failsafe.high_descent_m_s_max);
            let missing_m_s = -wanted_m_s - vertical.speed_m_s;
            (GRAVITY_M_S2 + self.settings.attitude.descent_gain_1_s * missing_m_s)
                .clamp(GRAVITY_M_S2 * DESCENT_RATIO_MIN, GRAVITY_M_S2 * DESCENT_RATIO_MAX)
        })
    }

    fn flip(&mut self, flown: Flown) -> [f64; 4] {
        let error = self.rate_error(&flown);
        let turn = self.rate_loop.flip(error, &self.settings);
        self.mix(&flown, turn, YawShare::Sides)
    }

    fn fly(&mut self, flown: Flown) -> [f64; 4] {
        let error = self.rate_error(&flown);
        let grounded = flown.collective_m_s2 < GROUNDED_RATIO * self.settings.airframe.hover_collective_m_s2
            && self.supervisor.mode() == FlightMode::Flying;
        let turn = self.rate_loop.fly(error, &self.settings, grounded);
        self.mix(&flown, turn, YawShare::All)
    }

    fn rate_error(&self, flown: &Flown) -> RateError {
        RateError {
            error_rad_s: flown.rate_rad_s - self.sensors.rate_rad_s,
            room_rad_s2: room_rad_s2(&self.settings.airframe, flown.collective_m_s2),
        }
    }

    fn mix(
        &mut self,
        flown: &Flown,
        angular_acceleration_rad_s2: Vector<Body>,
        yaw_share: YawShare,
    ) -> [f64; 4] {
        self.collective_m_s2 = flown.collective_m_s2;
        let yaw_thrust_n_max = self.settings.rates.yaw_thrust_n_max;
        let airframe = &self.settings.airframe;
        thrusts_n(airframe, flown.collective_m_s2, angular_acceleration_rad_s2, yaw_share, yaw_thrust_n_max)
    }

    /// The command link's receiver has a frame. One the receiver itself repeated or made up is not used.
    pub fn receive_sbus(&mut self, now: Time, frame: &sbus::Frame) {
        if !frame.failsafe && !frame.frame_lost {
            self.receive_channels(now, &frame.channels);
        }
    }

    /// The sixteen channels of a command frame. What is damaged, repeated or not for this vehicle changes
    /// nothing but the [counters](Self::counters).
    pub fn receive_channels(&mut self, now: Time, channels: &[u16; 16]) {
        let map = self.settings.channel_map;
        let Ok((vehicle, frame)) = map.decode(channels, self.settings.vehicle) else {
            self.counters.commands_damaged += 1;
            return;
        };
        if vehicle != self.settings.vehicle {
            self.counters.misaddressed += 1;
            return;
        }
        self.receive_frame(now, frame);
    }

    /// A command frame that no channels carried.
    pub fn receive_frame(&mut self, now: Time, frame: CommandFrame) {
        let in_maneuver = self.generator.is_running();
        if !self.supervisor.accept(now, frame, &self.own, &self.settings.failsafe) {
            self.counters.commands_repeated += 1;
            return;
        }
        self.counters.commands_accepted += 1;
        self.end_maneuver_if_stopped(now);
        if !in_maneuver {
            self.own.correct(&frame, self.sensors.rate_rad_s, &self.settings.attitude);
        }
    }

    /// A payload of the data link. What is damaged or not for this vehicle changes nothing but the
    /// [counters](Self::counters).
    pub fn receive_payload(&mut self, now: Time, payload: &[u8]) {
        let Ok((vehicle, message)) = Uplink::decode(payload) else {
            self.counters.payloads_damaged += 1;
            return;
        };
        if vehicle != self.settings.vehicle {
            self.counters.misaddressed += 1;
            return;
        }
        self.counters.payloads_accepted += 1;
        self.obey(now, message);
    }

    fn obey(&mut self, now: Time, message: Uplink) {
        match message {
            Uplink::Begin { set_id, count, digest } => {
                self.telemetry.upload_reply(self.store.begin(set_id, count, digest));
            }
            Uplink::Items(items) => self.telemetry.upload_reply(self.store.items(&items)),
            Uplink::Commit { set_id, digest } => {
                let (busy, settings) = (self.generator.is_running(), &self.settings);
                let reply = self.store.commit(set_id, digest, busy, |items| admit(items, settings).is_some());
                self.telemetry.upload_reply(reply);
            }
            Uplink::Start { maneuver_id, set_id, digest } => {
                self.generator.order(StartOrder { maneuver_id, set_id, digest });
            }
            Uplink::Abort { maneuver_id } => {
                if self.generator.record().id == maneuver_id
                    && self.generator.abort(now, Reason::AbortOrdered)
                {
                    self.abort_maneuver(now);
                }
            }
            Uplink::Ping { token } => self.telemetry.ping(now, token),
            Uplink::Stop => {
                self.supervisor.stop(true);
                self.end_maneuver_if_stopped(now);
            }
            Uplink::Rearm => self.supervisor.rearm(),
        }
    }

    fn end_maneuver_if_stopped(&mut self, now: Time) {
        if self.supervisor.mode() == FlightMode::Stopped {
            self.generator.abort(now, Reason::Stopped);
        }
    }

    /// Writes the next payload due for the ground and answers its length; call it until it answers `None`.
    /// `out` should hold [`PAYLOAD_BYTES_MAX`](device::vehicle_link::PAYLOAD_BYTES_MAX) bytes; what does not
    /// fit is lost.
    pub fn poll_transmit(&mut self, now: Time, out: &mut [u8]) -> Option<usize> {
        let status = self.status(now);
        self.telemetry.poll(now, status)?.encode(self.settings.vehicle, out).ok()
    }

    /// Identity and items of the active set: what a maneuver that begins now flies.
    #[must_use]
    pub fn active_set(&self) -> Option<(u16, &[f32])> {
        self.store.active().map(|set| (set.id, set.items()))
    }

    /// The vehicle's report on itself at this moment.
    #[must_use]
    pub fn status(&self, now: Time) -> Status {
        let record = self.generator.record();
        let command = self.supervisor.command();
        let age_ms = self.supervisor.command_age(now).map_or(i64::MAX, |age| age.as_nanos() / 1_000_000);
        let battery_v = self.sensors.battery_v();
        let active = self.store.active();
        Status {
            uptime_us: micros(now),
            mode: self.supervisor.mode(),
            // `as` saturates; the voltage is known to be a number.
            battery_mv: (battery_v * 1e3 + 0.5) as u16,
            set_id: active.map_or(0, |set| set.id),
            set_digest: active.map_or(0, |set| set.digest),
            maneuver_id: record.id,
            maneuver_phase: record.phase,
            reason: record.reason,
            began_us: micros(record.began),
            ended_us: micros(record.ended),
            command_age_ms: u16::try_from(age_ms.max(0)).unwrap_or(u16::MAX),
            command_counter: command.map_or(0, |received| received.frame.counter),
            command_received_us: command.map_or(0, |received| micros(received.at)),
            flags: self.flags(now),
        }
    }

    fn flags(&self, now: Time) -> StatusFlags {
        StatusFlags::default()
            .with_if(self.supervisor.latched(), StatusFlags::LATCHED)
            .with_if(self.supervisor.emergency(), StatusFlags::EMERGENCY_STOP)
            .with_if(self.sensors.faulty(now), StatusFlags::SENSOR_FAULT)
            .with_if(self.sensors.battery_v() < self.settings.gate.battery_v_min, StatusFlags::BATTERY_LOW)
            .with_if(self.own.attitude_known(), StatusFlags::ATTITUDE_KNOWN)
            .with_if(self.own.vertical().is_some(), StatusFlags::HEIGHT_KNOWN)
            .with_if(!self.supervisor.command_fresh(now, &self.settings.failsafe), StatusFlags::COMMAND_STALE)
    }

    /// What is being done.
    #[must_use]
    pub const fn mode(&self) -> FlightMode {
        self.supervisor.mode()
    }

    /// What was received so far.
    #[must_use]
    pub const fn counters(&self) -> ReceiveCounters {
        self.counters
    }

    /// The settings the vehicle was switched on with.
    #[must_use]
    pub const fn settings(&self) -> &FirmwareSettings {
        &self.settings
    }
}
