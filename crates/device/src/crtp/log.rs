//! The log subsystem, port 5: which variables a vehicle has, and reports of some of them.
//!
//! | Channel | Asked | Answered |
//! | --- | --- | --- |
//! | 0 | `03` | `03`, u16 how many variables, u32 check of their list, u8 most blocks, u8 most variables |
//! | 0 | `02`, u16 id | `02`, u16 id, u8 type, group and name, a NUL after each; `02` alone: no such variable |
//! | 1 | `06`, u8 block, and for each variable u8 type, u16 id: create | `06`, u8 block, u8 error |
//! | 1 | `07`, likewise: append | `07`, u8 block, u8 error |
//! | 1 | `02`, u8 block: delete | `02`, u8 block, u8 error |
//! | 1 | `03`, u8 block, u8 period in 10 ms: start | `03`, u8 block, u8 error |
//! | 1 | `04`, u8 block: stop | `04`, u8 block, u8 error |
//! | 1 | `05`: forget all blocks | `05`, u8 0, u8 error |
//! | 2 | | u8 block, u24 time in ms, the values |
//!
//! Question and answer share their number, and some of them their length: bytes alone do not tell which they are. So
//! [`LogRequest`] is what goes to a vehicle and [`LogReply`] what comes from it.

use super::{CrtpError, DATA_BYTES_MAX, Packet, write_packet};
use crate::bytes::{Reader, Writer};

const PORT_LOG: u8 = 5;
const CHANNEL_CONTENTS: u8 = 0;
const CHANNEL_CONTROL: u8 = 1;
const CHANNEL_DATA: u8 = 2;

const CONTENTS_ITEM: u8 = 2;
const CONTENTS_INFO: u8 = 3;
const CONTROL_DELETE: u8 = 2;
const CONTROL_START: u8 = 3;
const CONTROL_STOP: u8 = 4;
const CONTROL_RESET: u8 = 5;
const CONTROL_CREATE: u8 = 6;
const CONTROL_APPEND: u8 = 7;

/// Most variables that one packet names.
pub const LOG_VARIABLES_MAX: usize = (DATA_BYTES_MAX - 2) / 3;

/// Most bytes of values in a report.
pub const LOG_VALUE_BYTES_MAX: usize = DATA_BYTES_MAX - 4;

/// Time of a report counts up to here, ms, and then from zero.
const TIME_MS_END: u32 = 1 << 24;

/// What a variable is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum LogType {
    /// An unsigned byte.
    U8 = 1,
    /// Two bytes, unsigned.
    U16 = 2,
    /// Four bytes, unsigned.
    U32 = 3,
    /// A signed byte.
    I8 = 4,
    /// Two bytes, signed.
    I16 = 5,
    /// Four bytes, signed.
    I32 = 6,
    /// A number with a fraction, four bytes.
    F32 = 7,
    /// The same in two bytes.
    F16 = 8,
}

impl LogType {
    /// The type with that number; whatever stands in the upper half of the byte does not matter.
    #[must_use]
    pub const fn new(number: u8) -> Option<Self> {
        Some(match number & 0x0F {
            1 => Self::U8,
            2 => Self::U16,
            3 => Self::U32,
            4 => Self::I8,
            5 => Self::I16,
            6 => Self::I32,
            7 => Self::F32,
            8 => Self::F16,
            _ => return None,
        })
    }

    /// Bytes of a value.
    #[must_use]
    pub const fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 | Self::F16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
        }
    }

    /// As it is asked for: how it is kept, and how it is to be sent.
    const fn asked(self) -> u8 {
        self as u8 | (self as u8) << 4
    }
}

/// The variables that a packet names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LogVariables {
    items: [(LogType, u16); LOG_VARIABLES_MAX],
    length: usize,
}

impl LogVariables {
    /// These variables, by type and id; `None` for more than [`LOG_VARIABLES_MAX`].
    #[must_use]
    pub fn new(variables: &[(LogType, u16)]) -> Option<Self> {
        let mut all = Self { items: [(LogType::U8, 0); LOG_VARIABLES_MAX], length: variables.len() };
        all.items.get_mut(..variables.len())?.copy_from_slice(variables);
        Some(all)
    }

    /// The same as a slice.
    #[must_use]
    pub fn as_slice(&self) -> &[(LogType, u16)] {
        self.items.get(..self.length).unwrap_or(&[])
    }

