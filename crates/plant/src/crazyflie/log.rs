//! The log of a simulated Crazyflie: a short list of variables, blocks of them, and their reports.

use device::crtp::{
    LOG_VALUE_BYTES_MAX, LogOrder, LogReply, LogRequest, LogType, LogVariables, PACKET_BYTES_MAX, log_error,
};
use quantity::{Span, Time};

/// Most blocks, and most variables in all of them: the firmware's.
const BLOCKS_MAX: usize = 16;
const VARIABLES_MAX: usize = 128;

/// The variables, by id. The firmware has some hundreds; these are what there is to tell of this one.
const CONTENTS: [(&str, &str, LogType); 6] = [
    ("stabilizer", "roll", LogType::F32),
    ("stabilizer", "pitch", LogType::F32),
    ("stabilizer", "thrust", LogType::F32),
    ("gyro", "z", LogType::F32),
    ("pm", "vbat", LogType::F32),
    ("supervisor", "info", LogType::U16),
];

/// A check of that list: it changes when the list does.
const CONTENTS_CHECK: u32 = 0xF1A6_0001;

/// What the variables are now.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Values {
    pub roll_deg: f32,
    pub pitch_deg: f32,
    pub thrust: f32,
    pub yaw_rate_deg_s: f32,
    pub battery_v: f32,
    pub supervisor: u16,
}

impl Values {
    fn put(&self, id: u16, out: &mut Vec<u8>) {
        match id {
            0 => out.extend(self.roll_deg.to_le_bytes()),
            1 => out.extend(self.pitch_deg.to_le_bytes()),
            2 => out.extend(self.thrust.to_le_bytes()),
            3 => out.extend(self.yaw_rate_deg_s.to_le_bytes()),
            4 => out.extend(self.battery_v.to_le_bytes()),
            _ => out.extend(self.supervisor.to_le_bytes()),
        }
    }
}

#[derive(Clone, Debug)]
struct Block {
    id: u8,
    variables: Vec<u16>,
    running: Option<(Span, Time)>,
}

/// The log.
#[derive(Clone, Debug, Default)]
pub(super) struct Log {
    blocks: Vec<Block>,
}

impl Log {
    /// The packet that answers this request.
    pub(super) fn answer(&mut self, now: Time, request: &LogRequest) -> Vec<u8> {
        let answer = |order, block, error| LogReply::Answer { order, block, error };
        packet(&match *request {
            LogRequest::Info => LogReply::Info {
                count: CONTENTS.len() as u16,
                check: CONTENTS_CHECK,
                blocks_max: BLOCKS_MAX as u8,
                variables_max: VARIABLES_MAX as u8,
            },
            LogRequest::Item { id } => match CONTENTS.get(usize::from(id)) {
                None => LogReply::NoItem,
                Some((group, name, kind)) => {
                    LogReply::Item { id, kind: *kind, group: group.as_bytes(), name: name.as_bytes() }
                }
            },
            LogRequest::Create { block, variables } => {
                answer(LogOrder::Create, block, self.create(block, &variables))
            }
            LogRequest::Append { block, variables } => {
                answer(LogOrder::Append, block, self.append(block, &variables))
            }
            LogRequest::Delete { block } => {
                let before = self.blocks.len();
                self.blocks.retain(|known| known.id != block);
                let error = if self.blocks.len() < before { 0 } else { log_error::NOT_FOUND };
                answer(LogOrder::Delete, block, error)
            }
            LogRequest::Start { block, period_10_ms } => {
                let period = Span::from_millis(10 * i64::from(period_10_ms.max(1)));
                answer(LogOrder::Start, block, self.run(block, Some((period, now + period))))
            }
            LogRequest::Stop { block } => answer(LogOrder::Stop, block, self.run(block, None)),
            LogRequest::Reset => {
                self.blocks.clear();
                answer(LogOrder::Reset, 0, 0)
            }
        })
    }

    fn create(&mut self, id: u8, variables: &LogVariables) -> u8 {
        if self.blocks.iter().any(|block| block.id == id) {
            return log_error::EXISTS;
        }
        if self.blocks.len() >= BLOCKS_MAX {
            return log_error::NO_ROOM;
        }
        self.blocks.push(Block { id, variables: Vec::new(), running: None });
        self.append(id, variables)
    }

    fn append(&mut self, id: u8, variables: &LogVariables) -> u8 {
        let used: usize = self.blocks.iter().map(|block| block.variables.len()).sum();
        let Some(block) = self.blocks.iter_mut().find(|block| block.id == id) else {
            return log_error::NOT_FOUND;
        };
        let wanted = variables.as_slice();
        if used + wanted.len() > VARIABLES_MAX {
            return log_error::NO_ROOM;
        }
        let known = |(kind, id): &(LogType, u16)| {
            CONTENTS.get(usize::from(*id)).is_some_and(|(.., known)| known == kind)
        };
        if !wanted.iter().all(known) {
            return log_error::NOT_FOUND;
        }
        let all = block.variables.iter().chain(wanted.iter().map(|(_, id)| id));
        let bytes: usize = all.map(|id| CONTENTS.get(usize::from(*id)).map_or(0, |(.., k)| k.bytes())).sum();
        if bytes > LOG_VALUE_BYTES_MAX {
            return log_error::TOO_LONG;
        }
        block.variables.extend(wanted.iter().map(|(_, id)| *id));
        0
    }

