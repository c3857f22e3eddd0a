//! The battery's voltage, by the vehicle's log: finds the variable, makes a block of it, and has that reported.
//!
//! The list of variables is asked item by item, anew each time: the firmware's changes with every version.

use device::crtp::{LogOrder, LogReply, LogRequest, LogType, LogVariables, PACKET_BYTES_MAX};
use quantity::{Span, Time};

/// The variable.
const GROUP: &[u8] = b"pm";
const NAME: &[u8] = b"vbat";
/// The number of our block.
const BLOCK: u8 = 1;
/// Time between two reports.
const PERIOD_10_MS: u8 = 10;
/// What is not answered is asked again after so long.
const RETRY: Span = Span::from_millis(100);
/// Reports that have not come for so long will not come: the vehicle was restarted.
const SILENCE_MAX: Span = Span::from_secs(2);
/// A vehicle without the variable is asked again after so long.
const ABSENT_RETRY: Span = Span::from_secs(10);
/// A voltage above this is none.
const VOLTAGE_V_MAX: f64 = 100.0;

/// Where the client stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// How many variables are there?
    Info,
    /// Is it this one?
    Item { id: u16, count: u16 },
    /// It is that one. Blocks of a bridge before this one are forgotten first.
    Reset { variable: u16 },
    /// A block of it is made.
    Create { variable: u16 },
    /// The block is started.
    Start,
    /// It reports.
    Running,
    /// There is no such variable.
    Absent,
}

/// What came of a reply.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum LogNews {
    /// Nothing to tell.
    None,
    /// The battery's voltage.
    Voltage(f64),
    /// The vehicle has no such variable.
    Absent,
}

/// The client of one vehicle's log.
#[derive(Clone, Debug)]
pub(crate) struct LogClient {
    stage: Stage,
    next_at: Time,
}

impl LogClient {
    /// A client that begins then.
    pub(crate) const fn new(start: Time) -> Self {
        Self { stage: Stage::Info, next_at: start }
    }

    /// When to ask next.
    pub(crate) const fn due_at(&self) -> Time {
        self.next_at
    }

    /// Asks what is due.
    pub(crate) fn send_due(&mut self, now: Time, mut send: impl FnMut(&[u8])) {
        if now < self.next_at {
            return;
        }
        if matches!(self.stage, Stage::Running | Stage::Absent) {
            // Silent for too long, or time to look again.
            self.stage = Stage::Info;
        }
        self.next_at = now.saturating_add(RETRY);
        let mut out = [0; PACKET_BYTES_MAX];
        if let Some(length) = self.request().and_then(|request| request.encode(&mut out).ok()) {
            send(&out[..length]);
        }
    }

    fn request(&self) -> Option<LogRequest> {
        Some(match self.stage {
            Stage::Info => LogRequest::Info,
            Stage::Item { id, .. } => LogRequest::Item { id },
            Stage::Reset { .. } => LogRequest::Reset,
            Stage::Create { variable } => LogRequest::Create {
                block: BLOCK,
                variables: LogVariables::new(&[(LogType::F32, variable)])?,
            },
            Stage::Start => LogRequest::Start { block: BLOCK, period_10_ms: PERIOD_10_MS },
            Stage::Running | Stage::Absent => return None,
        })
    }

    /// Takes a reply; one to nothing that is asked changes nothing.
    pub(crate) fn hear(&mut self, now: Time, reply: &LogReply<'_>) -> LogNews {
        let next = match (self.stage, *reply) {
            (_, LogReply::Data { block: BLOCK, values, .. }) => return self.hear_values(now, values),
            (Stage::Info, LogReply::Info { count, .. }) => Stage::Item { id: 0, count },
            (Stage::Item { id, count }, LogReply::Item { id: told, kind, group, name }) if id == told => {
                if (group, name, kind) == (GROUP, NAME, LogType::F32) {
                    Stage::Reset { variable: id }
                } else {
                    match id.checked_add(1).filter(|next| *next < count) {
                        Some(id) => Stage::Item { id, count },
                        None => return self.give_up(now),
                    }
                }
            }
            (Stage::Item { .. }, LogReply::NoItem) => return self.give_up(now),
            (Stage::Reset { variable }, LogReply::Answer { order: LogOrder::Reset, .. }) => {
                Stage::Create { variable }
            }
            (Stage::Create { .. }, LogReply::Answer { order: LogOrder::Create, block: BLOCK, error: 0 }) => {
                Stage::Start
            }
            (Stage::Start, LogReply::Answer { order: LogOrder::Start, block: BLOCK, error: 0 }) => {
                self.next_at = now.saturating_add(SILENCE_MAX);
                self.stage = Stage::Running;
                return LogNews::None;
            }
            // Refused: from the beginning, at the pace of retries.
            (
                Stage::Create { .. } | Stage::Start,
                LogReply::Answer { order: LogOrder::Create | LogOrder::Start, .. },
            ) => {
                self.stage = Stage::Info;
                return LogNews::None;
            }
            _ => return LogNews::None,
        };
        self.stage = next;
        self.next_at = now;
        LogNews::None
    }

