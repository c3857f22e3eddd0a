//! What is in a recording, topic by topic.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use quantity::Time;
use recording::{Channel, Condition, Gaps, Recording};
use serde_json::{Value, json};
use wire::Kind;

/// What is in a recording.
#[derive(Debug, Default)]
pub struct Contents {
    /// Of each topic, journals apart.
    pub topics: Vec<TopicContents>,
    /// What is wrong with it.
    pub damage: Vec<String>,
}

/// What is in a recording of one topic.
#[derive(Debug, Default)]
pub struct TopicContents {
    /// The topic.
    pub topic: String,
    /// Whether these are journals and not messages of the topic.
    pub journal: bool,
    /// The types of its messages; empty if no definition is known.
    pub types: BTreeSet<String>,
    /// Who sent them, and in how many incarnations.
    pub senders: BTreeMap<u32, BTreeSet<u32>>,
    /// Messages.
    pub messages: u64,
    /// What only reading all of it tells.
    pub read: Option<TopicRead>,
    /// Numbers that never came, by what the recorder wrote at its end.
    pub lost: Option<u64>,
}

/// What only reading all messages of a topic tells.
#[derive(Clone, Copy, Debug)]
pub struct TopicRead {
    /// Bytes of the bodies.
    pub bytes: u64,
    /// When the first arrived.
    pub first_at: Time,
    /// When the last arrived.
    pub last_at: Time,
    /// Numbers between each stream's first and last that are not there.
    pub missing: u64,
    /// Messages whose number had come before.
    pub repeated: u64,
    /// Messages that came after one with a higher number.
    pub late: u64,
}

impl Contents {
    /// What the index tells.
    #[must_use]
    pub fn of_index(recording: &Recording) -> Self {
        let mut topics: BTreeMap<(String, bool), TopicContents> = BTreeMap::new();
        for channel in recording.channels() {
            let journal = is_journal(channel);
            let entry = topics.entry((channel.topic.clone(), journal)).or_default();
            (entry.topic, entry.journal) = (channel.topic.clone(), journal);
            entry.types.extend(channel.schema.as_ref().map(|schema| schema.name.clone()));
            entry.messages += recording.channel_count(channel.id);
            if let Some(stream) = &channel.stream {
                entry.senders.entry(stream.source).or_default().insert(stream.incarnation);
            }
        }
        for loss in recording.losses() {
            if let Some(entry) = topics.get_mut(&(loss.topic.clone(), loss.kind == Kind::Journal)) {
                *entry.lost.get_or_insert(0) += loss.counts.lost;
            }
        }
        let damage = recording.damage().iter().map(ToString::to_string).collect();
        Self { topics: topics.into_values().collect(), damage }
    }

    /// What the index and a pass over all messages tell.
    #[must_use]
    pub fn of_all(recording: &Recording, gaps: &Gaps) -> Self {
        let mut contents = Self::of_index(recording);
        for stream in &gaps.streams {
            let journal = stream.stream.kind == Kind::Journal;
            let mut topics = contents.topics.iter_mut();
            let found = topics.find(|entry| entry.topic == stream.stream.topic && entry.journal == journal);
            let Some(entry) = found else { continue };
            let read = entry.read.get_or_insert(TopicRead {
                bytes: 0,
                first_at: stream.first_at,
                last_at: stream.last_at,
                missing: 0,
                repeated: 0,
                late: 0,
            });
            read.bytes += stream.bytes;
            read.first_at = read.first_at.min(stream.first_at);
            read.last_at = read.last_at.max(stream.last_at);
            read.missing += stream.missing();
            read.repeated += stream.repeated;
            read.late += stream.late;
        }
        for error in &gaps.damage {
            let error = error.to_string();
            if !contents.damage.contains(&error) {
                contents.damage.push(error);
            }
        }
        contents
    }

