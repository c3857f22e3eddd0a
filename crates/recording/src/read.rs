//! Reading: what a recording is, its channels, and its messages in order of time.
//!
//! Nothing is believed before its checksum held: messages come out of chunks whose checksum was computed over
//! what was unpacked, and times and channels of chunks out of a summary with a checksum of its own. A file
//! without a summary that holds is read from its beginning instead; one that was torn gives what stands
//! before the tear. Damage is an error that names file, place and both values; what lies beyond it can still
//! be read.

pub(crate) mod error;
mod gaps;
mod group;
mod merge;
mod messages;
pub(crate) mod record;
mod recording;
mod scan;
mod segment;
pub(crate) mod source;
mod visit;

pub use error::{Defect, ReadError, Shown};
pub use gaps::{Gaps, Hole, StreamGaps, StreamKey};
pub use messages::{Message, Messages};
pub use recording::{Attachment, Channel, Kept, Recording, Schema, SegmentFacts};
pub use segment::Condition;
