//! Sixteen channels of eleven bits in 22 bytes, least significant bit first: what SBUS and CRSF share.

/// Bytes of the packed channels.
pub(crate) const PACKED_BYTES: usize = 22;

const CHANNEL_BITS: usize = 11;

/// Packs the lower eleven bits of each channel.
pub(crate) fn pack(channels: &[u16; 16]) -> [u8; PACKED_BYTES] {
    let mut out = [0; PACKED_BYTES];
    for (channel, value) in channels.iter().enumerate() {
        for bit in (0..CHANNEL_BITS).filter(|bit| (value >> bit) & 1 == 1) {
            let at = channel * CHANNEL_BITS + bit;
            out[at / 8] |= 1 << (at % 8);
        }
    }
    out
}

/// The channels in these bytes, each 0 to 2047.
pub(crate) fn unpack(bytes: &[u8; PACKED_BYTES]) -> [u16; 16] {
    let mut channels = [0u16; 16];
    for (channel, value) in channels.iter_mut().enumerate() {
        for bit in 0..CHANNEL_BITS {
            let at = channel * CHANNEL_BITS + bit;
            *value |= u16::from((bytes[at / 8] >> (at % 8)) & 1) << bit;
        }
    }
    channels
}
