//! The published definitions are those of the code.

use std::collections::BTreeMap;
use std::path::Path;

use expect_test::expect_file;
use reflect::Schema;
use schemas::topics;

/// Every type of ours that crosses the bus, alone or within another, by published name.
fn types() -> BTreeMap<&'static str, &'static Schema> {
    topics::ALL
        .iter()
        .flat_map(|topic| topic.schema.nested().into_iter().chain([topic.schema]))
        .filter(|schema| schema.name.starts_with("flyarena/"))
        .map(|schema| (schema.name, schema))
        .collect()
}

fn file_name(schema: &Schema) -> String {
    schema.name.replace('/', "_") + ".msg"
}

/// Run with `UPDATE_EXPECT=1` after a change of a message, and commit what it writes.
#[test]
fn every_published_definition_is_fresh_and_none_is_left_over() {
    let mut expected = Vec::new();
    for schema in types().values() {
        let header = format!(
            "# {}, schema id {:016x}; generated from schemas/src, see schemas/tests/published.rs\n\n",
            schema.name,
            schema.id(),
        );
        expect_file![format!("../published/{}", file_name(schema))].assert_eq(&(header + &schema.text()));
        expected.push(file_name(schema));
    }
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("published");
    let mut found: Vec<String> = std::fs::read_dir(directory)
        .expect("the directory is part of the repository")
        .map(|entry| entry.expect("a readable entry").file_name().to_string_lossy().into_owned())
        .collect();
    found.sort();
    assert_eq!(found, expected);
}

#[test]
fn no_two_types_share_a_name_or_an_id() {
    let mut ids: BTreeMap<u64, &str> = BTreeMap::new();
    for schema in types().values() {
        assert_eq!(ids.insert(schema.id(), schema.name), None, "{}", schema.name);
    }
    for topic in topics::ALL {
        let named = types()[topic.schema.name];
        assert_eq!(named.text(), topic.schema.text(), "two types are called {}", topic.schema.name);
    }
}
