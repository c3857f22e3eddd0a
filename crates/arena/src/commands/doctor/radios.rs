//! The radios: whether the data link's module answers and reaches each vehicle, and what the command links' say.

use std::collections::BTreeSet;
use std::io;

use device::vehicle_link::{Downlink, PAYLOAD_BYTES_MAX, Uplink};
use device::xbee::{ApiMode, Decoder, Frame};
use device::{crsf, crtp};
use quantity::Span;
use settings::{Arena, CommandProtocol, DeviceUrl, FleetVehicle, Radio};

use super::cable::Cable;
use super::finding::Finding;
use super::serial;

const ANSWER_MAX: Span = Span::from_millis(600);
/// A frame of the greatest payload with every byte escaped.
const LINE_BYTES_MAX: usize = 2 * (PAYLOAD_BYTES_MAX + 9);
/// XBee: frame 08 asks a module for a parameter, 88 answers.
const AT_COMMAND: u8 = 0x08;
const AT_RESPONSE: u8 = 0x88;
/// Our own frame ids: of the question and of the pings, those from 1 on.
const AT_FRAME_ID: u8 = 0xFE;
/// CRSF: asks every device on the line who it is.
const CRSF_PING_DEVICES: u8 = 0x28;

/// What the data link's module and the vehicles said.
#[derive(Debug, Default, PartialEq, Eq)]
struct Answers {
    /// The module answered the question for its own address.
    address: Option<u16>,
    /// It said something that is an API frame.
    frames: usize,
    /// Vehicles that answered a ping.
    vehicles: BTreeSet<u8>,
}

/// Looks at the radios of the settings' fleet. Nothing that could move a vehicle is sent.
pub fn check(arena: &Arena) -> Vec<Finding> {
    let devices = &arena.network.devices;
    let pairs: Vec<&FleetVehicle> =
        arena.fleet.iter().filter(|member| member.vehicle.links.radio == Radio::Pair).collect();
    let mut findings = Vec::new();
    if !pairs.is_empty() {
        let url = &devices.data_link.url;
        findings.push(line_of("data link", url).unwrap_or_else(|| {
            let ids: BTreeSet<u8> = pairs.iter().map(|member| member.vehicle.id).collect();
            judge_data_link(url, &ids, Cable::to(url).and_then(|mut cable| ask_data_link(&mut cable, &pairs)))
        }));
    }
    for member in &arena.fleet {
        let name = format!("radio of vehicle {}", member.vehicle.id);
        findings.push(match devices.radio_of(member) {
            Err(reason) => Finding::fail(&name, reason, "correct the url"),
            Ok(url) => line_of(&name, &url).unwrap_or_else(|| match member.vehicle.links.radio {
                Radio::Pair => command_link(&name, devices.command_link.protocol, &url),
                Radio::Crazyradio => crazyflie(&name, &url),
            }),
        });
    }
    findings
}

/// What is wrong with a serial line, if anything: then there is nobody to ask.
fn line_of(name: &str, url: &DeviceUrl) -> Option<Finding> {
    let DeviceUrl::Serial(line) = url else { return None };
    let finding = serial::check(name, line);
    (finding.verdict == super::finding::Verdict::Fail).then_some(finding)
}

fn ask_data_link(cable: &mut Cable, fleet: &[&FleetVehicle]) -> io::Result<Answers> {
    let mut send = |frame: Frame<'_>| {
        let mut line = [0; LINE_BYTES_MAX];
        let length =
            frame.encode(ApiMode::Escaped, &mut line).map_err(|error| io::Error::other(error.to_string()))?;
        cable.send(&line[..length])
    };
    send(Frame::Other { id: AT_COMMAND, data: &[AT_FRAME_ID, b'M', b'Y'] })?;
    for (member, frame_id) in fleet.iter().zip(1_u8..) {
        let mut payload = [0; PAYLOAD_BYTES_MAX];
        let ping = Uplink::Ping { token: u16::from(frame_id) };
        let length = ping
            .encode(member.vehicle.id, &mut payload)
            .map_err(|error| io::Error::other(error.to_string()))?;
        let destination = member.vehicle.links.data_address;
        send(Frame::Transmit16 { frame_id, destination, options: 0, data: &payload[..length] })?;
    }
    let (mut decoder, mut answers) = (Decoder::new(ApiMode::Escaped), Answers::default());
    cable.listen(ANSWER_MAX, |bytes| {
        decoder.receive(bytes, |frame| answers.take(&frame));
        answers.address.is_some() && answers.vehicles.len() == fleet.len()
    })?;
    Ok(answers)
}

