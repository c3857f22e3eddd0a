//! Checks: over our own frames CRC-11 and CRC-10 for channels, CRC-16 for radio payloads, FNV-1a for parameter sets;
//! over CRSF's frames its CRC-8, over MAVLink's its CRC-16.

/// CRC-11/UMTS (polynomial 0x307, initial value 0) over 11-bit words, most significant bit first.
///
/// The polynomial has the factor x + 1, so every odd number of wrong bits is found; its period of 1023
/// exceeds the 176 bits of an SBUS frame, so every two wrong bits are found too.
pub(crate) fn crc11(words: &[u16]) -> u16 {
    words.iter().flat_map(|word| (0..11).rev().map(move |bit| (word >> bit) & 1)).fold(0, crc11_bit)
}

const fn crc11_bit(crc: u16, bit: u16) -> u16 {
    let feedback = ((crc >> 10) ^ bit) & 1;
    let shifted = (crc << 1) & 0x7FF;
    if feedback == 1 { shifted ^ 0x307 } else { shifted }
}

/// CRC-10/ATM (polynomial 0x233, initial value 0) over 10-bit words, most significant bit first.
pub(crate) fn crc10(words: impl IntoIterator<Item = u16>) -> u16 {
    words.into_iter().flat_map(|word| (0..10).rev().map(move |bit| (word >> bit) & 1)).fold(0, crc10_bit)
}

const fn crc10_bit(crc: u16, bit: u16) -> u16 {
    let feedback = ((crc >> 9) ^ bit) & 1;
    let shifted = (crc << 1) & 0x3FF;
    if feedback == 1 { shifted ^ 0x233 } else { shifted }
}

/// CRC-8/DVB-S2 (polynomial 0xD5, initial value 0).
pub(crate) fn crc8(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |crc, byte| {
        (0..8).fold(crc ^ byte, |crc, _| if crc & 0x80 == 0 { crc << 1 } else { (crc << 1) ^ 0xD5 })
    })
}

/// CRC-16/IBM-3740, often called CCITT-FALSE (polynomial 0x1021, initial value 0xFFFF).
pub(crate) fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, byte| {
        (0..8).fold(crc ^ (u16::from(*byte) << 8), |crc, _| {
            if crc & 0x8000 == 0 { crc << 1 } else { (crc << 1) ^ 0x1021 }
        })
    })
}

/// CRC-16/MCRF4XX (polynomial 0x1021 reflected, initial value 0xFFFF).
pub(crate) fn crc16_mcrf4xx<'b>(bytes: impl IntoIterator<Item = &'b u8>) -> u16 {
    bytes.into_iter().fold(0xFFFF, |crc, byte| {
        (0..8)
            .fold(crc ^ u16::from(*byte), |crc, _| if crc & 1 == 0 { crc >> 1 } else { (crc >> 1) ^ 0x8408 })
    })
}

/// FNV-1a, 64 bits.
pub(crate) fn fnv1a64(bytes: impl IntoIterator<Item = u8>) -> u64 {
    bytes.into_iter().fold(0xCBF2_9CE4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn check_values_are_those_of_the_catalogues() {
        let bits =
            b"123456789".iter().flat_map(|byte| (0..8).rev().map(move |bit| u16::from(byte >> bit) & 1));
        assert_eq!(bits.clone().fold(0, crc11_bit), 0x061);
        assert_eq!(bits.fold(0, crc10_bit), 0x199);
        assert_eq!(crc8(b"123456789"), 0xBC);
        assert_eq!(crc16(b"123456789"), 0x29B1);
        assert_eq!(crc16_mcrf4xx(b"123456789"), 0x6F91);
        assert_eq!(fnv1a64(*b"foobar"), 0x8594_4171_F739_67E8);
    }

    #[test]
    fn crc11_finds_every_one_and_two_wrong_bits_of_a_frame() {
        // The check is linear: a set of wrong bits goes unseen exactly if the checks of its members cancel.
        let syndromes = (0..176usize).map(|bit| {
            let (word, mask) = (bit / 11, 1 << (bit % 11));
            if word == 15 {
                return mask;
            }
            let mut words = [0; 15];
            words[word] = mask;
            crc11(&words)
        });
        let mut seen = std::collections::BTreeSet::new();
        for syndrome in syndromes {
            assert_ne!(syndrome, 0);
            assert!(seen.insert(syndrome), "two wrong bits would cancel");
        }
    }

    #[test]
    fn crc11_finds_every_three_wrong_bits_by_parity() {
        // x + 1 divides the generator x^11 + 0x307: an even number of terms.
        assert_eq!((0x800u16 | 0x307).count_ones() % 2, 0);
    }
}
