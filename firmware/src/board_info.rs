//! What a board knows about itself.

use crate::fold::MAX_CHANNELS;
use crate::reference::SAMPLES_PER_PERIOD;
use protocol::{Hello, Limits, MAX_SLOTS, MAX_VALUES, Version, text};

/// The constants of one board, gathered in one place of its crate. Everything else of [`Hello`] follows.
#[derive(Clone, Copy, Debug)]
pub struct BoardInfo<'a> {
    /// Kind of board, at most 32 bytes.
    pub name: &'a str,
    /// This very board, at most 32 bytes.
    pub serial: &'a str,
    /// Electrodes wired.
    pub electrodes: u8,
    /// Channels sampled at once.
    pub channels: u8,
    /// Clock of the sampling timer, Hz.
    pub timer_hz: u32,
    /// Timer ticks from one sample to the next.
    pub ticks_per_sample: u32,
    /// Voltage between the lowest and the highest code, microvolt.
    pub adc_span_uv: u32,
    /// Amplitude of the excitation source, microvolt.
    pub excitation_uv: u32,
    /// Gains that a route can choose from, in thousandths; at most four.
    pub gains_milli: &'a [u32],
}

impl BoardInfo<'_> {
    /// The message that introduces the board.
    pub fn hello(&self) -> Hello {
        Hello {
            version: Version::CURRENT,
            firmware: text(env!("CARGO_PKG_VERSION")),
            board: text(self.name),
            serial: text(self.serial),
            electrodes: self.electrodes,
            samples_per_period: SAMPLES_PER_PERIOD as u8,
            timer_hz: self.timer_hz,
            ticks_per_sample: self.ticks_per_sample,
            adc_bits: crate::FULL_SCALE.count_ones() as u8,
            adc_span_uv: self.adc_span_uv,
            excitation_uv: self.excitation_uv,
            gains_milli: self.gains_milli.iter().copied().take(4).collect(),
            limits: Limits {
                slots: MAX_SLOTS as u8,
                values: MAX_VALUES as u16,
                channels: self.channels.min(MAX_CHANNELS as u8),
                settle_periods: u16::MAX,
                integrate_periods: u16::MAX,
            },
        }
    }
}