impl Answers {
    fn take(&mut self, frame: &Frame<'_>) {
        self.frames += 1;
        match frame {
            // Frame id, two letters, status 0, value.
            Frame::Other { id: AT_RESPONSE, data: [AT_FRAME_ID, b'M', b'Y', 0, high, low] } => {
                self.address = Some(u16::from_be_bytes([*high, *low]));
            }
            Frame::Receive16 { data, .. } | Frame::ReceiveMesh { data, .. } => {
                if let Ok((vehicle, Downlink::Pong { .. })) = Downlink::decode(data) {
                    self.vehicles.insert(vehicle);
                }
            }
            _ => {}
        }
    }
}

fn listed(ids: impl IntoIterator<Item = u8>) -> String {
    ids.into_iter().map(|id| id.to_string()).collect::<Vec<_>>().join(", ")
}

fn judge_data_link(url: &DeviceUrl, fleet: &BTreeSet<u8>, answers: io::Result<Answers>) -> Finding {
    let name = "data link";
    let answers = match answers {
        Ok(answers) if answers.frames > 0 => answers,
        Ok(_) => {
            let advice = "set the module to AP=2 and to the baud rate of the url, and give it power";
            return Finding::fail(name, format!("{url}: no answer"), advice);
        }
        Err(error) => {
            return Finding::fail(name, format!("{url}: {error}"), "check where the module is, and its url");
        }
    };
    let module = match answers.address {
        Some(address) => format!("the module has address {address:04X}"),
        None => "the module is there".to_owned(),
    };
    let silent: Vec<u8> = fleet.difference(&answers.vehicles).copied().collect();
    if silent.is_empty() {
        return Finding::ok(name, format!("{module}; vehicles {} answer", listed(fleet.iter().copied())));
    }
    let advice =
        "switch the vehicles on; their modules need the same CH and ID, and MY as links.data_address";
    Finding::fail(name, format!("{module}; no answer from vehicles {}", listed(silent)), advice)
}

fn command_link(name: &str, protocol: CommandProtocol, url: &DeviceUrl) -> Finding {
    let cable = Cable::to(url);
    match protocol {
        CommandProtocol::Sbus => judge_encoder(name, url, cable.map(|_| ())),
        CommandProtocol::Crsf => judge_module(name, url, cable.and_then(|mut cable| ask_module(&mut cable))),
    }
}

/// An encoder of SBUS has nothing to say.
fn judge_encoder(name: &str, url: &DeviceUrl, opened: io::Result<()>) -> Finding {
    match opened {
        Ok(()) => Finding::ok(name, format!("{url} opens; an SBUS encoder does not answer")),
        Err(error) => {
            Finding::fail(name, format!("{url}: {error}"), "check where the encoder is, and its url")
        }
    }
}

/// How many frames the module said when asked who it is.
fn ask_module(cable: &mut Cable) -> io::Result<usize> {
    let payload = &[crsf::ADDRESS_BROADCAST, crsf::ADDRESS_HANDSET];
    let mut bytes = [0; crsf::FRAME_BYTES_MAX];
    let length = crsf::Frame::Other { kind: CRSF_PING_DEVICES, payload }
        .encode(crsf::ADDRESS_MODULE, &mut bytes)
        .map_err(|error| io::Error::other(error.to_string()))?;
    cable.send(&bytes[..length])?;
    let (mut decoder, mut frames) = (crsf::Decoder::new(), 0);
    cable.listen(ANSWER_MAX, |bytes| {
        // A half-duplex line brings our own question back.
        decoder.receive(bytes, |frame| {
            frames += usize::from(!matches!(frame, crsf::Frame::Other { kind: CRSF_PING_DEVICES, .. }));
        });
        frames > 0
    })?;
    Ok(frames)
}

fn judge_module(name: &str, url: &DeviceUrl, frames: io::Result<usize>) -> Finding {
    match frames {
        Ok(0) => Finding::warn(
            name,
            format!("{url} opens; the module does not answer"),
            "give the module power, check the baud rate and that its line is half duplex and not inverted",
        ),
        Ok(_) => Finding::ok(name, format!("{url}: the module answers")),
        Err(error) => {
            Finding::fail(name, format!("{url}: {error}"), "check where the module is, and its url")
        }
    }
}

