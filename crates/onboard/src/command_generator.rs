//! Flying a stored flip: what may start, what is commanded meanwhile, what ends it early.

use device::vehicle_link::{FLIP_SET_LEN, FlipSet, ManeuverPhase, Reason};
use maneuver::{Envelope, FlipDesign, Parameters, Primitive, Setpoint};
use quantity::{Body, Span, Time, Vector};

use crate::sensors::elapsed;
use crate::settings::{FirmwareSettings, ManeuverGuard};

/// Most whole turns of a flip.
const FLIPS_MAX: f32 = 10.0;

/// Items travel as `f32`: a limit must not refuse what was cut exactly to it.
const ROUNDING_RATIO: f64 = 1e-6;

/// The flip a set stands for, or `None` where it is none, or none this vehicle flies.
// Lupashin 2010, eqs. (15) to (22).
pub(crate) fn admit(items: &[f32], settings: &FirmwareSettings) -> Option<Primitive> {
    let items: &[f32; FLIP_SET_LEN] = items.try_into().ok()?;
    let set = FlipSet::from_items(items);
    if !(1.0..=FLIPS_MAX).contains(&set.flips) || f32::from(set.flips as u8) != set.flips {
        return None;
    }
    let design = FlipDesign {
        flips: set.flips as u8,
        rate_rad_s_max: f64::from(set.rate_rad_s_max),
        envelope: Envelope {
            low_m_s2: f64::from(set.envelope_low_m_s2),
            high_m_s2: f64::from(set.envelope_high_m_s2),
        },
    };
    let parameters = Parameters {
        u1_m_s2: f64::from(set.u1_m_s2),
        t1_s: f64::from(set.t1_s),
        t3_s: f64::from(set.t3_s),
        u5_m_s2: f64::from(set.u5_m_s2),
        t5_s: f64::from(set.t5_s),
    };
    let lever_m = f64::from(set.lever_m);
    let lever_ratio = lever_m / settings.lever_m();
    let primitive = Primitive::new(&design, lever_m, &parameters).ok()?;
    let ratio_max = settings.limits.lever_ratio_max;
    let lever_fits = lever_ratio <= ratio_max && lever_ratio * ratio_max >= 1.0;
    (lever_fits && within_limits(&primitive, settings)).then_some(primitive)
}

fn within_limits(primitive: &Primitive, settings: &FirmwareSettings) -> bool {
    let limits = &settings.limits;
    let (above, below) = (1.0 + ROUNDING_RATIO, 1.0 - ROUNDING_RATIO);
    let mut rate_rad_s = 0.0;
    for step in primitive.steps() {
        rate_rad_s += step.angular_acceleration_rad_s2 * step.duration_s;
        // Written so that what is no number fails.
        let fits = step.duration_s > 0.0
            && step.collective_m_s2 >= limits.collective_m_s2_min * below
            && step.collective_m_s2 <= limits.collective_m_s2_max * above
            && f64::abs(rate_rad_s) <= limits.rate_rad_s_max * above;
        if !fits {
            return false;
        }
    }
    primitive.duration_s() <= limits.duration_s_max * above
}

/// An order to start, as it came.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct StartOrder {
    /// The maneuver.
    pub maneuver_id: u16,
    /// The set to fly.
    pub set_id: u16,
    /// Its digest.
    pub digest: u64,
}

/// What is reported of the last maneuver.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct ManeuverRecord {
    /// Zero for none.
    pub id: u16,
    /// How far it got.
    pub phase: ManeuverPhase,
    /// Why it was refused or ended early.
    pub reason: Reason,
    /// When it began.
    pub began: Time,
    /// When it ended; of one flown to its end the planned end, which lies up to a tick before the tick that
    /// noticed.
    pub ended: Time,
}

/// A maneuver under way.
#[derive(Clone, Copy, Debug)]
struct Running {
    primitive: Primitive,
    /// Since when something is out of bounds, and what.
    off_axis_since: Option<Time>,
    fast_since: Option<Time>,
    astray_since: Option<Time>,
}

/// What the generator asks for at a tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Step {
    /// No maneuver runs.
    Idle,
    /// Fly this.
    Fly(Setpoint),
    /// The maneuver was flown to its planned end.
    Completed,
    /// The maneuver was ended early.
    Aborted,
}

/// The generator.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct CommandGenerator {
    record: ManeuverRecord,
    order: Option<StartOrder>,
    running: Option<Running>,
}

impl CommandGenerator {
    /// What is reported.
    pub const fn record(&self) -> ManeuverRecord {
        self.record
    }

    /// Whether a maneuver runs.
    pub const fn is_running(&self) -> bool {
        self.running.is_some()
    }

    /// An order arrives; it is judged at the next tick. Each maneuver must follow the last one's identity, so
    /// an order repeated, overtaken or replayed is not obeyed twice; while one runs or is about to, any other
    /// is not heard.
    pub fn order(&mut self, order: StartOrder) {
        let steps_ahead = order.maneuver_id.wrapping_sub(self.record.id);
        let is_new = match self.record.phase {
            ManeuverPhase::None => order.maneuver_id != 0,
            _ => order.maneuver_id != 0 && (1..0x8000).contains(&steps_ahead),
        };
        if is_new && !self.is_running() && self.order.is_none() {
            self.order = Some(order);
        }
    }

