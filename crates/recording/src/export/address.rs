//! What people name: a topic, or a field of it.

use super::ExportError;

/// A topic, or a field of it, as people write it: `vehicle/state.estimate.position_m.x`.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Address {
    /// The topic.
    pub topic: String,
    /// Names and indices from the message to the field; the whole message, if `None`.
    pub field: Option<String>,
}

/// What an address's text says of a topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldOf<'a> {
    /// The whole message.
    Message,
    /// A field of it.
    Field(&'a str),
}

impl Address {
    /// Finds the topic that a text begins with, the longest if there are several: names of topics may have
    /// dots.
    ///
    /// # Errors
    /// No topic is called so.
    pub fn find<'t>(text: &str, topics: impl IntoIterator<Item = &'t str>) -> Result<Self, ExportError> {
        let mut known: Vec<&str> = topics.into_iter().collect();
        known.sort_unstable();
        known.dedup();
        let best = known
            .iter()
            .filter_map(|topic| Some((topic, Self::field_of(text, topic)?)))
            .max_by_key(|(topic, _)| topic.len());
        match best {
            Some((topic, FieldOf::Message)) => Ok(Self { topic: (*topic).to_owned(), field: None }),
            Some((topic, FieldOf::Field(field))) => {
                Ok(Self { topic: (*topic).to_owned(), field: Some(field.to_owned()) })
            }
            None => {
                let known = known.into_iter().map(str::to_owned).collect();
                Err(ExportError::NoTopic { wanted: text.to_owned(), known })
            }
        }
    }

    /// What of this topic a text names, if it names the topic.
    #[must_use]
    pub fn field_of<'a>(text: &'a str, topic: &str) -> Option<FieldOf<'a>> {
        let rest = text.strip_prefix(topic)?;
        if rest.is_empty() {
            return Some(FieldOf::Message);
        }
        rest.strip_prefix('.').map(FieldOf::Field)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_topic_is_meant() {
        let find = |text: &str| Address::find(text, ["a/b", "a/b.c", "a/bc"]);
        let address = |topic: &str, field: Option<&str>| Address {
            topic: topic.to_owned(),
            field: field.map(str::to_owned),
        };
        assert_eq!(find("a/b").unwrap(), address("a/b", None));
        assert_eq!(find("a/b.d.0").unwrap(), address("a/b", Some("d.0")));
        assert_eq!(find("a/b.c.d").unwrap(), address("a/b.c", Some("d")));
        let error = find("a/x.y").unwrap_err().to_string();
        assert!(error.contains("a/x.y") && error.contains("a/b, a/b.c, a/bc"), "{error}");
    }
}
