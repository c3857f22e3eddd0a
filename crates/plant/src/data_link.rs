//! The data link: the coordinator radio on the ground, speaking XBee API frames, and one radio on each
//! vehicle.

use device::xbee::{ApiMode, BROADCAST_16, Decoder, Frame, OPTION_NO_ACK, PAYLOAD_BYTES_MAX, TransmitResult};
use quantity::{Span, Time};
use settings::{FleetVehicle, LinkSettings};

use crate::command_link::{LinkCounts, flip_bits};
use crate::faults::{Fault, Schedule};
use crate::output::{Device, Outputs};
use crate::queue::DelayQueue;
use crate::random::{Purpose, Stream};

/// Received power the coordinator reports, -dBm.
const RSSI: u8 = 40;

/// Serial line framing of the coordinator.
const MODE: ApiMode = ApiMode::Escaped;

/// Longest API frame we write: the payload with its fields, every byte escaped.
const SERIAL_BYTES_MAX: usize = 2 * (PAYLOAD_BYTES_MAX + 16);

/// Payloads under way at most, each way; more are lost.
const UNDER_WAY_MAX: usize = 64;

/// What one radio frame carries.
#[derive(Clone, Copy, Debug)]
struct Payload {
    bytes: [u8; PAYLOAD_BYTES_MAX],
    length: usize,
}

impl Payload {
    fn new(data: &[u8]) -> Option<Self> {
        let mut bytes = [0; PAYLOAD_BYTES_MAX];
        bytes.get_mut(..data.len())?.copy_from_slice(data);
        Some(Self { bytes, length: data.len() })
    }

    fn as_slice(&self) -> &[u8] {
        &self.bytes[..self.length]
    }
}

/// One direction of one vehicle's link.
#[derive(Clone, Debug)]
struct Way {
    settings: LinkSettings,
    stream: Stream,
    air: DelayQueue<Payload>,
    counts: LinkCounts,
}

impl Way {
    fn new(settings: &LinkSettings, stream: Stream) -> Self {
        Self { settings: settings.clone(), stream, air: DelayQueue::new(), counts: LinkCounts::default() }
    }

    fn delay(&mut self) -> Span {
        Span::from_secs_f64(self.settings.delay_s + self.stream.exponential(self.settings.jitter_s))
    }

    /// Sends a payload; answers whether it will arrive. Payloads may overtake each other: radios retry.
    fn send(&mut self, now: Time, data: &[u8], trouble: Trouble) -> bool {
        self.counts.sent += 1;
        let delay = self.delay();
        let lost = self.stream.chance(self.settings.loss_ratio.max(trouble.loss_ratio));
        let corrupted = self.stream.chance(self.settings.corruption_ratio);
        let payload = Payload::new(data).filter(|_| !lost && self.air.len() < UNDER_WAY_MAX);
        let Some(mut payload) = payload else {
            self.counts.lost += 1;
            return false;
        };
        if corrupted {
            self.counts.corrupted += 1;
            flip_bits(&mut self.stream, &mut payload.bytes[..payload.length]);
        }
        self.air.push(now + delay, payload);
        // Without the fault nothing is drawn, so that the world stays as it was.
        if trouble.duplicate_ratio > 0.0 && self.stream.chance(trouble.duplicate_ratio) {
            let delay = self.delay();
            self.air.push(now + delay, payload);
        }
        true
    }
}

/// What faults add to one way of one vehicle's link.
#[derive(Clone, Copy, Debug)]
struct Trouble {
    loss_ratio: f64,
    duplicate_ratio: f64,
}

/// A vehicle's radio.
#[derive(Clone, Debug)]
struct Radio {
    vehicle: u8,
    address: u16,
    up: Way,
    down: Way,
}

/// The coordinator, the vehicles' radios and the air between them.
#[derive(Clone, Debug)]
pub struct DataLink {
    decoder: Decoder,
    radios: Vec<Radio>,
}

impl DataLink {
    /// The radios of a fleet.
    #[must_use]
    pub fn new(fleet: &[FleetVehicle], seed: u64) -> Self {
        let radio = |member: &FleetVehicle| {
            let (id, link) = (member.vehicle.id, &member.vehicle.plant.data_link);
            Radio {
                vehicle: id,
                address: member.vehicle.links.data_address,
                up: Way::new(link, Stream::new(seed, Purpose::Uplink, id)),
                down: Way::new(link, Stream::new(seed, Purpose::Downlink, id)),
            }
        };
        Self { decoder: Decoder::new(MODE), radios: fleet.iter().map(radio).collect() }
    }

