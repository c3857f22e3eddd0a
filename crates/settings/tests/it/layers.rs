//! What one file inherits from another, and what a scenario lays over its vehicles.

use crate::folder::Folder;

const KIND: &str = "vehicles/kinds/hummingbird.toml";
const SCENARIO: &str = "scenarios/double-flip.toml";

#[test]
fn a_files_own_value_wins_over_the_inherited_and_the_scenarios_over_both() {
    let folder = Folder::new("wins");
    let scale = |folder: &Folder| folder.load("double-flip").unwrap().fleet[0].vehicle.plant.gyro.scale_ratio;
    folder.set(KIND, "scale_ratio", "scale_ratio = 1.5");
    assert_eq!(scale(&folder), 1.5);
    folder.append("vehicles/v01.toml", "[plant.gyro]\nscale_ratio = 1.25");
    assert_eq!(scale(&folder), 1.25);
    folder.append(SCENARIO, "[vehicles.plant.gyro]\nscale_ratio = 0.75");
    assert_eq!(scale(&folder), 0.75);
}

#[test]
fn an_override_reaches_every_vehicle_and_nothing_but_its_key() {
    let folder = Folder::new("reaches");
    let before = folder.load("fleet").unwrap();
    folder.append("scenarios/fleet.toml", "[vehicles.plant.gyro]\nscale_ratio = 1.25");
    let mut after = folder.load("fleet").unwrap();
    for member in &mut after.fleet {
        assert_eq!(member.vehicle.plant.gyro.scale_ratio, 1.25);
        member.vehicle.plant.gyro.scale_ratio = before.fleet[0].vehicle.plant.gyro.scale_ratio;
    }
    assert_eq!(after, before);
}

#[test]
fn a_misspelt_override_is_refused_in_the_scenarios_name() {
    for (name, text) in [
        ("section", "[vehicles.plant.gyroo]\nscale_ratio = 1.1"),
        ("key", "[vehicles.plant.gyro]\nscale_ration = 1.1"),
        ("top", "[vehicles]\nplnat = 1.1"),
        ("inherit", "[vehicles]\ninherit = \"kinds/hummingbird.toml\""),
    ] {
        let folder = Folder::new(&format!("misspelt-{name}"));
        let text = folder.append(SCENARIO, text).refusal("double-flip");
        assert!(
            text.starts_with("config/scenarios/double-flip.toml: [vehicles] over config/vehicles/v01.toml"),
            "{text}"
        );
        let word = ["gyroo", "scale_ration", "plnat", "inherit"].into_iter().find(|word| text.contains(word));
        assert!(text.contains("unknown field") && word.is_some(), "{text}");
    }
}

#[test]
fn a_wrong_override_is_refused_by_the_key_it_has_in_the_scenario() {
    let folder = Folder::new("wrong-override");
    folder.append(SCENARIO, "[vehicles.plant.gyro]\nscale_ratio = 7.0");
    expect_test::expect!["config/scenarios/double-flip.toml: vehicles.plant.gyro.scale_ratio = 7, but it must lie within 0.5 and 2"].assert_eq(&folder.refusal("double-flip"));
    let folder = Folder::new("wrong-override-pair");
    folder.append(SCENARIO, "[vehicles.battery]\nflip_v_min = 9.0");
    expect_test::expect!["config/scenarios/double-flip.toml: battery.land_v_min = 9.65 does not go with vehicles.battery.flip_v_min = 9: it must not be above it"].assert_eq(&folder.refusal("double-flip"));
    let folder = Folder::new("wrong-override-type");
    folder.append(SCENARIO, "[vehicles.plant]\ngyro = 3");
    expect_test::expect!["config/scenarios/double-flip.toml: [vehicles] over config/vehicles/v01.toml: plant.gyro = 3: invalid type: integer `3`, expected struct GyroSettings"].assert_eq(&folder.refusal("double-flip"));
    let folder = Folder::new("overrides-no-table");
    folder.set(SCENARIO, "description", "description = \"\"\nvehicles = 3");
    expect_test::expect!["config/scenarios/double-flip.toml: vehicles = 3, but it must be a table of settings laid over each vehicle"].assert_eq(&folder.refusal("double-flip"));
}

#[test]
fn a_refused_value_is_laid_to_the_file_it_stands_in() {
    let folder = Folder::new("laid-inherited");
    folder.set(KIND, "mass_kg", "mass_kg = 468.0");
    expect_test::expect![
        "config/vehicles/kinds/hummingbird.toml: airframe.mass_kg = 468, but it must lie within 0.01 and 20"
    ]
    .assert_eq(&folder.refusal("double-flip"));
    let folder = Folder::new("laid-own");
    folder.append("vehicles/v01.toml", "[airframe]\nmass_kg = 468.0");
    expect_test::expect![
        "config/vehicles/v01.toml: airframe.mass_kg = 468, but it must lie within 0.01 and 20"
    ]
    .assert_eq(&folder.refusal("double-flip"));
    // An unknown key could stand in either: both are named.
    let folder = Folder::new("laid-unknown");
    folder.append(KIND, "[propeller]\nblades = 2");
    let text = folder.refusal("double-flip");
    assert!(text.contains("vehicles/v01.toml") && text.contains("kinds/hummingbird.toml"), "{text}");
    assert!(text.contains("propeller"), "{text}");
}

#[test]
fn a_chain_of_inheritance_is_refused() {
    let folder = Folder::new("chain");
    folder.write("vehicles/kinds/base.toml", "").append(KIND, "");
    let kind = std::fs::read_to_string(folder.path().join(KIND)).unwrap();
    folder.write(KIND, &format!("inherit = \"base.toml\"\n{kind}"));
    expect_test::expect![[r#"config/vehicles/kinds/hummingbird.toml: inherit = "base.toml" does not go with inherit of config/vehicles/v01.toml = config/vehicles/kinds/hummingbird.toml: settings are inherited once, not through a chain"#]].assert_eq(&folder.refusal("double-flip"));
    let folder = Folder::new("chain-self");
    folder.set("vehicles/v01.toml", "inherit", "inherit = \"v01.toml\"");
    assert!(folder.refusal("double-flip").contains("not through a chain"));
}

#[test]
fn an_inherited_file_that_is_not_there_or_not_named_is_refused() {
    let folder = Folder::new("inherit-absent");
    folder.set("vehicles/v01.toml", "inherit", "inherit = \"kinds/humming.toml\"");
    expect_test::expect![
        "config/vehicles/kinds/humming.toml: cannot be read: No such file or directory (os error 2)"
    ]
    .assert_eq(&folder.refusal("double-flip"));
    let folder = Folder::new("inherit-number");
    folder.set("vehicles/v01.toml", "inherit", "inherit = 3");
    expect_test::expect!["config/vehicles/v01.toml: inherit = 3, but it must be the text of a path"]
        .assert_eq(&folder.refusal("double-flip"));
}

#[test]
fn a_scenario_may_inherit_another() {
    let folder = Folder::new("inherit-scenario");
    folder.write("scenarios/short.toml", "inherit = \"double-flip.toml\"\n[flip]\niterations = 3\n");
    let (short, whole) = (folder.load("short").unwrap(), folder.load("double-flip").unwrap());
    let flips = [&short, &whole].map(|arena| arena.scenario.flip.clone().unwrap());
    assert_eq!(flips[0].iterations, 3);
    assert_eq!(short.scenario.vehicles, whole.scenario.vehicles);
    assert_eq!(flips[0].flips, flips[1].flips);
}
