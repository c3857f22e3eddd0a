//! Frames: what was seen at one exposure.
//!
//! | Section | Entry |
//! | --- | --- |
//! | (i32 frame number) | |
//! | marker sets | text name, i32 n, n × f32\[3\] |
//! | other markers | f32\[3\] |
//! | **rigid bodies** | i32 id, f32\[3\] m, f32\[4\] x y z w, f32 mean marker error, u16 parameters |
//! | skeletons | i32 id, i32 n, n × rigid body |
//! | assets (4.1) | i32 id, i32 n, n × rigid body, i32 m, m × labelled marker |
//! | labelled markers | i32 id, f32\[3\], f32 size, u16 parameters, f32 residual |
//! | force plates, devices | i32 id, i32 channels, each i32 n, n × f32 |
//! | (timing) | u32 ×2 timecode, f64 s, u64 ×3 ticks; 4.1: u32 ×2; u16 flags, i32 0 |
//!
//! A section begins with an i32 count, from 4.1 on followed by an i32 of bytes.

use quantity::Span;

use super::{Fields, MESSAGE_FRAME, NatNetError, Version, seal};
use crate::bytes::{Reader, Writer};

/// Bytes of a rigid body.
pub const RIGID_BODY_BYTES: usize = 38;

const VECTOR_BYTES: usize = 12;
const LABELLED_MARKER_BYTES: usize = 26;

/// Bit of a rigid body's parameters: it was tracked in this frame.
pub const PARAM_TRACKED: u16 = 1;

/// Bit of a frame's flags: the server is recording.
pub const FLAG_RECORDING: u16 = 1;

/// Bit of a frame's flags: what is tracked has changed, so ask for the model definition again.
pub const FLAG_MODELS_CHANGED: u16 = 2;

/// One rigid body of a frame, in the vendor's axes ([`UpAxis`](super::UpAxis)).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RigidBody {
    /// Its streaming id; the model definition has its name.
    pub id: i32,
    /// Position of its pivot.
    pub position_m: [f32; 3],
    /// Attitude, a unit quaternion with the real part last.
    pub orientation_xyzw: [f32; 4],
    /// Mean distance of its markers from where its pose puts them.
    pub marker_error_m: f32,
    /// Parameters; of these only [`PARAM_TRACKED`] is documented.
    pub params: u16,
}

impl RigidBody {
    /// Whether it was seen in this frame. A body that was not is streamed all the same, commonly where it was
    /// last or at zero.
    #[must_use]
    pub const fn is_tracked(&self) -> bool {
        self.params & PARAM_TRACKED != 0
    }

    /// Whether position and attitude are finite. The stream guarantees nothing of the kind.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.position_m.iter().chain(&self.orientation_xyzw).all(|number| number.is_finite())
    }

    fn read(bytes: &[u8]) -> Option<Self> {
        let mut reader = Reader::new(bytes);
        Some(Self {
            id: reader.i32()?,
            position_m: reader.f32s()?,
            orientation_xyzw: reader.f32s()?,
            marker_error_m: reader.f32()?,
            params: reader.u16()?,
        })
    }

    fn write(&self, writer: &mut Writer<'_>) {
        writer.i32(self.id).f32s(&self.position_m).f32s(&self.orientation_xyzw);
        writer.f32(self.marker_error_m).u16(self.params);
    }
}

/// When a frame was taken and sent. Ticks are of the server's clock, whose frequency the
/// [`ServerInfo`](super::ServerInfo) has; zero means that the server does not say.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Timing {
    /// SMPTE timecode, where a camera system has one.
    pub timecode: u32,
    /// Its fraction.
    pub timecode_subframe: u32,
    /// Seconds by the server's software since it began to stream.
    pub timestamp_s: f64,
    /// The middle of the exposure.
    pub exposed_ticks: u64,
    /// When the server had the cameras' data.
    pub received_ticks: u64,
    /// When the server sent the frame.
    pub transmitted_ticks: u64,
    /// Seconds by a precision clock (4.1; zero before).
    pub precision_s: u32,
    /// Their fraction.
    pub precision_fraction: u32,
}