    fn hear_values(&mut self, now: Time, values: &[u8]) -> LogNews {
        let Some(four) = values.first_chunk::<4>() else { return LogNews::None };
        let volts = f64::from(f32::from_le_bytes(*four));
        if self.stage != Stage::Running || !(volts > 0.0 && volts < VOLTAGE_V_MAX) {
            // Before ours is made, the block is one of a bridge before.
            return LogNews::None;
        }
        self.next_at = now.saturating_add(SILENCE_MAX);
        LogNews::Voltage(volts)
    }

    fn give_up(&mut self, now: Time) -> LogNews {
        self.stage = Stage::Absent;
        self.next_at = now.saturating_add(ABSENT_RETRY);
        LogNews::Absent
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const VARIABLES: [(&[u8], &[u8], LogType); 4] = [
        (b"stabilizer", b"roll", LogType::F32),
        (b"pm", b"vbatMV", LogType::U16),
        (b"pm", b"vbat", LogType::F32),
        (b"gyro", b"x", LogType::F32),
    ];

    fn ms(milliseconds: i64) -> Time {
        Time::ZERO + Span::from_millis(milliseconds)
    }

    fn asked(client: &mut LogClient, now: Time) -> Option<LogRequest> {
        let mut request = None;
        client.send_due(now, |packet| request = LogRequest::decode(packet).expect("a request"));
        request
    }

    fn reply(
        request: LogRequest,
        variables: &[(&'static [u8], &'static [u8], LogType)],
    ) -> LogReply<'static> {
        let answer = |order, block| LogReply::Answer { order, block, error: 0 };
        match request {
            LogRequest::Info => {
                LogReply::Info { count: variables.len() as u16, check: 7, blocks_max: 16, variables_max: 128 }
            }
            LogRequest::Item { id } => {
                variables.get(usize::from(id)).map_or(LogReply::NoItem, |(group, name, kind)| {
                    LogReply::Item { id, kind: *kind, group, name }
                })
            }
            LogRequest::Reset => answer(LogOrder::Reset, 0),
            LogRequest::Create { block, variables } => {
                assert_eq!(variables.as_slice(), [(LogType::F32, 2)]);
                answer(LogOrder::Create, block)
            }
            LogRequest::Start { block, .. } => answer(LogOrder::Start, block),
            other => panic!("{other:?}"),
        }
    }

    /// Runs for so long, losing one packet of `loses`; answers when it ran at last.
    fn run(client: &mut LogClient, until_ms: i64, loses: i64) -> Option<i64> {
        let mut asked_count = 0;
        for at in 0..until_ms {
            let Some(request) = asked(client, ms(at)) else { continue };
            asked_count += 1;
            if asked_count % loses != 0 {
                client.hear(ms(at), &reply(request, &VARIABLES));
            }
            if client.stage == Stage::Running {
                return Some(at);
            }
        }
        None
    }

    #[test]
    fn it_finds_the_variable_among_others_and_has_it_reported() {
        let mut client = LogClient::new(ms(0));
        assert!(run(&mut client, 100, 1_000).is_some_and(|at| at < 20));
        let values = 3.9f32.to_le_bytes();
        let data = LogReply::Data { block: 1, time_ms: 5, values: &values };
        assert_eq!(client.hear(ms(100), &data), LogNews::Voltage(f64::from(3.9f32)));
        assert_eq!(asked(&mut client, ms(2099)), None);
        assert_eq!(asked(&mut client, ms(2100)), Some(LogRequest::Info), "silent: from the beginning");
    }

    #[test]
    fn what_is_lost_is_asked_again() {
        let mut client = LogClient::new(ms(0));
        assert!(run(&mut client, 3_000, 2).is_some());
    }

    #[test]
    fn a_vehicle_without_it_is_reported_and_asked_again_later() {
        let mut client = LogClient::new(ms(0));
        let request = asked(&mut client, ms(0)).expect("asks");
        assert_eq!(client.hear(ms(0), &reply(request, &VARIABLES[..1])), LogNews::None);
        let request = asked(&mut client, ms(1)).expect("asks");
        assert_eq!(client.hear(ms(1), &reply(request, &VARIABLES[..1])), LogNews::Absent);
        assert_eq!(asked(&mut client, ms(10_000)), None);
        assert_eq!(asked(&mut client, ms(10_001)), Some(LogRequest::Info));
    }

    #[test]
    fn replies_to_nothing_asked_and_voltages_that_are_none_change_nothing() {
        let mut client = LogClient::new(ms(0));
        let started = LogReply::Answer { order: LogOrder::Start, block: 1, error: 0 };
        assert_eq!(client.hear(ms(0), &started), LogNews::None);
        assert_eq!(client.stage, Stage::Info);
        run(&mut client, 100, 1_000);
        for wrong in [f32::NAN, 0.0, -1.0, 1e9] {
            let values = wrong.to_le_bytes();
            let data = LogReply::Data { block: 1, time_ms: 5, values: &values };
            assert_eq!(client.hear(ms(100), &data), LogNews::None);
        }
    }
}
