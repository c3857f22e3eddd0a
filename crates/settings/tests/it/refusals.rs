//! What is refused, and in which words.

use expect_test::{Expect, expect};

use crate::folder::Folder;

/// Sets a key of a file to something it cannot be, and looks at what is said.
fn refused(name: &str, file: &str, key: &str, line: &str, words: Expect) {
    let folder = Folder::new(name);
    words.assert_eq(&folder.set(file, key, line).refusal("double-flip"));
}

#[test]
fn an_unknown_scenario_is_refused_with_those_there_are() {
    let folder = Folder::new("no-scenario");
    expect![[r#"config/scenarios: scenario = "duble-flip", but there is only crazyflie-hover, double-flip, fleet, rate-mismatch, single-flip, ten, triple-flip"#]].assert_eq(&folder.refusal("duble-flip"));
    for name in ["", "..", "../hall", "double-flip.toml", "scenarios/double-flip", "Double-Flip"] {
        assert!(
            folder.refusal(name).contains("there is only crazyflie-hover, double-flip, fleet"),
            "{name:?}"
        );
    }
}

#[test]
fn a_folder_that_is_not_there_is_refused() {
    let folder = Folder::new("no-folder");
    std::fs::remove_dir_all(folder.path().join("scenarios")).unwrap();
    expect!["config/scenarios: cannot be read: No such file or directory (os error 2)"]
        .assert_eq(&folder.refusal("double-flip"));
    std::fs::remove_dir_all(folder.path()).unwrap();
    expect!["config/hall.toml: cannot be read: No such file or directory (os error 2)"]
        .assert_eq(&folder.refusal("double-flip"));
}

#[test]
fn each_file_must_be_there() {
    for file in ["hall.toml", "network.toml", "services.toml"] {
        let folder = Folder::new("no-file");
        std::fs::remove_file(folder.path().join(file)).unwrap();
        let text = folder.refusal("double-flip");
        assert!(text.starts_with(&format!("config/{file}: cannot be read")), "{text}");
    }
}

#[test]
fn what_is_not_toml_is_refused_with_its_line() {
    refused(
        "syntax",
        "hall.toml",
        "width_m",
        "width_m = ten",
        expect![[r#"
        config/hall.toml: TOML parse error at line 2, column 11
          |
        2 | width_m = ten
          |           ^^^
        invalid boolean, expected `true`"#]],
    );
}

#[test]
fn an_unknown_key_is_refused() {
    refused(
        "unknown-hall",
        "hall.toml",
        "width_m",
        "widht_m = 10.0",
        expect![
            "config/hall.toml: unknown field `widht_m`, expected one of `width_m`, `depth_m`, `height_m`, `margin_m`"
        ],
    );
    refused(
        "unknown-network",
        "network.toml",
        "ttl",
        "ttl = 0\nhops = 1",
        expect![
            "config/network.toml: unknown field `hops`, expected one of `interface`, `ttl`, `receive_buffer_bytes`, `live`, `sim`, `replay`, `devices`"
        ],
    );
    refused(
        "unknown-scenario",
        "scenarios/double-flip.toml",
        "flips",
        "flips = 2\nflops = 1",
        expect![
            "config/scenarios/double-flip.toml: unknown field `flops`, expected one of `flips`, `design_rate_rad_s`, `flown_rate_rad_s`, `envelope_margin_ratio`, `step_size_ratio`, `iterations` in `flip`"
        ],
    );
    refused(
        "unknown-part",
        "scenarios/double-flip.toml",
        "start_x_m",
        "start_x_m = 0.0\nstart = 1",
        expect![
            "config/scenarios/double-flip.toml: unknown field `start`, expected one of `file`, `start_x_m`, `start_y_m`, `place_x_m`, `place_y_m`, `place_z_m`, `heading_rad` in `vehicle`"
        ],
    );
    refused(
        "unknown-vehicle",
        "vehicles/v01.toml",
        "subject",
        "subject = \"quad1\"\nname = \"one\"",
        expect![
            "config/vehicles/v01.toml: unknown field `name`, expected one of `id`, `subject`, `airframe`, `rotor`, `rate_loop`, `links`, `battery`, `plant` (it inherits config/vehicles/kinds/hummingbird.toml)"
        ],
    );
}

#[test]
fn a_missing_key_is_refused() {
    refused("missing", "hall.toml", "height_m", "", expect!["config/hall.toml: missing field `height_m`"]);
}

#[test]
fn a_value_of_the_wrong_type_is_refused() {
    refused(
        "type-text",
        "hall.toml",
        "width_m",
        "width_m = \"wide\"",
        expect![[r#"config/hall.toml: width_m = "wide": invalid type: string "wide", expected f64"#]],
    );
    refused(
        "type-id",
        "vehicles/v01.toml",
        "id",
        "id = 300",
        expect!["config/vehicles/v01.toml: id = 300: invalid value: integer `300`, expected u8"],
    );
    refused(
        "type-address",
        "network.toml",
        "interface",
        "interface = \"localhost\"",
        expect![[
            r#"config/network.toml: interface = "localhost": "localhost" is neither an IPv4 address nor a network like "10.0.0.0/24""#
        ]],
    );
    refused(
        "type-choice",
        "vehicles/kinds/hummingbird.toml",
        "integral",
        "integral = \"none\"",
        expect![[
            r#"config/vehicles/kinds/hummingbird.toml: rate_loop.integral = "none": unknown variant `none`, expected `literal` or `conditional`"#
        ]],
    );
}

#[test]
fn a_number_out_of_range_is_refused() {
    refused(
        "range-hall",
        "hall.toml",
        "width_m",
        "width_m = 1.0",
        expect!["config/hall.toml: width_m = 1, but it must lie within 2 and 200"],
    );
    refused(
        "range-margin",
        "hall.toml",
        "margin_m",
        "margin_m = 4.5",
        expect!["config/hall.toml: margin_m = 4.5, but it must lie within 0.1 and 4"],
    );
    refused(
        "range-ttl",
        "network.toml",
        "ttl",
        "ttl = 2",
        expect!["config/network.toml: ttl = 2, but it must lie within 0 and 1"],
    );
    refused(
        "range-flips",
        "scenarios/double-flip.toml",
        "flips",
        "flips = 0",
        expect!["config/scenarios/double-flip.toml: flip.flips = 0, but it must lie within 1 and 10"],
    );
    refused(
        "range-id",
        "vehicles/v01.toml",
        "id",
        "id = 0",
        expect!["config/vehicles/v01.toml: id = 0, but it must lie within 1 and 254"],
    );
    refused(
        "range-address",
        "vehicles/v01.toml",
        "data_address",
        "data_address = 0xFFFE",
        expect!["config/vehicles/v01.toml: links.data_address = 65534, but it must lie within 0 and 65533"],
    );
}

#[test]
fn what_is_not_a_number_is_refused_wherever_it_stands() {
    for (file, keys) in [
        ("hall.toml", vec!["width_m", "depth_m", "height_m", "margin_m"]),
        (
            "scenarios/double-flip.toml",
            vec![
                "design_rate_rad_s",
                "flown_rate_rad_s",
                "envelope_margin_ratio",
                "step_size_ratio",
                "start_x_m",
                "start_y_m",
                "place_x_m",
                "place_y_m",
                "place_z_m",
                "heading_rad",
            ],
        ),
    ] {
        for key in keys {
            for value in ["nan", "inf", "-inf"] {
                let folder = Folder::new("not-a-number");
                let text = folder.set(file, key, &format!("{key} = {value}")).refusal("double-flip");
                assert!(text.contains(&format!("{key} = ")) && text.contains("must lie within"), "{text}");
            }
        }
    }
}

/// Every number of a vehicle, found in what is shipped, so that none that is added later is forgotten.
#[test]
fn no_number_of_a_vehicle_may_be_nan_or_infinite() {
    let kind = "vehicles/kinds/hummingbird.toml";
    let shipped = std::fs::read_to_string(crate::folder::shipped().join(kind)).unwrap();
    let mut tried = 0;
    for (number, line) in shipped.lines().enumerate() {
        let Some((key, value)) = line.split_once('=') else { continue };
        let value = value.split('#').next().unwrap_or_default().trim();
        let first = value.trim_start_matches('[');
        if !first.starts_with(|c: char| c.is_ascii_digit())
            || value.starts_with("0x")
            || line.starts_with('#')
        {
            continue;
        }
        let (first, rest) = first.split_at(first.find([',', ']']).unwrap_or(first.len()));
        let opening = if value.starts_with('[') { "[" } else { "" };
        assert!(first.parse::<f64>().is_ok(), "{line}");
        for not in ["nan", "inf", "-inf"] {
            let spoilt: Vec<String> = shipped
                .lines()
                .enumerate()
                .map(
                    |(at, old)| {
                        if at == number { format!("{key}= {opening}{not}{rest}") } else { old.to_owned() }
                    },
                )
                .collect();
            let folder = Folder::new("vehicle-nan");
            let text = folder.write(kind, &spoilt.join("\n")).refusal("double-flip");
            let expected = format!(".{} = ", key.trim());
            assert!(text.contains(&expected) && text.contains("hummingbird.toml"), "{key}= {not}: {text}");
            tried += 1;
        }
    }
    assert!(tried > 150, "only {tried} values were tried");
}

#[test]
fn two_settings_that_contradict_each_other_are_refused_with_both() {
    let kind = "vehicles/kinds/hummingbird.toml";
    refused(
        "pair-thrust",
        kind,
        "thrust_n_min",
        "thrust_n_min = 1.5",
        expect![
            "config/vehicles/kinds/hummingbird.toml: rotor.thrust_n_min = 1.5 does not go with rotor.thrust_n_max = 2.8: it must not be above 0.5 of it"
        ],
    );
    refused(
        "pair-volts",
        kind,
        "flip_v_min",
        "flip_v_min = 9.0",
        expect![
            "config/vehicles/kinds/hummingbird.toml: battery.land_v_min = 9.65 does not go with battery.flip_v_min = 9: it must not be above it"
        ],
    );
    refused(
        "pair-battery",
        kind,
        "empty_v",
        "empty_v = 13.0",
        expect![
            "config/vehicles/kinds/hummingbird.toml: plant.battery.empty_v = 13 does not go with plant.battery.full_v = 12.6: it must not be above it"
        ],
    );
    refused(
        "pair-rates",
        "scenarios/double-flip.toml",
        "flown_rate_rad_s",
        "flown_rate_rad_s = 13.0",
        expect![
            "config/scenarios/double-flip.toml: flip.design_rate_rad_s = 27.925268 does not go with flip.flown_rate_rad_s = 13: it must not be above 2 of it"
        ],
    );
    refused(
        "pair-gyro",
        kind,
        "range_rad_s",
        "range_rad_s = 25.0",
        expect![
            "config/scenarios/double-flip.toml: flip.flown_rate_rad_s = 27.925268 does not go with v01.plant.gyro.range_rad_s = 25: the gyros must be able to read the rate"
        ],
    );
    let network = "network.toml";
    refused(
        "pair-groups",
        network,
        "group",
        "group = \"239.255.71.1\"",
        expect![
            "config/network.toml: live = 239.255.71.1:47101 does not go with sim = 239.255.71.1:47102: each domain needs a group and a port of its own"
        ],
    );
    refused(
        "pair-multicast",
        network,
        "group",
        "group = \"10.0.0.1\"",
        expect!["config/network.toml: live.group = 10.0.0.1 is not a multicast address (224.0.0.0/4)"],
    );
}

/// `network.toml` with one piece of its text changed.
fn network(name: &str, from: &str, to: &str, words: Expect) {
    let shipped = std::fs::read_to_string(crate::folder::shipped().join("network.toml")).unwrap();
    assert!(shipped.contains(from), "{from:?} is not shipped");
    let folder = Folder::new(name);
    words.assert_eq(&folder.write("network.toml", &shipped.replace(from, to)).refusal("double-flip"));
}

#[test]
fn a_device_that_cannot_be_there_is_refused() {
    network(
        "device-port",
        "udp://127.0.0.1:51001",
        "udp://127.0.0.1:0",
        expect![[
            r#"config/network.toml: devices.motion_capture.url = "udp://127.0.0.1:0": "udp://127.0.0.1:0" is no device: port 0 is nobody's"#
        ]],
    );
    network(
        "device-scheme",
        "udp://127.0.0.1:51001",
        "127.0.0.1:51001",
        expect![[
            r#"config/network.toml: devices.motion_capture.url = "127.0.0.1:51001": "127.0.0.1:51001" is no device: it begins with none of udp://, serial://, pty:, radio://"#
        ]],
    );
    network(
        "device-cameras",
        "udp://127.0.0.1:51001",
        "pty:cameras",
        expect![[
            r#"config/network.toml: devices.motion_capture.url = "pty:cameras": motion capture comes in datagrams, so it needs udp://"#
        ]],
    );
    network(
        "device-data",
        "udp://127.0.0.1:52000",
        "radio://0/80/2M/E7E7E7E7E7",
        expect![[
            r#"config/network.toml: devices.data_link.url = "radio://0/80/2M/E7E7E7E7E7": the data link is an XBee module: udp://, serial:// or pty:"#
        ]],
    );
    network(
        "device-encoder",
        "udp://127.0.0.1:52100",
        "radio://0/80/2M/E7E7E7E7{id}",
        expect![[
            r#"config/network.toml: devices.command_link.url = "radio://0/80/2M/E7E7E7E7{id}": the command link has encoders: udp://, serial:// or pty:"#
        ]],
    );
    network(
        "device-crazyflie",
        "udp://127.0.0.1:19849",
        "pty:crazyflie-{id}",
        expect![[
            r#"config/network.toml: devices.crazyflie.url = "pty:crazyflie-{id}": a Crazyflie is reached by radio:// or, simulated, by udp://"#
        ]],
    );
    network(
        "device-protocol",
        "\"sbus\"",
        "\"ppm\"",
        expect![[
            r#"config/network.toml: devices.command_link.protocol = "ppm": unknown variant `ppm`, expected `sbus` or `crsf`"#
        ]],
    );
    network(
        "device-bits",
        "channel_bits = 11",
        "channel_bits = 12",
        expect![
            "config/network.toml: devices.command_link.channel_bits = 12: a channel has 10 or 11 bits, not 12"
        ],
    );
    network(
        "device-pair",
        "udp://127.0.0.1:52100",
        "udp://127.0.0.1:51000",
        expect![
            "config/network.toml: devices.command_link.url = udp://127.0.0.1:51000 does not go with devices.motion_capture.url = udp://127.0.0.1:51001: that is where vehicle 1's radio is"
        ],
    );
    network(
        "device-last-port",
        "udp://127.0.0.1:52100",
        "udp://127.0.0.1:65535",
        expect![[
            r#"config/network.toml: devices.command_link.url = "udp://127.0.0.1:65535": 127.0.0.1:65535 plus a vehicle's id of 1 is beyond port 65535"#
        ]],
    );
    let group = "51001\"\nnatnet = { group = \"10.0.0.1:1511\" }";
    network(
        "device-group",
        "51001\"",
        group,
        expect![[
            r#"config/network.toml: devices.motion_capture.natnet.group = "10.0.0.1:1511": that is no multicast address (224.0.0.0/4) and port"#
        ]],
    );
}

#[test]
fn a_fleet_needs_a_command_link_each() {
    let shipped = std::fs::read_to_string(crate::folder::shipped().join("network.toml")).unwrap();
    let one_line = shipped.replace("udp://127.0.0.1:52100", "serial:///dev/ttyUSB0?baud=100000");
    let folder = Folder::new("device-fleet");
    folder.write("network.toml", &one_line).load("double-flip").unwrap();
    expect!["config/network.toml: devices.command_link.url = serial:///dev/ttyUSB0?baud=100000 does not go with the radio of vehicle 1 = serial:///dev/ttyUSB0?baud=100000: that is where vehicle 2's radio is; {id} stands for a vehicle's id"].assert_eq(&folder.refusal("fleet"));
    folder.write("network.toml", &one_line.replace("ttyUSB0", "link-{id}")).load("fleet").unwrap();
}

/// The fleet with one line of its second vehicle changed.
fn fleet(name: &str, file: &str, key: &str, line: &str, words: Expect) {
    let folder = Folder::new(name);
    words.assert_eq(&folder.set(file, key, line).refusal("fleet"));
}

#[test]
fn vehicles_that_cannot_be_told_apart_are_refused() {
    fleet(
        "same-id",
        "vehicles/v02.toml",
        "id",
        "id = 1",
        expect![
            "config/scenarios/fleet.toml: v02.id = 1 does not go with v01.id = 1: each vehicle of a scenario needs its own"
        ],
    );
    fleet(
        "same-subject",
        "vehicles/v02.toml",
        "subject",
        "subject = \"quad1\"",
        expect![
            "config/scenarios/fleet.toml: v02.subject = quad1 does not go with v01.subject = quad1: each vehicle of a scenario needs its own"
        ],
    );
    fleet(
        "same-address",
        "vehicles/v02.toml",
        "data_address",
        "data_address = 0x5001",
        expect![
            "config/scenarios/fleet.toml: v02.links.data_address = 20481 does not go with v01.links.data_address = 20481: each vehicle of a scenario needs its own"
        ],
    );
    fleet(
        "same-file",
        "scenarios/fleet.toml",
        "file",
        "file = \"v01\"",
        expect![
            "config/scenarios/fleet.toml: v01.id = 1 does not go with v01.id = 1: each vehicle of a scenario needs its own"
        ],
    );
    fleet(
        "no-file",
        "scenarios/fleet.toml",
        "file",
        "file = \"v99\"",
        expect![[
            r#"config/scenarios/fleet.toml: vehicle.file = "v99", but there is only cf1, v01, v02, v03, v04, v05, v06, v07, v08, v09, v10, v11"#
        ]],
    );
}

#[test]
fn a_place_outside_the_hall_or_too_near_another_is_refused() {
    let scenario = "scenarios/double-flip.toml";
    refused(
        "outside-x",
        scenario,
        "place_x_m",
        "place_x_m = 4.6",
        expect![
            "config/scenarios/double-flip.toml: vehicle v01.place_x_m = 4.6, but it must lie within -4.5 and 4.5"
        ],
    );
    refused(
        "outside-z",
        scenario,
        "place_z_m",
        "place_z_m = 9.9",
        expect![
            "config/scenarios/double-flip.toml: vehicle v01.place_z_m = 9.9, but it must lie within 0.5 and 9.5"
        ],
    );
    refused(
        "outside-start",
        scenario,
        "start_y_m",
        "start_y_m = -5.0",
        expect![
            "config/scenarios/double-flip.toml: vehicle v01.start_y_m = -5, but it must lie within -4.5 and 4.5"
        ],
    );
    fleet(
        "near-place",
        "scenarios/fleet.toml",
        "place_y_m",
        "place_y_m = 1.0",
        expect![
            "config/scenarios/fleet.toml: vehicle v02.place_x_m, place_y_m = (0, 1) does not go with vehicle v01.place_x_m, place_y_m = (0, 1): two vehicles need 3 m between their places, seen from above"
        ],
    );
    fleet(
        "near-start",
        "scenarios/fleet.toml",
        "start_y_m",
        "start_y_m = 1.0",
        expect![
            "config/scenarios/fleet.toml: vehicle v02.start_x_m, start_y_m = (0, 1) does not go with vehicle v01.start_x_m, start_y_m = (0, 1): two vehicles need 1 m between their starts, seen from above"
        ],
    );
}

#[test]
fn a_scenario_needs_a_vehicle_and_has_room_for_sixteen() {
    let head = "description = \"\"\n[flip]\nflips = 1\ndesign_rate_rad_s = 20.0\nflown_rate_rad_s = 20.0\n\
                envelope_margin_ratio = 0.1\nstep_size_ratio = 0.1\niterations = 1\n";
    let folder = Folder::new("no-vehicle");
    folder.write("scenarios/none.toml", &format!("vehicle = []\n{head}"));
    expect!["config/scenarios/none.toml: vehicle (how many) = 0, but it must lie within 1 and 16"]
        .assert_eq(&folder.refusal("none"));
    let part = "[[vehicle]]\nfile = \"v01\"\nstart_x_m = 0\nstart_y_m = 0\nplace_x_m = 0\nplace_y_m = 0\nplace_z_m = 5\n\
                heading_rad = 0\n";
    folder.write("scenarios/many.toml", &format!("{head}{}", part.repeat(17)));
    expect!["config/scenarios/many.toml: vehicle (how many) = 17, but it must lie within 1 and 16"]
        .assert_eq(&folder.refusal("many"));
}
