//! Collective and angular accelerations to thrusts, thrusts to motor commands.
//!
//! The propellers stand at front (+x), back (-x), left (+y) and right (-y); every array here is in that
//! order. More thrust at the back than at the front turns about +y and tips the thrust toward +x; more at the
//! left than at the right turns about +x.

use quantity::{Body, Vector, math};

use crate::settings::Airframe;

/// Motor command of full speed; 0 is off.
pub const MOTOR_COMMAND_MAX: u8 = 200;

/// How yaw is mixed in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum YawShare {
    /// By all four propellers, leaving the collective as it is.
    All,
    /// By the two at the sides alone, leaving the plane of a flip to the flip. // Lupashin 2010, eqs. (4),
    /// (7), (8).
    Sides,
}

/// Greatest angular accelerations about roll and pitch that still change a propeller's command at this
/// collective.
pub(crate) fn room_rad_s2(airframe: &Airframe, collective_m_s2: f64) -> [f64; 2] {
    let share_n = airframe.mass_kg * collective_m_s2 / 4.0;
    let room_n = (airframe.thrust_n_max - share_n).max(share_n - airframe.thrust_n_min);
    [0, 1].map(|axis| room_n * 2.0 * airframe.arm_m / airframe.inertia_kg_m2[axis])
}

/// The commanded thrusts, each within its range. // Lupashin 2010, eqs. (4), (7), (8).
pub(crate) fn thrusts_n(
    airframe: &Airframe,
    collective_m_s2: f64,
    angular_acceleration_rad_s2: Vector<Body>,
    yaw_share: YawShare,
    yaw_thrust_n_max: f64,
) -> [f64; 4] {
    let [roll_inertia, pitch_inertia, yaw_inertia] = airframe.inertia_kg_m2;
    let share = airframe.mass_kg * collective_m_s2 / 4.0;
    let roll = roll_inertia * angular_acceleration_rad_s2.x / (2.0 * airframe.arm_m);
    let pitch = pitch_inertia * angular_acceleration_rad_s2.y / (2.0 * airframe.arm_m);
    // A quarter of the yaw torque from each of four, or half from each of two.
    let yaw_torque_n_m = yaw_inertia * angular_acceleration_rad_s2.z;
    let (front_back, sides) = match yaw_share {
        YawShare::All => (0.25, -0.25),
        YawShare::Sides => (0.0, -0.5),
    };
    let yaw_n = |part: f64| {
        (part * yaw_torque_n_m / airframe.yaw_torque_per_thrust_m).clamp(-yaw_thrust_n_max, yaw_thrust_n_max)
    };
    [
        share - pitch + yaw_n(front_back),
        share + pitch + yaw_n(front_back),
        share + roll + yaw_n(sides),
        share - roll + yaw_n(sides),
    ]
    .map(|thrust| thrust.clamp(airframe.thrust_n_min, airframe.thrust_n_max))
}

/// Motor commands that give these thrusts on this vehicle's propellers. They stay within what corresponds to
/// the thrust range whatever the trim says.
pub(crate) fn motor_commands(airframe: &Airframe, thrusts_n: [f64; 4]) -> [u8; 4] {
    let exact = |thrust_n: f64| {
        f64::from(MOTOR_COMMAND_MAX) * math::sqrt(thrust_n.max(0.0) / airframe.full_command_thrust_n)
    };
    let least = math::ceil(exact(airframe.thrust_n_min) - 1e-9);
    let greatest = math::floor(exact(airframe.thrust_n_max) + 1e-9);
    let mut commands = [0; 4];
    for (command, (thrust_n, trim)) in commands.iter_mut().zip(thrusts_n.iter().zip(airframe.trim_ratio)) {
        // `as` saturates at the ends of the byte.
        *command = math::round(exact(thrust_n * trim)).max(least).min(greatest) as u8;
    }
    commands
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::FirmwareSettings;

    const AIRFRAME: Airframe = FirmwareSettings::table_i(1).airframe;

    fn thrusts(x: f64, y: f64, z: f64, yaw_share: YawShare) -> [f64; 4] {
        thrusts_n(&AIRFRAME, 9.81, Vector::new(x, y, z), yaw_share, 0.2)
    }

    /// Torques about x, y and z that the vehicle feels from four thrusts.
    fn torques([front, back, left, right]: [f64; 4]) -> [f64; 3] {
        let (l, c) = (AIRFRAME.arm_m, AIRFRAME.yaw_torque_per_thrust_m);
        [l * (left - right), l * (back - front), c * (front + back - left - right)]
    }

    #[test]
    fn angular_accelerations_come_out_as_asked() {
        for yaw_share in [YawShare::All, YawShare::Sides] {
            let [x, y, z] = torques(thrusts(3.0, -5.0, 0.7, yaw_share));
            for (torque, wanted) in [(x, 0.0023 * 3.0), (y, 0.0023 * -5.0), (z, 0.004 * 0.7)] {
                assert!((torque - wanted).abs() < 1e-12);
            }
        }
        let sum: f64 = thrusts(3.0, -5.0, 0.7, YawShare::All).iter().sum();
        assert!((sum - 9.81 * 0.468).abs() < 1e-12);
    }

    #[test]
    fn a_flip_has_its_plane_for_itself() {
        let calm = thrusts(0.0, 20.0, 0.0, YawShare::Sides);
        let turning = thrusts(1.0, 20.0, 3.0, YawShare::Sides);
        assert_eq!(calm[..2], turning[..2]);
        assert_eq!(calm[2], 9.81 * 0.468 / 4.0);
    }

    #[test]
    fn yaw_cannot_take_everything_and_no_thrust_leaves_its_range() {
        let [front, ..] = thrusts(0.0, 0.0, 1e9, YawShare::All);
        assert!((front - (9.81 * 0.468 / 4.0 + 0.2)).abs() < 1e-12);
        let wild = thrusts(1e9, -1e9, 1e9, YawShare::All);
        assert_eq!(wild, [2.8, 0.08, 2.8, 0.08]);
    }

    #[test]
    fn commands_follow_the_square_root_and_stay_in_range() {
        assert_eq!(motor_commands(&AIRFRAME, [2.8, 0.7, 0.08, 1.147_77]), [200, 100, 34, 128]);
        let mut trimmed = AIRFRAME;
        trimmed.trim_ratio = [1.5, 1.21, 0.2, 1.0];
        assert_eq!(motor_commands(&trimmed, [2.8, 0.7, 0.08, 0.7]), [200, 110, 34, 100]);
        trimmed.full_command_thrust_n = 3.5;
        let commands = motor_commands(&trimmed, [2.8, 2.8, 0.08, 0.08]);
        for command in commands {
            let ratio = f64::from(command) / 200.0;
            assert!((0.08..=2.8).contains(&(3.5 * ratio * ratio)), "{command}");
        }
    }

    #[test]
    fn room_is_what_the_farther_limit_leaves() {
        let [_, pitch] = room_rad_s2(&AIRFRAME, 9.81);
        let thrusts = thrusts(0.0, pitch, 0.0, YawShare::All);
        assert_eq!(thrusts[0], 0.08);
        assert!((thrusts[1] - 2.8).abs() < 1e-9);
    }
}