    /// The order waiting to be judged, once.
    pub fn take_order(&mut self) -> Option<StartOrder> {
        self.order.take()
    }

    /// The order is not obeyed, now or ever.
    pub fn refuse(&mut self, now: Time, order: StartOrder, reason: Reason) {
        let phase = ManeuverPhase::Refused;
        self.record = ManeuverRecord { id: order.maneuver_id, phase, reason, began: now, ended: now };
    }

    /// The maneuver begins with this tick.
    pub fn begin(&mut self, now: Time, order: StartOrder, primitive: Primitive) {
        self.record = ManeuverRecord {
            id: order.maneuver_id,
            phase: ManeuverPhase::Running,
            reason: Reason::None,
            began: now,
            ended: Time::ZERO,
        };
        self.running =
            Some(Running { primitive, off_axis_since: None, fast_since: None, astray_since: None });
    }

    /// When the running maneuver is planned to end.
    pub fn planned_end(&self) -> Option<Time> {
        self.running.map(|running| {
            self.record.began.saturating_add(Span::from_secs_f64(running.primitive.duration_s()))
        })
    }

    /// Ends the running maneuver early; answers whether there was one.
    pub fn abort(&mut self, now: Time, reason: Reason) -> bool {
        let was_running = self.running.take().is_some();
        if was_running {
            self.record.phase = ManeuverPhase::Aborted;
            self.record.reason = reason;
            self.record.ended = now;
        }
        was_running
    }

    /// One tick, given the rate the gyros read.
    pub fn step(&mut self, now: Time, rate_rad_s: Vector<Body>, settings: &FirmwareSettings) -> Step {
        let began = self.record.began;
        let Some(running) = &mut self.running else {
            return Step::Idle;
        };
        let at = elapsed(began, now).as_secs_f64();
        if at >= running.primitive.duration_s() {
            let ended = self.planned_end().unwrap_or(now);
            self.running = None;
            self.record.phase = ManeuverPhase::Completed;
            self.record.ended = ended;
            return Step::Completed;
        }
        let setpoint = running.primitive.sample(at);
        let broken = if at > settings.limits.duration_s_max * (1.0 + ROUNDING_RATIO) {
            Some(Reason::TooLong)
        } else {
            running.guard(now, rate_rad_s, setpoint.rate_rad_s, &settings.guard)
        };
        match broken {
            Some(reason) => {
                self.abort(now, reason);
                Step::Aborted
            }
            None => Step::Fly(setpoint),
        }
    }
}