impl Timing {
    /// From the middle of the exposure to the frame's departure: the part of the latency that is the
    /// server's. `None` where a stamp or the clock's frequency is missing, or they contradict each other.
    #[must_use]
    pub fn latency(&self, clock_hz: u64) -> Option<Span> {
        if self.exposed_ticks == 0 {
            return None;
        }
        let ticks = u128::from(self.transmitted_ticks.checked_sub(self.exposed_ticks)?);
        let nanos = (ticks * 1_000_000_000).checked_div(u128::from(clock_hz))?;
        i64::try_from(nanos).ok().map(Span::from_nanos)
    }
}

/// What a frame says besides the bodies.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameHead {
    /// Counts exposures, or in a take that is played back the take's frames; wraps.
    pub number: u32,
    /// When.
    pub timing: Timing,
    /// [`FLAG_RECORDING`], [`FLAG_MODELS_CHANGED`].
    pub flags: u16,
}

/// A frame: its head, and its rigid bodies still in the datagram.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame<'a> {
    /// Number, times and flags.
    pub head: FrameHead,
    bodies: &'a [u8],
}

impl<'a> Frame<'a> {
    /// The frame in a datagram, laid out as in `version`; all of it has been walked when this answers.
    ///
    /// # Errors
    /// [`NatNetError`] for another message, a length or a count that does not come out, or an end that is
    /// none: the last two are what a frame of another version looks like.
    pub fn decode(version: Version, bytes: &'a [u8]) -> Result<Self, NatNetError> {
        let mut fields = Fields::open(bytes, MESSAGE_FRAME)?;
        let number = fields.get("frame number", Reader::u32)?;
        skip(&mut fields, version, "marker sets", |fields| {
            fields.get("marker sets", Reader::text)?;
            skip_block(fields, "marker sets", VECTOR_BYTES)
        })?;
        skip_fixed(&mut fields, version, "other markers", VECTOR_BYTES)?;
        let bodies = skip_fixed(&mut fields, version, "rigid bodies", RIGID_BODY_BYTES)?;
        skip(&mut fields, version, "skeletons", |fields| {
            fields.get("skeletons", Reader::i32)?;
            skip_block(fields, "skeletons", RIGID_BODY_BYTES)
        })?;
        if version.has_sizes() {
            // Its entries are stepped over by the section's size.
            skip(&mut fields, version, "assets", |_| Ok(()))?;
        }
        skip_fixed(&mut fields, version, "labelled markers", LABELLED_MARKER_BYTES)?;
        skip(&mut fields, version, "force plates", |fields| skip_channels(fields, "force plates"))?;
        skip(&mut fields, version, "devices", |fields| skip_channels(fields, "devices"))?;
        let timing = fields.get("timing", |reader| read_timing(reader, version))?;
        let flags = fields.get("flags", Reader::u16)?;
        let value = fields.get("end mark", Reader::i32)?;
        if value != 0 {
            return Err(NatNetError::EndMark { value });
        }
        fields.finish()?;
        Ok(Self { head: FrameHead { number, timing, flags }, bodies })
    }

    /// The rigid bodies in the order they were sent, tracked or not.
    pub fn rigid_bodies(&self) -> impl ExactSizeIterator<Item = RigidBody> + use<'a> {
        // Sections of rigid bodies have whole bodies, so none is left out.
        self.bodies.chunks_exact(RIGID_BODY_BYTES).map(|body| RigidBody::read(body).unwrap_or_default())
    }
}

