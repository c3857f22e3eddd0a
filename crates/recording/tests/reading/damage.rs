//! A small file, cut off at every byte and damaged at every byte: what is read is true, or an error is.

use crate::files::{self, Said};
use recording::{Compression, ReadError, Recording, Selection};

/// About 64 KiB.
const MESSAGES: usize = 700;

/// Whether these are the first messages of the truth, by the order in which they were written.
fn is_prefix(read: &[Said], truth: &[Said]) -> bool {
    read == files::in_order(&truth[..read.len().min(truth.len())])
}

fn read(bytes: &[u8]) -> Result<(Vec<Said>, Vec<ReadError>), ReadError> {
    let recording = Recording::from_bytes("a", bytes.to_vec())?;
    Ok(files::read_all(&recording, &Selection::all()))
}

#[test]
fn cut_off_at_every_byte_it_gives_a_prefix() {
    for compression in [Compression::Lz4, Compression::None] {
        let said = files::said(MESSAGES);
        let whole = files::sealed(&said, compression);
        let (mut kept, mut expected) = (0, Vec::new());
        for length in 0..whole.len() {
            match read(&whole[..length]) {
                Err(_) => assert!(length < 8, "{length} bytes of {} do not open", whole.len()),
                Ok((read, errors)) => {
                    assert!(errors.is_empty(), "{length} bytes: {errors:?}");
                    assert!(read.len() >= kept, "{length} bytes give less than fewer do");
                    if read.len() > kept {
                        kept = read.len();
                        expected = files::in_order(&said[..kept]);
                    }
                    assert!(read == expected, "{length} bytes give something else");
                }
            }
        }
        assert_eq!(kept, said.len());
    }
}

/// Damages every byte in turn, now all of its bits and now one. Gives the places where that changed no
/// message.
fn flipped(whole: &[u8], said: &[Said]) -> Vec<usize> {
    let truth = files::in_order(said);
    let mut harmless = Vec::new();
    for at in 0..whole.len() {
        let mask = if at % 3 == 0 { 0xff } else { 1 << (at % 8) };
        let mut bytes = whole.to_vec();
        bytes[at] ^= mask;
        let Ok((read, errors)) = read(&bytes) else { continue };
        // What is left is true and in order; what is missing, an error or the file's condition tells.
        let mut rest = truth.iter();
        let only_true = read.iter().all(|said| rest.any(|true_one| true_one == said));
        assert!(only_true, "byte {at} ^ {mask:#x}: a wrong message");
        if read.len() == truth.len() {
            harmless.push(at);
        } else if errors.is_empty() {
            let recording = Recording::from_bytes("a", bytes).unwrap();
            let condition = &recording.segments()[0].condition;
            let told = matches!(condition, recording::Condition::Torn { .. }) && is_prefix(&read, said);
            let (found, all) = (read.len(), truth.len());
            assert!(
                told,
                "byte {at} ^ {mask:#x}: {found} of {all} messages, and nobody says so: {condition:?}"
            );
        }
    }
    harmless
}

/// Whether a place is one that no checksum of a chunk covers.
fn is_outside_of_chunks(whole: &[u8], at: usize) -> bool {
    // Before the packed content stand code, length, two times, size, checksum, and the compression's name.
    const TIMES: std::ops::Range<usize> = 9..25;
    let chunks = files::records(whole, mcap::records::op::CHUNK);
    chunks.iter().all(|chunk| !chunk.contains(&at) || TIMES.contains(&(at - chunk.start)))
}

#[test]
fn with_every_byte_flipped_no_message_is_wrong() {
    let said = files::said(MESSAGES);
    let whole = files::sealed(&said, Compression::Lz4);
    let harmless = flipped(&whole, &said);
    // What changes nothing stands outside of chunks, but for bytes of a packed stream that are there twice.
    let inside = harmless.iter().filter(|at| !is_outside_of_chunks(&whole, **at)).count();
    assert!(inside < 200, "{inside} bytes inside of chunks change nothing");
    assert!(harmless.len() < whole.len() / 4, "{} of {} change nothing", harmless.len(), whole.len());
}

#[test]
fn with_every_byte_of_a_torn_file_flipped_no_message_is_wrong() {
    let said = files::said(MESSAGES);
    flipped(&files::torn(&said, Compression::Lz4), &said);
}

#[test]
fn with_every_byte_of_an_unpacked_torn_file_flipped_no_message_is_wrong() {
    let said = files::said(MESSAGES);
    let whole = files::torn(&said, Compression::None);
    let harmless = flipped(&whole, &said);
    assert!(harmless.iter().all(|at| is_outside_of_chunks(&whole, *at)), "a chunk's byte changes nothing");
}

#[test]
fn damage_costs_its_chunk_and_no_other() {
    let said = files::said(3000);
    for whole in [files::sealed(&said, Compression::Lz4), files::torn(&said, Compression::Lz4)] {
        let chunks = files::records(&whole, mcap::records::op::CHUNK);
        let mut bytes = whole.clone();
        let chunk = &chunks[chunks.len() / 2];
        bytes[chunk.end - 20] ^= 1;
        let (read, errors) = read(&bytes).unwrap();
        assert_eq!(errors.len(), 1, "{errors:?}");
        assert!(errors[0].to_string().contains(&format!("byte {}", chunk.start)), "{}", errors[0]);
        assert!(read.len() > said.len() * 8 / 10 && read.len() < said.len());
        let last = files::in_order(&said).pop();
        assert_eq!(read.last(), last.as_ref());
    }
}
