//! What is laid over a folder's settings: a file for the equipment, or one value.

use std::fs;
use std::path::PathBuf;

use settings::{Arena, ConfigError, DeviceUrl, Overlay};

use crate::folder::{Folder, shipped};

fn file(folder: &Folder, text: &str) -> PathBuf {
    folder.write("../lab.toml", text);
    folder.path().join("../lab.toml")
}

/// A folder with a folder around it, for the file that is laid over it.
fn folder(name: &str) -> Folder {
    Folder::new(&format!("overlay-{name}/config"))
}

fn load(folder: &Folder, scenario: &str, text: &str) -> Result<Arena, ConfigError> {
    let mut overlay = Overlay::default();
    overlay.add_file(&file(folder, text))?;
    Arena::load_over(folder.path(), scenario, &overlay, |_| Ok(()))
}

fn refusal(folder: &Folder, text: &str) -> String {
    let error = load(folder, "double-flip", text).expect_err("it was to be refused").to_string();
    let lab = folder.path().join("../lab.toml");
    error
        .replace(&lab.display().to_string(), "lab.toml")
        .replace(&folder.path().display().to_string(), "config")
}

#[test]
fn nothing_laid_over_a_folder_changes_nothing() {
    for scenario in Arena::scenarios(&shipped()).unwrap() {
        let plain = Arena::load(&shipped(), &scenario).unwrap();
        let over = Arena::load_over(&shipped(), &scenario, &Overlay::default(), |_| Ok(())).unwrap();
        assert_eq!(plain, over);
    }
}

#[test]
fn every_shipped_hardware_file_loads_over_every_scenario_and_is_of_real_devices() {
    let mut seen = 0;
    for entry in fs::read_dir(shipped().join("hardware")).unwrap() {
        let path = entry.unwrap().path();
        let mut overlay = Overlay::default();
        overlay.add_file(&path).unwrap();
        for scenario in ["single-flip", "double-flip", "triple-flip", "rate-mismatch"] {
            let arena = Arena::load_over(&shipped(), scenario, &overlay, |_| Ok(()))
                .unwrap_or_else(|error| panic!("{scenario}: {error}"));
            let radio = arena.network.devices.radio_of(&arena.fleet[0]).unwrap();
            assert!(!matches!(radio, DeviceUrl::Pty(_)), "{}", path.display());
            assert_ne!(arena.network.devices, Arena::load(&shipped(), scenario).unwrap().network.devices);
        }
        seen += 1;
    }
    assert!(seen >= 2, "{seen} files");
}

#[test]
fn a_file_changes_its_keys_in_every_kind_of_file_and_nothing_else() {
    let folder = folder("changes");
    let before = folder.load("fleet").unwrap();
    let text = "[network]\nttl = 1\n[network.devices.data_link]\nurl = \"udp://10.0.0.2:7\"\n\
                [hall]\nmargin_m = 0.25\n[services.learner]\nx = 1\n\
                [vehicles.v02.links]\ndata_address = 77\n[vehicles.kinds.hummingbird.plant.gyro]\nscale_ratio = 1.25\n\
                [scenarios.fleet.flip]\niterations = 3\n";
    let mut after = load(&folder, "fleet", text).unwrap();
    assert_eq!((after.network.ttl, after.hall.margin_m), (1, 0.25));
    assert_eq!(after.network.devices.data_link.url.to_string(), "udp://10.0.0.2:7");
    assert_eq!(after.services["learner"]["x"].as_integer(), Some(1));
    assert_eq!(
        (after.fleet[1].vehicle.links.data_address, after.scenario.flip.as_ref().unwrap().iterations),
        (77, 3)
    );
    assert!(after.fleet.iter().all(|member| member.vehicle.plant.gyro.scale_ratio == 1.25));
    after.network = before.network.clone();
    after.hall = before.hall.clone();
    after.services = before.services.clone();
    after.scenario.flip = before.scenario.flip.clone();
    for (member, old) in after.fleet.iter_mut().zip(&before.fleet) {
        member.vehicle.plant.gyro.scale_ratio = old.vehicle.plant.gyro.scale_ratio;
        member.vehicle.links.data_address = old.vehicle.links.data_address;
    }
    assert_eq!(after, before);
}

