//! The kernel's filter: a node wakes only for what it reads.
//!
//! A classic BPF program over kind and topic hash. It only spares work: the text of the topic is still
//! compared and the tag still checked by whoever receives.

use schemas::Topic;
use socket2::SockFilter;
use wire::Kind;

/// What of the bus a socket lets through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Listen<'a> {
    /// Everything, definitions included: recorders and tools.
    Everything,
    /// Messages of these topics, and requests for definitions: services.
    Topics(&'a [&'static Topic]),
}

// A filter on a UDP socket sees the datagram from its UDP header on.
const UDP_HEADER_BYTES: u32 = 8;
const KIND_OFFSET: u32 = UDP_HEADER_BYTES + 3;
const TOPIC_HASH_OFFSET: u32 = UDP_HEADER_BYTES + 8;

// linux/bpf_common.h
const LOAD_BYTE: u16 = 0x30;
const LOAD_WORD: u16 = 0x20;
const JUMP_IF_EQUAL: u16 = 0x15;
const RETURN: u16 = 0x06;
const REJECT: u32 = 0;
const ACCEPT: u32 = u32::MAX;

/// The most topics a filter can name: jumps reach no farther.
const TOPICS_MAX: usize = 200;

/// The program, or none where everything passes.
pub(crate) fn program(listen: Listen<'_>) -> Option<Vec<SockFilter>> {
    match listen {
        Listen::Topics(topics) if topics.len() <= TOPICS_MAX => Some(
            instructions(topics)
                .into_iter()
                .map(|(code, yes, no, k)| SockFilter::new(code, yes, no, k))
                .collect(),
        ),
        Listen::Everything | Listen::Topics(_) => None,
    }
}

/// Operation, jump if true, jump if false, operand. Jumps are relative to the next instruction.
type Instruction = (u16, u8, u8, u32);

fn instructions(topics: &[&'static Topic]) -> Vec<Instruction> {
    let comparisons = topics.len() as u8;
    let mut program = vec![
        (LOAD_BYTE, 0, 0, KIND_OFFSET),
        (JUMP_IF_EQUAL, comparisons + 3, 0, Kind::SchemaRequest as u32),
        (JUMP_IF_EQUAL, 0, comparisons + 1, Kind::Data as u32),
        (LOAD_WORD, 0, 0, TOPIC_HASH_OFFSET),
    ];
    for (index, topic) in (0_u8..).zip(topics) {
        // BPF loads words in network order, our header is little endian.
        program.push((JUMP_IF_EQUAL, comparisons - index, 0, topic.hash.swap_bytes()));
    }
    program.push((RETURN, 0, 0, REJECT));
    program.push((RETURN, 0, 0, ACCEPT));
    program
}

#[cfg(test)]
mod tests {
    use schemas::topics;

    use super::*;

    /// Classic BPF, as far as used here.
    fn run(program: &[Instruction], payload: &[u8]) -> bool {
        let packet = [vec![0; UDP_HEADER_BYTES as usize], payload.to_vec()].concat();
        let (mut at, mut accumulator) = (0, 0);
        loop {
            let (code, yes, no, k) = program[at];
            at += 1;
            match code {
                LOAD_BYTE => match packet.get(k as usize) {
                    Some(byte) => accumulator = u32::from(*byte),
                    None => return false,
                },
                LOAD_WORD => match packet.get(k as usize..k as usize + 4) {
                    Some(word) => accumulator = u32::from_be_bytes(word.try_into().unwrap()),
                    None => return false,
                },
                JUMP_IF_EQUAL => at += usize::from(if accumulator == k { yes } else { no }),
                RETURN => return k != REJECT,
                _ => unreachable!("no such instruction"),
            }
        }
    }

    fn header(kind: Kind, hash: u32) -> Vec<u8> {
        let mut bytes = vec![b'F', b'M', 1, kind as u8, 2, 0, 0, 0];
        bytes.extend(hash.to_le_bytes());
        bytes
    }

    #[test]
    fn only_messages_of_the_topics_and_requests_pass() {
        for count in 0..=topics::ALL.len() {
            let (read, unread) = topics::ALL.split_at(count);
            let program = instructions(read);
            for topic in read {
                assert!(run(&program, &header(Kind::Data, topic.hash)), "{} of {count}", topic.name);
                assert!(!run(&program, &header(Kind::Schema, topic.hash)), "{} of {count}", topic.name);
            }
            for topic in unread {
                assert!(!run(&program, &header(Kind::Data, topic.hash)), "{} of {count}", topic.name);
                assert!(run(&program, &header(Kind::SchemaRequest, topic.hash)), "{} of {count}", topic.name);
            }
            assert!(!run(&program, b"FM"));
            assert!(!run(&program, &[]));
        }
    }
}
