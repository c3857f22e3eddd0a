//! The topic table holds together.

use std::collections::{BTreeMap, BTreeSet};

use schemas::{topic_hash, topics};

#[test]
fn no_two_topics_share_a_name_or_a_hash() {
    let mut hashes: BTreeMap<u32, &str> = BTreeMap::new();
    for topic in topics::ALL {
        // The kernel's filter knows topics by their hash alone.
        assert_eq!(hashes.insert(topic.hash, topic.name), None, "{}", topic.name);
    }
}

#[test]
fn the_hash_is_fnv_1a() {
    assert_eq!(topic_hash("foobar"), 0xbf9c_f968, "the published vector");
    for topic in topics::ALL {
        assert_eq!(topic.hash, reflect::fnv1a_32(topic.name.as_bytes()), "{}", topic.name);
    }
}

#[test]
fn names_are_words_between_slashes() {
    for topic in topics::ALL {
        let words: Vec<&str> = topic.name.split('/').collect();
        assert!(words.len() >= 2 && topic.name.len() <= 64, "{}", topic.name);
        for word in words {
            let valid = word.chars().all(|letter| letter.is_ascii_lowercase() || letter == '-');
            assert!(
                valid && !word.is_empty() && !word.starts_with('-') && !word.ends_with('-'),
                "{}",
                topic.name
            );
        }
        assert_eq!(topics::by_name(topic.name), Some(*topic));
    }
}

#[test]
fn every_topic_has_one_writer_and_each_reader_once() {
    for topic in topics::ALL {
        assert!(!topic.writer.is_empty() && !topic.writer.contains([',', ' ']), "{}", topic.name);
        assert_eq!(topic.writer == "*", topic.name.starts_with("node/"), "{}", topic.name);
        let readers: BTreeSet<&str> = topic.readers.iter().copied().collect();
        assert_eq!(readers.len(), topic.readers.len(), "{}", topic.name);
        assert!(!readers.contains("*") && topic.rate_hz > 0, "{}", topic.name);
    }
}

#[test]
fn the_schema_id_is_that_of_the_schema() {
    for topic in topics::ALL {
        assert_eq!(topic.schema_id(), topic.schema.id(), "{}", topic.name);
        assert_eq!(topic.schema_text(), topic.schema.text(), "{}", topic.name);
    }
}