    fn read(fields: &[u8], length: CrtpError) -> Result<Self, CrtpError> {
        let (groups, rest) = fields.as_chunks::<3>();
        let mut all = Self { items: [(LogType::U8, 0); LOG_VARIABLES_MAX], length: groups.len() };
        if !rest.is_empty() || groups.len() > LOG_VARIABLES_MAX {
            return Err(length);
        }
        for (place, [kind, low, high]) in all.items.iter_mut().zip(groups) {
            let kind = LogType::new(*kind).ok_or(CrtpError::Value { field: "type", value: *kind })?;
            *place = (kind, u16::from_le_bytes([*low, *high]));
        }
        Ok(all)
    }

    fn write(&self, writer: &mut Writer<'_>) {
        for (kind, id) in self.as_slice() {
            writer.u8(kind.asked()).u16(*id);
        }
    }
}

/// What a vehicle's log is asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LogRequest {
    /// How many variables are there?
    Info,
    /// What is the variable with this id?
    Item {
        /// Counted from zero.
        id: u16,
    },
    /// Make a block of these variables.
    Create {
        /// The block's number, the asker's choice.
        block: u8,
        /// What it reports.
        variables: LogVariables,
    },
    /// Let a block report these variables too.
    Append {
        /// The block.
        block: u8,
        /// What it reports besides.
        variables: LogVariables,
    },
    /// Forget a block.
    Delete {
        /// The block.
        block: u8,
    },
    /// Report a block from now on.
    Start {
        /// The block.
        block: u8,
        /// Time between two reports.
        period_10_ms: u8,
    },
    /// Report a block no longer.
    Stop {
        /// The block.
        block: u8,
    },
    /// Forget all blocks.
    Reset,
}

/// What a vehicle's log says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LogReply<'a> {
    /// How many variables there are.
    Info {
        /// So many, with ids from zero.
        count: u16,
        /// A check of their list: it is the same as long as they are.
        check: u32,
        /// Most blocks at a time.
        blocks_max: u8,
        /// Most variables in all blocks together.
        variables_max: u8,
    },
    /// A variable.
    Item {
        /// Its id.
        id: u16,
        /// What it is.
        kind: LogType,
        /// The group it belongs to.
        group: &'a [u8],
        /// Its name in the group.
        name: &'a [u8],
    },
    /// There is no variable with the id that was asked for.
    NoItem,
    /// What became of an order.
    Answer {
        /// The order.
        order: LogOrder,
        /// The block.
        block: u8,
        /// Zero where it was done.
        error: u8,
    },
    /// Values.
    Data {
        /// The block.
        block: u8,
        /// When they were read, on the vehicle's clock, modulo 2^24.
        time_ms: u32,
        /// The values one after the other, in the order of the block's variables.
        values: &'a [u8],
    },
}

/// An order to a vehicle's log, without what it is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LogOrder {
    /// Create a block.
    Create,
    /// Append to a block.
    Append,
    /// Delete a block.
    Delete,
    /// Start a block.
    Start,
    /// Stop a block.
    Stop,
    /// Forget all blocks.
    Reset,
}

/// Errors of a vehicle's log, as its firmware numbers them.
pub mod log_error {
    /// No such block or variable.
    pub const NOT_FOUND: u8 = 2;
    /// What was asked is too long for a packet.
    pub const TOO_LONG: u8 = 7;
    /// No such order, or not now.
    pub const REFUSED: u8 = 8;
    /// No room for another block or variable.
    pub const NO_ROOM: u8 = 12;
    /// There is such a block already.
    pub const EXISTS: u8 = 17;
}

impl LogOrder {
    const ALL: [(Self, u8); 6] = [
        (Self::Create, CONTROL_CREATE),
        (Self::Append, CONTROL_APPEND),
        (Self::Delete, CONTROL_DELETE),
        (Self::Start, CONTROL_START),
        (Self::Stop, CONTROL_STOP),
        (Self::Reset, CONTROL_RESET),
    ];

    const fn number(self) -> u8 {
        match self {
            Self::Create => CONTROL_CREATE,
            Self::Append => CONTROL_APPEND,
            Self::Delete => CONTROL_DELETE,
            Self::Start => CONTROL_START,
            Self::Stop => CONTROL_STOP,
            Self::Reset => CONTROL_RESET,
        }
    }

    fn of(number: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|(_, known)| *known == number).map(|(order, _)| order)
    }
}

