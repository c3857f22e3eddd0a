//! The one module with `unsafe`: what the kernel offers and no safe crate does.
//!
//! Three socket options, several datagrams in one system call with the kernel's notes on each (when it came,
//! how many were dropped), a descriptor of our own watched by tokio, and the state of the wall clock.

#![allow(
    unsafe_code,
    reason = "SO_TIMESTAMPNS, SO_RXQ_OVFL, SO_MEMINFO, recvmmsg, adjtimex and AsyncFd::register have no safe wrapper"
)]

use std::io;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use std::task::{Context, Poll};

use tokio::io::Interest;
use tokio::io::unix::{AsyncFd, AsyncFdReadyGuard};

/// Datagrams taken per system call.
pub(crate) const BATCH: usize = 16;
/// Room for the longest UDP datagram there is.
const DATAGRAM_BYTES_MAX: usize = 65_536;
const CONTROL_BYTES: usize = 128;

// The notes are parsed for the layout of 64-bit Linux.
const CMSG_HEADER_BYTES: usize = 16;
const _: () = assert!(size_of::<libc::cmsghdr>() == CMSG_HEADER_BYTES, "service-shell needs 64-bit Linux");
const _: () = assert!(size_of::<libc::timespec>() == 16, "service-shell needs 64-bit Linux");

/// Asks the kernel to note on each datagram when it came and how many were dropped before it.
pub(crate) fn enable_notes(socket: &impl AsFd) -> io::Result<()> {
    for option in [libc::SO_TIMESTAMPNS, libc::SO_RXQ_OVFL] {
        let on: libc::c_int = 1;
        // SAFETY: the descriptor is borrowed for the call and so is open; `on` is a c_int that outlives the
        // call, and its size is passed along.
        let result = unsafe {
            libc::setsockopt(
                socket.as_fd().as_raw_fd(),
                libc::SOL_SOCKET,
                option,
                (&raw const on).cast(),
                size_of_val(&on) as libc::socklen_t,
            )
        };
        if result != 0 {
            return Err(io::Error::last_os_error());
        }
    }
    Ok(())
}

/// How full a socket's receive queue is: bytes held and bytes allowed, both with the kernel's bookkeeping.
pub(crate) fn queue_fill(socket: &impl AsFd) -> io::Result<(u32, u32)> {
    // linux/sock_diag.h: SK_MEMINFO_RMEM_ALLOC and SK_MEMINFO_RCVBUF are the first two of nine.
    let mut memory = [0_u32; 9];
    let mut length = size_of_val(&memory) as libc::socklen_t;
    // SAFETY: the descriptor is borrowed for the call and so is open; the kernel writes at most `length`
    // bytes, which is the size of `memory`; both outlive the call.
    let result = unsafe {
        libc::getsockopt(
            socket.as_fd().as_raw_fd(),
            libc::SOL_SOCKET,
            libc::SO_MEMINFO,
            (&raw mut memory).cast(),
            &raw mut length,
        )
    };
    if result == 0 { Ok((memory[0], memory[1])) } else { Err(io::Error::last_os_error()) }
}

/// Whether somebody keeps the wall clock to a reference.
pub(crate) fn clock_synchronised() -> io::Result<bool> {
    // SAFETY: a timex is numbers alone, for which zeros stand; with `modes` zero nothing is set.
    let mut state: libc::timex = unsafe { std::mem::zeroed() };
    // SAFETY: the kernel writes within `state`, which outlives the call.
    match unsafe { libc::adjtimex(&raw mut state) } {
        -1 => Err(io::Error::last_os_error()),
        code => Ok(code != libc::TIME_ERROR),
    }
}

/// A descriptor that wakes the task when it becomes readable. It cannot be exchanged for another while
/// watched.
#[derive(Debug)]
pub(crate) struct Watched(AsyncFd<OwnedFd>);

impl Watched {
    /// Call within a tokio runtime.
    pub(crate) fn new(fd: OwnedFd) -> io::Result<Self> {
        // SAFETY: the OwnedFd is open and moves in here; no method hands it out by value or by exclusive
        // reference, so it stays open and the same until the AsyncFd is dropped.
        unsafe { AsyncFd::register_with_interest(fd, Interest::READABLE) }.map(Self).map_err(io::Error::from)
    }

