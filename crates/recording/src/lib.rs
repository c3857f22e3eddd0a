//! Recordings: MCAP files, written so that a crash costs little, read so that damage costs no more than what it hit.
//!
//! This is the one crate that names the MCAP library. `docs/recordings.md` has the format.

mod about;
mod cdr;
mod chunk;
mod csv;
mod cut;
pub mod export;
mod format;
mod read;
mod recover;
mod ros2;
mod segment;
mod select;
pub mod verify;
mod write;

pub use about::{ABOUT_RECORD, About, ENDING_RECORD, Ending, LOSSES_RECORD};
pub use cut::{CutError, Piece, cut};
pub use format::{
    Definition, Entry, FormatError, MESSAGE_ENCODING, PROFILE, SCHEMA_ENCODING, SETTINGS_FILE, Stream,
};
pub use read::{
    Attachment, Channel, Condition, Defect, Gaps, Hole, Kept, Message, Messages, ReadError, Recording,
    Schema, SegmentFacts, Shown, StreamGaps, StreamKey,
};
pub use recover::{Missing, RecoverError, Recovered, recover, recover_file};
pub use segment::{
    Host, HostFile, Keep, Limits, MIN_FREE_BYTES, Notice, Plan, SEGMENT_BYTES, SEGMENT_SPAN, Segments,
    Standing, Storage, StoredFile, Totals, file_of_segment, part_of,
};
pub use select::Selection;
pub use write::{
    CHUNK_BYTES, CHUNK_SPAN, Compression, GAP_RECORD, Gap, Loss, Taken, WriteError, WriteOptions, Writer,
    losses_from_metadata, losses_metadata,
};
