//! Subject names at the vendor's system, and the vehicles they stand for.

use device::vicon::NAME_BYTES;
use schemas::MocapBody;
use settings::{Arena, ConfigError};

/// Names that belong to no vehicle are remembered up to so many, so that a hostile stream cannot fill memory.
const UNKNOWN_NAMES_MAX: usize = 32;

/// One vehicle the cameras may report.
#[derive(Clone, Debug)]
pub(crate) struct Subject {
    /// Its name at the vendor's system.
    pub(crate) name: String,
    /// A body of a frame with vehicle and name filled in.
    pub(crate) body: MocapBody,
}

/// All vehicles, and the strangers met so far.
#[derive(Clone, Debug)]
pub(crate) struct Subjects {
    known: Vec<Subject>,
    unknown: Vec<Vec<u8>>,
    unknown_objects: u64,
}

/// Whose name it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Whose {
    /// The vehicle's at this index of the fleet.
    Vehicle(usize),
    /// Nobody's, and it is the first time it was seen.
    NewStranger,
    /// Nobody's.
    Stranger,
}

impl Subjects {
    /// The fleet's names.
    ///
    /// # Errors
    /// A name the stream cannot carry.
    pub(crate) fn new(arena: &Arena) -> Result<Self, ConfigError> {
        let mut known = Vec::with_capacity(arena.fleet.len());
        for member in &arena.fleet {
            let name = member.vehicle.subject.clone();
            let (false, false, Ok(subject)) =
                (name.is_empty(), name.bytes().any(|byte| byte == 0), name.as_str().try_into())
            else {
                return Err(ConfigError::Malformed {
                    file: format!("vehicles/{}.toml", member.part.file),
                    reason: format!("subject = {name:?}, but a subject's name has 1 to {NAME_BYTES} bytes"),
                });
            };
            let body = MocapBody { vehicle: member.vehicle.id, subject, ..MocapBody::default() };
            known.push(Subject { name, body });
        }
        Ok(Self { known, unknown: Vec::new(), unknown_objects: 0 })
    }

    /// The fleet, in its order.
    pub(crate) fn known(&self) -> &[Subject] {
        &self.known
    }

    /// Whose name that is; a stranger's is counted.
    pub(crate) fn whose(&mut self, name: &[u8]) -> Whose {
        if let Some(index) = self.known.iter().position(|subject| subject.name.as_bytes() == name) {
            return Whose::Vehicle(index);
        }
        self.unknown_objects += 1;
        if self.unknown.len() == UNKNOWN_NAMES_MAX || self.unknown.iter().any(|unknown| unknown == name) {
            return Whose::Stranger;
        }
        self.unknown.push(name.to_vec());
        Whose::NewStranger
    }

    /// Objects seen that belong to no vehicle.
    pub(crate) const fn unknown_objects(&self) -> u64 {
        self.unknown_objects
    }
}
