//! Crazyflies behind a Crazyradio: a thread for each dongle that passes packets on between the air and a socket.
//!
//! A Crazyflie speaks only when it is spoken to: what it has to say comes back with the acknowledgement of a packet. So
//! the thread sends what there is to send, and the null packet where there is nothing, often while there are answers
//! and seldom otherwise. A packet that is not acknowledged is not sent again, beyond what the dongle does by itself:
//! setpoints must not come late, and whatever else must arrive is repeated by the bridge.
//!
//! To the bridge a vehicle behind a dongle is a socket like that of a simulated one. What drives the dongle itself is
//! Bitcraze's crate `crazyradio`, which needs libusb, so it is there only in a build with the feature `crazyradio`.

use std::io;
use std::net::{Ipv4Addr, UdpSocket};
use std::time::{Duration, Instant};

use settings::RadioAddress;
use tracing::{info, warn};

/// Longest packet on the air.
pub(super) const AIR_BYTES_MAX: usize = 32;
/// The null packet.
const NULL_PACKET: [u8; 1] = [0xFF];
/// Bits of a header that make a packet a null packet: port 15, channel 3.
const NULL_HEADER: u8 = 0xF3;
/// Packets sent to one vehicle before it is the next one's turn.
const TURN_MAX: usize = 4;
/// A silent vehicle is asked so often.
const POLL_PERIOD: Duration = Duration::from_millis(10);
/// And this long after an answer it is asked again at once.
const TALK_SPAN: Duration = Duration::from_millis(5);
/// A thread with nothing to do looks again after so long.
const IDLE: Duration = Duration::from_micros(500);
/// A dongle that does not work is tried again after so long.
const RETRY: Duration = Duration::from_secs(1);

/// What drives a dongle.
pub(super) trait Dongle {
    /// Sends a packet to a vehicle and answers the length of what came back; `None` where nothing was acknowledged.
    fn exchange(
        &mut self,
        to: &RadioAddress,
        packet: &[u8],
        answer: &mut [u8; AIR_BYTES_MAX],
    ) -> io::Result<Option<usize>>;
}

/// A vehicle behind a dongle.
struct User {
    address: RadioAddress,
    socket: UdpSocket,
    asked_at: Option<Instant>,
    answered_at: Option<Instant>,
}

/// The vehicles behind the dongles of this host.
#[derive(Default)]
pub(super) struct Dongles {
    users: Vec<User>,
}

impl Dongles {
    /// The bridge's end of a cable to a vehicle.
    pub(super) fn plug(&mut self, address: RadioAddress) -> io::Result<UdpSocket> {
        let [ours, theirs] =
            [UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?, UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?];
        ours.connect(theirs.local_addr()?)?;
        theirs.connect(ours.local_addr()?)?;
        theirs.set_nonblocking(true)?;
        self.users.push(User { address, socket: theirs, asked_at: None, answered_at: None });
        Ok(ours)
    }

    /// Starts a thread for each dongle; `open` opens one by its number. The threads live as long as the process.
    pub(super) fn start<D: Dongle + 'static>(mut self, open: fn(u8) -> io::Result<D>) -> io::Result<()> {
        self.users.sort_by_key(|user| user.address.dongle);
        while let Some(number) = self.users.last().map(|user| user.address.dongle) {
            let first = self.users.partition_point(|user| user.address.dongle < number);
            let users = self.users.split_off(first);
            let name = format!("crazyradio-{number}");
            std::thread::Builder::new().name(name).spawn(move || serve(number, users, open))?;
        }
        Ok(())
    }
}

/// Serves the vehicles behind one dongle for ever.
fn serve<D: Dongle>(number: u8, mut users: Vec<User>, open: fn(u8) -> io::Result<D>) {
    loop {
        let error = match open(number) {
            Err(error) => error,
            Ok(mut dongle) => {
                info!(dongle = number, vehicles = users.len(), "a Crazyradio is open");
                loop {
                    match round(&mut users, &mut dongle) {
                        Ok(true) => {}
                        Ok(false) => std::thread::sleep(IDLE),
                        Err(error) => break error,
                    }
                }
            }
        };
        warn!(dongle = number, %error, "a Crazyradio does not work");
        std::thread::sleep(RETRY);
        for user in &mut users {
            // What has waited meanwhile is too old to be sent.
            while user.socket.recv(&mut [0; AIR_BYTES_MAX]).is_ok() {}
        }
    }
}

/// One turn for each vehicle; whether anything was sent.
fn round<D: Dongle>(users: &mut [User], dongle: &mut D) -> io::Result<bool> {
    let mut busy = false;
    for user in users {
        busy |= user.turn(dongle, Instant::now())?;
    }
    Ok(busy)
}

impl User {
    fn turn<D: Dongle>(&mut self, dongle: &mut D, now: Instant) -> io::Result<bool> {
        let mut sent = 0;
        let mut packet = [0; AIR_BYTES_MAX];
        while sent < TURN_MAX {
            // A cable with nobody at its other end says so here; that is no fault of the dongle's.
            let Ok(length) = self.socket.recv(&mut packet) else { break };
            self.exchange(dongle, &packet[..length], now)?;
            sent += 1;
        }
        if sent == 0 && self.is_due(now) {
            self.exchange(dongle, &NULL_PACKET, now)?;
            sent += 1;
        }
        Ok(sent > 0)
    }

    fn is_due(&self, now: Instant) -> bool {
        let talks = self.answered_at.is_some_and(|at| now.duration_since(at) < TALK_SPAN);
        talks || self.asked_at.is_none_or(|at| now.duration_since(at) >= POLL_PERIOD)
    }

