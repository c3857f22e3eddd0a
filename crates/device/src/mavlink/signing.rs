//! Signatures, and the rules that make a recorded frame worthless.
//!
//! Behind the check stand the link's number, a timestamp, and the first six bytes of a SHA-256 over key,
//! frame, link and timestamp. A receiver takes no frame whose timestamp does not exceed the last of the same
//! system, component and link, and none whose timestamp is over a minute behind its own clock; its own clock
//! is never behind what it has accepted.
//!
//! A timestamp is given at the moment of sending: one that was made when a frame was put in a queue may be
//! overtaken by another's, and the frame is then refused.

use core::fmt;

use sha2::{Digest, Sha256};

use super::Frame;
use crate::bytes::{Reader, Writer};

/// What timestamps count from: 2015-01-01 00:00 UTC, in Unix seconds.
pub const TIMESTAMP_EPOCH_UNIX_S: u64 = 1_420_070_400;

/// Senders a [`Verifier`] keeps apart. There is no forgetting one, since who is forgotten can be replayed.
pub const STREAMS_MAX: usize = 16;

/// A minute.
const OLDEST_TICKS: u64 = 6_000_000;

/// A shared secret.
#[derive(Clone)]
pub struct Key([u8; 32]);

impl Key {
    /// A key of these bytes.
    #[must_use]
    pub const fn new(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// The first six bytes of the digest over the key and `parts`.
    pub(super) fn tag(&self, parts: &[&[u8]]) -> [u8; 6] {
        let mut hash = Sha256::new();
        hash.update(self.0);
        parts.iter().for_each(|part| hash.update(part));
        let digest: [u8; 32] = hash.finalize().into();
        let [a, b, c, d, e, f, ..] = digest;
        [a, b, c, d, e, f]
    }
}

impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Key(..)")
    }
}

/// Ticks of 10 µs since [`TIMESTAMP_EPOCH_UNIX_S`], 48 bits: enough until 2104.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Timestamp(u64);

impl Timestamp {
    /// The last there is.
    pub const MAX: Self = Self((1 << 48) - 1);

    /// So many ticks; `None` for more than 48 bits of them.
    #[must_use]
    pub const fn new(ticks: u64) -> Option<Self> {
        if ticks <= Self::MAX.0 { Some(Self(ticks)) } else { None }
    }

    /// Of a time in microseconds of the Unix epoch; `None` before 2015 and after 2104.
    #[must_use]
    pub const fn from_unix_micros(micros: u64) -> Option<Self> {
        match micros.checked_sub(TIMESTAMP_EPOCH_UNIX_S * 1_000_000) {
            Some(micros) => Self::new(micros / 10),
            None => None,
        }
    }

    /// The ticks.
    #[must_use]
    pub const fn ticks(self) -> u64 {
        self.0
    }

    const fn next(self) -> Self {
        if self.0 < Self::MAX.0 { Self(self.0 + 1) } else { self }
    }

    pub(super) const fn to_bytes(self) -> [u8; 6] {
        let [a, b, c, d, e, f, ..] = self.0.to_le_bytes();
        [a, b, c, d, e, f]
    }

    const fn from_bytes([a, b, c, d, e, f]: [u8; 6]) -> Self {
        Self(u64::from_le_bytes([a, b, c, d, e, f, 0, 0]))
    }
}

/// What stands behind a signed frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Signature {
    /// The sender's number for the way it was sent.
    pub link: u8,
    /// When it was signed.
    pub timestamp: Timestamp,
    /// What only a holder of the key can make.
    pub tag: [u8; 6],
}

impl Signature {
    pub(super) fn read(reader: &mut Reader<'_>) -> Option<Self> {
        let link = reader.u8()?;
        let timestamp = Timestamp::from_bytes(reader.array()?);
        Some(Self { link, timestamp, tag: reader.array()? })
    }

    pub(super) fn write(&self, writer: &mut Writer<'_>) {
        writer.u8(self.link).bytes(&self.timestamp.to_bytes()).bytes(&self.tag);
    }
}

/// Signs what one sender says on one link.
#[derive(Clone, Debug)]
pub struct Signer {
    key: Key,
    link: u8,
    last: Timestamp,
}

impl Signer {
    /// A signer that has signed nothing. A sender that was restarted is heard again because its clock went on
    /// meanwhile.
    #[must_use]
    pub const fn new(key: Key, link: u8) -> Self {
        Self { key, link, last: Timestamp(0) }
    }

    pub(super) const fn key(&self) -> &Key {
        &self.key
    }

    /// Link and timestamp of the next frame: now, and later than the one before even within one tick.
    pub(super) fn stamp(&mut self, now: Timestamp) -> (u8, Timestamp) {
        self.last = now.max(self.last.next());
        (self.link, self.last)
    }
}

/// Why a frame is not believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SignatureError {
    /// It is not signed.
    Unsigned,
    /// It was signed with another key, or changed on its way.
    Tag,
    /// A frame of the same sender that was signed then or later has been accepted.
    Replayed {
        /// When it was signed.
        timestamp: Timestamp,
        /// The newest accepted of that sender.
        newest: Timestamp,
    },
    /// It was signed over a minute ago.
    Stale {
        /// When it was signed.
        timestamp: Timestamp,
        /// The verifier's time.
        now: Timestamp,
    },
    /// Its sender has not been heard, and there is no room for another.
    TooManySenders,
}

