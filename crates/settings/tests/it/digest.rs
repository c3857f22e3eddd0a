//! The digest of resolved settings: layout makes no difference, every value does.

use settings::Arena;

use crate::folder::Folder;

fn digest(folder: &Folder) -> u64 {
    folder.load("double-flip").unwrap().digest()
}

#[test]
fn layout_comments_and_where_a_value_comes_from_make_no_difference() {
    let folder = Folder::new("digest-layout");
    folder.write("services.toml", "[learner]\n[estimator]\n");
    let before = digest(&folder);
    folder
        .append("hall.toml", "# a remark")
        .set("hall.toml", "width_m", "width_m=10.000")
        .write("services.toml", "[estimator]\n\n[learner]\n")
        .append("vehicles/v01.toml", "[airframe]\nmass_kg = 0.468")
        .append("scenarios/double-flip.toml", "[vehicles.plant.gyro]\nscale_ratio = 1.005")
        .append("scenarios/fleet.toml", "# of no concern to this one");
    assert_eq!(digest(&folder), before);
}

#[test]
fn every_file_makes_a_difference() {
    let folder = Folder::new("digest-values");
    let mut seen = vec![digest(&folder)];
    for (file, key, line) in [
        ("hall.toml", "width_m", "width_m = 10.0000001"),
        ("network.toml", "ttl", "ttl = 1"),
        ("scenarios/double-flip.toml", "iterations", "iterations = 128"),
        ("scenarios/double-flip.toml", "description", "description = \"another\""),
        ("vehicles/v01.toml", "subject", "subject = \"quad7\""),
        ("vehicles/kinds/hummingbird.toml", "mass_kg", "mass_kg = 0.469"),
    ] {
        seen.push(digest(folder.set(file, key, line)));
    }
    folder.append("services.toml", "[estimator]");
    seen.push(digest(&folder));
    let mut distinct = seen.clone();
    distinct.sort_unstable();
    distinct.dedup();
    assert_eq!(distinct.len(), seen.len(), "{seen:x?}");
}

#[test]
fn a_copy_that_went_through_another_format_has_the_same_digest() {
    let arena = Folder::new("digest-copy").load("fleet").unwrap();
    let copy: Arena = toml::from_str(&toml::to_string(&arena).unwrap()).unwrap();
    assert_eq!(copy, arena);
    assert_eq!(copy.digest(), arena.digest());
}