    /// A table for people.
    #[must_use]
    pub fn table(&self, recording: &Recording) -> String {
        let name = |entry: &TopicContents| match entry.journal {
            true => format!("{} (journal)", entry.topic),
            false => entry.topic.clone(),
        };
        let wide = self.topics.iter().map(|entry| name(entry).len()).max().unwrap_or(0).max(5);
        let mut table = format!(
            "{:wide$} {:>9} {:>9} {:>11} {:>10} {:>10} {:>7} {:>7}  {:24} senders\n",
            "topic", "messages", "rate/s", "bytes", "first s", "last s", "missing", "lost", "type"
        );
        for entry in &self.topics {
            let seconds = |at: Time| format!("{:.3}", recording.seconds_at(at));
            let text = |value: Option<String>| value.unwrap_or_else(|| "-".to_owned());
            let types: Vec<&str> = entry.types.iter().map(String::as_str).collect();
            let types = if types.is_empty() { "unknown".to_owned() } else { types.join(", ") };
            let read = entry.read;
            // Writing to text does not fail.
            let _ = writeln!(
                table,
                "{:wide$} {:>9} {:>9} {:>11} {:>10} {:>10} {:>7} {:>7}  {types:24} {}",
                name(entry),
                entry.messages,
                text(entry.rate_hz(recording).map(|rate| format!("{rate:.1}"))),
                text(read.map(|read| read.bytes.to_string())),
                text(read.map(|read| seconds(read.first_at))),
                text(read.map(|read| seconds(read.last_at))),
                text(read.map(|read| read.missing.to_string())),
                text(entry.lost.map(|lost| lost.to_string())),
                senders(&entry.senders),
            );
        }
        table
    }

    /// One JSON object.
    #[must_use]
    pub fn json(&self, recording: &Recording) -> Value {
        let (about, ending) = (recording.about(), recording.ending());
        let range = recording.time_range();
        json!({
            "segments": recording.segments().iter().map(segment_json).collect::<Vec<_>>(),
            "recording": about.map(|about| format!("{:016x}", about.recording)),
            "run": about.map(|about| format!("{:016x}", about.run)),
            "domain": about.map(|about| about.domain.name()),
            "scenario": about.map(|about| about.scenario.as_str()),
            "settings_digest": about.map(|about| format!("{:016x}", about.settings_digest)),
            "host": about.map(|about| about.host.as_str()),
            "revision": about.map(|about| about.revision.as_str()),
            "started_at_ns": recording.started_at().as_nanos(),
            "started_wall_ns": about.map(|about| about.started_wall_ns),
            "first_ns": range.map(|(first, _)| first.as_nanos()),
            "last_ns": range.map(|(_, last)| last.as_nanos()),
            "messages": recording.message_count(),
            "ending": ending.map(|ending| json!({
                "stopped_at_ns": ending.stopped_at.as_nanos(),
                "reason": ending.reason,
                "recorded": ending.recorded,
                "dropped_full": ending.dropped_full,
                "dropped_stopped": ending.dropped_stopped,
                "refused": ending.refused,
                "overflowed": ending.overflowed,
            })),
            "profile": recording.profile(),
            "library": recording.library(),
            "attachments": recording.attachments(),
            "topics": self.topics.iter().map(|entry| entry.json(recording)).collect::<Vec<_>>(),
            "damage": self.damage,
        })
    }
}

impl TopicContents {
    /// Messages a second, over the time in which they came; over the whole recording if that is not known.
    #[must_use]
    pub fn rate_hz(&self, recording: &Recording) -> Option<f64> {
        let (first, last) = match self.read {
            Some(read) => (read.first_at, read.last_at),
            None => recording.time_range()?,
        };
        let span_s = recording.seconds_at(last) - recording.seconds_at(first);
        (span_s > 0.0 && self.messages > 1).then(|| (self.messages - 1) as f64 / span_s)
    }