/// The channel and the data of a packet to or from the log; `None` for any other.
fn log_packet(packet: &[u8]) -> Result<Option<(u8, &[u8])>, CrtpError> {
    match Packet::decode(packet)? {
        Packet::Other { port: PORT_LOG, channel, data } => Ok(Some((channel, data))),
        _ => Ok(None),
    }
}

impl LogRequest {
    /// What this packet asks of the log; `None` where it asks nothing of it, or what is not listed here.
    ///
    /// # Errors
    /// As of [`Packet::decode`].
    pub fn decode(packet: &[u8]) -> Result<Option<Self>, CrtpError> {
        let Some((channel, data)) = log_packet(packet)? else { return Ok(None) };
        let length = CrtpError::Length { port: PORT_LOG, channel, bytes: data.len() };
        let [number, fields @ ..] = data else { return Err(length) };
        Ok(Some(match (channel, *number, fields) {
            (CHANNEL_CONTENTS, CONTENTS_INFO, []) => Self::Info,
            (CHANNEL_CONTENTS, CONTENTS_ITEM, [low, high]) => {
                Self::Item { id: u16::from_le_bytes([*low, *high]) }
            }
            (CHANNEL_CONTROL, CONTROL_CREATE, [block, items @ ..]) => {
                Self::Create { block: *block, variables: LogVariables::read(items, length)? }
            }
            (CHANNEL_CONTROL, CONTROL_APPEND, [block, items @ ..]) => {
                Self::Append { block: *block, variables: LogVariables::read(items, length)? }
            }
            (CHANNEL_CONTROL, CONTROL_DELETE, [block]) => Self::Delete { block: *block },
            (CHANNEL_CONTROL, CONTROL_START, [block, period]) => {
                Self::Start { block: *block, period_10_ms: *period }
            }
            (CHANNEL_CONTROL, CONTROL_STOP, [block]) => Self::Stop { block: *block },
            (CHANNEL_CONTROL, CONTROL_RESET, []) => Self::Reset,
            (CHANNEL_CONTENTS, CONTENTS_INFO | CONTENTS_ITEM, _)
            | (CHANNEL_CONTROL, CONTROL_DELETE..=CONTROL_APPEND, _) => return Err(length),
            _ => return Ok(None),
        }))
    }

    /// Writes the packet and answers its length, at most [`PACKET_BYTES_MAX`](super::PACKET_BYTES_MAX).
    ///
    /// # Errors
    /// [`CrtpError::NoRoom`].
    pub fn encode(&self, out: &mut [u8]) -> Result<usize, CrtpError> {
        write_packet(out, |writer| {
            match self {
                Self::Info => writer.u8(CONTENTS_INFO),
                Self::Item { id } => writer.u8(CONTENTS_ITEM).u16(*id),
                Self::Create { block, variables } => {
                    variables.write(writer.u8(CONTROL_CREATE).u8(*block));
                    return (PORT_LOG, CHANNEL_CONTROL);
                }
                Self::Append { block, variables } => {
                    variables.write(writer.u8(CONTROL_APPEND).u8(*block));
                    return (PORT_LOG, CHANNEL_CONTROL);
                }
                Self::Delete { block } => writer.u8(CONTROL_DELETE).u8(*block),
                Self::Start { block, period_10_ms } => writer.u8(CONTROL_START).u8(*block).u8(*period_10_ms),
                Self::Stop { block } => writer.u8(CONTROL_STOP).u8(*block),
                Self::Reset => writer.u8(CONTROL_RESET),
            };
            let contents = matches!(self, Self::Info | Self::Item { .. });
            (PORT_LOG, if contents { CHANNEL_CONTENTS } else { CHANNEL_CONTROL })
        })
    }
}

