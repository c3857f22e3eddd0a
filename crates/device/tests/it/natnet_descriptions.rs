//! NatNet's model definitions and requests against the `natnet` crate.

use device::natnet::{ModelDefinition, Request, RigidBodyName, Version, encode_model_definition};
use natnet as oracle;
use oracle::command::{ConnectOptions, connect_request, connect_request_with, request_modeldef};
use oracle::modeldef::MarkerDef;
use oracle::{
    AssetDef, CameraDef, DataSet, Decoder, DeviceDef, ForcePlateDef, MarkerSetDef, Message, ModelDef,
    RigidBodyDef, SkeletonDef,
};
use proptest::prelude::*;

use crate::natnet::{any_version, their_version};
use crate::random::Random;

type Names = Vec<(String, i32)>;

fn names(version: Version, bytes: &[u8]) -> Option<Names> {
    let model = ModelDefinition::decode(version, bytes).ok()?;
    let text = |body: RigidBodyName<'_>| (String::from_utf8_lossy(body.name).into_owned(), body.id);
    Some(model.rigid_bodies().map(text).collect())
}

fn their_names(version: Version, bytes: &[u8]) -> Option<Names> {
    match Decoder::new(their_version(version)).unwrap().parse(bytes).ok()?.into_message() {
        Message::ModelDef(model) => {
            Some(model.rigid_bodies().map(|(name, id)| (name.to_owned(), id)).collect())
        }
        _ => None,
    }
}

fn some<T>(random: &mut Random, mut make: impl FnMut(&mut Random) -> T) -> Vec<T> {
    (0..random.below(4)).map(|_| make(random)).collect()
}

fn name(random: &mut Random) -> String {
    "quad1quad22".chars().cycle().skip(random.below(9)).take(random.below(12)).collect()
}

fn body(random: &mut Random, version: Version) -> RigidBodyDef {
    let markers = random.below(4);
    let mut tail = (markers as i32).to_le_bytes().to_vec();
    tail.extend((0..markers * 16).map(|_| random.next() as u8));
    if version >= Version::V4_0 {
        for _ in 0..markers {
            tail.extend(name(random).bytes().chain([0]));
        }
    }
    RigidBodyDef { name: name(random), id: random.next() as i32, parent_id: -1, offset: [0.5; 3], tail }
}

fn data_set(random: &mut Random, version: Version) -> DataSet {
    let id = random.next() as i32;
    match random.below(9) {
        0 => DataSet::MarkerSet(MarkerSetDef { name: name(random), marker_names: some(random, name) }),
        1 => DataSet::Skeleton(SkeletonDef {
            name: name(random),
            id,
            rigid_bodies: some(random, |random| body(random, version)),
        }),
        2 => DataSet::ForcePlate(Box::new(ForcePlateDef {
            id,
            serial_number: name(random),
            width: 0.5,
            length: 0.6,
            origin: [0.0; 3],
            calibration_matrix: [[1.0; 12]; 12],
            corners: [[2.0; 3]; 4],
            plate_type: 1,
            channel_data_type: 2,
            channel_names: some(random, name),
        })),
        3 => DataSet::Device(DeviceDef {
            id,
            name: name(random),
            serial_number: name(random),
            device_type: 1,
            channel_data_type: 2,
            channel_names: some(random, name),
        }),
        4 => DataSet::Camera(CameraDef { name: name(random), position: [1.0; 3], orientation: [0.5; 4] }),
        5 => DataSet::Asset(AssetDef {
            name: name(random),
            asset_type: 1,
            id,
            rigid_bodies: some(random, |random| body(random, version)),
            markers: some(random, |random| MarkerDef {
                name: name(random),
                id: 1,
                position: [0.0; 3],
                size: 0.01,
                params: 1,
            }),
        }),
        6 if version == Version::V4_1 => DataSet::Other { type_id: 99, body: random.bytes(20) },
        _ => DataSet::RigidBody(body(random, version)),
    }
}

fn any_model(version: Version, random: &mut Random) -> Vec<u8> {
    let count = random.below(8);
    let datasets = (0..count).map(|_| data_set(random, version)).collect();
    ModelDef { datasets }.to_datagram(their_version(version)).unwrap()
}

#[test]
fn what_they_write_of_all_kinds_we_read() {
    let (mut random, mut bodies) = (Random::new(7), 0);
    for round in 0..4_000 {
        let version = Version::ALL[round % 4];
        let bytes = any_model(version, &mut random);
        let found = names(version, &bytes).unwrap();
        assert_eq!(Some(&found), their_names(version, &bytes).as_ref(), "round {round}, {version}");
        bodies += found.len();
    }
    assert!(bodies > 4_000);
}

/// Before 4.1 both walk every byte, so both refuse the same definitions. In 4.1 we step over by sizes what
/// they look into, so what they accept we accept.
#[test]
fn we_agree_on_which_damaged_definitions_are_none() {
    let (mut random, mut accepted) = (Random::new(8), 0);
    for round in 0..40_000 {
        let version = Version::ALL[round % 4];
        let mut bytes = any_model(version, &mut random);
        for _ in 0..=random.below(2) {
            let at = 4 + random.below(bytes.len() - 4);
            bytes[at] = [0, 1, 2, 4, 0xFF, random.next() as u8][random.below(6)];
        }
        let (ours, theirs) = (names(version, &bytes), their_names(version, &bytes));
        if version == Version::V4_1 && theirs.is_none() {
            continue;
        }
        assert_eq!(ours, theirs, "{version}: {bytes:02x?}");
        accepted += u32::from(ours.is_some());
    }
    assert!((5_000..38_000).contains(&accepted), "{accepted}");
}

proptest! {
    #[test]
    fn what_we_write_they_read(
        version in any_version(), bodies in prop::collection::vec(("[!-~]{0,30}", any::<i32>()), 0..12),
    ) {
        let ours: Vec<RigidBodyName<'_>> =
            bodies.iter().map(|(name, id)| RigidBodyName { id: *id, name: name.as_bytes() }).collect();
        let mut out = [0; 2_000];
        let length = encode_model_definition(version, &ours, &mut out).unwrap();
        prop_assert_eq!(their_names(version, &out[..length]), Some(bodies.clone()));
        prop_assert_eq!(names(version, &out[..length]), Some(bodies));
    }
}

#[test]
fn requests_both_ways() {
    let mut out = [0; 300];
    for version in Version::ALL {
        let options = ConnectOptions::requesting(their_version(version));
        let request = Request::connect(version);
        assert_eq!(Request::decode(connect_request_with(options).unwrap().as_bytes()), Ok(request));
        let length = request.encode(&mut out).unwrap();
        assert_eq!(ConnectOptions::parse(&out[4..length]), Some(options));
    }
    let any = Request::Connect { natnet_version: None };
    assert_eq!(Request::decode(connect_request().unwrap().as_bytes()), Ok(any));
    let length = any.encode(&mut out).unwrap();
    assert_eq!(ConnectOptions::parse(&out[4..length]), Some(ConnectOptions::default()));
    let model = request_modeldef().unwrap();
    assert_eq!(Request::decode(model.as_bytes()), Ok(Request::ModelDefinition));
    let length = Request::ModelDefinition.encode(&mut out).unwrap();
    assert_eq!(out[..length], *model.as_bytes());
    for (request, bytes) in [
        (Request::KeepAlive, oracle::command::keepalive_datagram()),
        (Request::Disconnect, oracle::command::disconnect_datagram()),
    ] {
        assert_eq!(Request::decode(&bytes), Ok(request));
        assert_eq!(request.encode(&mut out), Ok(4));
        assert_eq!(out[..4], bytes);
    }
}
