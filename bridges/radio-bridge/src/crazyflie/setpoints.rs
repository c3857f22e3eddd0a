//! Commands as a Crazyflie's setpoints.
//!
//! | Command | Setpoint |
//! | --- | --- |
//! | fly | manual: the rates, and the thrust that gives the collective acceleration |
//! | descend | manual: level by the vehicle's own attitude, and the thrust of a descent at 1 m/s |
//! | disarmed | stop; of a vehicle that flies above half a metre, a descent |
//!
//! Thrust is taken to be linear in the command, 65 535 being four times the settings' `rotor.thrust_n_max`: so the
//! firmware's battery compensation makes it. Whatever is wrong with that, the estimator's disturbance makes up for in
//! flight.

use device::crtp::{PACKET_BYTES_MAX, Packet, Setpoint};
use quantity::{GRAVITY_M_S2, Span, Time, Vector};
use schemas::{CommandMode, VehicleCommand};

use crate::form::Framed;

/// Cutting the motors drops the vehicle: above this height it descends instead.
const DISARM_HEIGHT_M_MAX: f64 = 0.5;
/// Speed of a descent.
const DESCENT_M_S: f64 = 1.0;
/// Vertical acceleration by error of the vertical speed in a descent, and the greatest.
const DESCENT_GAIN_1_S: f64 = 2.0;
const DESCENT_M_S2_MAX: f64 = 2.0;
/// A descent is over so long after it should have met the floor.
const DESCENT_MARGIN: Span = Span::from_secs(2);
/// Two slots of a descent further apart are two descents.
const DESCENT_GAP_MAX: Span = Span::from_millis(500);
/// What a hover takes is the average over about this long.
const HOVER_TIME_S: f64 = 1.0;
/// And lies within these parts of gravity.
const HOVER_RATIO_RANGE: [f64; 2] = [0.6, 1.6];

/// Makes setpoints of one vehicle's commands.
#[derive(Clone, Debug)]
pub(crate) struct Setpoints {
    /// Collective acceleration of a full command.
    full_m_s2: f64,
    /// Whether the vehicle says that it flies.
    flying: bool,
    /// Collective acceleration that held its height lately, as commanded.
    hover_m_s2: f64,
    hover_at: Option<Time>,
    descent: Option<Descent>,
}

/// A descent under way, carried on from what the ground believed when it began.
#[derive(Clone, Copy, Debug)]
struct Descent {
    at: Time,
    ends_at: Time,
    speed_m_s: f64,
}

impl Setpoints {
    /// For a vehicle that has said nothing yet.
    pub(crate) fn new(member: &settings::Vehicle) -> Self {
        Self {
            full_m_s2: member.collective_m_s2_max(),
            flying: false,
            hover_m_s2: GRAVITY_M_S2,
            hover_at: None,
            descent: None,
        }
    }

    /// Takes note of whether the vehicle says that it flies.
    pub(crate) const fn note_flying(&mut self, flying: bool) {
        self.flying = flying;
    }

