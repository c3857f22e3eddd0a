//! The model definition: which rigid bodies there are, and what they are called.
//!
//! A count, then for each description an i32 kind, from 4.1 on an i32 of bytes, and the description. Of the
//! seven kinds only rigid bodies are kept; the others are stepped over, before 4.1 by walking them.

use super::{Fields, MESSAGE_MODEL_DEFINITION, NatNetError, Version, seal};
use crate::bytes::Reader;

const KIND_MARKER_SET: i32 = 0;
const KIND_RIGID_BODY: i32 = 1;
const KIND_SKELETON: i32 = 2;
const KIND_FORCE_PLATE: i32 = 3;
const KIND_DEVICE: i32 = 4;
const KIND_CAMERA: i32 = 5;
const KIND_ASSET: i32 = 6;

/// Of a force plate: width, length, origin, a matrix of 12 × 12, four corners, and two numbers of a kind.
const FORCE_PLATE_BYTES: usize = 4 * (1 + 1 + 3 + 144 + 12 + 1 + 1);
/// Of a camera: position and attitude.
const CAMERA_BYTES: usize = 4 * (3 + 4);
/// Of an asset's marker: id, position, size, parameters.
const ASSET_MARKER_BYTES: usize = 4 + 12 + 4 + 2;
/// Of a rigid body: parent, and offset from it.
const PIVOT_BYTES: usize = 4 + 12;
/// Of a rigid body's marker, without its name: position and label.
const MARKER_BYTES: usize = 12 + 4;
const NO_PARENT: i32 = -1;

/// A rigid body's name and the id its poses come under.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RigidBodyName<'a> {
    /// Streaming id.
    pub id: i32,
    /// Name, commonly ASCII.
    pub name: &'a [u8],
}

/// What is tracked. The descriptions stay in the datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ModelDefinition<'a> {
    version: Version,
    count: usize,
    descriptions: &'a [u8],
}

impl<'a> ModelDefinition<'a> {
    /// The model definition in a datagram, laid out as in `version`; all of it has been walked when this
    /// answers.
    ///
    /// # Errors
    /// [`NatNetError`] for another message, a length or a count that does not come out, or, before 4.1, a
    /// description of unknown kind.
    pub fn decode(version: Version, bytes: &'a [u8]) -> Result<Self, NatNetError> {
        let mut fields = Fields::open(bytes, MESSAGE_MODEL_DEFINITION)?;
        let count = fields.count("descriptions")?;
        let descriptions = fields.reader.rest();
        // Every description takes bytes, so a count beyond the datagram's end fails soon.
        for _ in 0..count {
            next_description(&mut fields, version)?;
        }
        fields.finish()?;
        Ok(Self { version, count, descriptions })
    }

    /// The rigid bodies in the order they were sent; those that are parts of skeletons and assets are left
    /// out, since the ids of these are only their own.
    pub fn rigid_bodies(&self) -> impl Iterator<Item = RigidBodyName<'a>> + use<'a> {
        let version = self.version;
        let bytes = self.descriptions.len();
        let mut fields = Fields { reader: Reader::new(self.descriptions), bytes };
        // All have been walked once, so none fails.
        (0..self.count).map_while(move |_| next_description(&mut fields, version).ok()).flatten()
    }
}

/// Steps over one description; answers with it where it is a rigid body's.
fn next_description<'a>(
    fields: &mut Fields<'a>,
    version: Version,
) -> Result<Option<RigidBodyName<'a>>, NatNetError> {
    let kind = fields.get("descriptions", Reader::i32)?;
    if !version.has_sizes() {
        return walk(fields, version, kind);
    }
    let bytes = fields.count("descriptions")?;
    let body = fields.block("descriptions", bytes, 1)?;
    let mut fields = Fields { reader: Reader::new(body), bytes: fields.bytes };
    match kind {
        // What later versions may add to it stands behind what is read.
        KIND_RIGID_BODY => read_rigid_body(&mut fields).map(Some),
        _ => Ok(None),
    }
}

