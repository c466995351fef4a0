//! How much the samples scattered, in one byte.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// Variance of one sample in 256ths of a squared ADC code of 12 bits, as a small floating-point number: `(8 + m) 2^e / 8` with m the
/// low three bits and e the rest. Less than 1 counts as 1. Range 1/256 to 2^24 squared codes, cut to 12 % or less.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Variance(u8);

impl Variance {
    /// From 256ths of a squared code; cut, never rounded up.
    pub const fn new(parts: u32) -> Self {
        if parts == 0 {
            return Self(0);
        }
        let exponent = parts.ilog2();
        let mantissa = ((parts as u64) << 3 >> exponent) as u8 & 7;
        Self((exponent as u8) << 3 | mantissa)
    }

    /// In 256ths of a squared code.
    pub const fn parts(self) -> u32 {
        ((8 + (self.0 & 7) as u64) << (self.0 >> 3) >> 3) as u32
    }

    /// In squared ADC codes.
    pub const fn codes2(self) -> f64 {
        self.parts() as f64 / 256.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_cut_by_less_than_an_eighth_and_keeps_the_order() {
        let mut last = Variance::new(0);
        for k in 0..3_000_000u32 {
            let parts = k.wrapping_mul(1431) | 1;
            let back = Variance::new(parts).parts();
            assert!(back <= parts && parts - back <= parts / 8, "{parts} {back}");
            let v = Variance::new(k);
            assert!(v >= last);
            last = v;
        }
        assert_eq!(Variance::new(u32::MAX).parts(), 15 << 28);
        assert_eq!(Variance::new(256).codes2(), 1.0);
    }
}
