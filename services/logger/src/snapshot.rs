//! The last seconds, kept in memory until somebody wants them.

use std::collections::{BTreeMap, VecDeque};

use quantity::{Span, Time};
use recording::{Definition, Host, Limits, Plan, Segments, Totals, WriteError};

use crate::ear::table_definitions;
use crate::ring::datagrams;

/// Memory is given back in blocks of about this size, or less where little is kept.
const BLOCK_BYTES: usize = 1 << 20;
/// Definitions kept, whenever they came.
const DEFINITIONS_MAX: usize = 4096;

/// The last seconds of the bus.
#[derive(Debug)]
pub(crate) struct Snapshot {
    span: Span,
    bytes_max: usize,
    bytes: usize,
    blocks: VecDeque<Block>,
    definitions: BTreeMap<u64, Definition>,
}

#[derive(Debug)]
struct Block {
    /// As in the ring.
    bytes: Vec<u8>,
    newest: Time,
}

impl Snapshot {
    /// Keeps this long, in so much memory at most.
    pub(crate) fn new(span: Span, bytes_max: u64) -> Self {
        Self {
            span,
            bytes_max: usize::try_from(bytes_max).unwrap_or(usize::MAX),
            bytes: 0,
            blocks: VecDeque::new(),
            definitions: table_definitions().map(|definition| (definition.id, definition)).collect(),
        }
    }

    /// Takes what the ring held; the oldest gives way.
    pub(crate) fn take(&mut self, now: Time, drained: &[u8]) {
        let mut newest = Time::ZERO;
        for (at, observed) in datagrams(drained) {
            newest = newest.max(at);
            if let Some(announced) = observed.definition()
                && self.definitions.len() < DEFINITIONS_MAX
                && !self.definitions.contains_key(&announced.id)
            {
                let (name, text) = (announced.name.to_owned(), announced.text.to_owned());
                self.definitions.insert(announced.id, Definition { id: announced.id, name, text });
            }
        }
        if !drained.is_empty() {
            self.append(drained, newest);
        }
        while self.blocks.front().is_some_and(|block| now - block.newest > self.span)
            || (self.bytes > self.bytes_max && self.blocks.len() > 1)
        {
            self.bytes -= self.blocks.pop_front().map_or(0, |block| block.bytes.len());
        }
    }

    fn append(&mut self, drained: &[u8], newest: Time) {
        self.bytes += drained.len();
        // A block is given back as a whole, so it must not span much of what is kept.
        let fresh = newest.as_nanos() - self.span.as_nanos() / 16;
        match self.blocks.back_mut() {
            Some(block)
                if block.bytes.len() + drained.len() <= BLOCK_BYTES.min(self.bytes_max / 16)
                    && block.began().is_some_and(|began| began.as_nanos() >= fresh) =>
            {
                block.bytes.extend_from_slice(drained);
                block.newest = block.newest.max(newest);
            }
            _ => self.blocks.push_back(Block { bytes: drained.to_vec(), newest }),
        }
    }

    /// Bytes kept.
    #[cfg(test)]
    pub(crate) fn bytes(&self) -> usize {
        self.bytes
    }

    /// Writes the last seconds to a file of their own: what it holds.
    ///
    /// # Errors
    /// The file cannot be begun, or not be written to its end.
    pub(crate) fn dump(&self, now: Time, plan: Plan) -> Result<Totals, WriteError> {
        let limits = Limits { min_free_bytes: plan.limits.min_free_bytes, ..Limits::one_file() };
        let mut segments = Segments::begin(Host, Plan { limits, ..plan }, now)?;
        for definition in self.definitions.values() {
            segments.define(now, definition);
        }
        let since = now - self.span;
        for block in &self.blocks {
            for (at, observed) in datagrams(&block.bytes).filter(|(at, _)| *at >= since) {
                segments.observe(now, at, &observed);
            }
        }
        segments.finish(now, "snapshot");
        let faults = segments.take_notices().into_iter().find(|notice| notice.name == "recording-stopped");
        match faults {
            Some(fault) => Err(WriteError::Sink(std::io::Error::other(fault.detail))),
            None => Ok(segments.totals()),
        }
    }
}

impl Block {
    fn began(&self) -> Option<Time> {
        datagrams(&self.bytes).next().map(|(at, _)| at)
    }
}

#[cfg(test)]
mod tests;
