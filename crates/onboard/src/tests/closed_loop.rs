//! The rate loop around rotors that lag, and whole flips against the learner's model.

use super::*;
use device::vehicle_link::ManeuverPhase;
use maneuver::{Discretisation, Envelope, FinalError, FlipDesign, Integral, Model, Parameters, final_error};
use quantity::math;

use crate::{LOOP_HZ, RateGains};

/// The vertical plane of the paper's model: x, z, vx, vz, theta, rate, thrust at the back, thrust at the
/// front.
type Plane = [f64; 8];

const HOVERING: Plane = {
    let hover_n = 0.468 * GRAVITY_M_S2 / 4.0;
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, hover_n, hover_n]
};

/// Slopes under commanded thrusts. // Lupashin 2010, eqs. (1) to (6).
fn slopes(model: &Model, state: &Plane, back_n: f64, front_n: f64) -> Plane {
    let [_, _, vx, vz, theta, rate, back, front] = *state;
    let collective = 2.0 * (back + front) / model.mass_kg;
    let (sin, cos) = math::sin_cos(theta);
    let lag = |missing: f64| {
        missing * if missing >= 0.0 { model.rotor_gain_up_1_s } else { model.rotor_gain_down_1_s }
    };
    [
        vx,
        vz,
        collective * sin,
        collective * cos - GRAVITY_M_S2,
        rate,
        model.arm_m * (back - front) / model.inertia_kg_m2,
        lag(back_n - back),
        lag(front_n - front),
    ]
}

/// Runge-Kutta over `dt_s` in four parts.
fn advance(model: &Model, state: &mut Plane, back_n: f64, front_n: f64, dt_s: f64) {
    let h = dt_s / 4.0;
    let moved = |state: &Plane, slope: &Plane, by: f64| -> Plane {
        core::array::from_fn(|index| state[index] + by * slope[index])
    };
    for _ in 0..4 {
        let k1 = slopes(model, state, back_n, front_n);
        let k2 = slopes(model, &moved(state, &k1, h / 2.0), back_n, front_n);
        let k3 = slopes(model, &moved(state, &k2, h / 2.0), back_n, front_n);
        let k4 = slopes(model, &moved(state, &k3, h), back_n, front_n);
        *state = core::array::from_fn(|i| state[i] + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]));
    }
}

/// What a thrust becomes through the motor command.
fn through_motor(thrusts_n: [f64; 4], settings: &FirmwareSettings) -> [f64; 4] {
    crate::mixer::motor_commands(&settings.airframe, thrusts_n)
        .map(|command| 2.8 * (f64::from(command) / 200.0) * (f64::from(command) / 200.0))
}

struct Flip {
    model: Model,
    set: FlipSet,
    settings: FirmwareSettings,
}

impl Flip {
    /// A model whose lever is exactly one that an `f32` carries, and the firmware of the same vehicle.
    fn new(set: FlipSet, integral: Integral) -> Self {
        let lever_m = Model::TABLE_I.alpha_l_m() as f32;
        let inertia_kg_m2 = f64::from(lever_m) * Model::TABLE_I.mass_kg * Model::TABLE_I.arm_m / 2.0;
        let model = Model { inertia_kg_m2, integral, ..Model::TABLE_I };
        let mut settings = FirmwareSettings::table_i(VEHICLE);
        settings.airframe.inertia_kg_m2[1] = inertia_kg_m2;
        settings.rates.maneuver.integral = integral;
        Self { model, set: FlipSet { lever_m, ..set }, settings }
    }

    fn by_model(&self) -> FinalError {
        let set = &self.set;
        let design = FlipDesign {
            flips: set.flips as u8,
            rate_rad_s_max: f64::from(set.rate_rad_s_max),
            envelope: Envelope::new(f64::from(set.envelope_low_m_s2), f64::from(set.envelope_high_m_s2))
                .unwrap(),
        };
        let parameters = [set.u1_m_s2, set.t1_s, set.t3_s, set.u5_m_s2, set.t5_s].map(f64::from);
        let parameters = Parameters::from_array(parameters);
        final_error(&self.model, &design, &parameters, Discretisation::Hold800).unwrap()
    }