    fn json(&self, recording: &Recording) -> Value {
        let read = self.read;
        let senders = self.senders.iter().map(|(source, incarnations)| {
            let (name, source) = (sender_name(*source), format!("{source:08x}"));
            json!({ "source": source, "name": name, "incarnations": incarnations })
        });
        json!({
            "topic": self.topic,
            "kind": if self.journal { "journal" } else { "data" },
            "types": self.types,
            "messages": self.messages,
            "rate_hz": self.rate_hz(recording),
            "bytes": read.map(|read| read.bytes),
            "first_ns": read.map(|read| read.first_at.as_nanos()),
            "last_ns": read.map(|read| read.last_at.as_nanos()),
            "missing": read.map(|read| read.missing),
            "repeated": read.map(|read| read.repeated),
            "late": read.map(|read| read.late),
            "lost": self.lost,
            "senders": senders.collect::<Vec<_>>(),
        })
    }
}

fn segment_json(segment: &recording::SegmentFacts) -> Value {
    let (condition, bytes) = match segment.condition {
        Condition::Sealed => ("sealed", None),
        Condition::WithoutSummary => ("without summary", None),
        Condition::Torn { whole_bytes, lost_bytes } => ("torn", Some((whole_bytes, lost_bytes))),
        Condition::Damaged { whole_bytes, lost_bytes } => ("damaged", Some((whole_bytes, lost_bytes))),
    };
    json!({
        "path": segment.path.display().to_string(),
        "bytes": segment.bytes,
        "messages": segment.messages,
        "chunks": segment.chunks,
        "condition": condition,
        "whole_bytes": bytes.map(|(whole, _)| whole),
        "lost_bytes": bytes.map(|(_, lost)| lost),
    })
}

fn is_journal(channel: &Channel) -> bool {
    channel.stream.as_ref().is_some_and(|stream| stream.kind == Kind::Journal)
}

/// The service whose only instance has this number.
fn sender_name(source: u32) -> Option<&'static str> {
    let writers = schemas::topics::ALL.iter().map(|topic| topic.writer);
    writers.into_iter().find(|writer| service_core::source_of(writer) == source)
}

fn senders(senders: &BTreeMap<u32, BTreeSet<u32>>) -> String {
    let words = senders.iter().map(|(source, incarnations)| {
        let name = sender_name(*source).map_or_else(|| format!("{source:08x}"), str::to_owned);
        match incarnations.len() {
            0 | 1 => name,
            starts => format!("{name} ({starts} starts)"),
        }
    });
    words.collect::<Vec<_>>().join(", ")
}

/// An instant of the wall clock, in words.
#[must_use]
pub fn utc(wall_ns: i64) -> String {
    let seconds = wall_ns.div_euclid(1_000_000_000);
    let (days, of_day) = (seconds.div_euclid(86_400), seconds.rem_euclid(86_400));
    // Days from the civil calendar's era of 400 years that begins on the first of March of the year zero.
    let shifted = days + 719_468;
    let (era, of_era) = (shifted.div_euclid(146_097), shifted.rem_euclid(146_097));
    let year_of_era = (of_era - of_era / 1_460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * of_year + 2) / 153;
    let day = of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    let (hour, minute, second) = (of_day / 3600, of_day / 60 % 60, of_day % 60);
    format!("{year:04}-{month:02}-{day:02} {hour:02}:{minute:02}:{second:02} UTC")
}

#[cfg(test)]
mod tests {
    use super::utc;

    #[test]
    fn the_calendar_is_the_calendar() {
        for (seconds, expected) in [
            (0, "1970-01-01 00:00:00 UTC"),
            (1_700_000_000, "2023-11-14 22:13:20 UTC"),
            (951_782_400, "2000-02-29 00:00:00 UTC"),
            (1_709_251_199, "2024-02-29 23:59:59 UTC"),
            (4_107_542_400, "2100-03-01 00:00:00 UTC"),
            (-1, "1969-12-31 23:59:59 UTC"),
        ] {
            assert_eq!(utc(seconds * 1_000_000_000), expected);
        }
    }
}