impl<'a> LogReply<'a> {
    /// What this packet of the log says; `None` where it is none of the log's, or what is not listed here.
    ///
    /// # Errors
    /// As of [`Packet::decode`].
    pub fn decode(packet: &'a [u8]) -> Result<Option<Self>, CrtpError> {
        let Some((channel, data)) = log_packet(packet)? else { return Ok(None) };
        let length = CrtpError::Length { port: PORT_LOG, channel, bytes: data.len() };
        let [number, fields @ ..] = data else { return Err(length) };
        let mut reader = Reader::new(fields);
        match (channel, *number) {
            (CHANNEL_CONTENTS, CONTENTS_INFO) => read_info(&mut reader).ok_or(length).map(Some),
            (CHANNEL_CONTENTS, CONTENTS_ITEM) if fields.is_empty() => Ok(Some(Self::NoItem)),
            (CHANNEL_CONTENTS, CONTENTS_ITEM) => {
                let (id, kind, group, name) = read_item(&mut reader).ok_or(length)?;
                let kind = LogType::new(kind).ok_or(CrtpError::Value { field: "type", value: kind })?;
                Ok(Some(Self::Item { id, kind, group, name }))
            }
            (CHANNEL_CONTROL, number) => {
                let Some(order) = LogOrder::of(number) else { return Ok(None) };
                let [block, error] = fields else { return Err(length) };
                Ok(Some(Self::Answer { order, block: *block, error: *error }))
            }
            (CHANNEL_DATA, block) => {
                let [low, middle, high] = reader.array().ok_or(length)?;
                let time_ms = u32::from_le_bytes([low, middle, high, 0]);
                Ok(Some(Self::Data { block, time_ms, values: reader.rest() }))
            }
            _ => Ok(None),
        }
    }

    /// Writes the packet and answers its length, at most [`PACKET_BYTES_MAX`](super::PACKET_BYTES_MAX).
    ///
    /// # Errors
    /// [`CrtpError::TooLong`] for names or values that do not fit, [`CrtpError::NoRoom`].
    pub fn encode(&self, out: &mut [u8]) -> Result<usize, CrtpError> {
        write_packet(out, |writer| match *self {
            Self::Info { count, check, blocks_max, variables_max } => {
                writer.u8(CONTENTS_INFO).u16(count).u32(check).u8(blocks_max).u8(variables_max);
                (PORT_LOG, CHANNEL_CONTENTS)
            }
            Self::Item { id, kind, group, name } => {
                writer.u8(CONTENTS_ITEM).u16(id).u8(kind as u8).bytes(group).u8(0).bytes(name).u8(0);
                (PORT_LOG, CHANNEL_CONTENTS)
            }
            Self::NoItem => {
                writer.u8(CONTENTS_ITEM);
                (PORT_LOG, CHANNEL_CONTENTS)
            }
            Self::Answer { order, block, error } => {
                writer.u8(order.number()).u8(block).u8(error);
                (PORT_LOG, CHANNEL_CONTROL)
            }
            Self::Data { block, time_ms, values } => {
                let [low, middle, high, _] = (time_ms % TIME_MS_END).to_le_bytes();
                writer.u8(block).bytes(&[low, middle, high]).bytes(values);
                (PORT_LOG, CHANNEL_DATA)
            }
        })
    }
}

fn read_info(reader: &mut Reader<'_>) -> Option<LogReply<'static>> {
    let (count, check) = (reader.u16()?, reader.u32()?);
    let [blocks_max, variables_max] = reader.array()?;
    reader.rest().is_empty().then_some(LogReply::Info { count, check, blocks_max, variables_max })
}

fn read_item<'a>(reader: &mut Reader<'a>) -> Option<(u16, u8, &'a [u8], &'a [u8])> {
    let item = (reader.u16()?, reader.u8()?, reader.text()?, reader.text()?);
    reader.rest().is_empty().then_some(item)
}

#[cfg(test)]
mod tests {
    use super::super::PACKET_BYTES_MAX;
    use super::*;
    use crate::bytes::from_hex;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn asks(request: &LogRequest, hex: &str) {
        let (bytes, mut out) = (from_hex(hex), [0; PACKET_BYTES_MAX]);
        let length = request.encode(&mut out).unwrap();
        assert_eq!(out[..length], bytes);
        assert_eq!(LogRequest::decode(&bytes), Ok(Some(*request)));
    }

    fn says(reply: &LogReply<'_>, hex: &str) {
        let (bytes, mut out) = (from_hex(hex), [0; PACKET_BYTES_MAX]);
        let length = reply.encode(&mut out).unwrap();
        assert_eq!(out[..length], bytes);
        assert_eq!(LogReply::decode(&bytes), Ok(Some(*reply)));
    }

