//! What is shipped loads, and is what its name says.

use settings::{Arena, Integral, Ports};

use crate::folder::{Folder, shipped};

#[test]
fn every_shipped_scenario_loads() {
    let names = Arena::scenarios(&shipped()).unwrap();
    assert_eq!(
        names,
        ["crazyflie-hover", "double-flip", "fleet", "rate-mismatch", "single-flip", "ten", "triple-flip"]
    );
    for name in names {
        let arena = Arena::load(&shipped(), &name).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(arena.name, name);
        assert_eq!(arena.fleet.len(), arena.scenario.vehicles.len());
        for (member, part) in arena.fleet.iter().zip(&arena.scenario.vehicles) {
            assert_eq!(&member.part, part, "the fleet is in the scenario's order");
            assert!(arena.hall.contains(part.place_x_m, part.place_y_m, part.place_z_m));
            assert_eq!(arena.vehicle(member.vehicle.id), Some(member));
        }
    }
}

#[test]
fn only_toml_files_are_scenarios() {
    let folder = Folder::new("only-toml");
    folder.write("scenarios/notes.txt", "").write("scenarios/a-copy.toml.orig", "");
    assert_eq!(Arena::scenarios(folder.path()).unwrap(), Arena::scenarios(&shipped()).unwrap());
}

#[test]
fn a_setting_left_out_has_no_default_but_the_choice_of_integral_is_spelt_as_documented() {
    let folder = Folder::new("spelling");
    folder.set("vehicles/kinds/hummingbird.toml", "integral", "integral = \"literal\"");
    assert_eq!(folder.load("double-flip").unwrap().fleet[0].vehicle.rate_loop.integral, Integral::Literal);
    folder.set("vehicles/kinds/hummingbird.toml", "integral", "");
    assert!(folder.refusal("double-flip").contains("missing field `integral`"));
}

#[test]
fn a_section_reads_as_the_services_own_type_and_an_absent_one_as_empty() {
    #[derive(Debug, Default, PartialEq, serde::Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct Tuning {
        gain: f64,
    }
    let folder = Folder::new("sections");
    folder.write(
        "services.toml",
        "simulator = 3\n[estimator]\ngain = 2.5\n[learner]\ngian = 1.0\n[arena]\ngain = \"much\"\n",
    );
    let arena = folder.load("double-flip").unwrap();
    assert_eq!(arena.section::<Tuning>("estimator").unwrap(), Tuning { gain: 2.5 });
    assert_eq!(arena.section::<Tuning>("flip-manager").unwrap(), Tuning::default());
    let refused = |service| arena.section::<Tuning>(service).unwrap_err().to_string();
    expect_test::expect!["services.toml: [learner] unknown field `gian`, expected `gain`"]
        .assert_eq(&refused("learner"));
    expect_test::expect![[
        r#"services.toml: [arena] gain = "much": invalid type: string "much", expected f64"#
    ]]
    .assert_eq(&refused("arena"));
    expect_test::expect!["services.toml: simulator = 3, but it must be a section of settings"]
        .assert_eq(&refused("simulator"));
}

#[test]
fn a_section_that_is_nobodys_is_refused_with_those_there_are() {
    let folder = Folder::new("nobodys");
    folder.write("services.toml", "[estimator]\n[estimater]\n");
    let arena = folder.load("double-flip").unwrap();
    arena.check_sections(&["estimater", "estimator"]).unwrap();
    let error = arena.check_sections(&["estimator", "learner"]).unwrap_err();
    expect_test::expect![[r#"services.toml: section = "estimater", but there is only estimator, learner"#]]
        .assert_eq(&error.to_string());
}

#[test]
fn a_command_links_port_and_its_vehicle_are_one_number() {
    for vehicle in 0..=u8::MAX {
        assert_eq!(Ports::vehicle_of_command_link(Ports::command_link(vehicle)), Some(vehicle));
    }
    for port in [Ports::MOTION_CAPTURE, Ports::MOTION_CAPTURE_GROUP, Ports::DATA_LINK, 0xff, 0x1101] {
        assert_eq!(Ports::vehicle_of_command_link(port), None, "{port:#x}");
    }
}
