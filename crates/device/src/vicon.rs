//! The UDP object stream of Vicon's Tracker (default port 51001).
//!
//! | Offset | Type | Field |
//! | --- | --- | --- |
//! | 0 | u32 | frame number |
//! | 4 | u8 | number of items |
//! | 5 | items | u8 id (0 is an object), u16 bytes that follow (72): char\[24\] name, f64×3 mm, f64×3 rad |
//!
//! Little-endian; what follows the last item is padding. The stream carries no time stamp and no sign of
//! occlusion: an occluded object may be absent, at zero, or repeat its last pose. This module says what the
//! bytes say; what to believe of it is the bridge's business.

use core::fmt;

use quantity::{Body, Rotation, World, math};

use crate::bytes::{Reader, Writer};

/// Longest name of an object.
pub const NAME_BYTES: usize = 24;

/// Objects one datagram of 512 bytes, the readers' usual size, can carry.
pub const OBJECTS_PER_512_BYTES: usize = 6;

const ITEM_OBJECT: u8 = 0;
const ITEM_BYTES: u16 = 72;

/// One object of a datagram, in the vendor's units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Object<'a> {
    /// Name without its padding; at most [`NAME_BYTES`] bytes, commonly ASCII.
    pub name: &'a [u8],
    /// Position in the vendor's global frame, **millimetres**.
    pub translation_mm: [f64; 3],
    /// Rotations about x, the new y and the newest z.
    pub rotation_rad: [f64; 3],
}

impl Object<'_> {
    /// Whether all six numbers are finite. The stream guarantees nothing of the kind.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.translation_mm.iter().chain(&self.rotation_rad).all(|number| number.is_finite())
    }
}

/// Why bytes are not a datagram of the stream, or objects do not make one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ViconError {
    /// The datagram ends inside its header or inside an item it announces.
    Truncated {
        /// Bytes given.
        bytes: usize,
    },
    /// An object's item is shorter than an object.
    ShortObject {
        /// Bytes it says it has.
        bytes: u16,
    },
    /// An object's name is longer than its field.
    LongName,
    /// More objects than the count's one byte can tell.
    TooManyObjects,
    /// The buffer to write to is too short.
    NoRoom,
}

impl fmt::Display for ViconError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Truncated { bytes } => write!(f, "object stream datagram cut short at {bytes} bytes"),
            Self::ShortObject { bytes } => write!(f, "object of {bytes} bytes, should be {ITEM_BYTES}"),
            Self::LongName => write!(f, "object name over {NAME_BYTES} bytes"),
            Self::TooManyObjects => write!(f, "more than 255 objects in a datagram"),
            Self::NoRoom => write!(f, "buffer too short for the datagram"),
        }
    }
}

impl core::error::Error for ViconError {}

/// A datagram whose every item lies within its bytes.
#[derive(Clone, Copy, Debug)]
pub struct Datagram<'a> {
    /// The frame, as Tracker counts; a frame of many objects may come in several datagrams.
    pub frame_number: u32,
    items: u8,
    body: &'a [u8],
}

impl<'a> Datagram<'a> {
    /// Looks through the whole datagram once.
    ///
    /// # Errors
    /// [`ViconError::Truncated`] or [`ViconError::ShortObject`].
    pub fn decode(bytes: &'a [u8]) -> Result<Self, ViconError> {
        let truncated = ViconError::Truncated { bytes: bytes.len() };
        let mut reader = Reader::new(bytes);
        let frame_number = reader.u32().ok_or(truncated)?;
        let items = reader.u8().ok_or(truncated)?;
        let body = reader.rest();
        for _ in 0..items {
            let (id, item) = next_item(&mut reader).ok_or(truncated)?;
            if id == ITEM_OBJECT && item.len() < usize::from(ITEM_BYTES) {
                return Err(ViconError::ShortObject { bytes: item.len() as u16 });
            }
        }
        Ok(Self { frame_number, items, body })
    }

    /// The objects in the order they were sent; items that are no objects are left out.
    pub fn objects(&self) -> impl Iterator<Item = Object<'a>> + use<'a> {
        let mut reader = Reader::new(self.body);
        let items = (0..self.items).map_while(move |_| next_item(&mut reader));
        items.filter(|(id, _)| *id == ITEM_OBJECT).filter_map(|(_, item)| read_object(item))
    }
}

fn next_item<'a>(reader: &mut Reader<'a>) -> Option<(u8, &'a [u8])> {
    let (id, length) = (reader.u8()?, reader.u16()?);
    Some((id, reader.take(usize::from(length))?))
}

fn read_object(item: &[u8]) -> Option<Object<'_>> {
    let mut reader = Reader::new(item);
    let field = reader.take(NAME_BYTES)?;
    let name = field.split(|byte| *byte == 0).next().unwrap_or(field);
    let translation_mm = [reader.f64()?, reader.f64()?, reader.f64()?];
    let rotation_rad = [reader.f64()?, reader.f64()?, reader.f64()?];
    Some(Object { name, translation_mm, rotation_rad })
}