    pub(crate) fn poll_readable(
        &self,
        cx: &mut Context<'_>,
    ) -> Poll<io::Result<AsyncFdReadyGuard<'_, OwnedFd>>> {
        self.0.poll_read_ready(cx)
    }
}

impl AsFd for Watched {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.get_ref().as_fd()
    }
}

/// Aligned as `cmsghdr` needs.
#[derive(Clone, Copy)]
#[repr(C, align(8))]
struct Control([u8; CONTROL_BYTES]);

/// Where a batch of datagrams lands.
pub(crate) struct Buffers {
    bytes: Box<[u8]>,
    control: [Control; BATCH],
    peers: [SocketAddrV4; BATCH],
    lengths: [usize; BATCH],
    control_lengths: [usize; BATCH],
}

type Headers = [libc::mmsghdr; BATCH];

/// What the kernel noted on a datagram.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Notes {
    /// When it came, wall clock, nanoseconds since 1970.
    pub stamp_ns: Option<i64>,
    /// Datagrams the socket had dropped before it, modulo 2^32; absent while none.
    pub dropped: Option<u32>,
}

impl Buffers {
    pub(crate) fn new() -> Self {
        Self {
            // Zeroed pages come from the kernel as they are touched: sixteen times 64 KiB cost nothing until
            // used.
            bytes: vec![0; BATCH * DATAGRAM_BYTES_MAX].into_boxed_slice(),
            control: [Control([0; CONTROL_BYTES]); BATCH],
            peers: [SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, 0); BATCH],
            lengths: [0; BATCH],
            control_lengths: [0; BATCH],
        }
    }

    /// Takes what has come without waiting: the number of datagrams, fewer than [`BATCH`] if there are no
    /// more.
    pub(crate) fn receive(&mut self, socket: &impl AsFd) -> io::Result<usize> {
        // SAFETY: all three are plain C structs of integers and pointers, for which all zeros are valid.
        let (mut vectors, mut peers, mut messages): (
            [libc::iovec; BATCH],
            [libc::sockaddr_in; BATCH],
            Headers,
        ) = unsafe { (std::mem::zeroed(), std::mem::zeroed(), std::mem::zeroed()) };
        let slots = self.bytes.chunks_exact_mut(DATAGRAM_BYTES_MAX).zip(&mut self.control);
        let headers = vectors.iter_mut().zip(&mut peers).zip(&mut messages);
        for (((vector, peer), message), (bytes, control)) in headers.zip(slots) {
            vector.iov_base = bytes.as_mut_ptr().cast();
            vector.iov_len = bytes.len();
            message.msg_hdr.msg_iov = vector;
            message.msg_hdr.msg_iovlen = 1;
            message.msg_hdr.msg_name = (&raw mut *peer).cast();
            message.msg_hdr.msg_namelen = size_of::<libc::sockaddr_in>() as libc::socklen_t;
            message.msg_hdr.msg_control = control.0.as_mut_ptr().cast();
            message.msg_hdr.msg_controllen = CONTROL_BYTES;
        }
        // SAFETY: each header points at one iovec, one address and one control buffer that belong to `self`
        // or this frame, are disjoint, have the lengths given, and outlive the call; the descriptor is
        // borrowed and so is open; no timeout is passed.
        let count = unsafe {
            libc::recvmmsg(
                socket.as_fd().as_raw_fd(),
                messages.as_mut_ptr(),
                BATCH as libc::c_uint,
                libc::MSG_DONTWAIT,
                std::ptr::null_mut(),
            )
        };
        let Ok(count) = usize::try_from(count) else {
            return Err(io::Error::last_os_error());
        };
        for (index, (message, peer)) in messages.iter().zip(&peers).take(count).enumerate() {
            self.lengths[index] = (message.msg_len as usize).min(DATAGRAM_BYTES_MAX);
            self.control_lengths[index] = message.msg_hdr.msg_controllen.min(CONTROL_BYTES);
            let address = Ipv4Addr::from_bits(u32::from_be(peer.sin_addr.s_addr));
            self.peers[index] = SocketAddrV4::new(address, u16::from_be(peer.sin_port));
        }
        Ok(count)
    }

    /// Who sent a datagram of the last batch.
    pub(crate) fn peer(&self, index: usize) -> SocketAddrV4 {
        self.peers[index]
    }

    /// A datagram of the last batch.
    pub(crate) fn datagram(&self, index: usize) -> &[u8] {
        let start = index * DATAGRAM_BYTES_MAX;
        &self.bytes[start..start + self.lengths[index]]
    }

    /// What the kernel noted on it.
    pub(crate) fn notes(&self, index: usize) -> Notes {
        parse_notes(&self.control[index].0[..self.control_lengths[index]])
    }
}

