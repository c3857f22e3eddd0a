//! Files torn and damaged everywhere.

use super::*;
use crate::segment::testing::{about, ending_of, numbers_in, observed};
use crate::write::{Compression, Writer};

/// A whole file of so many messages, and what of it stood on the disk before it was sealed.
fn file(messages: u64, compression: Compression) -> (Vec<u8>, usize) {
    let options = WriteOptions { compression, chunk_bytes: 3000 };
    let mut writer = Writer::new(Vec::new(), options, &about(), None).unwrap();
    for number in 0..messages {
        observed(number, |at, observed| writer.observe(at, observed)).unwrap();
    }
    writer.close_chunk().unwrap();
    let unsealed = writer.sink().len();
    (writer.finish(&Ending { reason: "stopped".to_owned(), ..Ending::default() }, &[]).unwrap(), unsealed)
}

fn recovered(bytes: &[u8]) -> Result<(Recovered, Vec<u8>), RecoverError> {
    let mut output = Vec::new();
    let recovered = recover(bytes, bytes.len() as u64, &mut output)?;
    Ok((recovered, output))
}

#[test]
fn a_whole_file_stays_as_it_is() {
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        let (file, _) = file(300, compression);
        let (account, output) = recovered(&file).unwrap();
        assert_eq!((account.messages, account.missing), (300, None));
        assert_eq!(numbers_in(&output), (0..300).collect::<Vec<_>>());
        assert_eq!(ending_of(&output).reason, "stopped");
    }
}

#[test]
fn a_file_torn_at_every_byte_gives_an_exact_prefix_that_grows_with_it() {
    let (file, unsealed) = file(120, Compression::Lz4);
    let mut last = 0;
    for length in 0..file.len() {
        let result = recovered(&file[..length]);
        if length < 8 {
            assert!(matches!(result, Err(RecoverError::Foreign(_))), "{length} bytes");
            continue;
        }
        let (account, output) = result.unwrap();
        let numbers = numbers_in(&output);
        assert_eq!(numbers, (0..account.messages).collect::<Vec<_>>(), "{length} bytes");
        assert!(account.messages >= last, "{length} bytes");
        last = account.messages;
        let missing = account.missing.expect("something is missing");
        assert_eq!(missing.offset + missing.bytes, length as u64);
        assert_eq!(account.kept_bytes, missing.offset);
        if length >= unsealed {
            assert_eq!(account.messages, 120, "{length} bytes");
        }
    }
}

#[test]
fn a_file_with_any_byte_flipped_gives_a_prefix_or_an_error_never_another_message() {
    let (file, _) = file(60, Compression::Lz4);
    for index in 0..file.len() {
        for bits in [0x01, 0x80, 0xff] {
            let mut damaged = file.clone();
            damaged[index] ^= bits;
            let Ok((account, output)) = recovered(&damaged) else { continue };
            // Names and metadata have no checksum of their own; messages do.
            let mut found = 0;
            for message in mcap::MessageStream::new(&output).unwrap() {
                let message = message.unwrap();
                assert_eq!(message.data.as_ref(), crate::segment::testing::body(found), "byte {index}");
                found += 1;
            }
            assert_eq!(found, account.messages);
        }
    }
}

#[test]
fn what_is_no_recording_is_refused_with_what_was_found() {
    for (bytes, named) in
        [(&b""[..], "0 bytes"), (b"\x89MCAP", "5 bytes"), (b"#LCM-log-file-header", "begins")]
    {
        let error = recovered(bytes).unwrap_err().to_string();
        assert!(error.contains(named), "{error}");
    }
}

#[test]
fn a_record_that_claims_the_world_costs_no_memory() {
    let (mut file, unsealed) = file(60, Compression::Lz4);
    file.truncate(unsealed);
    for claimed in [u64::MAX, 1 << 40, 60 << 20] {
        let mut damaged = file.clone();
        damaged.push(op::CHUNK);
        damaged.extend_from_slice(&claimed.to_le_bytes());
        let (account, _) = recovered(&damaged).unwrap();
        assert_eq!(account.messages, 60);
    }
}

#[test]
fn files_are_recovered_beside_the_torn_one_and_never_over_another() {
    let folder = std::env::temp_dir().join(format!("recording-recover-{}", std::process::id()));
    fs::create_dir_all(&folder).unwrap();
    let (torn, output) = (folder.join("a.mcap.part"), folder.join("a.mcap"));
    let (file, unsealed) = file(60, Compression::Lz4);
    fs::write(&torn, &file[..unsealed]).unwrap();
    assert_eq!(recover_file(&torn, &output).unwrap().messages, 60);
    assert_eq!(numbers_in(&fs::read(&output).unwrap()).len(), 60);
    assert_eq!(ending_of(&fs::read(&output).unwrap()).reason, "recovered");
    let error = recover_file(&torn, &output).unwrap_err().to_string();
    assert!(error.contains("is there already"), "{error}");
    assert!(matches!(recover_file(&folder.join("none"), &output), Err(RecoverError::Read(_))));
    assert_eq!(fs::read_dir(&folder).unwrap().count(), 2, "no drafts are left");
    fs::remove_dir_all(&folder).unwrap();
}
