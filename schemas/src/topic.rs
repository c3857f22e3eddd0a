//! What a topic is.

use std::sync::OnceLock;

use reflect::Schema;

/// One row of the topic table.
#[derive(Debug)]
pub struct Topic {
    /// The topic's name on the bus.
    pub name: &'static str,
    /// FNV-1a-32 of the name: what kernel filters compare.
    pub hash: u32,
    /// The type of its messages.
    pub schema: &'static Schema,
    /// The one service that writes it; `*` for topics every node writes.
    pub writer: &'static str,
    /// The services that read it.
    pub readers: &'static [&'static str],
    /// Usual messages per second, of each vehicle where it speaks of vehicles.
    pub rate_hz: u32,
    /// Whether its newest message is worth having for whoever comes late: playback sends it before anything else.
    pub latched: bool,
    #[doc(hidden)]
    pub definition: OnceLock<(u64, String)>,
}

impl Topic {
    /// The schema id that datagrams of this topic carry.
    #[must_use]
    pub fn schema_id(&self) -> u64 {
        self.definition().0
    }

    /// The definition of its messages, as recordings and viewers take it (`ros1msg`).
    #[must_use]
    pub fn schema_text(&self) -> &str {
        &self.definition().1
    }

    fn definition(&self) -> &(u64, String) {
        // Composed once: the text is long, and every datagram carries the id.
        self.definition.get_or_init(|| (self.schema.id(), self.schema.text()))
    }
}

impl PartialEq for Topic {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl Eq for Topic {}

/// FNV-1a-32 of a topic's name.
#[must_use]
pub const fn topic_hash(name: &str) -> u32 {
    let bytes = name.as_bytes();
    let mut hash = 0x811c_9dc5_u32;
    let mut i = 0;
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u32).wrapping_mul(0x0100_0193);
        i += 1;
    }
    hash
}

/// Writes the topic table down once: a static per row, and all of them in order.
macro_rules! table {
    (@latched) => { false };
    (@latched latched) => { true };
    ($(#[doc = $doc:literal] $row:ident: $message:ty = $name:literal, by $writer:literal,
        for [$($reader:literal),*], at $rate:literal $(, $latched:ident)?;)*) => {
        $(#[doc = $doc]
        pub static $row: Topic = Topic {
            name: $name,
            hash: $crate::topic_hash($name),
            schema: <$message as reflect::Message>::SCHEMA,
            writer: $writer,
            readers: &[$($reader),*],
            rate_hz: $rate,
            latched: $crate::topic::table!(@latched $($latched)?),
            definition: std::sync::OnceLock::new(),
        };)*

        /// Every row, in the table's order.
        pub static ALL: &[&Topic] = &[$(&$row),*];
    };
}

pub(crate) use table;