/// Steps over a section: by its size where it has one, else entry by entry.
fn skip<'a>(
    fields: &mut Fields<'a>,
    version: Version,
    part: &'static str,
    mut entry: impl FnMut(&mut Fields<'a>) -> Result<(), NatNetError>,
) -> Result<(), NatNetError> {
    let count = fields.count(part)?;
    if version.has_sizes() {
        let bytes = fields.count(part)?;
        return fields.block(part, bytes, 1).map(|_| ());
    }
    // Every entry takes bytes, so a count beyond the datagram's end fails soon.
    (0..count).try_for_each(|_| entry(fields))
}

/// Steps over a section whose entries have a fixed size and answers its bytes.
fn skip_fixed<'a>(
    fields: &mut Fields<'a>,
    version: Version,
    part: &'static str,
    each: usize,
) -> Result<&'a [u8], NatNetError> {
    let count = fields.count(part)?;
    if version.has_sizes() {
        let bytes = fields.count(part)?;
        if count.checked_mul(each) != Some(bytes) {
            return Err(NatNetError::SectionSize { part, count, bytes });
        }
    }
    fields.block(part, count, each)
}

/// A count and as many things of one size.
fn skip_block(fields: &mut Fields<'_>, part: &'static str, each: usize) -> Result<(), NatNetError> {
    let count = fields.count(part)?;
    fields.block(part, count, each).map(|_| ())
}

/// A force plate or a device: an id, and channels of samples.
fn skip_channels(fields: &mut Fields<'_>, part: &'static str) -> Result<(), NatNetError> {
    fields.get(part, Reader::i32)?;
    let channels = fields.count(part)?;
    (0..channels).try_for_each(|_| skip_block(fields, part, size_of::<f32>()))
}

fn read_timing(reader: &mut Reader<'_>, version: Version) -> Option<Timing> {
    let mut timing = Timing {
        timecode: reader.u32()?,
        timecode_subframe: reader.u32()?,
        timestamp_s: reader.f64()?,
        exposed_ticks: reader.u64()?,
        received_ticks: reader.u64()?,
        transmitted_ticks: reader.u64()?,
        ..Timing::default()
    };
    if version.has_sizes() {
        timing.precision_s = reader.u32()?;
        timing.precision_fraction = reader.u32()?;
    }
    Some(timing)
}

/// Bytes of a frame of so many rigid bodies and nothing else.
#[must_use]
pub const fn frame_bytes(version: Version, bodies: usize) -> usize {
    let empty = if version.has_sizes() { 126 } else { 82 };
    bodies.saturating_mul(RIGID_BODY_BYTES).saturating_add(empty)
}

/// Writes a frame of rigid bodies, every other section empty, and answers its length
/// ([`frame_bytes`]). The precision clock is left out before 4.1.
///
/// # Errors
/// [`NatNetError::TooLong`] for more bodies than a datagram can have, [`NatNetError::NoRoom`].
pub fn encode_frame(
    version: Version,
    head: &FrameHead,
    bodies: &[RigidBody],
    out: &mut [u8],
) -> Result<usize, NatNetError> {
    let body_bytes = frame_bytes(version, bodies.len()) - super::HEADER_BYTES;
    let sections = if version.has_sizes() { 5 } else { 4 };
    seal(out, MESSAGE_FRAME, body_bytes, |writer| {
        writer.u32(head.number);
        // Marker sets, other markers, rigid bodies; then skeletons, assets, labelled markers, force plates,
        // devices. That the counts fit is what the length was checked for.
        for count in [0, 0, bodies.len() as i32].into_iter().chain((0..sections).map(|_| 0)) {
            writer.i32(count);
            if version.has_sizes() {
                writer.i32(count * RIGID_BODY_BYTES as i32);
            }
            for body in &bodies[..count as usize] {
                body.write(writer);
            }
        }
        write_timing(writer, version, &head.timing);
        writer.u16(head.flags).i32(0);
    })
}

