//! What a recording says of what it does not hold.

use std::collections::BTreeMap;

use quantity::Time;
use wire::{Kind, SequenceCounts};

use crate::format::Fields;
use crate::{FormatError, LOSSES_RECORD};

/// Name of the metadata record that stands where messages were dropped.
pub const GAP_RECORD: &str = "flyarena.gap";

/// What one sender's sequence numbers on one topic told, since the recorder's start.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Loss {
    /// The topic.
    pub topic: String,
    /// What the datagrams were.
    pub kind: Kind,
    /// The sender.
    pub source: u32,
    /// What its sequence numbers told.
    pub counts: SequenceCounts,
}

/// Messages that the recorder had to drop: they came, and it had no room.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Gap {
    /// When the first of them came.
    pub from: Time,
    /// When the last of them came.
    pub until: Time,
    /// How many there were on each topic.
    pub dropped: BTreeMap<String, u64>,
}

impl Gap {
    /// The metadata record's content: `from_ns`, `until_ns`, and for each topic `dropped TOPIC`.
    #[must_use]
    pub fn metadata(&self) -> BTreeMap<String, String> {
        let mut metadata: BTreeMap<String, String> = self
            .dropped
            .iter()
            .map(|(topic, dropped)| (format!("dropped {topic}"), dropped.to_string()))
            .collect();
        metadata.insert("from_ns".to_owned(), self.from.as_nanos().to_string());
        metadata.insert("until_ns".to_owned(), self.until.as_nanos().to_string());
        metadata
    }

    /// Reads the metadata record's content.
    ///
    /// # Errors
    /// A key that is not there, or a value that cannot be.
    pub fn from_metadata(metadata: &BTreeMap<String, String>) -> Result<Self, FormatError> {
        let fields = Fields { of: GAP_RECORD, metadata };
        let from = Time::from_nanos(fields.number("from_ns")?);
        let until = Time::from_nanos(fields.number("until_ns")?);
        let dropped = metadata
            .iter()
            .filter_map(|(key, value)| Some((key.strip_prefix("dropped ")?, value)))
            .map(|(topic, value)| Ok((topic.to_owned(), count(GAP_RECORD, topic, value)?)))
            .collect::<Result<_, FormatError>>()?;
        Ok(Self { from, until, dropped })
    }
}

/// The metadata record with the losses: from topic, kind and source to the counts accepted, lost, reordered,
/// duplicate and stale.
#[must_use]
pub fn losses_metadata(losses: &[Loss]) -> BTreeMap<String, String> {
    losses
        .iter()
        .map(|loss| {
            let SequenceCounts { accepted, lost, reordered, duplicates, stale } = loss.counts;
            let key = format!("{} {} {:08x}", loss.topic, name_of(loss.kind), loss.source);
            (key, format!("{accepted} {lost} {reordered} {duplicates} {stale}"))
        })
        .collect()
}

/// Reads the metadata record's content.
///
/// # Errors
/// A key or value that cannot be.
pub fn losses_from_metadata(metadata: &BTreeMap<String, String>) -> Result<Vec<Loss>, FormatError> {
    metadata.iter().map(|(key, value)| loss(key, value)).collect()
}

fn loss(key: &str, value: &str) -> Result<Loss, FormatError> {
    let refused = |key: &'static str, value: &str, reason| FormatError::Value {
        of: LOSSES_RECORD.to_owned(),
        key,
        value: value.to_owned(),
        reason,
    };
    // A topic may hold blanks; what follows it does not.
    let mut words = key.rsplitn(3, ' ');
    let (source, kind, topic) = (words.next(), words.next(), words.next());
    let (Some(source), Some(kind), Some(topic)) = (source, kind, topic) else {
        return Err(refused("key", key, "not a topic, a kind and a source"));
    };
    let source =
        u32::from_str_radix(source, 16).map_err(|_| refused("source", source, "no hexadecimal number"))?;
    let kind = [Kind::Data, Kind::Schema, Kind::SchemaRequest, Kind::Journal]
        .into_iter()
        .find(|known| name_of(*known) == kind)
        .ok_or_else(|| refused("kind", kind, "none of the known words"))?;
    let numbers: Vec<u64> =
        value.split(' ').map(|number| count(LOSSES_RECORD, topic, number)).collect::<Result<_, _>>()?;
    let [accepted, lost, reordered, duplicates, stale] = numbers[..] else {
        return Err(refused("counts", value, "not five numbers"));
    };
    let counts = SequenceCounts { accepted, lost, reordered, duplicates, stale };
    Ok(Loss { topic: topic.to_owned(), kind, source, counts })
}

fn count(of: &str, topic: &str, value: &str) -> Result<u64, FormatError> {
    value.parse().map_err(|_| FormatError::Value {
        of: format!("{of}, {topic}"),
        key: "count",
        value: value.to_owned(),
        reason: "no number, or too great",
    })
}

fn name_of(kind: Kind) -> &'static str {
    match kind {
        Kind::Data => "data",
        Kind::Schema => "schema",
        Kind::SchemaRequest => "schema-request",
        Kind::Journal => "journal",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn losses_survive_their_metadata() {
        let counts = SequenceCounts { accepted: 1, lost: 2, reordered: 3, duplicates: 4, stale: u64::MAX };
        let losses: Vec<Loss> = [Kind::Data, Kind::Journal, Kind::Schema, Kind::SchemaRequest]
            .map(|kind| Loss { topic: "a topic/with blanks".to_owned(), kind, source: 0xdead_beef, counts })
            .to_vec();
        let read = losses_from_metadata(&losses_metadata(&losses)).unwrap();
        assert_eq!(read.len(), losses.len());
        assert!(losses.iter().all(|loss| read.contains(loss)), "{read:?}");
    }

    #[test]
    fn a_gap_survives_its_metadata() {
        let dropped = BTreeMap::from([("a/b".to_owned(), 3), ("until_ns".to_owned(), 4)]);
        let gap = Gap { from: Time::from_nanos(5), until: Time::from_nanos(7), dropped };
        assert_eq!(Gap::from_metadata(&gap.metadata()), Ok(gap));
    }

    #[test]
    fn what_is_no_loss_is_named() {
        for (key, value, named) in [
            ("a/b data", "1 2 3 4 5", "a/b data"),
            ("a/b word 00000001", "1 2 3 4 5", "word"),
            ("a/b data xyz", "1 2 3 4 5", "xyz"),
            ("a/b data 00000001", "1 2 3 4", "1 2 3 4"),
            ("a/b data 00000001", "1 2 3 4 nine", "nine"),
        ] {
            let metadata = BTreeMap::from([(key.to_owned(), value.to_owned())]);
            let error = losses_from_metadata(&metadata).unwrap_err().to_string();
            assert!(error.contains(named), "{error}");
        }
    }
}