/// Writes one datagram and answers its length; pad it to a fixed block by sending more of `out`, zeroed
/// before.
///
/// # Errors
/// [`ViconError::LongName`], [`ViconError::TooManyObjects`] or [`ViconError::NoRoom`].
pub fn encode(frame_number: u32, objects: &[Object<'_>], out: &mut [u8]) -> Result<usize, ViconError> {
    let count = u8::try_from(objects.len()).map_err(|_| ViconError::TooManyObjects)?;
    let mut writer = Writer::new(out);
    writer.u32(frame_number).u8(count);
    for object in objects {
        let mut name = [0; NAME_BYTES];
        name.get_mut(..object.name.len()).ok_or(ViconError::LongName)?.copy_from_slice(object.name);
        writer.u8(ITEM_OBJECT).u16(ITEM_BYTES).bytes(&name);
        for number in object.translation_mm.iter().chain(&object.rotation_rad) {
            writer.f64(*number);
        }
    }
    writer.finish().ok_or(ViconError::NoRoom)
}

/// The attitude that the stream's three rotations stand for: about x, then the new y, then the newest z (R =
/// Rx·Ry·Rz). `None` where one of them is not finite.
#[must_use]
pub fn euler_to_rotation(rotation_rad: [f64; 3]) -> Option<Rotation<Body, World>> {
    let [(sx, cx), (sy, cy), (sz, cz)] = rotation_rad.map(|angle| math::sin_cos(0.5 * angle));
    let w = cx * cy * cz - sx * sy * sz;
    let x = sx * cy * cz + cx * sy * sz;
    let y = cx * sy * cz - sx * cy * sz;
    let z = cx * cy * sz + sx * sy * cz;
    Rotation::from_components(w, x, y, z)
}

/// The stream's three rotations of an attitude: x and z in (-π, π], y in [-π/2, π/2].
///
/// The inverse of [`euler_to_rotation`] also where the x and z axes coincide (y = ±π/2, which a flip passes
/// through): there z is measured against whatever x came out, so that together they stay right.
#[must_use]
pub fn rotation_to_euler(attitude: Rotation<Body, World>) -> [f64; 3] {
    let Rotation { x, y, z, w, .. } = attitude;
    // Rows and columns of the matrix of the attitude, as far as needed.
    let r00 = 1.0 - 2.0 * (y * y + z * z);
    let r01 = 2.0 * (x * y - z * w);
    let r02 = 2.0 * (x * z + y * w);
    let (r10, r11, r12) = (2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w));
    let (r20, r21, r22) = (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y));
    let about_x = math::atan2(-r12, r22);
    let about_y = math::atan2(r02, math::sqrt(r00 * r00 + r01 * r01));
    let (sx, cx) = math::sin_cos(about_x);
    let about_z = math::atan2(cx * r10 + sx * r20, cx * r11 + sx * r21);
    [about_x, about_y, about_z]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bytes::from_hex;
    use core::f64::consts::FRAC_PI_2;
    use proptest::prelude::*;
    use quantity::Vector;
    use std::vec::Vec;

    const GOLDEN: &str = "92100000 01 00 4800 7175616431 00000000000000000000000000000000000000
        0000000000005940 00000000001069c0 0000000000719740
        9a9999999999b93f 9a9999999999c9bf 333333333333d33f";

    const QUAD: Object<'_> =
        Object { name: b"quad1", translation_mm: [100.0, -200.5, 1500.25], rotation_rad: [0.1, -0.2, 0.3] };

    fn encoded(frame_number: u32, objects: &[Object<'_>]) -> Vec<u8> {
        let mut out = [0; 1024];
        let length = encode(frame_number, objects, &mut out).unwrap();
        out[..length].to_vec()
    }

    #[test]
    fn golden_datagram_both_ways() {
        let bytes = from_hex(GOLDEN);
        assert_eq!(bytes.len(), 80);
        assert_eq!(encoded(4242, &[QUAD]), bytes);
        let datagram = Datagram::decode(&bytes).unwrap();
        assert_eq!(datagram.frame_number, 4242);
        assert_eq!(datagram.objects().collect::<Vec<_>>(), [QUAD]);
    }

    #[test]
    fn so_many_objects_fit_a_block_and_no_more() {
        for (block, objects) in [(256, 3), (512, OBJECTS_PER_512_BYTES), (1024, 13)] {
            assert!(encoded(1, &[QUAD; 14][..objects]).len() <= block);
            assert!(5 + 75 * (objects + 1) > block);
        }
        assert_eq!(encoded(1, &[QUAD; 2]).len(), 5 + 75 * 2);
    }

    #[test]
    fn unknown_items_and_longer_objects_and_padding_are_stepped_over() {
        let mut bytes = encoded(7, &[QUAD, Object { name: b"second", ..QUAD }]);
        bytes[4] = 4;
        // An unknown item of three bytes in front, and an object with two bytes to spare behind.
        bytes.splice(5..5, [9, 3, 0, 1, 2, 3]);
        let mut longer = bytes[11..86].to_vec();
        longer[1] = 74;
        longer.extend([0xAA, 0xBB]);
        bytes.extend(longer);
        bytes.resize(512, 0);
        let names: Vec<Vec<u8>> =
            Datagram::decode(&bytes).unwrap().objects().map(|object| object.name.to_vec()).collect();
        assert_eq!(names, [b"quad1".to_vec(), b"second".to_vec(), b"quad1".to_vec()]);
    }

    #[test]
    fn every_cut_is_an_error() {
        let bytes = from_hex(GOLDEN);
        for length in 0..bytes.len() {
            let error = Datagram::decode(&bytes[..length]).unwrap_err();
            assert_eq!(error, ViconError::Truncated { bytes: length });
        }
        let mut short = bytes;
        short[6] = 71;
        assert_eq!(Datagram::decode(&short).unwrap_err(), ViconError::ShortObject { bytes: 71 });
    }

    #[test]
    fn what_cannot_be_sent_is_an_error() {
        assert_eq!(encode(1, &[QUAD], &mut [0; 79]), Err(ViconError::NoRoom));
        assert_eq!(
            encode(1, &[Object { name: &[b'x'; 25], ..QUAD }], &mut [0; 99]),
            Err(ViconError::LongName)
        );
        assert_eq!(encode(1, &[QUAD; 256], &mut [0; 99]), Err(ViconError::TooManyObjects));
        let full = Object { name: b"abcdefghijklmnopqrstuvwx", ..QUAD };
        assert_eq!(Datagram::decode(&encoded(1, &[full])).unwrap().objects().next(), Some(full));
    }

    #[test]
    fn rotations_are_about_x_then_the_new_y_then_the_newest_z() {
        let [x, y, z] = QUAD.rotation_rad;
        let about = |x, y, z| Rotation::<Body, Body>::from_rotation_vector(Vector::new(x, y, z));
        let step_by_step = Rotation::<Body, World>::from_rotation_vector(Vector::new(x, 0.0, 0.0))
            * about(0.0, y, 0.0)
            * about(0.0, 0.0, z);
        let at_once = euler_to_rotation(QUAD.rotation_rad).unwrap();
        assert!(at_once.angle_to(step_by_step) < 1e-12);
        assert_eq!(euler_to_rotation([f64::NAN, 0.0, 0.0]), None);
        assert_eq!(euler_to_rotation([0.0, f64::INFINITY, 0.0]), None);
    }

    fn angle() -> impl Strategy<Value = f64> {
        prop_oneof![
            4 => -7.0..7.0f64,
            1 => prop::sample::select(std::vec![0.0, FRAC_PI_2, -FRAC_PI_2, FRAC_PI_2 + 1e-9]),
        ]
    }

    proptest! {
        #[test]
        fn attitudes_survive_the_three_rotations(x in angle(), y in angle(), z in angle()) {
            let attitude = euler_to_rotation([x, y, z]).unwrap();
            let euler = rotation_to_euler(attitude);
            prop_assert!(euler[1].abs() <= FRAC_PI_2);
            prop_assert!(attitude.angle_to(euler_to_rotation(euler).unwrap()) < 1e-7);
        }

        #[test]
        fn rotations_in_their_ranges_come_back(x in -3.1..3.1f64, y in -1.5..1.5f64, z in -3.1..3.1f64) {
            let back = rotation_to_euler(euler_to_rotation([x, y, z]).unwrap());
            for (a, b) in back.iter().zip([x, y, z]) {
                prop_assert!((a - b).abs() < 1e-12, "{back:?}");
            }
        }

        #[test]
        fn datagrams_round_trip(
            frame_number: u32,
            objects in prop::collection::vec(("[a-z]{0,24}", any::<[f64; 3]>(), any::<[f64; 3]>()), 0..10),
        ) {
            let objects: Vec<Object<'_>> = objects
                .iter()
                .map(|(name, translation_mm, rotation_rad)| Object {
                    name: name.as_bytes(),
                    translation_mm: *translation_mm,
                    rotation_rad: *rotation_rad,
                })
                .collect();
            let bytes = encoded(frame_number, &objects);
            let datagram = Datagram::decode(&bytes).unwrap();
            prop_assert_eq!(datagram.frame_number, frame_number);
            prop_assert_eq!(datagram.objects().collect::<Vec<_>>(), objects);
        }

        #[test]
        fn any_bytes_decode_or_are_refused(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
            if let Ok(datagram) = Datagram::decode(&bytes) {
                prop_assert!(datagram.objects().count() <= 255);
            }
        }

        #[test]
        fn damaged_datagrams_decode_or_are_refused(at in 0usize..80, byte: u8) {
            let mut bytes = from_hex(GOLDEN);
            bytes[at] = byte;
            if let Ok(datagram) = Datagram::decode(&bytes) {
                prop_assert!(datagram.objects().count() <= 255);
            }
        }
    }
}