    fn exchange<D: Dongle>(&mut self, dongle: &mut D, packet: &[u8], now: Instant) -> io::Result<()> {
        let mut answer = [0; AIR_BYTES_MAX];
        self.asked_at = Some(now);
        let Some(length) = dongle.exchange(&self.address, packet, &mut answer)? else { return Ok(()) };
        let answer = answer.get(..length).unwrap_or(&[]);
        match answer.first() {
            Some(header) if header & NULL_HEADER != NULL_HEADER => {
                self.answered_at = Some(now);
                // As above.
                let _ = self.socket.send(answer);
            }
            _ => {}
        }
        Ok(())
    }
}

/// Bitcraze's driver.
#[cfg(feature = "crazyradio")]
pub(super) mod driver {
    use std::io;

    use crazyradio::{Channel, Crazyradio, Datarate};
    use settings::{RadioAddress, RadioRate};

    use super::{AIR_BYTES_MAX, Dongle};

    impl Dongle for Crazyradio {
        fn exchange(
            &mut self,
            to: &RadioAddress,
            packet: &[u8],
            answer: &mut [u8; AIR_BYTES_MAX],
        ) -> io::Result<Option<usize>> {
            let rate = match to.rate {
                RadioRate::K250 => Datarate::Dr250K,
                RadioRate::M1 => Datarate::Dr1M,
                RadioRate::M2 => Datarate::Dr2M,
            };
            // The driver remembers what the dongle is set to: only what changes goes over the cable.
            let sent = Channel::from_number(to.channel)
                .and_then(|channel| self.set_channel(channel))
                .and_then(|()| self.set_datarate(rate))
                .and_then(|()| self.set_address(&to.address))
                .and_then(|()| self.send_packet(packet, answer));
            let ack = sent.map_err(io::Error::other)?;
            Ok(ack.received.then_some(ack.length))
        }
    }

    /// The dongle of that number.
    pub(crate) fn open(number: u8) -> io::Result<Crazyradio> {
        Crazyradio::open_nth(usize::from(number)).map_err(io::Error::other)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use settings::RadioRate;

    /// A dongle with vehicles that echo what is sent to them, each by one packet late.
    #[derive(Default)]
    struct Fake {
        air: Vec<(u8, Vec<u8>)>,
        waiting: Option<Vec<u8>>,
        deaf: bool,
        broken: bool,
    }

    impl Dongle for Fake {
        fn exchange(
            &mut self,
            to: &RadioAddress,
            packet: &[u8],
            answer: &mut [u8; AIR_BYTES_MAX],
        ) -> io::Result<Option<usize>> {
            if self.broken {
                return Err(io::ErrorKind::NotConnected.into());
            }
            self.air.push((to.address[4], packet.to_vec()));
            if self.deaf {
                return Ok(None);
            }
            let said = self.waiting.replace(packet.to_vec()).unwrap_or_else(|| vec![0xF7, 1, 2]);
            answer[..said.len()].copy_from_slice(&said);
            Ok(Some(said.len()))
        }
    }

    fn address(last: u8) -> RadioAddress {
        RadioAddress { dongle: 0, channel: 80, rate: RadioRate::M2, address: [0xE7, 0xE7, 0xE7, 0xE7, last] }
    }

    fn plugged() -> (UdpSocket, User) {
        let mut dongles = Dongles::default();
        let ours = dongles.plug(address(5)).unwrap();
        ours.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        (ours, dongles.users.remove(0))
    }

    #[test]
    fn packets_go_out_in_order_and_answers_come_back_without_the_null_packets() {
        let (ours, mut user) = plugged();
        let mut dongle = Fake::default();
        let now = Instant::now();
        ours.send(&[0x9C, 1]).unwrap();
        ours.send(&[0x9C, 2]).unwrap();
        while dongle.air.len() < 2 {
            user.turn(&mut dongle, now).unwrap();
        }
        assert_eq!(dongle.air[0], (5, vec![0x9C, 1]));
        // The answer to the second comes with the acknowledgement of a null packet.
        user.turn(&mut dongle, now).unwrap();
        user.turn(&mut dongle, now).unwrap();
        let mut piece = [0; 40];
        for expected in [1, 2] {
            assert_eq!(ours.recv(&mut piece).unwrap(), 2);
            assert_eq!(piece[..2], [0x9C, expected]);
        }
        ours.set_nonblocking(true).unwrap();
        assert!(ours.recv(&mut piece).is_err(), "null packets say nothing");
    }

    #[test]
    fn a_silent_vehicle_is_asked_seldom_and_nothing_is_sent_again() {
        let (ours, mut user) = plugged();
        let mut dongle = Fake { deaf: true, ..Fake::default() };
        let start = Instant::now();
        ours.send(&[0x9C, 1]).unwrap();
        while dongle.air.is_empty() {
            user.turn(&mut dongle, start).unwrap();
            dongle.air.retain(|(_, packet)| *packet != NULL_PACKET);
        }
        dongle.air.clear();
        (0..100).for_each(|ms| drop(user.turn(&mut dongle, start + Duration::from_millis(20 + ms))));
        assert_eq!(dongle.air.len(), 10);
        assert!(dongle.air.iter().all(|(_, packet)| *packet == NULL_PACKET));
    }

    #[test]
    fn a_broken_dongle_is_an_error_and_a_cable_with_no_other_end_is_none() {
        let (ours, mut user) = plugged();
        drop(ours);
        let mut dongle = Fake::default();
        let start = Instant::now();
        for ms in 0..50 {
            user.turn(&mut dongle, start + Duration::from_millis(ms)).unwrap();
        }
        dongle.broken = true;
        assert!(user.turn(&mut dongle, start + Duration::from_secs(1)).is_err());
    }
}
