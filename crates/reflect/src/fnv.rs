//! FNV-1a: the hash of topic names and schema texts. It keeps no secrets; authentication is `wire`'s.

const PRIME_32: u32 = 0x0100_0193;
const OFFSET_32: u32 = 0x811c_9dc5;
const PRIME_64: u64 = 0x0000_0100_0000_01b3;
const OFFSET_64: u64 = 0xcbf2_9ce4_8422_2325;

/// FNV-1a of 32 bits.
#[must_use]
pub const fn fnv1a_32(bytes: &[u8]) -> u32 {
    let mut hash = OFFSET_32;
    let mut i = 0;
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u32).wrapping_mul(PRIME_32);
        i += 1;
    }
    hash
}

/// FNV-1a of 64 bits, over the parts one after another.
#[must_use]
pub const fn fnv1a_64(parts: &[&[u8]]) -> u64 {
    let mut hash = OFFSET_64;
    let mut part = 0;
    while part < parts.len() {
        let mut i = 0;
        while i < parts[part].len() {
            hash = (hash ^ parts[part][i] as u64).wrapping_mul(PRIME_64);
            i += 1;
        }
        part += 1;
    }
    hash
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The vectors of the FNV authors' own test suite.
    #[test]
    fn published_vectors_hold() {
        assert_eq!(fnv1a_32(b""), 0x811c_9dc5);
        assert_eq!(fnv1a_32(b"foobar"), 0xbf9c_f968);
        assert_eq!(fnv1a_64(&[]), 0xcbf2_9ce4_8422_2325);
        assert_eq!(fnv1a_64(&[b"foobar"]), 0x8594_4171_f739_67e8);
        assert_eq!(fnv1a_64(&[b"foo", b"", b"bar"]), 0x8594_4171_f739_67e8);
    }
}