fn walk<'a>(
    fields: &mut Fields<'a>,
    version: Version,
    kind: i32,
) -> Result<Option<RigidBodyName<'a>>, NatNetError> {
    match kind {
        KIND_RIGID_BODY => return walk_rigid_body(fields, version).map(Some),
        KIND_MARKER_SET => {
            fields.get("marker sets", Reader::text)?;
            walk_names(fields, "marker sets")?;
        }
        KIND_SKELETON => {
            fields.get("skeletons", Reader::text)?;
            fields.get("skeletons", Reader::i32)?;
            walk_rigid_bodies(fields, version)?;
        }
        KIND_FORCE_PLATE => {
            fields.get("force plates", Reader::i32)?;
            fields.get("force plates", Reader::text)?;
            fields.block("force plates", 1, FORCE_PLATE_BYTES)?;
            walk_names(fields, "force plates")?;
        }
        KIND_DEVICE => {
            fields.get("devices", Reader::i32)?;
            fields.get("devices", Reader::text)?;
            fields.get("devices", Reader::text)?;
            fields.block("devices", 2, size_of::<i32>())?;
            walk_names(fields, "devices")?;
        }
        KIND_CAMERA => {
            fields.get("cameras", Reader::text)?;
            fields.block("cameras", 1, CAMERA_BYTES)?;
        }
        KIND_ASSET => {
            fields.get("assets", Reader::text)?;
            fields.block("assets", 2, size_of::<i32>())?;
            walk_rigid_bodies(fields, version)?;
            for _ in 0..fields.count("assets")? {
                fields.get("assets", Reader::text)?;
                fields.block("assets", 1, ASSET_MARKER_BYTES)?;
            }
        }
        kind => return Err(NatNetError::Description { kind }),
    }
    Ok(None)
}

fn read_rigid_body<'a>(fields: &mut Fields<'a>) -> Result<RigidBodyName<'a>, NatNetError> {
    let name = fields.get("rigid bodies", Reader::text)?;
    let id = fields.get("rigid bodies", Reader::i32)?;
    Ok(RigidBodyName { id, name })
}

fn walk_rigid_body<'a>(fields: &mut Fields<'a>, version: Version) -> Result<RigidBodyName<'a>, NatNetError> {
    let body = read_rigid_body(fields)?;
    fields.block("rigid bodies", 1, PIVOT_BYTES)?;
    let markers = fields.count("rigid bodies")?;
    fields.block("rigid bodies", markers, MARKER_BYTES)?;
    if version.has_marker_names() {
        for _ in 0..markers {
            fields.get("rigid bodies", Reader::text)?;
        }
    }
    Ok(body)
}

fn walk_rigid_bodies(fields: &mut Fields<'_>, version: Version) -> Result<(), NatNetError> {
    let count = fields.count("rigid bodies")?;
    (0..count).try_for_each(|_| walk_rigid_body(fields, version).map(|_| ()))
}

fn walk_names(fields: &mut Fields<'_>, part: &'static str) -> Result<(), NatNetError> {
    let count = fields.count(part)?;
    (0..count).try_for_each(|_| fields.get(part, Reader::text).map(|_| ()))
}

