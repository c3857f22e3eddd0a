//! The end of a file whose writing failed: enough for a reader to find it whole, and small enough for a full
//! disk.
//!
//! Written by hand, since the format's library ends a file only with what it believes to have written.

use mcap::MAGIC;
use mcap::records::op;

use crate::{ENDING_RECORD, Ending};

/// More than any tail takes, blocks of a file system included.
pub(super) const TAIL_ROOM_BYTES: u64 = 64 * 1024;
/// A reason is cut to this many characters in a tail.
const REASON_CHARACTERS_MAX: usize = 400;

/// The metadata record that says how the file ended, the end of the data, an empty summary, and the closing
/// magic.
pub(super) fn tail(ending: &Ending) -> Vec<u8> {
    let mut ending = ending.clone();
    ending.reason = ending.reason.chars().take(REASON_CHARACTERS_MAX).collect();
    let mut map = Vec::new();
    for (key, value) in ending.metadata() {
        put_text(&mut map, &key);
        put_text(&mut map, &value);
    }
    let mut metadata = Vec::new();
    put_text(&mut metadata, ENDING_RECORD);
    put_length(&mut metadata, map.len());
    metadata.extend_from_slice(&map);

    let mut tail = Vec::new();
    put_record(&mut tail, op::METADATA, &metadata);
    // A checksum of zero stands for none, and summary offsets of zero for no summary.
    put_record(&mut tail, op::DATA_END, &[0; 4]);
    put_record(&mut tail, op::FOOTER, &[0; 20]);
    tail.extend_from_slice(MAGIC);
    tail
}

fn put_record(out: &mut Vec<u8>, opcode: u8, content: &[u8]) {
    out.push(opcode);
    out.extend_from_slice(&(content.len() as u64).to_le_bytes());
    out.extend_from_slice(content);
}

fn put_text(out: &mut Vec<u8>, text: &str) {
    put_length(out, text.len());
    out.extend_from_slice(text.as_bytes());
}

fn put_length(out: &mut Vec<u8>, length: usize) {
    let length = u32::try_from(length).expect("keys and values of an ending are some hundred bytes");
    out.extend_from_slice(&length.to_le_bytes());
}