    /// The setpoint of a command.
    ///
    /// # Errors
    /// Why nothing is to be sent.
    pub(crate) fn frame(&mut self, now: Time, command: &VehicleCommand) -> Result<Framed, &'static str> {
        let finite = command.collective_m_s2.is_finite()
            && command.rate_rad_s.is_finite()
            && command.height_m.is_finite()
            && command.vertical_speed_m_s.is_finite();
        if !finite {
            return Err("the newest command is not finite");
        }
        let high = self.flying && command.height_m > DISARM_HEIGHT_M_MAX;
        match command.mode {
            CommandMode::Fly => {
                self.descent = None;
                self.learn_hover(now, command.collective_m_s2);
                self.fly(command)
            }
            CommandMode::Disarmed if !high => {
                self.descent = None;
                Ok(Self::off())
            }
            CommandMode::Descend | CommandMode::Disarmed => self.descend(now, command),
        }
    }

    /// The setpoint that stops the motors.
    pub(crate) fn stop() -> Vec<u8> {
        bytes(Setpoint::Stop).unwrap_or_default()
    }

    fn off() -> Framed {
        Framed {
            bytes: Self::stop(),
            mode: CommandMode::Disarmed,
            collective_m_s2: 0.0,
            rate_rad_s: Vector::ZERO,
        }
    }

    fn fly(&self, command: &VehicleCommand) -> Result<Framed, &'static str> {
        let (thrust, collective_m_s2) = self.thrust(command.collective_m_s2);
        let setpoint = Setpoint::rates(command.rate_rad_s, thrust);
        let rate_rad_s = setpoint.rate_rad_s().unwrap_or(Vector::ZERO);
        let bytes = bytes(setpoint).ok_or("the newest command's rate is no f32")?;
        Ok(Framed { bytes, mode: CommandMode::Fly, collective_m_s2, rate_rad_s })
    }

    /// The thrust that comes nearest to a collective acceleration, and the one it gives.
    fn thrust(&self, collective_m_s2: f64) -> (u16, f64) {
        let full = f64::from(u16::MAX);
        // `as` saturates at both ends.
        let thrust = (collective_m_s2 / self.full_m_s2 * full + 0.5) as u16;
        (thrust, f64::from(thrust) / full * self.full_m_s2)
    }

    fn learn_hover(&mut self, now: Time, collective_m_s2: f64) {
        let span_s = self.hover_at.map_or(0.0, |at| (now - at).as_secs_f64());
        self.hover_at = Some(now);
        let share = (span_s / HOVER_TIME_S).clamp(0.0, 1.0);
        let [least, most] = HOVER_RATIO_RANGE.map(|ratio| ratio * GRAVITY_M_S2);
        let seen = collective_m_s2.clamp(least, most);
        self.hover_m_s2 += share * (seen - self.hover_m_s2);
    }

    fn descend(&mut self, now: Time, command: &VehicleCommand) -> Result<Framed, &'static str> {
        let begun = self.descent.filter(|descent| now - descent.at <= DESCENT_GAP_MAX);
        let mut descent = match begun {
            Some(descent) => descent,
            // The vehicle levels and stops by itself, which beats a descent from nobody knows where.
            None if command.height_m <= 0.0 => return Err("a descent from no known height"),
            None => Descent {
                at: now,
                ends_at: now.saturating_add(
                    Span::from_secs_f64(command.height_m.min(1e3) / DESCENT_M_S) + DESCENT_MARGIN,
                ),
                speed_m_s: command.vertical_speed_m_s,
            },
        };
        if now >= descent.ends_at {
            self.descent = Some(Descent { at: now, ..descent });
            return Ok(Self::off());
        }
        let wanted = DESCENT_GAIN_1_S * (-DESCENT_M_S - descent.speed_m_s);
        let acceleration = wanted.clamp(-DESCENT_M_S2_MAX, DESCENT_M_S2_MAX);
        descent.speed_m_s += acceleration * (now - descent.at).as_secs_f64();
        descent.at = now;
        self.descent = Some(descent);
        let (thrust, collective_m_s2) = self.thrust(self.hover_m_s2 * (1.0 + acceleration / GRAVITY_M_S2));
        let level = Setpoint::Angles { roll_deg: 0.0, pitch_deg: 0.0, yaw_deg_s: 0.0, thrust };
        let bytes = bytes(level).ok_or("a level setpoint is no packet")?;
        Ok(Framed { bytes, mode: CommandMode::Descend, collective_m_s2, rate_rad_s: Vector::ZERO })
    }
}