#[test]
fn a_later_layer_wins_and_a_pair_that_only_holds_together_is_taken_together() {
    let folder = folder("later");
    let mut overlay = Overlay::default();
    overlay.add_file(&file(&folder, "[network]\nttl = 1\n")).unwrap();
    overlay.add_change(&"network.ttl=0".parse().unwrap());
    // For a moment both domains share a port.
    overlay.add_change(&"network.sim.port=47101".parse().unwrap());
    overlay.add_change(&"network.live.port=47109".parse().unwrap());
    let arena = Arena::load_over(folder.path(), "double-flip", &overlay, |_| Ok(())).unwrap();
    assert_eq!((arena.network.ttl, arena.network.sim.port, arena.network.live.port), (0, 47101, 47109));
}

#[test]
fn what_is_refused_names_the_file_that_was_laid_over_the_key_and_both_values() {
    let folder = folder("refused");
    for (text, expected) in [
        (
            "[network]\nttl = 3\n",
            "lab.toml, laid over the settings: config/network.toml: ttl = 3, but it must lie within 0 and 1",
        ),
        (
            "[netwrok]\nttl = 1\n",
            "lab.toml: section = \"netwrok\", but there is only hall, network, services, scenarios, vehicles",
        ),
        (
            "[vehicles.v99]\nid = 1\n",
            "lab.toml: section of vehicles = \"v99\", but there is only v01, v02, v03",
        ),
        ("ttl = 1\n", "lab.toml: ttl = 1, but it must be a section of settings"),
        ("[vehicles]\nv01 = 3\n", "lab.toml: vehicles.v01 = 3, but it must be a section of settings"),
        (
            "[hall]\nheight_m = 4.0\n",
            "lab.toml, laid over the settings: config/scenarios/double-flip.toml: vehicle v01.place_z_m = 5, but it must lie within 0.5 and 3.5",
        ),
        (
            "[network.devices.command_link]\nurl = \"udp://127.0.0.1:51000\"\n",
            "lab.toml, laid over the settings: config/network.toml: devices.command_link.url = udp://127.0.0.1:51000 does not go with devices.motion_capture.url = udp://127.0.0.1:51001",
        ),
        ("[network.devices.motion_capture]\nurl = \"pty:x\"\n", "it needs udp://"),
        (
            "[hall]\nwidth_m = \"wide\"\n",
            "lab.toml, laid over the settings: config/hall.toml: width_m = \"wide\"",
        ),
        ("[hall]\nlenght_m = 3.0\n", "lenght_m"),
        // Nothing of it is used in this scenario; it is wrong all the same.
        ("[vehicles.v02.links]\ndata_adress = 3\n", "data_adress"),
        ("[scenarios.fleet.flip]\niteration = 3\n", "iteration"),
        ("[vehicles.kinds.hummingbird.airframe]\nmass_kg = 468.0\n", "airframe.mass_kg = 468"),
        ("network = [", "lab.toml: "),
    ] {
        let text = refusal(&folder, text);
        assert!(text.starts_with("lab.toml") && text.contains(expected), "{text}\nis not\n{expected}");
    }
}

#[test]
fn what_was_wrong_before_is_not_laid_to_what_was_laid_over() {
    let folder = folder("before");
    folder.set("hall.toml", "width_m", "width_m = -1.0");
    let text = refusal(&folder, "[network]\nttl = 1\n");
    assert!(text.starts_with("config/hall.toml: width_m = -1"), "{text}");
}

#[test]
fn of_several_layers_the_one_that_spoils_it_is_named() {
    let folder = folder("several");
    let mut overlay = Overlay::default();
    overlay.add_change(&"hall.margin_m=0.25".parse().unwrap());
    overlay.add_change(&"network.ttl=3".parse().unwrap());
    overlay.add_change(&"network.interface=10.0.0.1".parse().unwrap());
    let error = Arena::load_over(folder.path(), "double-flip", &overlay, |_| Ok(())).unwrap_err();
    assert!(error.to_string().starts_with("network.ttl=3, laid over the settings"), "{error}");
}

#[test]
fn what_the_services_refuse_is_laid_to_it_too() {
    let folder = folder("services");
    let mut overlay = Overlay::default();
    overlay.add_file(&file(&folder, "[services.estimater]\n")).unwrap();
    let check = |arena: &Arena| arena.check_sections(&["estimator"]);
    let error = Arena::load_over(folder.path(), "double-flip", &overlay, check).unwrap_err().to_string();
    assert!(
        error.contains("lab.toml, laid over the settings: services.toml: section = \"estimater\""),
        "{error}"
    );
}
