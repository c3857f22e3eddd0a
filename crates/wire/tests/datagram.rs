//! Datagrams: the layout, who may say what, and everything that must be refused.

use expect_test::expect;
use proptest::prelude::*;
use quantity::Time;
use wire::{
    BODY_BYTES_MAX, Domain, DropReason, HEADER_BYTES, Header, Keyring, Kind, Malformed, Role, SealError,
    Secret, SigningKey, TAG_BYTES, TopicName, VerifyKey, Windows, open, seal,
};

const RUN: u64 = 0x1122_3344_5566_7788;
const ROLE: Role = Role("hover-controller");

fn secret() -> Secret {
    Secret::new(core::array::from_fn(|i| i as u8))
}

fn signing_key() -> SigningKey {
    SigningKey::derive(&secret(), Domain::Sim, RUN, ROLE)
}

fn verify_key() -> VerifyKey {
    VerifyKey::derive(&secret(), Domain::Sim, RUN, ROLE)
}

fn topic() -> TopicName<'static> {
    TopicName::new("vehicle/command").expect("a valid name")
}

fn header() -> Header {
    Header {
        kind: Kind::Data,
        domain: Domain::Sim,
        latched: true,
        source: 0xaabb_ccdd,
        schema_id: 0x0102_0304_0506_0708,
        run: RUN,
        incarnation: 3,
        sequence: 42,
        published_at: Time::from_nanos(1_000_000_007),
    }
}

fn sealed(header: &Header, body: &[u8]) -> Vec<u8> {
    let mut datagram = Vec::new();
    seal(header, topic(), body, &signing_key(), &mut datagram).expect("it can be sealed");
    datagram
}

/// All checks in their order, for one who has heard nothing before.
fn receive(datagram: &[u8], key: &VerifyKey) -> Result<(Header, Vec<u8>), DropReason> {
    let fresh = open(datagram)?.verify(key)?.fresh(&mut Windows::new())?;
    Ok((*fresh.header(), fresh.body().to_vec()))
}

fn hex(bytes: &[u8]) -> String {
    let lines = bytes
        .chunks(16)
        .map(|line| line.iter().map(|byte| format!("{byte:02x}")).collect::<Vec<_>>().join(" "));
    lines.collect::<Vec<_>>().join("\n")
}