impl fmt::Display for SignatureError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unsigned => write!(f, "the frame is not signed"),
            Self::Tag => write!(f, "the signature is not that of the key"),
            Self::Replayed { timestamp, newest } => {
                write!(f, "signed at {}, no later than the sender's newest, {}", timestamp.0, newest.0)
            }
            Self::Stale { timestamp, now } => {
                write!(f, "signed at {}, over a minute before {}", timestamp.0, now.0)
            }
            Self::TooManySenders => write!(f, "more than {STREAMS_MAX} senders"),
        }
    }
}

impl core::error::Error for SignatureError {}

/// One sender on one link, and the newest that was accepted of it.
#[derive(Clone, Copy, Debug)]
struct Stream {
    sender: (u8, u8, u8),
    newest: Timestamp,
}

/// Believes each signed frame once.
#[derive(Clone, Debug)]
pub struct Verifier {
    key: Key,
    newest: Timestamp,
    streams: [Option<Stream>; STREAMS_MAX],
}

impl Verifier {
    /// A verifier that has heard nobody.
    #[must_use]
    pub const fn new(key: Key) -> Self {
        Self { key, newest: Timestamp(0), streams: [None; STREAMS_MAX] }
    }

    /// Whether `frame` is to be believed at `now`. If it is, it and whatever its sender signed before it is
    /// not a second time; if it is not, nothing has changed.
    ///
    /// # Errors
    /// [`SignatureError`] says why not.
    pub fn verify(&mut self, frame: &Frame<'_>, now: Timestamp) -> Result<(), SignatureError> {
        let signature = frame.signature.ok_or(SignatureError::Unsigned)?;
        let timestamp = signature.timestamp;
        let expected = frame.expected_tag(&self.key, &signature).ok_or(SignatureError::Tag)?;
        if differ(&expected, &signature.tag) {
            return Err(SignatureError::Tag);
        }
        let now = now.max(self.newest);
        if timestamp.0.saturating_add(OLDEST_TICKS) < now.0 {
            return Err(SignatureError::Stale { timestamp, now });
        }
        let sender = (frame.header.system, frame.header.component, signature.link);
        self.accept(sender, timestamp)?;
        self.newest = self.newest.max(timestamp);
        Ok(())
    }

    fn accept(&mut self, sender: (u8, u8, u8), timestamp: Timestamp) -> Result<(), SignatureError> {
        // Places are filled from the front, so the sender stands before the first free one.
        let place = self
            .streams
            .iter_mut()
            .find(|place| place.is_none_or(|stream| stream.sender == sender))
            .ok_or(SignatureError::TooManySenders)?;
        match *place {
            Some(Stream { newest, .. }) if timestamp <= newest => {
                Err(SignatureError::Replayed { timestamp, newest })
            }
            _ => {
                *place = Some(Stream { sender, newest: timestamp });
                Ok(())
            }
        }
    }
}

/// Whether two tags differ, found in the same time wherever they do.
fn differ(one: &[u8; 6], other: &[u8; 6]) -> bool {
    one.iter().zip(other).fold(0, |all, (a, b)| all | (a ^ b)) != 0
}

#[cfg(test)]
mod tests {
    use super::super::{FRAME_BYTES_MAX, Header, Heartbeat, Message, PAYLOAD_BYTES_MAX};
    use super::*;
    use crate::bytes::from_hex;
    use std::vec::Vec;

    fn key() -> Key {
        Key::new(core::array::from_fn(|at| at as u8))
    }

    fn at(ticks: u64) -> Timestamp {
        Timestamp::new(ticks).unwrap()
    }

    fn signed(signer: &mut Signer, system: u8, now: Timestamp) -> Vec<u8> {
        let (mut payload, mut out) = ([0; PAYLOAD_BYTES_MAX], [0; FRAME_BYTES_MAX]);
        let header = Header { sequence: 5, system, component: 190 };
        let heartbeat = Heartbeat { custom_mode: 0x0102, ..Heartbeat::GROUND_STATION };
        let frame = Message::Heartbeat(heartbeat).frame(header, &mut payload).unwrap();
        let length = frame.signed(signer, now).unwrap().encode(&mut out).unwrap();
        out[..length].to_vec()
    }

    fn verify(verifier: &mut Verifier, bytes: &[u8], now: Timestamp) -> Result<(), SignatureError> {
        verifier.verify(&Frame::decode(bytes).unwrap(), now)
    }

    /// Worked out with a separate program from the definition.
    const GOLDEN: &str = "fd09010005ffbe0000000201
        000006080004031b03070605040302010bdc9af603d7";

    #[test]
    fn golden_signature_both_ways() {
        let bytes = from_hex(GOLDEN);
        let now = at(0x0102_0304_0506);
        assert_eq!(signed(&mut Signer::new(key(), 7), 255, now), bytes);
        assert_eq!(verify(&mut Verifier::new(key()), &bytes, now), Ok(()));
        let signature = Frame::decode(&bytes).unwrap().signature.unwrap();
        assert_eq!((signature.link, signature.timestamp), (7, now));
    }

