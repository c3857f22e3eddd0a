//! How the recording fares, and what people want of it.

use quantity::Time;
use reflect::{Enumeration, Message, Text};
use serde::{Deserialize, Serialize};

/// What the logger is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Enumeration)]
#[repr(u8)]
pub enum LoggerState {
    /// Writing to a file.
    #[default]
    Recording = 0,
    /// Keeping the last seconds in memory.
    Snapshot = 1,
    /// A write failed or the disk is full: nothing is recorded any more. The arena flies on.
    Stopped = 2,
}

/// How the recording fares; all counts are since the logger's start.
#[derive(Clone, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/LoggerStatus")]
pub struct LoggerStatus {
    /// What the logger is doing.
    pub state: LoggerState,
    /// The file of the open segment, shortened from the front if need be.
    pub file: Text<128>,
    /// Segments begun.
    pub segments: u32,
    /// Authentic datagrams taken from the bus.
    pub accepted: u64,
    /// Messages handed to the file.
    pub recorded: u64,
    /// Definitions taken; they stand in the file once each, not as messages.
    pub definitions: u64,
    /// Bytes written.
    pub written_bytes: u64,
    /// Messages dropped because the disk was too slow for the memory there is.
    pub dropped_full: u64,
    /// Messages dropped because no file was open to take them.
    pub dropped_stopped: u64,
    /// Datagrams refused: not authentic, of another run or domain, seen before, not of our format.
    pub refused: u64,
    /// Sequence numbers that never came, over all sources and topics.
    pub lost: u64,
    /// Datagrams the kernel dropped because the logger was slow.
    pub overflowed: u64,
    /// Free bytes on the disk of the recording.
    pub free_bytes: u64,
}

/// What people want of the logger.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Enumeration)]
#[repr(u8)]
pub enum LoggerOrderKind {
    /// Write the seconds kept in memory to a file.
    #[default]
    Dump = 0,
}

/// An order to the logger. One repeated with the same `given_at` is one order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Message, Serialize, Deserialize)]
#[message(name = "flyarena/LoggerOrder")]
pub struct LoggerOrder {
    /// What is asked.
    pub kind: LoggerOrderKind,
    /// When it was first given.
    pub given_at: Time,
}