    /// What has become of a vehicle's payloads: to it, from it.
    #[must_use]
    pub fn counts(&self, vehicle: u8) -> Option<(LinkCounts, LinkCounts)> {
        let radio = self.radios.iter().find(|radio| radio.vehicle == vehicle)?;
        Some((radio.up.counts, radio.down.counts))
    }

    /// Bytes of the coordinator's serial line, any number.
    pub(crate) fn feed(&mut self, now: Time, bytes: &[u8], faults: &Schedule, outputs: &mut Outputs) {
        let Self { decoder, radios } = self;
        decoder.receive(bytes, |frame| {
            if let Frame::Transmit16 { frame_id, destination, options, data } = frame {
                transmit(radios, now, (frame_id, destination, options), data, faults, outputs);
            }
        });
    }

    /// A payload from a vehicle.
    pub(crate) fn send_down(
        &mut self,
        index: usize,
        now: Time,
        data: &[u8],
        faults: &Schedule,
        outputs: &mut Outputs,
    ) {
        let Some(vehicle) = self.radios.get(index).map(|radio| radio.vehicle) else {
            return;
        };
        let source = address_of(&self.radios, vehicle, now, faults);
        let radio = &mut self.radios[index];
        let trouble = Trouble {
            loss_ratio: downlink_loss(vehicle, now, faults),
            duplicate_ratio: duplication(vehicle, now, faults),
        };
        if !radio.down.send(now, data, trouble) {
            return;
        }
        while let Some((at, payload)) = radio.down.air.pop_due(Time::FAR_FUTURE) {
            radio.down.counts.delivered += 1;
            write(Frame::Receive16 { source, rssi: RSSI, options: 0, data: payload.as_slice() }, at, outputs);
        }
    }

    /// When the next payload arrives at a vehicle.
    pub(crate) fn next_up_at(&self, index: usize) -> Option<Time> {
        self.radios.get(index)?.up.air.next_at()
    }

    /// Hands the next payload that has arrived at a vehicle by `now` to `receive`, with its time.
    pub(crate) fn arrived_up(&mut self, index: usize, now: Time, receive: impl FnOnce(Time, &[u8])) {
        let Some(radio) = self.radios.get_mut(index) else {
            return;
        };
        if let Some((at, payload)) = radio.up.air.pop_due(now) {
            radio.up.counts.delivered += 1;
            receive(at, payload.as_slice());
        }
    }

    /// The least delay from a vehicle to the coordinator.
    pub(crate) fn least_down_delay(&self) -> Span {
        let least = self.radios.iter().map(|radio| Span::from_secs_f64(radio.down.settings.delay_s)).min();
        least.unwrap_or(Span::ZERO)
    }
}

fn transmit(
    radios: &mut [Radio],
    now: Time,
    (frame_id, destination, options): (u8, u16, u8),
    data: &[u8],
    faults: &Schedule,
    outputs: &mut Outputs,
) {
    let mut status_at = now + Span::from_millis(2);
    let unacknowledged = destination == BROADCAST_16 || options & OPTION_NO_ACK != 0;
    let mut result = if unacknowledged { TransmitResult::Success } else { TransmitResult::NoAck };
    if data.len() > PAYLOAD_BYTES_MAX {
        result = TransmitResult::TooLarge;
    } else {
        for index in 0..radios.len() {
            let vehicle = radios[index].vehicle;
            let address = address_of(radios, vehicle, now, faults);
            if destination != BROADCAST_16 && destination != address {
                continue;
            }
            let up = &mut radios[index].up;
            let trouble = Trouble {
                loss_ratio: uplink_loss(vehicle, now, faults),
                duplicate_ratio: duplication(vehicle, now, faults),
            };
            let arrives = up.send(now, data, trouble);
            let ack_loss = up.settings.loss_ratio.max(downlink_loss(vehicle, now, faults));
            let acknowledged = !up.stream.chance(ack_loss) && arrives;
            status_at = now + up.delay();
            if acknowledged {
                result = TransmitResult::Success;
            }
        }
    }
    if frame_id != 0 {
        write(Frame::TransmitStatus { frame_id, result }, status_at, outputs);
    }
}

/// The address a vehicle's radio answers to.
fn address_of(radios: &[Radio], vehicle: u8, now: Time, faults: &Schedule) -> u16 {
    let mut seen_as = vehicle;
    for fault in faults.at(now) {
        if let Fault::SwappedAddresses { vehicle: one, other } = fault {
            if seen_as == one {
                seen_as = other;
            } else if seen_as == other {
                seen_as = one;
            }
        }
    }
    let radio = radios.iter().find(|radio| radio.vehicle == seen_as);
    radio.or_else(|| radios.iter().find(|radio| radio.vehicle == vehicle)).map_or(0, |radio| radio.address)
}

