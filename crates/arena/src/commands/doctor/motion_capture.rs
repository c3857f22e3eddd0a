//! Motion capture: whether frames come, how many, and of whom.

use std::collections::BTreeSet;
use std::io;

use device::natnet::{
    MESSAGE_MODEL_DEFINITION, MESSAGE_SERVER_INFO, ModelDefinition, Request, ServerInfo, Version,
    message_number,
};
use device::vicon;
use quantity::Span;
use settings::{Arena, DeviceUrl, MotionCaptureProtocol};

use super::cable::Cable;
use super::finding::Finding;

const NAME: &str = "motion capture";
const LISTENING: Span = Span::from_secs(1);
const ANSWER_MAX: Span = Span::from_millis(500);
/// The estimator coasts over gaps of so many frames a second, but flips need more.
const FRAMES_A_SECOND_MIN: usize = 95;

/// What came of a stream within a second.
#[derive(Debug, Default, PartialEq, Eq)]
struct Stream {
    frames: BTreeSet<u32>,
    datagrams: usize,
    undecodable: usize,
    subjects: BTreeSet<String>,
}

/// What a NatNet server says of itself.
#[derive(Debug, Default, PartialEq, Eq)]
struct Server {
    program: String,
    version: [u8; 4],
    bodies: Option<BTreeSet<String>>,
}

/// Looks at the motion-capture system of the settings.
pub fn check(arena: &Arena) -> Finding {
    let capture = &arena.network.devices.motion_capture;
    let wanted: BTreeSet<String> = arena.fleet.iter().map(|member| member.vehicle.subject.clone()).collect();
    match (capture.protocol, &capture.url) {
        (MotionCaptureProtocol::Vicon, DeviceUrl::Udp(at)) => {
            judge_stream(&at.to_string(), &wanted, Cable::from(*at).and_then(|mut cable| stream(&mut cable)))
        }
        (MotionCaptureProtocol::Natnet, url @ DeviceUrl::Udp(_)) => {
            judge_server(&url.to_string(), &wanted, Cable::to(url).and_then(|mut cable| server(&mut cable)))
        }
        (_, url) => {
            Finding::fail(NAME, format!("{url} is no place for it"), "set its url to udp://ADDRESS:PORT")
        }
    }
}

fn stream(cable: &mut Cable) -> io::Result<Stream> {
    let mut stream = Stream::default();
    cable.listen(LISTENING, |bytes| {
        stream.datagrams += 1;
        match vicon::Datagram::decode(bytes) {
            Ok(datagram) => {
                stream.frames.insert(datagram.frame_number);
                let names =
                    datagram.objects().map(|object| String::from_utf8_lossy(object.name).into_owned());
                stream.subjects.extend(names);
            }
            Err(_) => stream.undecodable += 1,
        }
        false
    })?;
    Ok(stream)
}

fn server(cable: &mut Cable) -> io::Result<Option<Server>> {
    let mut server: Option<Server> = None;
    ask(cable, Request::Connect { natnet_version: None }, |bytes| {
        if message_number(bytes) != Some(MESSAGE_SERVER_INFO) {
            return false;
        }
        server = ServerInfo::decode(bytes).ok().map(|info| Server {
            program: String::from_utf8_lossy(info.name).into_owned(),
            version: info.natnet_version,
            bodies: None,
        });
        server.is_some()
    })?;
    let Some(found) = &mut server else { return Ok(None) };
    if let Ok(version) = Version::from_bytes(found.version) {
        ask(cable, Request::ModelDefinition, |bytes| {
            if message_number(bytes) != Some(MESSAGE_MODEL_DEFINITION) {
                return false;
            }
            let names = |model: ModelDefinition<'_>| {
                model.rigid_bodies().map(|body| String::from_utf8_lossy(body.name).into_owned()).collect()
            };
            found.bodies = ModelDefinition::decode(version, bytes).ok().map(names);
            found.bodies.is_some()
        })?;
    }
    // Whoever connected is sent frames until it says otherwise.
    ask(cable, Request::Disconnect, |_| true)?;
    Ok(server)
}

fn ask(cable: &mut Cable, request: Request, each: impl FnMut(&[u8]) -> bool) -> io::Result<()> {
    let mut bytes = [0; 512];
    let length = request.encode(&mut bytes).map_err(|error| io::Error::other(error.to_string()))?;
    cable.send(&bytes[..length])?;
    match request {
        Request::Disconnect => Ok(()),
        _ => cable.listen(ANSWER_MAX, each),
    }
}

fn listed(names: &BTreeSet<String>) -> String {
    if names.is_empty() { "nobody".to_owned() } else { names.iter().cloned().collect::<Vec<_>>().join(", ") }
}

fn missing(wanted: &BTreeSet<String>, seen: &BTreeSet<String>) -> BTreeSet<String> {
    wanted.difference(seen).cloned().collect()
}