impl Running {
    fn guard(
        &mut self,
        now: Time,
        rate_rad_s: Vector<Body>,
        commanded_rad_s: f64,
        guard: &ManeuverGuard,
    ) -> Option<Reason> {
        let off_axis = rate_rad_s.x.abs().max(rate_rad_s.z.abs()) > guard.off_axis_rate_rad_s_max;
        let fast = rate_rad_s.y.abs() > guard.pitch_rate_rad_s_max;
        let astray = (rate_rad_s.y - commanded_rad_s).abs() > guard.rate_error_rad_s_max;
        let lasts = |since: &mut Option<Time>, holds: bool| {
            if !holds {
                *since = None;
            }
            holds && elapsed(*since.get_or_insert(now), now) >= guard.persistence
        };
        let off_axis = lasts(&mut self.off_axis_since, off_axis);
        let fast = lasts(&mut self.fast_since, fast);
        let astray = lasts(&mut self.astray_since, astray);
        if off_axis || fast { Some(Reason::RateExceeded) } else { astray.then_some(Reason::RateNotFollowed) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::TICK;

    pub(crate) const DOUBLE: FlipSet = FlipSet {
        u1_m_s2: 20.39544,
        t1_s: 0.16092,
        t3_s: 0.27833,
        u5_m_s2: 20.30911,
        t5_s: 0.18268,
        rate_rad_s_max: 27.925_268,
        envelope_low_m_s2: 3.589_744,
        envelope_high_m_s2: 21.025_64,
        lever_m: 0.057_818,
        flips: 2.0,
    };

    fn admitted(change: impl Fn(&mut FlipSet)) -> bool {
        let mut set = DOUBLE;
        change(&mut set);
        admit(&set.to_items(), &FirmwareSettings::table_i(1)).is_some()
    }

    #[test]
    fn the_papers_double_is_admitted_and_what_lies_outside_is_not() {
        assert!(admitted(|_| {}));
        assert!(admitted(|set| set.u1_m_s2 = 23.9));
        assert!(admitted(|set| set.envelope_low_m_s2 = 0.68));
        assert!(admitted(|set| set.rate_rad_s_max = 1800f32.to_radians()));
        type Change = fn(&mut FlipSet);
        let outside: [Change; 17] = [
            |set| set.u1_m_s2 = 23.91,
            |set| set.u5_m_s2 = 23.91,
            |set| set.u5_m_s2 = 0.67,
            |set| set.envelope_low_m_s2 = 0.67,
            |set| set.envelope_high_m_s2 = 3.0,
            |set| set.t1_s = 0.0,
            |set| set.t1_s = -0.1,
            |set| set.t3_s = -0.1,
            |set| set.t5_s = f32::NAN,
            |set| set.t3_s = 4.0,
            |set| set.rate_rad_s_max = 1801f32.to_radians(),
            |set| set.rate_rad_s_max = f32::INFINITY,
            |set| set.lever_m = 0.02,
            |set| set.lever_m = 0.2,
            |set| set.lever_m = -0.057,
            |set| set.flips = 1.5,
            |set| set.flips = 0.0,
        ];
        for (index, change) in outside.into_iter().enumerate() {
            assert!(!admitted(change), "change {index}");
        }
        assert!(admit(&DOUBLE.to_items()[..9], &FirmwareSettings::table_i(1)).is_none());
    }

    fn order(maneuver_id: u16) -> StartOrder {
        StartOrder { maneuver_id, set_id: 1, digest: 2 }
    }

    #[test]
    fn an_identity_is_heard_once_and_only_forward() {
        let mut generator = CommandGenerator::default();
        generator.order(order(0));
        assert_eq!(generator.take_order(), None);
        generator.order(order(65_535));
        generator.order(order(3));
        assert_eq!(generator.take_order(), Some(order(65_535)), "the first heard counts");
        generator.refuse(Time::ZERO, order(65_535), Reason::BatteryLow);
        for old in [65_535, 65_534, 40_000] {
            generator.order(order(old));
            assert_eq!(generator.take_order(), None);
        }
        generator.order(order(2));
        assert_eq!(generator.take_order(), Some(order(2)), "the count goes round");
    }

    fn started() -> (CommandGenerator, FirmwareSettings, Primitive) {
        let settings = FirmwareSettings::table_i(1);
        let primitive = admit(&DOUBLE.to_items(), &settings).unwrap();
        let mut generator = CommandGenerator::default();
        generator.begin(Time::ZERO, order(1), primitive);
        (generator, settings, primitive)
    }

    #[test]
    fn the_profile_is_the_primitives_sampled_at_each_tick() {
        let (mut generator, settings, primitive) = started();
        let mut now = Time::ZERO;
        let mut ticks = 0u32;
        let ended = loop {
            let commanded = primitive.sample(f64::from(ticks) / 800.0);
            let rate = Vector::new(0.0, commanded.rate_rad_s, 0.0);
            match generator.step(now, rate, &settings) {
                Step::Fly(setpoint) => {
                    assert_eq!(setpoint.collective_m_s2, commanded.collective_m_s2);
                    assert!((setpoint.rate_rad_s - commanded.rate_rad_s).abs() < 1e-9);
                }
                Step::Completed => break generator.record().ended,
                other => panic!("{other:?}"),
            }
            now += TICK;
            ticks += 1;
        };
        assert_eq!(f64::from(ticks), quantity::math::ceil(primitive.duration_s() * 800.0));
        assert_eq!(ended.as_nanos(), Span::from_secs_f64(primitive.duration_s()).as_nanos());
        assert_eq!(generator.record().phase, ManeuverPhase::Completed);
        assert_eq!(generator.step(now, Vector::ZERO, &settings), Step::Idle);
    }

    fn run_at(rate: impl Fn(f64) -> Vector<Body>) -> (Reason, f64) {
        let (mut generator, settings, primitive) = started();
        let mut now = Time::ZERO;
        while generator.is_running() {
            let commanded = primitive.sample(now.as_secs_f64());
            generator.step(now, rate(commanded.rate_rad_s), &settings);
            now += TICK;
        }
        (generator.record().reason, generator.record().ended.as_secs_f64())
    }

    #[test]
    fn the_guard_ends_what_has_gone_wrong_for_long_enough() {
        let (reason, _) = run_at(|commanded| Vector::new(0.0, (commanded + 14.0).min(37.9), 9.0));
        assert_eq!(reason, Reason::None);
        let (reason, ended_s) = run_at(|commanded| Vector::new(0.0, commanded, -10.5));
        assert_eq!((reason, ended_s), (Reason::RateExceeded, 0.1));
        let (reason, ended_s) = run_at(|commanded| Vector::new(0.0, commanded - 15.5, 0.0));
        assert_eq!((reason, ended_s), (Reason::RateNotFollowed, 0.1));
        let (reason, _) = run_at(|_| Vector::new(0.0, 38.5, 0.0));
        assert_eq!(reason, Reason::RateExceeded);
    }

    #[test]
    fn an_abort_is_recorded_once() {
        let (mut generator, ..) = started();
        let at = Time::ZERO + Span::from_millis(300);
        assert!(generator.abort(at, Reason::AbortOrdered));
        assert!(!generator.abort(at + TICK, Reason::Stopped));
        let record = generator.record();
        assert_eq!(
            (record.phase, record.reason, record.ended),
            (ManeuverPhase::Aborted, Reason::AbortOrdered, at)
        );
    }
}