fn uplink_loss(vehicle: u8, now: Time, faults: &Schedule) -> f64 {
    faults.at(now).fold(0.0, |loss: f64, fault| match fault {
        Fault::DataLoss { vehicle: of, loss_ratio } if of == vehicle => loss.max(loss_ratio),
        _ => loss,
    })
}

fn duplication(vehicle: u8, now: Time, faults: &Schedule) -> f64 {
    faults.at(now).fold(0.0, |ratio: f64, fault| match fault {
        Fault::DataDuplication { vehicle: of, duplicate_ratio } if of == vehicle => {
            ratio.max(duplicate_ratio)
        }
        _ => ratio,
    })
}

fn downlink_loss(vehicle: u8, now: Time, faults: &Schedule) -> f64 {
    faults.at(now).fold(0.0, |loss: f64, fault| match fault {
        Fault::DataLoss { vehicle: of, loss_ratio } | Fault::DataDownlinkLoss { vehicle: of, loss_ratio }
            if of == vehicle =>
        {
            loss.max(loss_ratio)
        }
        _ => loss,
    })
}

fn write(frame: Frame<'_>, at: Time, outputs: &mut Outputs) {
    let mut serial = [0; SERIAL_BYTES_MAX];
    // The buffer holds any payload of ours escaped throughout, so this cannot fail.
    if let Ok(length) = frame.encode(MODE, &mut serial) {
        outputs.push(Device::DataLink, at, &serial[..length]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::fleet;

    struct Bench {
        link: DataLink,
        outputs: Outputs,
        faults: Schedule,
    }

    impl Bench {
        fn new(change: impl Fn(&mut LinkSettings)) -> Self {
            let mut arena = fleet();
            for member in &mut arena.fleet {
                change(&mut member.vehicle.plant.data_link);
            }
            let link = DataLink::new(&arena.fleet, 3);
            Self { link, outputs: Outputs::new(), faults: Schedule::default() }
        }

        fn transmit(&mut self, now: Time, destination: u16, frame_id: u8, data: &[u8]) {
            let mut serial = [0; 512];
            let frame = Frame::Transmit16 { frame_id, destination, options: 0, data };
            let length = frame.encode(MODE, &mut serial).unwrap();
            self.link.feed(now, &serial[..length], &self.faults, &mut self.outputs);
        }

        fn arrivals(&mut self, index: usize) -> Vec<(Time, Vec<u8>)> {
            let mut arrivals = Vec::new();
            while self.link.next_up_at(index).is_some() {
                self.link.arrived_up(index, Time::FAR_FUTURE, |at, data| arrivals.push((at, data.to_vec())));
            }
            arrivals
        }

        /// What the bridge would read: statuses and payloads.
        fn read(&mut self) -> (Vec<TransmitResult>, Vec<(u16, Vec<u8>)>) {
            let (mut results, mut received) = (Vec::new(), Vec::new());
            let mut decoder = Decoder::new(MODE);
            self.outputs.send(Time::FAR_FUTURE, &mut |output| {
                decoder.receive(output.bytes, |frame| match frame {
                    Frame::TransmitStatus { result, .. } => results.push(result),
                    Frame::Receive16 { source, data, .. } => received.push((source, data.to_vec())),
                    other => panic!("{other:?}"),
                });
            });
            (results, received)
        }
    }

    fn perfect(settings: &mut LinkSettings) {
        settings.loss_ratio = 0.0;
        settings.corruption_ratio = 0.0;
    }

    #[test]
    fn a_payload_reaches_the_addressed_vehicle_and_no_other() {
        let mut bench = Bench::new(perfect);
        bench.transmit(Time::ZERO, 0x5002, 7, b"hello\x7e\x7d");
        bench.transmit(Time::ZERO, 0x7777, 8, b"nobody");
        bench.transmit(Time::ZERO, 0x5001, 0, b"no status");
        assert_eq!(bench.arrivals(2), []);
        let [(at, data)] = &bench.arrivals(1)[..] else { panic!("one payload") };
        assert!(*at >= Time::ZERO + Span::from_millis(8));
        assert_eq!(data, b"hello\x7e\x7d");
        assert_eq!(bench.arrivals(0).len(), 1);
        let (results, _) = bench.read();
        assert_eq!(results.len(), 2);
        assert!(results.contains(&TransmitResult::Success) && results.contains(&TransmitResult::NoAck));
    }

    #[test]
    fn a_broadcast_reaches_all_and_too_much_is_refused() {
        let mut bench = Bench::new(perfect);
        bench.transmit(Time::ZERO, BROADCAST_16, 1, b"all");
        assert_eq!([0, 1, 2].map(|index| bench.arrivals(index).len()), [1, 1, 1]);
        bench.transmit(Time::ZERO, 0x5001, 2, &[0; 101]);
        assert_eq!(bench.arrivals(0), []);
        // The refusal needs no radio and comes first.
        assert_eq!(bench.read().0, [TransmitResult::TooLarge, TransmitResult::Success]);
    }

    #[test]
    fn payloads_from_vehicles_come_out_of_the_serial_line() {
        let mut bench = Bench::new(perfect);
        for index in 0..3 {
            bench.link.send_down(index, Time::ZERO, &[index as u8; 90], &bench.faults, &mut bench.outputs);
        }
        let (_, mut received) = bench.read();
        received.sort();
        assert_eq!(received, [(0x5001, vec![0; 90]), (0x5002, vec![1; 90]), (0x5003, vec![2; 90])]);
    }

    #[test]
    fn losses_have_their_rate_and_lost_acknowledgements_are_told_apart() {
        let mut bench = Bench::new(|settings| {
            settings.loss_ratio = 0.2;
            settings.corruption_ratio = 0.0;
        });
        let (n, mut arrived) = (10_000, 0);
        for k in 0..n {
            bench.transmit(Time::from_nanos(k * 1_000_000), 0x5001, 1, b"x");
            arrived += bench.arrivals(0).len();
        }
        let (results, _) = bench.read();
        let acknowledged = results.iter().filter(|result| **result == TransmitResult::Success).count();
        // 8000 with a standard deviation of 40, and 6400 with one of 48.
        assert!(arrived.abs_diff(8_000) < 160, "{arrived}");
        assert!(acknowledged.abs_diff(6_400) < 200, "{acknowledged}");
    }

    #[test]
    fn faults_silence_one_way_or_both_and_swap_addresses() {
        let mut bench = Bench::new(perfect);
        let (begin, end) = (Time::ZERO, Time::FAR_FUTURE);
        bench.faults.add(Fault::DataDownlinkLoss { vehicle: 1, loss_ratio: 1.0 }, begin, end);
        bench.transmit(Time::ZERO, 0x5001, 1, b"x");
        bench.link.send_down(0, Time::ZERO, b"y", &bench.faults, &mut bench.outputs);
        assert_eq!(bench.arrivals(0).len(), 1);
        assert_eq!(bench.read(), (vec![TransmitResult::NoAck], vec![]));
        bench.faults.add(Fault::DataLoss { vehicle: 1, loss_ratio: 1.0 }, begin, end);
        bench.transmit(Time::ZERO, 0x5001, 1, b"x");
        assert_eq!(bench.arrivals(0).len(), 0);
        bench.read();
        bench.faults.add(Fault::SwappedAddresses { vehicle: 2, other: 3 }, begin, end);
        bench.transmit(Time::ZERO, 0x5003, 1, b"for three");
        assert_eq!((bench.arrivals(1).len(), bench.arrivals(2).len()), (1, 0));
        bench.link.send_down(1, Time::ZERO, b"from two", &bench.faults, &mut bench.outputs);
        assert_eq!(bench.read().1, [(0x5003, b"from two".to_vec())]);
    }

    #[test]
    fn doubled_payloads_come_twice_each_way() {
        let mut bench = Bench::new(perfect);
        let twice = Fault::DataDuplication { vehicle: 1, duplicate_ratio: 1.0 };
        bench.faults.add(twice, Time::ZERO, Time::FAR_FUTURE);
        bench.transmit(Time::ZERO, 0x5001, 0, b"x");
        bench.link.send_down(0, Time::ZERO, b"y", &bench.faults, &mut bench.outputs);
        bench.link.send_down(1, Time::ZERO, b"z", &bench.faults, &mut bench.outputs);
        assert_eq!(bench.arrivals(0).len(), 2);
        let (_, mut received) = bench.read();
        received.sort();
        assert_eq!(received, [(0x5001, b"y".to_vec()), (0x5001, b"y".to_vec()), (0x5002, b"z".to_vec())]);
    }

    #[test]
    fn noise_on_the_serial_line_costs_nothing_but_itself() {
        let mut bench = Bench::new(perfect);
        bench.link.feed(Time::ZERO, &[0x00, 0x7E, 0xFF, 0x12], &bench.faults, &mut bench.outputs);
        bench.transmit(Time::ZERO, 0x5001, 1, b"still");
        assert_eq!(bench.arrivals(0).len(), 1);
    }
}
