//! The converter's codes: how many bits they have, and what follows from it.
//!
//! Whatever the converter gives, everything after the lock-in counts in codes of 12 bits, 4096ths of the range: values,
//! noise, limits. A converter of more bits shows more of their fractions.

/// Fewest bits of a code. A converter of fewer shifts its codes left.
pub const LEAST_BITS: u8 = 12;

/// Most bits of a code: a sample is two bytes.
pub const MOST_BITS: u8 = 16;

/// Highest code of 12 bits. A sample of 0 or of the converter's highest code touches a rail.
pub const FULL_SCALE: u16 = full_scale(LEAST_BITS);

/// Highest code of so many bits, [`LEAST_BITS`] to [`MOST_BITS`].
pub const fn full_scale(bits: u8) -> u16 {
    u16::MAX >> (MOST_BITS as u32 - LEAST_BITS as u32 - extra_bits(bits))
}

/// Most periods that can be folded of codes of so many bits: the sums have the same bound for all of them. Of 12 bits it is all
/// that a plan can count.
pub const fn max_periods(bits: u8) -> u16 {
    u16::MAX >> extra_bits(bits)
}

/// Bits beyond twelve.
pub(crate) const fn extra_bits(bits: u8) -> u32 {
    let bits = if bits > MOST_BITS { MOST_BITS } else { bits };
    bits.saturating_sub(LEAST_BITS) as u32
}

const _: () = assert!(FULL_SCALE == 4095 && full_scale(MOST_BITS) == u16::MAX);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_have_the_bits_that_they_are_said_to_have() {
        for bits in LEAST_BITS..=MOST_BITS {
            assert_eq!(u32::from(full_scale(bits)) + 1, 1 << bits);
            assert_eq!(u32::from(max_periods(bits)) + 1, 1 << (28 - bits));
        }
        // What no board may say is brought to the next that it may.
        assert_eq!((full_scale(8), full_scale(24)), (FULL_SCALE, u16::MAX));
    }
}