    fn run(&mut self, id: u8, running: Option<(Span, Time)>) -> u8 {
        match self.blocks.iter_mut().find(|block| block.id == id) {
            None => log_error::NOT_FOUND,
            Some(block) => {
                block.running = running;
                0
            }
        }
    }

    /// The reports due.
    pub(super) fn reports(&mut self, now: Time, values: &Values, mut send: impl FnMut(Vec<u8>)) {
        for block in &mut self.blocks {
            let Some((period, next_at)) = &mut block.running else { continue };
            if now < *next_at {
                continue;
            }
            *next_at += *period;
            let mut bytes = Vec::with_capacity(LOG_VALUE_BYTES_MAX);
            block.variables.iter().for_each(|id| values.put(*id, &mut bytes));
            let time_ms = (now.as_nanos() / 1_000_000) as u32;
            send(packet(&LogReply::Data { block: block.id, time_ms, values: &bytes }));
        }
    }
}

fn packet(reply: &LogReply<'_>) -> Vec<u8> {
    let mut out = [0; PACKET_BYTES_MAX];
    // Names and values are kept to what fits.
    let length = reply.encode(&mut out).unwrap_or(0);
    out[..length].to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(milliseconds: i64) -> Time {
        Time::ZERO + Span::from_millis(milliseconds)
    }

    fn error(log: &mut Log, request: LogRequest) -> u8 {
        let packet = log.answer(ms(0), &request);
        match LogReply::decode(&packet) {
            Ok(Some(LogReply::Answer { error, .. })) => error,
            other => panic!("{other:?}"),
        }
    }

    fn variables(all: &[(LogType, u16)]) -> LogVariables {
        LogVariables::new(all).unwrap()
    }

    #[test]
    fn the_list_of_contents_ends_where_it_says() {
        let mut log = Log::default();
        for id in 0..7 {
            let packet = log.answer(ms(0), &LogRequest::Item { id });
            match LogReply::decode(&packet) {
                Ok(Some(LogReply::Item { id: told, group, .. })) => {
                    assert!(told == id && id < 6 && !group.is_empty());
                }
                Ok(Some(LogReply::NoItem)) => assert_eq!(id, 6),
                other => panic!("{other:?}"),
            }
        }
    }

    #[test]
    fn a_block_reports_its_variables_at_its_period() {
        let mut log = Log::default();
        let wanted = variables(&[(LogType::F32, 4), (LogType::U16, 5)]);
        assert_eq!(error(&mut log, LogRequest::Create { block: 3, variables: wanted }), 0);
        assert_eq!(error(&mut log, LogRequest::Start { block: 3, period_10_ms: 10 }), 0);
        let values = Values { battery_v: 4.1, supervisor: 0x0102, ..Values::default() };
        let mut told = Vec::new();
        (0..=1000).for_each(|at| log.reports(ms(at), &values, |packet| told.push(packet)));
        assert_eq!(told.len(), 10);
        let data = [&4.1f32.to_le_bytes()[..], &[2, 1]].concat();
        let expected = LogReply::Data { block: 3, time_ms: 100, values: &data };
        assert_eq!(LogReply::decode(&told[0]), Ok(Some(expected)));
        assert_eq!(error(&mut log, LogRequest::Stop { block: 3 }), 0);
        log.reports(ms(2000), &values, |packet| panic!("{packet:?}"));
    }

    #[test]
    fn what_cannot_be_is_refused_by_the_firmwares_numbers() {
        let mut log = Log::default();
        let battery = variables(&[(LogType::F32, 4)]);
        assert_eq!(error(&mut log, LogRequest::Start { block: 1, period_10_ms: 1 }), log_error::NOT_FOUND);
        assert_eq!(error(&mut log, LogRequest::Create { block: 1, variables: battery }), 0);
        let again = LogRequest::Create { block: 1, variables: battery };
        assert_eq!(error(&mut log, again), log_error::EXISTS);
        let absent = variables(&[(LogType::F32, 77)]);
        let append = LogRequest::Append { block: 1, variables: absent };
        assert_eq!(error(&mut log, append), log_error::NOT_FOUND);
        let long = variables(&[(LogType::F32, 0); 7]);
        let append = LogRequest::Append { block: 1, variables: long };
        assert_eq!(error(&mut log, append), log_error::TOO_LONG);
        assert_eq!(error(&mut log, LogRequest::Reset), 0);
        assert_eq!(error(&mut log, LogRequest::Delete { block: 1 }), log_error::NOT_FOUND);
    }
}
