//! A Crazyflie's settings, and a scenario without a flip.

use expect_test::expect;
use settings::Radio;

use crate::folder::{Folder, shipped};

const KIND: &str = "vehicles/kinds/crazyflie.toml";
const SCENARIO: &str = "crazyflie-hover";

#[test]
fn a_crazyflie_has_no_address_and_flies_no_flips() {
    let arena = settings::Arena::load(&shipped(), SCENARIO).unwrap();
    let vehicle = &arena.fleet[0].vehicle;
    assert_eq!((vehicle.links.radio, vehicle.flips()), (Radio::Crazyradio, false));
    assert!((vehicle.collective_m_s2_max() - 19.6).abs() < 1e-9);
    assert_eq!(arena.scenario.flip, None);
    assert_eq!(arena.network.devices.radio_of(&arena.fleet[0]).unwrap().to_string(), "udp://127.0.0.1:19854");
    let again = settings::Arena::from_toml("again", &arena.to_toml()).unwrap();
    assert_eq!(again, arena);
}

#[test]
fn an_address_of_the_data_link_is_refused() {
    let folder = Folder::new("crazyflie-address");
    folder.set("vehicles/cf1.toml", "subject", "subject = \"cf1\"\n[links]\ndata_address = 0x5005");
    expect!["config/vehicles/cf1.toml: links.data_address = 20485 does not go with links.radio = crazyradio: a Crazyflie has no data-link radio"]
        .assert_eq(&folder.refusal(SCENARIO));
}

#[test]
fn one_that_could_hardly_hover_is_refused() {
    let folder = Folder::new("crazyflie-heavy");
    folder.set(KIND, "mass_kg", "mass_kg = 0.05");
    expect!["config/vehicles/cf1.toml: airframe.mass_kg times gravity = 0.49050000000000005 does not go with rotor.thrust_n_max times four = 0.588: it must not be above 0.8 of it"]
        .assert_eq(&folder.refusal(SCENARIO));
}

#[test]
fn slow_gyros_matter_only_to_vehicles_that_flip() {
    let folder = Folder::new("crazyflie-gyro");
    folder.set(KIND, "range_rad_s", "range_rad_s = 10.0");
    assert!(folder.load(SCENARIO).is_ok());
    folder.append(
        &format!("scenarios/{SCENARIO}.toml"),
        "[flip]\nflips = 1\ndesign_rate_rad_s = 17.0\nflown_rate_rad_s = 17.0\nenvelope_margin_ratio = 0.125\n\
         step_size_ratio = 0.1\niterations = 3",
    );
    assert!(folder.load(SCENARIO).is_ok(), "it hovers while others learn");
}

#[test]
fn two_crazyflies_need_no_addresses_but_ids_of_their_own() {
    let folder = Folder::new("crazyflies");
    folder.write("vehicles/cf2.toml", "inherit = \"kinds/crazyflie.toml\"\nid = 6\nsubject = \"cf2\"\n");
    folder.append(
        &format!("scenarios/{SCENARIO}.toml"),
        "[[vehicle]]\nfile = \"cf2\"\nstart_x_m = 0.0\nstart_y_m = 4.0\nplace_x_m = 0.5\nplace_y_m = 4.0\n\
         place_z_m = 1.2\nheading_rad = 0.0",
    );
    assert_eq!(folder.load(SCENARIO).unwrap().fleet.len(), 2);
}
