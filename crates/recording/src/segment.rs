//! A recording as files: segments that are begun, sealed and renamed, so that a crash can only hurt the open
//! one.
//!
//! Decisions are made here without a clock or a disk of their own: every call takes `now`, and the disk is a
//! [`Storage`], so that a test can let any operation fail.

mod limits;
mod sealable;
mod segments;
mod storage;
mod tail;
#[cfg(test)]
pub(crate) mod testing;
#[cfg(test)]
mod tests;

pub use limits::{Keep, Limits, MIN_FREE_BYTES, SEGMENT_BYTES, SEGMENT_SPAN};
pub use segments::{Notice, Plan, Segments, Standing, Totals, file_of_segment, part_of};
pub use storage::{Host, HostFile, Storage, StoredFile};