/// Reads a chain of control messages: length, level, type, data, each entry padded to eight bytes.
fn parse_notes(mut chain: &[u8]) -> Notes {
    let mut notes = Notes::default();
    while let (Some(length), Some(level), Some(kind)) =
        (u64_at(chain, 0), i32_at(chain, 8), i32_at(chain, 12))
    {
        let length = usize::try_from(length).unwrap_or(usize::MAX);
        let Some(data) = chain.get(CMSG_HEADER_BYTES..length) else {
            break;
        };
        match (level, kind) {
            (libc::SOL_SOCKET, libc::SCM_TIMESTAMPNS) => {
                if let (Some(seconds), Some(nanos)) = (u64_at(data, 0), u64_at(data, 8)) {
                    let nanos_since_1970 =
                        (seconds as i64).saturating_mul(1_000_000_000).saturating_add(nanos as i64);
                    notes.stamp_ns = Some(nanos_since_1970);
                }
            }
            (libc::SOL_SOCKET, libc::SO_RXQ_OVFL) => {
                notes.dropped = i32_at(data, 0).map(|count| count as u32)
            }
            _ => {}
        }
        chain = chain.get(length.next_multiple_of(8)..).unwrap_or_default();
    }
    notes
}

fn u64_at(bytes: &[u8], offset: usize) -> Option<u64> {
    bytes.get(offset..)?.first_chunk().map(|bytes| u64::from_ne_bytes(*bytes))
}

fn i32_at(bytes: &[u8], offset: usize) -> Option<i32> {
    bytes.get(offset..)?.first_chunk().map(|bytes| i32::from_ne_bytes(*bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(level: i32, kind: i32, data: &[u8]) -> Vec<u8> {
        let mut bytes = ((CMSG_HEADER_BYTES + data.len()) as u64).to_ne_bytes().to_vec();
        bytes.extend(level.to_ne_bytes());
        bytes.extend(kind.to_ne_bytes());
        bytes.extend(data);
        bytes.resize(bytes.len().next_multiple_of(8), 0);
        bytes
    }

    #[test]
    fn notes_are_read_in_any_order_among_others() {
        let stamp = [1_700_000_000_i64.to_ne_bytes(), 20_000_000_i64.to_ne_bytes()].concat();
        let chain = [
            entry(libc::IPPROTO_IP, libc::IP_TTL, &1_i32.to_ne_bytes()),
            entry(libc::SOL_SOCKET, libc::SO_RXQ_OVFL, &7_u32.to_ne_bytes()),
            entry(libc::SOL_SOCKET, libc::SCM_TIMESTAMPNS, &stamp),
        ]
        .concat();
        let expected = Notes { stamp_ns: Some(1_700_000_000_020_000_000), dropped: Some(7) };
        assert_eq!(parse_notes(&chain), expected);
    }

    #[test]
    fn a_chain_cut_anywhere_gives_no_wrong_notes() {
        let stamp = [5_i64.to_ne_bytes(), 6_i64.to_ne_bytes()].concat();
        let chain = entry(libc::SOL_SOCKET, libc::SCM_TIMESTAMPNS, &stamp);
        for length in 0..chain.len() {
            assert_eq!(parse_notes(&chain[..length]), Notes::default(), "{length} bytes");
        }
    }

    #[test]
    fn an_entry_of_length_zero_ends_the_chain() {
        assert_eq!(parse_notes(&[0; CONTROL_BYTES]), Notes::default());
    }
}
