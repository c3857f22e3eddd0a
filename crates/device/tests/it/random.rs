//! Random bytes that are the same in every run.

/// Sebastiano Vigna's SplitMix64.
pub struct Random(u64);

impl Random {
    /// The numbers of this seed.
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next number.
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// A number below `end`.
    pub fn below(&mut self, end: usize) -> usize {
        (self.next() % end as u64) as usize
    }

    /// Up to `most` bytes; half of them of few values, so that counts and lengths are small now and then.
    pub fn bytes(&mut self, most: usize) -> Vec<u8> {
        let length = self.below(most + 1);
        let byte = |word: u64| if word & 0x100 == 0 { word as u8 } else { (word >> 9) as u8 & 3 };
        (0..length).map(|_| byte(self.next())).collect()
    }

    /// The bytes with one to eight of them changed, inserted or taken out.
    pub fn damaged(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut bytes = bytes.to_vec();
        for _ in 0..=self.below(8) {
            let (at, byte) = (self.below(bytes.len().max(1)), self.next() as u8);
            match self.below(6) {
                0 => bytes.insert(at.min(bytes.len()), byte),
                1 if !bytes.is_empty() => {
                    bytes.remove(at);
                }
                2 => bytes.truncate(at),
                3 if !bytes.is_empty() => bytes[at] ^= 1 << (byte & 7),
                _ if !bytes.is_empty() => bytes[at] = byte,
                _ => {}
            }
        }
        bytes
    }
}