    #[test]
    fn requests_both_ways() {
        // What Bitcraze's Python library 0.1.34 sends, `pm.vbat` having id 0x0123.
        asks(&LogRequest::Info, "5c 03");
        asks(&LogRequest::Item { id: 0x0123 }, "5c 02 2301");
        let variables = LogVariables::new(&[(LogType::F32, 0x0123), (LogType::U16, 4)]).unwrap();
        asks(&LogRequest::Create { block: 1, variables }, "5d 06 01 77 2301 22 0400");
        asks(&LogRequest::Append { block: 1, variables }, "5d 07 01 77 2301 22 0400");
        asks(&LogRequest::Delete { block: 1 }, "5d 02 01");
        asks(&LogRequest::Start { block: 1, period_10_ms: 10 }, "5d 03 01 0a");
        asks(&LogRequest::Stop { block: 1 }, "5d 04 01");
        asks(&LogRequest::Reset, "5d 05");
    }

    #[test]
    fn replies_both_ways() {
        // By hand from the firmware's log.c.
        says(
            &LogReply::Info { count: 0x0201, check: 0x0403_0201, blocks_max: 16, variables_max: 128 },
            "5c 03 0102 01020304 10 80",
        );
        says(
            &LogReply::Item { id: 0x0123, kind: LogType::F32, group: b"pm", name: b"vbat" },
            "5c 02 2301 07 706d00 7662617400",
        );
        says(&LogReply::NoItem, "5c 02");
        says(&LogReply::Answer { order: LogOrder::Start, block: 1, error: 0 }, "5d 03 01 00");
        let exists = LogReply::Answer { order: LogOrder::Create, block: 1, error: log_error::EXISTS };
        says(&exists, "5d 06 01 11");
        let values = 4.1f32.to_le_bytes();
        says(&LogReply::Data { block: 1, time_ms: 0x01_2345, values: &values }, "5e 01 452301 33338340");
    }

    #[test]
    fn the_upper_half_of_a_type_does_not_matter() {
        let core = from_hex("5c 02 0000 27 6100 6200");
        let item = LogReply::Item { id: 0, kind: LogType::F32, group: b"a", name: b"b" };
        assert_eq!(LogReply::decode(&core), Ok(Some(item)));
        let none = CrtpError::Value { field: "type", value: 0x20 };
        assert_eq!(LogReply::decode(&from_hex("5c 02 0000 20 6100 6200")), Err(none));
    }

    #[test]
    fn what_is_not_the_logs_passes_and_what_is_cut_short_does_not() {
        assert_eq!(LogReply::decode(&from_hex("9c 8c 0a04")), Ok(None));
        assert_eq!(LogRequest::decode(&from_hex("5d 09 01")), Ok(None));
        assert_eq!(LogReply::decode(&from_hex("5d 09 01")), Ok(None));
        let short = |channel, bytes| CrtpError::Length { port: 5, channel, bytes };
        assert_eq!(LogReply::decode(&from_hex("5c 02 2301 07 706d00 76626174")), Err(short(0, 11)));
        assert_eq!(LogReply::decode(&from_hex("5e 01 4523")), Err(short(2, 3)));
        assert_eq!(LogRequest::decode(&from_hex("5d 06 01 77 23")), Err(short(1, 4)));
        assert_eq!(LogRequest::decode(&from_hex("5d 03 01")), Err(short(1, 2)));
        assert_eq!(LogVariables::new(&[(LogType::U8, 0); LOG_VARIABLES_MAX + 1]), None);
    }

    #[test]
    fn what_does_not_fit_is_an_error() {
        let long = [b'a'; 30];
        let item = LogReply::Item { id: 0, kind: LogType::U8, group: &long, name: b"b" };
        assert!(matches!(item.encode(&mut [0; PACKET_BYTES_MAX]), Err(CrtpError::TooLong { .. })));
        assert_eq!(LogRequest::Info.encode(&mut [0; 1]), Err(CrtpError::NoRoom));
    }

    proptest! {
        #[test]
        fn whatever_decodes_encodes_to_what_decodes_to_the_same(
            channel in 0u8..4, number in 0u8..9, data in prop::collection::vec(any::<u8>(), 0..DATA_BYTES_MAX),
        ) {
            let bytes: Vec<u8> = [0x5C | channel, number].into_iter().chain(data).collect();
            let mut out = [0; PACKET_BYTES_MAX];
            if let Ok(Some(request)) = LogRequest::decode(&bytes) {
                let length = request.encode(&mut out).unwrap();
                prop_assert_eq!(LogRequest::decode(&out[..length]), Ok(Some(request)));
            }
            if let Ok(Some(reply)) = LogReply::decode(&bytes) {
                let length = reply.encode(&mut out).unwrap();
                prop_assert_eq!(LogReply::decode(&out[..length]), Ok(Some(reply)));
            }
        }
    }
}