    #[test]
    fn timestamps_count_from_2015() {
        assert_eq!(Timestamp::from_unix_micros(TIMESTAMP_EPOCH_UNIX_S * 1_000_000), Some(at(0)));
        assert_eq!(Timestamp::from_unix_micros(1_420_070_400_000_029), Some(at(2)));
        assert_eq!(Timestamp::from_unix_micros(1_420_070_399_999_999), None);
        assert_eq!(Timestamp::new(1 << 48), None);
        assert_eq!(Timestamp::from_unix_micros(u64::MAX), None);
    }

    #[test]
    fn frames_of_one_tick_have_rising_timestamps_and_are_believed_in_order_only() {
        let (mut signer, mut verifier) = (Signer::new(key(), 0), Verifier::new(key()));
        let frames: Vec<Vec<u8>> = (0..3).map(|_| signed(&mut signer, 1, at(1000))).collect();
        assert_eq!(verify(&mut verifier, &frames[0], at(1000)), Ok(()));
        assert_eq!(verify(&mut verifier, &frames[2], at(1000)), Ok(()));
        let (timestamp, newest) = (at(1001), at(1002));
        let overtaken = Err(SignatureError::Replayed { timestamp, newest });
        assert_eq!(verify(&mut verifier, &frames[1], at(1000)), overtaken);
        // A clock that was set back does not repeat a timestamp.
        assert_eq!(verify(&mut verifier, &signed(&mut signer, 1, at(1)), at(1000)), Ok(()));
    }

    #[test]
    fn a_replay_is_refused_on_every_link_but_senders_do_not_disturb_each_other() {
        let mut verifier = Verifier::new(key());
        let frames = [(1, 1, 9), (2, 1, 8), (1, 2, 7)]
            .map(|(link, system, ticks)| signed(&mut Signer::new(key(), link), system, at(ticks)));
        for frame in &frames {
            assert_eq!(verify(&mut verifier, frame, at(9)), Ok(()));
        }
        for (frame, ticks) in frames.iter().zip([9, 8, 7]) {
            let (timestamp, newest) = (at(ticks), at(ticks));
            let replayed = Err(SignatureError::Replayed { timestamp, newest });
            assert_eq!(verify(&mut verifier, frame, at(9)), replayed);
        }
    }

    #[test]
    fn a_frame_of_over_a_minute_ago_is_refused_also_by_the_clock_of_what_was_accepted() {
        let now = at(10_000_000);
        let old = signed(&mut Signer::new(key(), 0), 1, at(4_000_000));
        let older = signed(&mut Signer::new(key(), 0), 2, at(3_999_999));
        let stale = Err(SignatureError::Stale { timestamp: at(3_999_999), now });
        assert_eq!(verify(&mut Verifier::new(key()), &old, now), Ok(()));
        assert_eq!(verify(&mut Verifier::new(key()), &older, now), stale);
        let mut verifier = Verifier::new(key());
        assert_eq!(verify(&mut verifier, &signed(&mut Signer::new(key(), 0), 3, now), at(0)), Ok(()));
        assert_eq!(verify(&mut verifier, &older, at(0)), stale);
    }

    #[test]
    fn what_was_not_signed_with_the_key_is_refused_and_changes_nothing() {
        let mut verifier = Verifier::new(key());
        let good = signed(&mut Signer::new(key(), 0), 1, at(50));
        let foreign = signed(&mut Signer::new(Key::new([9; 32]), 0), 1, Timestamp::MAX);
        assert_eq!(verify(&mut verifier, &foreign, at(50)), Err(SignatureError::Tag));
        for bit in (good.len() - 13) * 8..good.len() * 8 {
            let mut forged = good.clone();
            forged[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(verify(&mut verifier, &forged, at(50)), Err(SignatureError::Tag), "bit {bit}");
        }
        let unsigned = Frame { signature: None, ..Frame::decode(&good).unwrap() };
        assert_eq!(verifier.verify(&unsigned, at(50)), Err(SignatureError::Unsigned));
        assert_eq!(verify(&mut verifier, &good, at(50)), Ok(()));
    }

    #[test]
    fn a_sender_too_many_is_refused_and_nobody_is_forgotten() {
        let mut verifier = Verifier::new(key());
        let frames: Vec<Vec<u8>> =
            (0..=STREAMS_MAX).map(|n| signed(&mut Signer::new(key(), 0), n as u8, at(5))).collect();
        for frame in &frames[..STREAMS_MAX] {
            assert_eq!(verify(&mut verifier, frame, at(5)), Ok(()));
        }
        assert_eq!(verify(&mut verifier, &frames[STREAMS_MAX], at(5)), Err(SignatureError::TooManySenders));
        assert!(frames[..STREAMS_MAX].iter().all(|frame| verify(&mut verifier, frame, at(5)).is_err()));
    }

    #[test]
    fn a_key_is_not_written_to_logs() {
        assert_eq!(std::format!("{:?}", key()), "Key(..)");
    }
}