fn bytes(setpoint: Setpoint) -> Option<Vec<u8>> {
    let mut out = [0; PACKET_BYTES_MAX];
    let length = Packet::Setpoint(setpoint).encode(&mut out).ok()?;
    Some(out[..length].to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::arena;

    fn ms(milliseconds: i64) -> Time {
        Time::ZERO + Span::from_millis(milliseconds)
    }

    fn setpoints() -> Setpoints {
        Setpoints::new(&arena("crazyflie-hover").fleet[0].vehicle)
    }

    fn command(mode: CommandMode, height_m: f64) -> VehicleCommand {
        VehicleCommand {
            vehicle: 5,
            mode,
            collective_m_s2: 9.8,
            rate_rad_s: Vector::new(0.5, -1.0, 0.25),
            height_m,
            ..VehicleCommand::default()
        }
    }

    fn setpoint(framed: &Framed) -> Setpoint {
        match Packet::decode(&framed.bytes) {
            Ok(Packet::Setpoint(setpoint)) => setpoint,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn the_bytes_of_a_flown_command_are_those_reckoned_apart() {
        let framed = setpoints().frame(ms(0), &command(CommandMode::Fly, 1.0)).expect("sent");
        // 65535 · 9.8 · 0.030 / (4 · 0.147) = 32767.5, rounded up; rates by struct.pack("<fff", ...).
        let expected = [
            0x7C, 0x0B, 0xE1, 0x2E, 0xE5, 0x41, 0xE1, 0x2E, 0x65, 0x42, 0xE1, 0x2E, 0x65, 0x41, 0x00, 0x80, 1,
        ];
        assert_eq!(framed.bytes, expected);
        assert_eq!(framed.mode, CommandMode::Fly);
        assert!((framed.collective_m_s2 - 9.8).abs() < 2e-4 && framed.collective_m_s2 != 9.8);
        assert!((framed.rate_rad_s - Vector::new(0.5, -1.0, 0.25)).norm() < 1e-6);
    }

    #[test]
    fn thrust_ends_where_the_command_does() {
        let setpoints = setpoints();
        assert_eq!(setpoints.thrust(-1.0), (0, 0.0));
        assert_eq!(setpoints.thrust(99.0).0, u16::MAX);
        assert!((setpoints.thrust(99.0).1 - 19.6).abs() < 1e-12);
    }

    #[test]
    fn disarming_stops_on_the_floor_and_descends_in_flight() {
        let mut setpoints = setpoints();
        let high = command(CommandMode::Disarmed, 1.0);
        let carried = setpoints.frame(ms(0), &high).expect("sent");
        assert_eq!((setpoint(&carried), carried.mode), (Setpoint::Stop, CommandMode::Disarmed));
        setpoints.note_flying(true);
        let flying = setpoints.frame(ms(20), &high).expect("sent");
        assert!(matches!(setpoint(&flying), Setpoint::Angles { .. }));
        assert_eq!(flying.mode, CommandMode::Descend);
        let low = setpoints.frame(ms(40), &command(CommandMode::Disarmed, 0.1)).expect("sent");
        assert_eq!(setpoint(&low), Setpoint::Stop);
    }

    #[test]
    fn a_descent_gets_to_one_metre_a_second_level_and_ends() {
        let mut setpoints = setpoints();
        // It hovers on a tenth more than gravity.
        let hover = VehicleCommand { collective_m_s2: 10.8, ..command(CommandMode::Fly, 3.0) };
        (0..500).for_each(|slot| drop(setpoints.frame(ms(20 * slot), &hover)));
        let (mut speed, mut height, mut slots) = (0.3, 3.0, 0);
        let begun = VehicleCommand { vertical_speed_m_s: speed, ..command(CommandMode::Descend, 3.0) };
        loop {
            let framed = setpoints.frame(ms(10_000 + 20 * slots), &begun).expect("sent");
            if framed.mode == CommandMode::Disarmed {
                break;
            }
            let level = setpoint(&framed);
            assert!(matches!(level, Setpoint::Angles { roll_deg: 0.0, pitch_deg: 0.0, .. }), "{level:?}");
            speed += (framed.collective_m_s2 / 10.8 - 1.0) * GRAVITY_M_S2 * 0.02;
            height += speed * 0.02;
            slots += 1;
            assert!(slots < 60 || (speed + 1.0).abs() < 0.1, "{speed} m/s after {slots} slots");
        }
        assert!(height < 0.0 && slots == 250, "{height} m after {slots} slots");
    }

    #[test]
    fn a_descent_from_nowhere_is_left_to_the_vehicle() {
        let mut setpoints = setpoints();
        assert!(setpoints.frame(ms(0), &command(CommandMode::Descend, 0.0)).is_err());
    }

    #[test]
    fn what_is_no_number_is_not_sent() {
        let mut setpoints = setpoints();
        let wrong = VehicleCommand { collective_m_s2: f64::NAN, ..command(CommandMode::Fly, 1.0) };
        assert!(setpoints.frame(ms(0), &wrong).is_err());
        let wild = VehicleCommand { rate_rad_s: Vector::new(1e300, 0.0, 0.0), ..wrong };
        let wild = VehicleCommand { collective_m_s2: 9.0, ..wild };
        assert!(setpoints.frame(ms(0), &wild).is_err());
    }
}
