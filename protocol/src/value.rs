//! One measured amplitude as it crosses the wire.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// An amplitude in sixteenths of an ADC code of 12 bits, always two bytes on the wire. These are 65,536ths of the converter's
/// range, whatever bits it has: of a converter of 16 bits, codes.
///
/// Range: the largest amplitude a 12-bit converter can show is 2047.5 codes = 32,760 sixteenths, so an `i16` holds all of
/// them; whatever exceeds it saturates and is flagged in the frame.
///
/// Why a sixteenth: rounding to a step q adds noise of `q / sqrt(12)`, 0.018 code for q = 1/16 code. A touch of 25 N in the
/// middle of the sheet changes the values by about 1.6 code rms. The paper's noise is 27 dB below such a touch, 0.07 code.
/// Rounding adds 7 % (0.3 dB) to the noise power where six periods are integrated, and 1 % (0.05 dB) where one is. Noise of
/// one step or more also dithers the rounding: the mean over many frames has no bias. A finer step would need a third byte,
/// and 208 values at 184 frames/s would no longer fit the link.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Value([u8; 2]);

impl Value {
    /// Units in one ADC code.
    pub const PER_CODE: i32 = 16;
    /// Largest value.
    pub const MAX: Self = Self::new(i16::MAX);
    /// Smallest value.
    pub const MIN: Self = Self::new(i16::MIN);

    /// From sixteenths of an ADC code.
    pub const fn new(sixteenths: i16) -> Self {
        Self(sixteenths.to_le_bytes())
    }

    /// From sixteenths of an ADC code; says whether it fitted. What does not fit becomes [`Value::MAX`] or
    /// [`Value::MIN`].
    pub const fn saturating(sixteenths: i64) -> (Self, bool) {
        if sixteenths > i16::MAX as i64 {
            (Self::MAX, false)
        } else if sixteenths < i16::MIN as i64 {
            (Self::MIN, false)
        } else {
            (Self::new(sixteenths as i16), true)
        }
    }

    /// In sixteenths of an ADC code.
    pub const fn sixteenths(self) -> i16 {
        i16::from_le_bytes(self.0)
    }

    /// In ADC codes, exact.
    pub const fn codes(self) -> f64 {
        self.sixteenths() as f64 / Self::PER_CODE as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_amplitude_of_twelve_bits_fits() {
        let full = (4095 * Value::PER_CODE / 2) as i64;
        assert_eq!(Value::saturating(full), (Value::new(32_760), true));
        assert_eq!(Value::saturating(-full).0.codes(), -2047.5);
    }

    #[test]
    fn beyond_the_range_saturates_and_says_so() {
        assert_eq!(Value::saturating(32_768), (Value::MAX, false));
        assert_eq!(Value::saturating(-32_769), (Value::MIN, false));
        assert_eq!(Value::saturating(-32_768), (Value::MIN, true));
    }
}