/// Writes a model definition of rigid bodies without parent, offset and markers, and answers its length.
///
/// # Errors
/// [`NatNetError::Name`] for a name with a NUL in it, [`NatNetError::TooLong`] for more than a datagram can
/// have, [`NatNetError::NoRoom`].
pub fn encode_model_definition(
    version: Version,
    bodies: &[RigidBodyName<'_>],
    out: &mut [u8],
) -> Result<usize, NatNetError> {
    let (mut length, kind_bytes) = (size_of::<i32>(), if version.has_sizes() { 8 } else { 4 });
    for body in bodies {
        if body.name.contains(&0) {
            return Err(NatNetError::Name { bytes: body.name.len() });
        }
        length += kind_bytes + description_bytes(body);
    }
    seal(out, MESSAGE_MODEL_DEFINITION, length, |writer| {
        // That counts and sizes fit is what the length was checked for.
        writer.i32(bodies.len() as i32);
        for body in bodies {
            writer.i32(KIND_RIGID_BODY);
            if version.has_sizes() {
                writer.i32(description_bytes(body) as i32);
            }
            writer.bytes(body.name).u8(0).i32(body.id).i32(NO_PARENT).f32s(&[0.0; 3]).i32(0);
        }
    })
}

const fn description_bytes(body: &RigidBodyName<'_>) -> usize {
    body.name.len() + 1 + size_of::<i32>() + PIVOT_BYTES + size_of::<i32>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bytes::from_hex;
    use std::vec::Vec;

    const BODIES: [RigidBodyName<'_>; 2] =
        [RigidBodyName { id: 7, name: b"quad1" }, RigidBodyName { id: -2, name: b"" }];

    const GOLDEN_4_1: &str = "0500 4b00 02000000
        01000000 1e000000 717561643100 07000000 ffffffff 000000000000000000000000 00000000
        01000000 19000000 00 feffffff ffffffff 000000000000000000000000 00000000";

    const GOLDEN_3_1: &str = "0500 4300 02000000
        01000000 717561643100 07000000 ffffffff 000000000000000000000000 00000000
        01000000 00 feffffff ffffffff 000000000000000000000000 00000000";

    fn encoded(version: Version) -> Vec<u8> {
        let mut out = [0xEE; 100];
        let length = encode_model_definition(version, &BODIES, &mut out).unwrap();
        out[..length].to_vec()
    }

    fn names<'a>(version: Version, bytes: &'a [u8]) -> Result<Vec<RigidBodyName<'a>>, NatNetError> {
        ModelDefinition::decode(version, bytes).map(|model| model.rigid_bodies().collect())
    }

    #[test]
    fn bodies_both_ways_by_the_layout_table() {
        for version in Version::ALL {
            let golden = from_hex(if version.has_sizes() { GOLDEN_4_1 } else { GOLDEN_3_1 });
            assert_eq!(encoded(version), golden, "{version}");
            assert_eq!(names(version, &golden).unwrap(), BODIES);
        }
    }

    #[test]
    fn every_cut_and_every_excess_is_an_error() {
        for version in Version::ALL {
            let mut bytes = encoded(version);
            for length in 0..bytes.len() {
                let error = names(version, &bytes[..length]).unwrap_err();
                assert!(matches!(error, NatNetError::Truncated { .. }), "{length}: {error}");
            }
            bytes.push(0);
            assert_eq!(names(version, &bytes), Err(NatNetError::Trailing { bytes: 1 }));
        }
    }

    #[test]
    fn unknown_kinds_are_stepped_over_where_they_can_be() {
        let mut bytes = from_hex(GOLDEN_4_1);
        bytes[8] = 77;
        assert_eq!(names(Version::V4_1, &bytes).unwrap(), BODIES[1..]);
        let mut bytes = from_hex(GOLDEN_3_1);
        bytes[8] = 77;
        assert_eq!(names(Version::V3_1, &bytes), Err(NatNetError::Description { kind: 77 }));
    }

    #[test]
    fn hostile_counts_are_errors_at_once() {
        for version in Version::ALL {
            for count in [i32::MAX, i32::MAX / 16 + 1, -1, i32::MIN] {
                let mut bytes = encoded(version);
                bytes[4..8].copy_from_slice(&count.to_le_bytes());
                assert!(names(version, &bytes).is_err());
                let mut bytes = encoded(Version::V4_0);
                let last = bytes.len() - 4;
                bytes[last..].copy_from_slice(&count.to_le_bytes());
                assert!(names(Version::V4_0, &bytes).is_err());
            }
        }
    }

    #[test]
    fn what_does_not_fit_is_an_error() {
        let version = Version::V4_1;
        let nul = [RigidBodyName { id: 1, name: b"a\0" }];
        assert_eq!(encode_model_definition(version, &nul, &mut [0; 99]), Err(NatNetError::Name { bytes: 2 }));
        assert_eq!(encode_model_definition(version, &BODIES, &mut [0; 78]), Err(NatNetError::NoRoom));
        let long = std::vec![b'x'; 70_000];
        let long = [RigidBodyName { id: 1, name: &long }];
        let error = encode_model_definition(version, &long, &mut std::vec![0; 80_000]);
        assert_eq!(error, Err(NatNetError::TooLong { bytes: 4 + 8 + 25 + 70_000 }));
    }
}