    /// The final error of the model's plane under the firmware's thrusts, exact or through the motors' 200
    /// steps.
    fn by_firmware(&self, quantised: bool) -> FinalError {
        let mut bench = Bench::new(self.settings).brought_to(6.0);
        bench.upload(7, &self.set);
        bench.start(1, 7, &self.set);
        let mut plane = HOVERING;
        loop {
            bench.send_frame();
            bench.imu.rate_rad_s = Vector::new(0.0, plane[5], 0.0);
            let thrusts = bench.firmware.commanded_thrusts_n(bench.now, &bench.imu).unwrap();
            let status = bench.status();
            if status.maneuver_phase != ManeuverPhase::Running {
                assert_eq!(status.maneuver_phase, ManeuverPhase::Completed, "{:?}", status.reason);
                break;
            }
            let planned_s =
                crate::command_generator::admit(&self.set.to_items(), &self.settings).unwrap().duration_s();
            let into_s = (bench.now - Time::from_nanos(status.began_us as i64 * 1_000)).as_secs_f64();
            let [front, back, left, right] =
                if quantised { through_motor(thrusts, &self.settings) } else { thrusts };
            assert_eq!(left, right);
            advance(&self.model, &mut plane, back, front, (planned_s - into_s).min(1.0 / LOOP_HZ));
            bench.now += TICK;
        }
        let turn_rad = core::f64::consts::TAU * f64::from(self.set.flips);
        FinalError {
            x_m: plane[0],
            z_m: plane[1],
            vx_m_s: plane[2],
            vz_m_s: plane[3],
            theta_rad: plane[4] - turn_rad,
        }
    }
}

fn distance(a: FinalError, b: FinalError) -> f64 {
    let squares = a.to_array().iter().zip(b.to_array()).map(|(a, b)| (a - b) * (a - b)).sum();
    math::sqrt(squares)
}

const TRIPLE: FlipSet = FlipSet {
    u1_m_s2: 20.79507,
    t1_s: 0.25931,
    t3_s: 0.50143,
    u5_m_s2: 20.75617,
    t5_s: 0.27774,
    flips: 3.0,
    ..DOUBLE
};

#[test]
fn a_flip_on_the_firmware_is_the_learners_flip_at_800_hz() {
    for set in [DOUBLE, TRIPLE] {
        for integral in [Integral::Literal, Integral::Conditional] {
            let flip = Flip::new(set, integral);
            let (model, firmware) = (flip.by_model(), flip.by_firmware(false));
            assert!(distance(model, firmware) < 1e-6, "{model:?} {firmware:?}");
        }
    }
}

#[test]
fn the_motors_200_steps_move_a_flips_end_by_centimetres() {
    let flip = Flip::new(DOUBLE, Integral::Literal);
    let moved = distance(flip.by_model(), flip.by_firmware(true));
    assert!((1e-4..0.05).contains(&moved), "{moved}");
}

/// Pitch rate of the plane after a step of the commanded rate, tick by tick, in normal flight.
fn rate_step(gains: RateGains, step_rad_s: f64, seconds: f64) -> Vec<f64> {
    let mut settings = FirmwareSettings::table_i(VEHICLE);
    settings.rates.flight = gains;
    let mut bench = Bench::new(settings).brought_to(6.0);
    bench.frame.rate_rad_s = Vector::new(0.0, step_rad_s, 0.0);
    (bench.frame.attitude_valid, bench.frame.height_valid) = (false, false);
    let commanded = bench.frame.quantise().unwrap().rate_rad_s.y;
    let mut plane = HOVERING;
    let mut rates = Vec::new();
    for tick in 0..(seconds * LOOP_HZ) as u32 {
        if tick % 16 == 0 {
            bench.send_frame();
        }
        bench.imu.rate_rad_s = Vector::new(0.0, plane[5], 0.0);
        let thrusts = bench.firmware.commanded_thrusts_n(bench.now, &bench.imu).unwrap();
        let [front, back, ..] = through_motor(thrusts, &settings);
        advance(&Model::TABLE_I, &mut plane, back, front, 1.0 / LOOP_HZ);
        bench.now += TICK;
        rates.push(plane[5] / commanded);
    }
    rates
}

/// Greatest overshoot, and when the rate was last off by over 5 %.
fn overshoot_and_settling(rates: &[f64]) -> (f64, f64) {
    let overshoot = rates.iter().copied().fold(0.0, f64::max) - 1.0;
    let settled = rates.iter().rposition(|rate| (rate - 1.0).abs() > 0.05).unwrap_or(0);
    (overshoot, (settled + 1) as f64 / LOOP_HZ)
}

#[test]
fn the_papers_gains_ring_but_settle_and_the_calm_ones_hardly_ring() {
    let (overshoot, settling_s) = overshoot_and_settling(&rate_step(RateGains::TABLE_I, 0.2, 1.5));
    assert!((0.75..0.9).contains(&overshoot), "{overshoot}");
    assert!((0.35..0.5).contains(&settling_s), "{settling_s}");
    let (overshoot, settling_s) = overshoot_and_settling(&rate_step(RateGains::CALM, 0.2, 1.5));
    assert!((0.25..0.35).contains(&overshoot), "{overshoot}");
    assert!(settling_s < 0.2, "{settling_s}");
}
