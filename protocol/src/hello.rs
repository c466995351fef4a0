//! Who the board is and what it can do.

use heapless::{String, Vec};
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// A short text, at most 32 bytes of UTF-8.
pub type Text = String<32>;

/// What a panic said and where, at most 64 bytes of UTF-8.
pub type PanicText = String<64>;

/// A text cut to what fits, at a character's boundary.
pub fn text<const N: usize>(s: &str) -> String<N> {
    let mut out = String::new();
    for c in s.chars() {
        if out.push(c).is_err() {
            break;
        }
    }
    out
}

/// Version of the protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Version {
    /// Differs when the two sides cannot understand each other.
    pub major: u8,
    /// Grows when something was appended.
    pub minor: u8,
}

impl Version {
    /// The version that this crate speaks.
    pub const CURRENT: Self = Self { major: 2, minor: 1 };
}

/// The largest plan that the board can carry out.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Limits {
    /// Most slots, at most [`crate::MAX_SLOTS`].
    pub slots: u8,
    /// Most values, at most [`crate::MAX_VALUES`].
    pub values: u16,
    /// Channels sampled at once; 1 on a board that can only measure one value after the other.
    pub channels: u8,
    /// Most quarter periods to wait after a switch.
    pub settle_quarters: u16,
    /// Most periods to integrate.
    pub integrate_periods: u16,
    /// Most amplitudes of a frame, in-phase and quadrature together.
    pub amplitudes: u16,
    /// Most slots of a watch, at most [`crate::MAX_WATCH_SLOTS`].
    pub watch_slots: u8,
    /// Most values of a watch, at most [`crate::MAX_WATCH_VALUES`].
    pub watch_values: u8,
}

/// Why the board started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ResetCause {
    /// It does not know.
    #[default]
    Unknown,
    /// Power came.
    PowerOn,
    /// The supply sagged.
    BrownOut,
    /// The reset pin.
    Pin,
    /// The firmware restarted itself.
    Software,
    /// The firmware hung.
    Watchdog,
    /// The firmware met a bug in itself; [`Hello::last_panic`] says which.
    Panic,
}

impl core::fmt::Display for ResetCause {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Unknown => "a cause that it does not know",
            Self::PowerOn => "its supply",
            Self::BrownOut => "a supply that sagged",
            Self::Pin => "the reset pin",
            Self::Software => "its own program",
            Self::Watchdog => "its watchdog: the program hung",
            Self::Panic => "its program, which met a bug",
        })
    }
}

/// The board's answer to [`crate::ToBoard::Hello`]; it also says it once, unasked, when it starts.
///
/// The version comes first so that it can be read whatever follows.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Hello {
    /// Version of the protocol.
    pub version: Version,
    /// Hash of all messages of both directions as the board knows them, [`crate::SCHEMA`].
    pub schema: u32,
    /// Version of the firmware.
    pub firmware: Text,
    /// State of the source tree it was built from: a commit, and `-dirty` when it was changed; empty when unknown.
    pub git: Text,
    /// Kind of board.
    pub board: Text,
    /// This very board.
    pub serial: Text,
    /// Electrodes wired to it, 4 to [`crate::MAX_ELECTRODES`].
    pub electrodes: u8,
    /// Samples in one period of the excitation.
    pub samples_per_period: u8,
    /// Clock of the sampling timer, Hz. The sampling rate is the ratio `timer_hz / ticks_per_sample`, exactly.
    pub timer_hz: u32,
    /// Timer ticks from one sample to the next.
    pub ticks_per_sample: u32,
    /// Resolution of the converter, bits: 12 to 16. Values and noise count in codes of 12 bits all the same, folded periods in
    /// its own.
    pub adc_bits: u8,
    /// Voltage between the lowest and the highest code, microvolt.
    pub adc_span_uv: u32,
    /// Amplitude of the excitation source, microvolt.
    pub excitation_uv: u32,
    /// The gains between sense pair and converter that a slot can choose from, in thousandths.
    pub gains_milli: Vec<u32, 4>,
    /// The largest plan it accepts.
    pub limits: Limits,
    /// Timer ticks from one channel's sample to the next one's. Values are corrected for it; folded periods are not.
    pub skew_ticks: u16,
    /// Why it started.
    pub reset: ResetCause,
    /// The last bug that its firmware met, told once, or what the board found wrong as it started; empty when there was none.
    pub last_panic: PanicText,
}

impl Hello {
    /// Samples a second. For display and plots: durations are better kept in samples.
    pub fn sample_rate(&self) -> f64 {
        f64::from(self.timer_hz) / f64::from(self.ticks_per_sample.max(1))
    }

    /// Whether this is the same board with the same firmware, whatever happened to it meanwhile.
    pub fn is_same_board(&self, other: &Self) -> bool {
        let lasting = |hello: &Self| Self {
            reset: ResetCause::Unknown,
            last_panic: PanicText::new(),
            ..hello.clone()
        };
        lasting(self) == lasting(other)
    }

    /// Frequency of the excitation, Hz.
    pub fn excitation_hz(&self) -> f64 {
        self.sample_rate() / f64::from(self.samples_per_period.max(1))
    }

    /// The converter's own codes in one code of 12 bits: 1 for 12 bits, 16 for 16.
    pub fn codes_in_one(&self) -> f64 {
        f64::from(1u32 << (self.adc_bits.clamp(12, 31) - 12))
    }

    /// The converter's range in codes of 12 bits.
    pub fn range_codes(&self) -> f64 {
        f64::from((1u32 << self.adc_bits.min(31)) - 1) / self.codes_in_one()
    }

    /// Volts at the sense pair for one ADC code of 12 bits at gain number `gain`; `None` for a gain that the board has not.
    pub fn volts_per_code(&self, gain: u8) -> Option<f64> {
        let milli = *self.gains_milli.get(usize::from(gain))?;
        (milli > 0).then(|| f64::from(self.adc_span_uv) * 1e-6 / self.range_codes() / (f64::from(milli) / 1000.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_text_is_cut_between_characters() {
        let s: Text = text("0123456789012345678901234567890\u{e9}x");
        assert_eq!(s.as_str(), "0123456789012345678901234567890");
        assert_eq!(text::<8>("skin").as_str(), "skin");
    }
}