fn judge_stream(at: &str, wanted: &BTreeSet<String>, seen: io::Result<Stream>) -> Finding {
    let stream = match seen {
        Ok(stream) => stream,
        Err(error) if error.kind() == io::ErrorKind::AddrInUse => {
            let advice = "end the program that listens there; `ss -lunp` names it";
            return Finding::fail(NAME, format!("udp {at} is taken by another program"), advice);
        }
        Err(error) => {
            let advice = "set devices.motion_capture.url to an address of this host, or to 0.0.0.0";
            return Finding::fail(NAME, format!("udp {at}: {error}"), advice);
        }
    };
    if stream.datagrams == 0 {
        let advice = "enable Tracker's UDP Object Stream, to this host's address and that port; let the firewall pass it";
        return Finding::fail(NAME, format!("nothing came to udp {at} within a second"), advice);
    }
    if stream.frames.is_empty() {
        let advice = "send the UDP Object Stream there and nothing else";
        return Finding::fail(NAME, format!("{} datagrams of another kind came", stream.datagrams), advice);
    }
    let rate = stream.frames.len();
    let found = format!("{rate} frames in a second, of {}", listed(&stream.subjects));
    let absent = missing(wanted, &stream.subjects);
    if !absent.is_empty() {
        let advice =
            "give the objects in Tracker the names of the settings' subjects, and put the vehicles in sight";
        return Finding::fail(NAME, format!("{found}; not of {}", listed(&absent)), advice);
    }
    if rate < FRAMES_A_SECOND_MIN || stream.undecodable > 0 {
        let advice = "set Tracker to 100 frames a second or more, on a network of its own";
        return Finding::warn(NAME, format!("{found}; {} datagrams undecodable", stream.undecodable), advice);
    }
    Finding::ok(NAME, found)
}

fn judge_server(url: &str, wanted: &BTreeSet<String>, answer: io::Result<Option<Server>>) -> Finding {
    let server = match answer {
        Ok(Some(server)) => server,
        Ok(None) | Err(_) => {
            let reason = answer.err().map_or_else(|| "no answer".to_owned(), |error| error.to_string());
            let advice =
                "enable Motive's Data Streaming, and set the url to its PC's address and command port (1510)";
            return Finding::fail(NAME, format!("{url}: {reason}"), advice);
        }
    };
    let [major, minor, ..] = server.version;
    let found = format!("{} speaks NatNet {major}.{minor}", server.program);
    let Some(bodies) = &server.bodies else {
        let advice = "use Motive 2 to 3.1 (NatNet 3.0 to 4.1), or set devices.motion_capture.natnet.version";
        return Finding::fail(NAME, format!("{found}; what it tracks cannot be read"), advice);
    };
    let absent = missing(wanted, bodies);
    if absent.is_empty() {
        return Finding::ok(NAME, format!("{found} and tracks {}", listed(bodies)));
    }
    let advice = "name the rigid bodies in Motive as the settings' subjects, and stream rigid bodies";
    Finding::fail(NAME, format!("{found} and tracks {}; not {}", listed(bodies), listed(&absent)), advice)
}

#[cfg(test)]
mod tests {
    use super::super::finding::Verdict;
    use super::*;

    fn names(names: &[&str]) -> BTreeSet<String> {
        names.iter().map(|name| (*name).to_owned()).collect()
    }

    fn stream(frames: u32, subjects: &[&str]) -> Stream {
        Stream {
            frames: (0..frames).collect(),
            datagrams: frames as usize,
            undecodable: 0,
            subjects: names(subjects),
        }
    }

    #[test]
    fn a_stream_is_judged_by_its_rate_and_by_whom_it_shows() {
        let judged = |stream| judge_stream("0.0.0.0:51001", &names(&["quad1"]), stream);
        assert_eq!(judged(Ok(stream(200, &["quad1", "wand"]))).verdict, Verdict::Ok);
        assert_eq!(judged(Ok(stream(50, &["quad1"]))).verdict, Verdict::Warn);
        let other = judged(Ok(stream(200, &["Quad1"])));
        assert!(other.verdict == Verdict::Fail && other.found.contains("not of quad1"), "{other:?}");
        assert_eq!(judged(Ok(Stream::default())).verdict, Verdict::Fail);
        let noise = judged(Ok(Stream { datagrams: 9, undecodable: 9, ..Stream::default() }));
        assert!(noise.found.contains("of another kind"), "{noise:?}");
        let taken = judged(Err(io::ErrorKind::AddrInUse.into()));
        assert!(taken.verdict == Verdict::Fail && taken.found.contains("taken"), "{taken:?}");
    }

    #[test]
    fn a_server_is_judged_by_its_version_and_by_whom_it_tracks() {
        let server = |bodies: Option<&[&str]>| {
            let (program, version) = ("Motive".to_owned(), [4, 1, 0, 0]);
            Ok(Some(Server { program, version, bodies: bodies.map(names) }))
        };
        let judged = |answer| judge_server("udp://10.0.0.5:1510", &names(&["quad1"]), answer);
        assert_eq!(judged(server(Some(&["quad1"]))).verdict, Verdict::Ok);
        assert_eq!(judged(server(Some(&["quad2"]))).verdict, Verdict::Fail);
        assert_eq!(judged(server(None)).verdict, Verdict::Fail);
        assert_eq!(judged(Ok(None)).verdict, Verdict::Fail);
        let refused = judged(Err(io::ErrorKind::ConnectionRefused.into()));
        assert!(refused.verdict == Verdict::Fail && refused.found.contains("refused"), "{refused:?}");
    }
}