fn crazyflie(name: &str, url: &DeviceUrl) -> Finding {
    if matches!(url, DeviceUrl::Radio(_)) {
        let advice = "look with the vendor's client: the doctor does not open a Crazyradio";
        return Finding::warn(name, format!("{url} is not looked at"), advice);
    }
    let answered = Cable::to(url).and_then(|mut cable| {
        cable.send(&crtp::NULL_PACKET)?;
        let mut answered = false;
        cable.listen(ANSWER_MAX, |_| {
            answered = true;
            true
        })?;
        Ok(answered)
    });
    judge_crazyflie(name, url, answered)
}

fn judge_crazyflie(name: &str, url: &DeviceUrl, answered: io::Result<bool>) -> Finding {
    match answered {
        Ok(true) => Finding::ok(name, format!("{url} answers")),
        Ok(false) => Finding::fail(name, format!("{url}: no answer"), "start it, and check its url"),
        Err(error) => Finding::fail(name, format!("{url}: {error}"), "start it, and check its url"),
    }
}

#[cfg(test)]
mod tests {
    use super::super::finding::Verdict;
    use super::*;

    fn url(text: &str) -> DeviceUrl {
        text.parse().unwrap()
    }

    #[test]
    fn a_data_link_needs_a_module_and_every_vehicle() {
        let fleet = BTreeSet::from([1, 2]);
        let judged = |answers| judge_data_link(&url("udp://10.0.0.1:1"), &fleet, answers);
        let answers = |vehicles: &[u8]| {
            let vehicles = vehicles.iter().copied().collect();
            Ok(Answers { address: Some(0x5000), frames: 3, vehicles })
        };
        assert_eq!(judged(answers(&[1, 2])).verdict, Verdict::Ok);
        let one = judged(answers(&[1]));
        assert!(one.verdict == Verdict::Fail && one.found.ends_with("no answer from vehicles 2"), "{one:?}");
        let silent = judged(Ok(Answers::default()));
        assert!(silent.verdict == Verdict::Fail && silent.advice.unwrap().contains("AP=2"));
        assert_eq!(judged(Err(io::ErrorKind::ConnectionRefused.into())).verdict, Verdict::Fail);
    }

    #[test]
    fn an_answer_tells_the_modules_address_and_a_pong_its_vehicle() {
        let mut answers = Answers::default();
        answers.take(&Frame::Other { id: AT_RESPONSE, data: &[AT_FRAME_ID, b'M', b'Y', 0, 0x50, 0x01] });
        answers.take(&Frame::Other { id: AT_RESPONSE, data: &[AT_FRAME_ID, b'M', b'Y', 1] });
        let mut payload = [0; PAYLOAD_BYTES_MAX];
        let pong = Downlink::Pong { token: 1, received_us: 2, turnaround_us: 3 };
        let length = pong.encode(7, &mut payload).unwrap();
        answers.take(&Frame::Receive16 { source: 0x5007, rssi: 40, options: 0, data: &payload[..length] });
        answers.take(&Frame::Receive16 { source: 0x5008, rssi: 40, options: 0, data: b"noise" });
        let expected = Answers { address: Some(0x5001), frames: 4, vehicles: BTreeSet::from([7]) };
        assert_eq!(answers, expected);
    }

    #[test]
    fn an_encoder_that_opens_will_do_and_a_silent_module_warns() {
        let at = url("serial:///dev/serial/by-id/x?baud=100000&framing=8E2");
        assert_eq!(judge_encoder("x", &at, Ok(())).verdict, Verdict::Ok);
        assert_eq!(judge_encoder("x", &at, Err(io::ErrorKind::NotFound.into())).verdict, Verdict::Fail);
        assert_eq!(judge_module("x", &at, Ok(2)).verdict, Verdict::Ok);
        assert_eq!(judge_module("x", &at, Ok(0)).verdict, Verdict::Warn);
        assert_eq!(judge_module("x", &at, Err(io::ErrorKind::NotFound.into())).verdict, Verdict::Fail);
        assert_eq!(judge_crazyflie("x", &at, Ok(true)).verdict, Verdict::Ok);
        assert_eq!(judge_crazyflie("x", &at, Ok(false)).verdict, Verdict::Fail);
    }
}
