//! Who may say what: keys by role, and the tag that proves a sender holds one.

use std::collections::BTreeMap;
use std::fmt;

use thiserror::Error;

use crate::{Domain, Kind};

/// Bytes of the tag at a datagram's end: the first 128 bits of keyed BLAKE3 over everything before it.
pub const TAG_BYTES: usize = 16;

/// Separates these keys from any other use of the same secret. Never changes while the format's version
/// stands.
const DERIVATION_CONTEXT: &str = "flyarena datagram authentication v1";

/// The arena's secret, from which all keys are derived. It is never printed, and goes from file to keys only.
#[derive(Clone)]
pub struct Secret([u8; 32]);

/// A secret file of the wrong length; its content is not repeated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("a secret file holds 32 bytes, this one {length}")]
pub struct SecretError {
    /// Bytes in the file.
    pub length: usize,
}

impl Secret {
    /// A secret from its bytes, which must be random.
    #[must_use]
    pub const fn new(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// A secret from the bytes of its file.
    ///
    /// # Errors
    /// Anything but 32 bytes: a file cut short, or one edited as text.
    pub fn from_file_bytes(bytes: &[u8]) -> Result<Self, SecretError> {
        bytes.try_into().map(Self).map_err(|_| SecretError { length: bytes.len() })
    }
}

impl fmt::Debug for Secret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Secret(..)")
    }
}

/// In which capacity a node speaks: the writer of a topic, as the topic table names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Role(pub &'static str);

impl Role {
    /// What every node may say: events, health, schemas and journals.
    pub const NODE: Self = Self("node");

    /// The role that signs datagrams of this kind on a topic with this writer in the topic table, where `*`
    /// stands for every node.
    #[must_use]
    pub fn of(kind: Kind, writer: &'static str) -> Self {
        match kind {
            Kind::Data if writer != "*" => Self(writer),
            Kind::Data | Kind::Schema | Kind::SchemaRequest | Kind::Journal => Self::NODE,
        }
    }
}

/// One role's key in one domain and run.
#[derive(Clone)]
struct Key {
    bytes: [u8; 32],
    domain: Domain,
    run: u64,
}

impl Key {
    fn derive(secret: &Secret, domain: Domain, run: u64, role: Role) -> Self {
        let mut hasher = blake3::Hasher::new_derive_key(DERIVATION_CONTEXT);
        // Fixed lengths first and the only variable one last, so that no two inputs read alike.
        hasher.update(&secret.0).update(&[domain as u8]).update(&run.to_le_bytes()).update(role.0.as_bytes());
        Self { bytes: *hasher.finalize().as_bytes(), domain, run }
    }

    fn describe(&self, name: &str, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{name}({}, run {:016x}, ..)", self.domain.name(), self.run)
    }
}

/// A key to seal with. A [`Keyring`] holds it for a node's own role and for [`Role::NODE`] only.
#[derive(Clone)]
pub struct SigningKey(Key);

/// A key to verify with. The bytes are those of the signing key; the type has no way to seal with them.
#[derive(Clone)]
pub struct VerifyKey(Key);

impl SigningKey {
    /// The key of a role in a domain and run.
    #[must_use]
    pub fn derive(secret: &Secret, domain: Domain, run: u64, role: Role) -> Self {
        Self(Key::derive(secret, domain, run, role))
    }

    /// The domain it signs for.
    #[must_use]
    pub const fn domain(&self) -> Domain {
        self.0.domain
    }

    /// The run it signs for.
    #[must_use]
    pub const fn run(&self) -> u64 {
        self.0.run
    }

    pub(crate) fn tag(&self, bytes: &[u8]) -> [u8; TAG_BYTES] {
        let mut tag = [0; TAG_BYTES];
        tag.copy_from_slice(&blake3::keyed_hash(&self.0.bytes, bytes).as_bytes()[..TAG_BYTES]);
        tag
    }
}

impl VerifyKey {
    /// The key of a role in a domain and run.
    #[must_use]
    pub fn derive(secret: &Secret, domain: Domain, run: u64, role: Role) -> Self {
        Self(Key::derive(secret, domain, run, role))
    }

    /// The domain it verifies.
    #[must_use]
    pub const fn domain(&self) -> Domain {
        self.0.domain
    }

    /// The run it verifies.
    #[must_use]
    pub const fn run(&self) -> u64 {
        self.0.run
    }

    /// Whether `tag` is that of `bytes`, in a time that does not tell where the two differ.
    pub(crate) fn holds(&self, bytes: &[u8], tag: &[u8; TAG_BYTES]) -> bool {
        let expected = blake3::keyed_hash(&self.0.bytes, bytes);
        // `blake3::Hash` compares in constant time: give it the tag, continued as it must be.
        let mut found = *expected.as_bytes();
        found[..TAG_BYTES].copy_from_slice(tag);
        blake3::Hash::from_bytes(found) == expected
    }
}

impl fmt::Debug for SigningKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.describe("SigningKey", f)
    }
}

impl fmt::Debug for VerifyKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.describe("VerifyKey", f)
    }
}

/// The keys of one node: to sign in its own role, to verify the roles it listens to, and no others. A
/// console, a logger or a learner that holds only this cannot forge a command.
#[derive(Clone, Debug)]
pub struct Keyring {
    own: SigningKey,
    node: SigningKey,
    reads: BTreeMap<Role, VerifyKey>,
}

impl Keyring {
    /// The keys of a node that writes as `own` and reads what `reads` write; [`Role::NODE`] is always among
    /// these.
    #[must_use]
    pub fn new(
        secret: &Secret,
        domain: Domain,
        run: u64,
        own: Role,
        reads: impl IntoIterator<Item = Role>,
    ) -> Self {
        let signing = |role| SigningKey::derive(secret, domain, run, role);
        let verifying = |role| (role, VerifyKey::derive(secret, domain, run, role));
        Self {
            own: signing(own),
            node: signing(Role::NODE),
            reads: reads.into_iter().chain([Role::NODE]).map(verifying).collect(),
        }
    }

    /// The key for the topics that this node alone writes.
    #[must_use]
    pub const fn own(&self) -> &SigningKey {
        &self.own
    }

    /// The key for what every node writes: events, health, schemas, journals.
    #[must_use]
    pub const fn node(&self) -> &SigningKey {
        &self.node
    }

    /// The key to verify a role with; `None` for one that this node does not listen to.
    #[must_use]
    pub fn verify_key(&self, role: Role) -> Option<&VerifyKey> {
        self.reads.get(&role)
    }
}