fn write_timing(writer: &mut Writer<'_>, version: Version, timing: &Timing) {
    writer.u32(timing.timecode).u32(timing.timecode_subframe).f64(timing.timestamp_s);
    writer.u64(timing.exposed_ticks).u64(timing.received_ticks).u64(timing.transmitted_ticks);
    if version.has_sizes() {
        writer.u32(timing.precision_s).u32(timing.precision_fraction);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bytes::from_hex;
    use std::vec::Vec;

    /// The rigid bodies' section of the specification's vector, 4.1.
    const GOLDEN_SECTION: &str = "01000000 26000000 07000000 0000803f 00000040 00004040
        00000000 00000000 00000000 0000803f 00000000 0100";

    const BODY: RigidBody = RigidBody {
        id: 7,
        position_m: [1.0, 2.0, 3.0],
        orientation_xyzw: [0.0, 0.0, 0.0, 1.0],
        marker_error_m: 0.0,
        params: 1,
    };

    fn head() -> FrameHead {
        FrameHead { number: 42, ..FrameHead::default() }
    }

    fn encoded(version: Version, head: &FrameHead, bodies: &[RigidBody]) -> Vec<u8> {
        let mut out = std::vec![0xEE; frame_bytes(version, bodies.len())];
        let length = encode_frame(version, head, bodies, &mut out).unwrap();
        assert_eq!(length, out.len());
        out
    }

    /// The specification's vector: frame 42 of one body, everything else zero.
    fn golden(version: Version) -> Vec<u8> {
        let section = from_hex(GOLDEN_SECTION);
        let (count, bodies) = section.split_at(4);
        if version.has_sizes() {
            let mut bytes = [&from_hex("0700 a000 2a000000")[..], &[0; 16], &section].concat();
            bytes.resize(164, 0);
            return bytes;
        }
        let mut bytes = [&from_hex("0700 7400 2a000000")[..], &[0; 8], count, &bodies[4..]].concat();
        bytes.resize(120, 0);
        bytes
    }

    #[test]
    fn golden_frames_both_ways() {
        for version in Version::ALL {
            let bytes = golden(version);
            assert_eq!(encoded(version, &head(), &[BODY]), bytes, "{version}");
            let frame = Frame::decode(version, &bytes).unwrap();
            assert_eq!(frame.head, head());
            assert_eq!(frame.rigid_bodies().collect::<Vec<_>>(), [BODY]);
        }
    }

    #[test]
    fn times_and_flags_have_their_places() {
        let timing = Timing {
            timecode: 0x0102_0304,
            timecode_subframe: 5,
            timestamp_s: 1.5,
            exposed_ticks: 6,
            received_ticks: 7,
            transmitted_ticks: 8,
            precision_s: 9,
            precision_fraction: 10,
        };
        let head = FrameHead { number: u32::MAX, timing, flags: FLAG_MODELS_CHANGED };
        let tail = from_hex(
            "04030201 05000000 000000000000f83f 0600000000000000 0700000000000000 0800000000000000
             09000000 0a000000 0200 00000000",
        );
        let bytes = encoded(Version::V4_1, &head, &[]);
        assert_eq!(bytes[bytes.len() - 54..], tail);
        assert_eq!(Frame::decode(Version::V4_1, &bytes).unwrap().head, head);
        let bytes = encoded(Version::V3_1, &head, &[]);
        assert_eq!(bytes[bytes.len() - 46..bytes.len() - 6], tail[..40]);
        let timing = Timing { precision_s: 0, precision_fraction: 0, ..timing };
        assert_eq!(Frame::decode(Version::V3_1, &bytes).unwrap().head, FrameHead { timing, ..head });
    }

    #[test]
    fn latency_is_the_servers_part_of_it() {
        let at = |exposed_ticks, transmitted_ticks| Timing {
            exposed_ticks,
            transmitted_ticks,
            ..Timing::default()
        };
        // 10 MHz: 52 341 ticks are 5.2341 ms.
        assert_eq!(at(1_000_000, 1_052_341).latency(10_000_000), Some(Span::from_nanos(5_234_100)));
        assert_eq!(at(7, 7).latency(1), Some(Span::ZERO));
        for missing in [at(0, 5).latency(10), at(5, 4).latency(10), at(5, 6).latency(0)] {
            assert_eq!(missing, None);
        }
        assert_eq!(at(1, u64::MAX).latency(1), None);
        assert_eq!(at(1, u64::MAX).latency(u64::MAX), Some(Span::from_nanos(999_999_999)));
    }

    #[test]
    fn a_frame_of_another_version_is_refused() {
        let bodies = [BODY, RigidBody { id: 8, params: 0, ..BODY }];
        for written in Version::ALL {
            for count in 0..=bodies.len() {
                let bytes = encoded(written, &head(), &bodies[..count]);
                for read in Version::ALL {
                    let alike = written.has_sizes() == read.has_sizes();
                    assert_eq!(Frame::decode(read, &bytes).is_ok(), alike, "{written} as {read}, {count}");
                }
            }
        }
    }

    #[test]
    fn every_cut_and_every_excess_is_an_error() {
        for version in Version::ALL {
            let mut bytes = golden(version);
            for length in 0..bytes.len() {
                let error = Frame::decode(version, &bytes[..length]).unwrap_err();
                assert!(
                    matches!(error, NatNetError::Truncated { bytes, .. } if bytes == length),
                    "{error:?}"
                );
            }
            bytes.push(0);
            assert_eq!(Frame::decode(version, &bytes), Err(NatNetError::Trailing { bytes: 1 }));
            bytes.pop();
            let end = bytes.len() - 4;
            bytes[end] = 1;
            assert_eq!(Frame::decode(version, &bytes), Err(NatNetError::EndMark { value: 1 }));
            bytes[0] = 5;
            let another = NatNetError::Message { found: 5, expected: MESSAGE_FRAME };
            assert_eq!(Frame::decode(version, &bytes), Err(another));
        }
    }

    #[test]
    fn hostile_counts_are_errors_at_once() {
        for version in Version::ALL {
            let step = if version.has_sizes() { 8 } else { 4 };
            for section in 0..3 {
                for count in [i32::MAX, i32::MAX / 38 + 1, 1_000_000, 3, -1, i32::MIN] {
                    let mut bytes = golden(version);
                    let at = 8 + section * step;
                    bytes[at..at + 4].copy_from_slice(&count.to_le_bytes());
                    // In 4.1 marker sets are stepped over by their size; what they count is nobody's
                    // business.
                    if version.has_sizes() && section == 0 && count > 0 {
                        continue;
                    }
                    let decoded = Frame::decode(version, &bytes);
                    assert!(decoded.is_err(), "{version}, section {section}, {count}");
                }
            }
        }
        let mut bytes = golden(Version::V4_1);
        bytes[28] = 39;
        let part = "rigid bodies";
        let error = NatNetError::SectionSize { part, count: 1, bytes: 39 };
        assert_eq!(Frame::decode(Version::V4_1, &bytes), Err(error));
        bytes[28..32].copy_from_slice(&(-1i32).to_le_bytes());
        assert_eq!(Frame::decode(Version::V4_1, &bytes), Err(NatNetError::Negative { part, value: -1 }));
    }

    #[test]
    fn what_does_not_fit_is_an_error() {
        let version = Version::V4_1;
        assert_eq!(encode_frame(version, &head(), &[BODY], &mut [0; 163]), Err(NatNetError::NoRoom));
        let mut out = std::vec![0; 100_000];
        let most = (usize::from(u16::MAX) - 122) / RIGID_BODY_BYTES;
        let bodies = std::vec![BODY; most + 1];
        let length = encode_frame(version, &head(), &bodies[..most], &mut out).unwrap();
        assert_eq!(Frame::decode(version, &out[..length]).unwrap().rigid_bodies().len(), most);
        let bytes = 122 + 38 * (most + 1);
        assert_eq!(encode_frame(version, &head(), &bodies, &mut out), Err(NatNetError::TooLong { bytes }));
    }
}