/// The tag was checked against an independent implementation of BLAKE3, written from its paper.
#[test]
fn golden_datagram() {
    let datagram = sealed(&header(), b"body");
    expect![[r#"
        46 4d 01 00 02 01 0f 00 c9 8b e7 7e dd cc bb aa
        08 07 06 05 04 03 02 01 88 77 66 55 44 33 22 11
        03 00 00 00 00 00 00 00 2a 00 00 00 00 00 00 00
        07 ca 9a 3b 00 00 00 00 76 65 68 69 63 6c 65 2f
        63 6f 6d 6d 61 6e 64 62 6f 64 79 cf 3e 53 3d c7
        eb af f1 76 e1 3d ca 9b 1e 9b 92"#]]
    .assert_eq(&hex(&datagram));
    assert_eq!(receive(&datagram, &verify_key()), Ok((header(), b"body".to_vec())));
}

#[test]
fn every_single_bit_flip_is_refused() {
    let datagram = sealed(&header(), b"a command that must not change");
    let key = verify_key();
    for bit in 0..datagram.len() * 8 {
        let mut flipped = datagram.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        assert!(receive(&flipped, &key).is_err(), "bit {bit}");
    }
}

#[test]
fn every_other_length_is_refused() {
    let datagram = sealed(&header(), b"a command that must not change");
    let key = verify_key();
    for length in 0..datagram.len() {
        assert!(receive(&datagram[..length], &key).is_err(), "cut to {length}");
    }
    for more in 1..=64 {
        let longer = [&datagram[..], &vec![0; more]].concat();
        assert!(receive(&longer, &key).is_err(), "{more} longer");
    }
}

#[test]
fn a_replayed_datagram_is_refused() {
    let datagram = sealed(&header(), b"once");
    let (key, mut windows) = (verify_key(), Windows::new());
    let mut take = |datagram: &[u8]| -> Result<(), DropReason> {
        open(datagram)?.verify(&key)?.fresh(&mut windows).map(|_| ())
    };
    assert_eq!(take(&datagram), Ok(()));
    assert_eq!(take(&datagram), Err(DropReason::Replayed));
    assert_eq!(take(&sealed(&Header { sequence: 41, ..header() }, b"late")), Ok(()));
    assert_eq!(take(&sealed(&Header { incarnation: 4, sequence: 0, ..header() }, b"restarted")), Ok(()));
    assert_eq!(take(&sealed(&Header { sequence: 43, ..header() }, b"the past")), Err(DropReason::Replayed));
}

/// Any node can sign a definition; with one it must not be able to make another's commands look old.
#[test]
fn a_schema_does_not_move_the_window_of_the_topics_messages() {
    let mut windows = Windows::new();
    let node = SigningKey::derive(&secret(), Domain::Sim, RUN, Role::NODE);
    let node_verify = VerifyKey::derive(&secret(), Domain::Sim, RUN, Role::NODE);
    let ahead = Header { kind: Kind::Schema, incarnation: u32::MAX, sequence: u64::MAX, ..header() };
    let mut datagram = Vec::new();
    seal(&ahead, topic(), b"definition", &node, &mut datagram).expect("it can be sealed");
    let opened = open(&datagram).expect("well formed");
    assert!(opened.verify(&node_verify).expect("authentic").fresh(&mut windows).is_ok());
    let command = sealed(&header(), b"command");
    let opened = open(&command).expect("well formed");
    assert!(opened.verify(&verify_key()).expect("authentic").fresh(&mut windows).is_ok());
}

#[test]
fn a_node_of_one_domain_or_run_cannot_verify_anothers_messages() {
    let datagram = sealed(&header(), b"simulated");
    let live = VerifyKey::derive(&secret(), Domain::Live, RUN, ROLE);
    assert_eq!(receive(&datagram, &live), Err(DropReason::Domain));
    let other_run = VerifyKey::derive(&secret(), Domain::Sim, RUN + 1, ROLE);
    assert_eq!(receive(&datagram, &other_run), Err(DropReason::Run));
    // The header's own word counts for nothing: with domain and run rewritten the tag still tells.
    let mut rewritten = datagram.clone();
    rewritten[4] = Domain::Live as u8;
    assert_eq!(receive(&rewritten, &live), Err(DropReason::Unauthentic));
    let mut rewritten = datagram;
    rewritten[24..32].copy_from_slice(&(RUN + 1).to_le_bytes());
    assert_eq!(receive(&rewritten, &other_run), Err(DropReason::Unauthentic));
}

#[test]
fn whoever_lacks_the_key_cannot_forge_a_command() {
    let logger = Keyring::new(&secret(), Domain::Sim, RUN, Role("logger"), [Role("estimator")]);
    assert!(logger.verify_key(ROLE).is_none(), "a logger is not given the command key");
    for key in
        [logger.own(), logger.node(), &SigningKey::derive(&Secret::new([9; 32]), Domain::Sim, RUN, ROLE)]
    {
        let mut forged = Vec::new();
        seal(&header(), topic(), b"forged", key, &mut forged).expect("it can be sealed");
        assert_eq!(receive(&forged, &verify_key()), Err(DropReason::Unauthentic));
    }
}

#[test]
fn a_keyring_signs_and_verifies_what_its_topics_need() {
    let bridge =
        Keyring::new(&secret(), Domain::Sim, RUN, Role("radio-bridge"), [Role::of(Kind::Data, ROLE.0)]);
    let datagram = sealed(&header(), b"command");
    let key = bridge.verify_key(ROLE).expect("the bridge reads commands");
    assert!(receive(&datagram, key).is_ok());
    let mut health = Vec::new();
    seal(&header(), topic(), b"fine", bridge.node(), &mut health).expect("it can be sealed");
    assert!(receive(&health, bridge.verify_key(Role::NODE).expect("every node reads these")).is_ok());
    assert_eq!(Role::of(Kind::Data, "*"), Role::NODE);
    for kind in [Kind::Schema, Kind::SchemaRequest, Kind::Journal] {
        assert_eq!(Role::of(kind, ROLE.0), Role::NODE);
    }
}

#[test]
fn what_cannot_be_sent_is_said() {
    let key = signing_key();
    let mut out = vec![1, 2, 3];
    let mut refused = |header: Header, body: &[u8]| {
        let error = seal(&header, topic(), body, &key, &mut out).expect_err("it must be refused");
        assert!(out.is_empty());
        error
    };
    assert_eq!(refused(Header { domain: Domain::Live, ..header() }, b""), SealError::ForeignKey);
    assert_eq!(refused(Header { run: RUN + 1, ..header() }, b""), SealError::ForeignKey);
    let early = Header { published_at: Time::from_nanos(-5), ..header() };
    assert_eq!(refused(early, b""), SealError::PublishTime { nanos: -5 });
    let long = vec![0; BODY_BYTES_MAX + 1];
    assert_eq!(refused(header(), &long), SealError::BodyTooLong { length: BODY_BYTES_MAX + 1 });
    assert_eq!(TopicName::new(""), None);
    assert_eq!(TopicName::new(&"x".repeat(256)), None);
}

#[test]
fn malformed_datagrams_say_what_was_found() {
    let good = sealed(&header(), b"body");
    let with = |at: usize, bytes: &[u8]| {
        let mut bad = good.clone();
        bad[at..at + bytes.len()].copy_from_slice(bytes);
        open(&bad).expect_err("it must be refused")
    };
    assert_eq!(with(0, b"FN"), Malformed::Magic { found: *b"FN" });
    assert_eq!(with(2, &[2]), Malformed::Version { found: 2 });
    assert_eq!(with(3, &[4]), Malformed::Unknown { field: "kind", found: 4 });
    assert_eq!(with(4, &[0]), Malformed::Unknown { field: "domain", found: 0 });
    assert_eq!(with(5, &[2]), Malformed::Unknown { field: "flags", found: 2 });
    assert_eq!(with(7, &[1]), Malformed::Reserved);
    assert_eq!(with(39, &[1]), Malformed::Reserved);
    assert_eq!(with(48, &[0xff; 8]), Malformed::PublishTime { found: u64::MAX });
    assert_eq!(with(56, &[0xff]), Malformed::TopicText);
    assert_eq!(with(6, &[0]), Malformed::Unknown { field: "topic length", found: 0 });
    let needed = HEADER_BYTES + 255 + TAG_BYTES;
    assert_eq!(with(6, &[255]), Malformed::Short { length: good.len(), needed });
    assert!(matches!(with(56, b"V"), Malformed::TopicHash { .. }));
    let long = [&good[..], &vec![0; BODY_BYTES_MAX]].concat();
    assert_eq!(open(&long).expect_err("it must be refused"), Malformed::Long { length: BODY_BYTES_MAX + 4 });
}

#[test]
fn secrets_and_keys_are_never_printed() {
    assert_eq!(format!("{:?}", secret()), "Secret(..)");
    assert_eq!(format!("{:?}", signing_key()), "SigningKey(sim, run 1122334455667788, ..)");
    assert_eq!(format!("{:?}", verify_key()), "VerifyKey(sim, run 1122334455667788, ..)");
}

#[test]
fn a_secret_file_holds_32_bytes() {
    assert!(Secret::from_file_bytes(&[7; 32]).is_ok());
    for length in [0, 31, 33, 64] {
        let error = Secret::from_file_bytes(&vec![7; length]).expect_err("it must be refused");
        assert_eq!(error.length, length);
    }
}

fn kinds() -> impl Strategy<Value = Kind> {
    prop::sample::select(vec![Kind::Data, Kind::Schema, Kind::SchemaRequest, Kind::Journal])
}

fn domains() -> impl Strategy<Value = Domain> {
    prop::sample::select(vec![Domain::Live, Domain::Sim, Domain::Replay])
}

prop_compose! {
    fn headers()(
        kind in kinds(), domain in domains(), latched in any::<bool>(),
        (source, schema_id, run, incarnation, sequence) in any::<(u32, u64, u64, u32, u64)>(),
        nanos in 0..=i64::MAX,
    ) -> Header {
        let published_at = Time::from_nanos(nanos);
        Header { kind, domain, latched, source, schema_id, run, incarnation, sequence, published_at }
    }
}

proptest! {
    #[test]
    fn every_datagram_comes_back_as_it_went(
        header in headers(), name in "[a-z/é-]{1,60}", body in prop::collection::vec(any::<u8>(), 0..2000),
    ) {
        let topic = TopicName::new(&name).expect("a valid name");
        let key = SigningKey::derive(&secret(), header.domain, header.run, ROLE);
        let mut datagram = Vec::new();
        seal(&header, topic, &body, &key, &mut datagram).expect("it can be sealed");
        prop_assert_eq!(datagram.len(), HEADER_BYTES + name.len() + body.len() + TAG_BYTES);
        let opened = open(&datagram).expect("well formed");
        prop_assert_eq!(opened.topic(), topic);
        let verify = VerifyKey::derive(&secret(), header.domain, header.run, ROLE);
        prop_assert_eq!(receive(&datagram, &verify), Ok((header, body)));
    }

    #[test]
    fn arbitrary_bytes_are_refused(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        prop_assert!(receive(&bytes, &verify_key()).is_err());
    }

    /// Bytes that get past the first checks, so that the later ones are reached too.
    #[test]
    fn arbitrary_bytes_behind_a_good_start_are_refused(
        length in 0..40_u8, bytes in prop::collection::vec(any::<u8>(), 0..200),
    ) {
        let start = [b'F', b'M', 1, 0, 2, 0, length, 0];
        prop_assert!(receive(&[&start[..], &bytes].concat(), &verify_key()).is_err());
    }
}
