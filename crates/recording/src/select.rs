//! Which messages of a recording are wanted.

use quantity::Time;

use crate::read::Channel;

/// Which messages of a recording are wanted. The default is all of them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Selection {
    /// Those logged at this time or later.
    pub from: Option<Time>,
    /// Those logged at this time or earlier.
    pub to: Option<Time>,
    /// Those of these topics; of all, if none is named. A name that ends in `*` stands for all topics that
    /// begin so.
    pub topics: Vec<String>,
    /// None of these topics, by the same rule.
    pub exclude: Vec<String>,
    /// Those of these channels, by [`Channel::id`]; of all, if `None`.
    pub channels: Option<Vec<u32>>,
}

impl Selection {
    /// All messages.
    #[must_use]
    pub fn all() -> Self {
        Self::default()
    }

    /// Those of one topic.
    #[must_use]
    pub fn topic(topic: impl Into<String>) -> Self {
        Self { topics: vec![topic.into()], ..Self::default() }
    }

    /// Those of these channels.
    #[must_use]
    pub fn of_channels(channels: impl IntoIterator<Item = u32>) -> Self {
        Self { channels: Some(channels.into_iter().collect()), ..Self::default() }
    }

    /// This selection, from a time on.
    #[must_use]
    pub fn from(self, from: Time) -> Self {
        Self { from: Some(from), ..self }
    }

    /// This selection, up to a time, which is included.
    #[must_use]
    pub fn to(self, to: Time) -> Self {
        Self { to: Some(to), ..self }
    }

    /// Whether messages of this channel are wanted.
    #[must_use]
    pub fn wants(&self, channel: &Channel) -> bool {
        let named = |names: &[String]| names.iter().any(|name| stands_for(name, &channel.topic));
        (self.topics.is_empty() || named(&self.topics))
            && !named(&self.exclude)
            && self.channels.as_ref().is_none_or(|channels| channels.contains(&channel.id))
    }

    pub(crate) fn bounds_ns(&self) -> (i64, i64) {
        (self.from.map_or(i64::MIN, Time::as_nanos), self.to.map_or(i64::MAX, Time::as_nanos))
    }
}

fn stands_for(name: &str, topic: &str) -> bool {
    match name.strip_suffix('*') {
        Some(prefix) => topic.starts_with(prefix),
        None => topic == name,
    }
}
