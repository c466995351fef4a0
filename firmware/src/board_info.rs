//! What a board knows about itself.

use crate::fold::MAX_CHANNELS;
use crate::reference::SAMPLES_PER_PERIOD;
use crate::scan::MAX_AMPLITUDES;
use protocol::{
    Hello, Limits, MAX_ELECTRODES, MAX_SLOTS, MAX_VALUES, MAX_WATCH_SLOTS, MAX_WATCH_VALUES, ResetCause, SCHEMA, Value,
    Version, text,
};

/// The constants of one board, gathered in one place of its crate. Everything else of [`Hello`] follows. A board asserts
/// [`BoardInfo::is_sound`] where it is compiled.
#[derive(Clone, Copy, Debug)]
pub struct BoardInfo<'a> {
    /// Kind of board, at most 32 bytes.
    pub name: &'a str,
    /// This very board, at most 32 bytes.
    pub serial: &'a str,
    /// State of the source tree it was built from, at most 32 bytes: a commit, `-dirty` after it when it was changed.
    pub git: &'a str,
    /// Electrodes wired, 4 to [`MAX_ELECTRODES`].
    pub electrodes: u8,
    /// Channels sampled at once.
    pub channels: u8,
    /// Clock of the sampling timer, Hz.
    pub timer_hz: u32,
    /// Timer ticks from one sample to the next.
    pub ticks_per_sample: u32,
    /// Timer ticks from one channel's conversion to the next one's of the same row; 0 where all are converted at once.
    pub skew_ticks: u16,
    /// Voltage between the lowest and the highest code, microvolt.
    pub adc_span_uv: u32,
    /// Amplitude of the excitation source at full scale, microvolt.
    pub excitation_uv: u32,
    /// Gain between the source and the converter on [`Sense::Source`](crate::Sense::Source), in thousandths.
    pub source_gain_milli: u32,
    /// Gains that a route can choose from, in thousandths; 0 where there are fewer than four. Number 0 is for sense pairs,
    /// the last one for the drive pair itself.
    pub gains_milli: [u32; 4],
    /// Why the board started.
    pub reset: ResetCause,
    /// The last panic, at most 64 bytes; empty when there was none.
    pub last_panic: &'a str,
}

impl BoardInfo<'_> {
    /// Whether the constants fit together. There has to be an excitation, of whatever frequency. A row of channels has to be
    /// converted before the next one begins. The firmware has to be able to use the electrodes, channels and gains.
    pub const fn is_sound(&self) -> bool {
        let in_tune = self.excitation_millihertz() > 0;
        let in_time = self.skew_ticks as u32 * self.channels as u32 <= self.ticks_per_sample;
        let electrodes = self.electrodes >= 4 && self.electrodes <= MAX_ELECTRODES;
        let channels = self.channels >= 1 && self.channels as usize <= MAX_CHANNELS;
        let gains = self.gains() >= 1;
        in_tune && in_time && electrodes && channels && gains
    }

    /// The excitation's frequency: the sampling timer's over the samples of a period, in thousandths of a hertz, rounded
    /// down. A board asserts the one that its filters are made for.
    pub const fn excitation_millihertz(&self) -> u64 {
        let ticks = self.ticks_per_sample as u64 * SAMPLES_PER_PERIOD as u64;
        if ticks == 0 {
            return 0;
        }
        self.timer_hz as u64 * 1000 / ticks
    }

    /// Samples in a second, at least one.
    pub(crate) fn samples_per_second(&self) -> u64 {
        let samples = self.timer_hz.checked_div(self.ticks_per_sample);
        samples.unwrap_or(1).max(1).into()
    }

    /// How many gains there are.
    pub const fn gains(&self) -> u8 {
        match self.gains_milli {
            [0, ..] => 0,
            [_, 0, ..] => 1,
            [_, _, 0, _] => 2,
            [_, _, _, 0] => 3,
            _ => 4,
        }
    }

    /// Amplitude in sixteenths of a code that the source shows on [`Sense::Source`](crate::Sense::Source) at full scale.
    pub fn source_full_scale(&self) -> i64 {
        let microvolt = i64::from(self.excitation_uv) * i64::from(self.source_gain_milli) / 1000;
        let per_code = i64::from(Value::PER_CODE) * i64::from(crate::FULL_SCALE);
        (microvolt * per_code)
            .checked_div(i64::from(self.adc_span_uv))
            .unwrap_or(0)
    }

    /// The largest plan and watch.
    pub fn limits(&self) -> Limits {
        Limits {
            slots: MAX_SLOTS as u8,
            values: MAX_VALUES as u16,
            channels: self.channels.min(MAX_CHANNELS as u8),
            settle_quarters: u16::MAX,
            integrate_periods: u16::MAX,
            amplitudes: MAX_AMPLITUDES as u16,
            watch_slots: MAX_WATCH_SLOTS as u8,
            watch_values: MAX_WATCH_VALUES as u8,
        }
    }

    /// The message that introduces the board.
    pub fn hello(&self) -> Hello {
        Hello {
            version: Version::CURRENT,
            schema: SCHEMA,
            firmware: text(env!("CARGO_PKG_VERSION")),
            git: text(self.git),
            board: text(self.name),
            serial: text(self.serial),
            electrodes: self.electrodes,
            samples_per_period: SAMPLES_PER_PERIOD as u8,
            timer_hz: self.timer_hz,
            ticks_per_sample: self.ticks_per_sample,
            adc_bits: crate::FULL_SCALE.count_ones() as u8,
            adc_span_uv: self.adc_span_uv,
            excitation_uv: self.excitation_uv,
            gains_milli: self.gains_milli.into_iter().take(self.gains().into()).collect(),
            limits: self.limits(),
            skew_ticks: self.skew_ticks,
            reset: self.reset,
            last_panic: text(self.last_panic),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: BoardInfo<'static> = BoardInfo {
        name: "",
        serial: "",
        git: "",
        electrodes: 16,
        channels: 16,
        timer_hz: 84_000_000,
        ticks_per_sample: 1425,
        skew_ticks: 60,
        adc_span_uv: 3_300_000,
        excitation_uv: 2_250_000,
        source_gain_milli: 586,
        gains_milli: [13_000, 600, 0, 0],
        reset: ResetCause::Unknown,
        last_panic: "",
    };

    #[test]
    fn constants_that_do_not_fit_together_are_found() {
        assert!(GOOD.is_sound());
        // Boards of other frequencies: 84 MHz / 16 / 1425, 170 MHz / 16 / 213, and none.
        for (timer_hz, ticks_per_sample, millihertz) in [
            (84_000_000, 1425, 3_684_210),
            (170_000_000, 213, 49_882_629),
            (84_000_000, 0, 0),
            (0, 1425, 0),
        ] {
            let info = BoardInfo {
                timer_hz,
                ticks_per_sample,
                skew_ticks: 0,
                ..GOOD
            };
            assert_eq!(info.excitation_millihertz(), millihertz);
            assert_eq!(info.is_sound(), millihertz > 0, "{timer_hz} {ticks_per_sample}");
        }
        assert!(!BoardInfo { skew_ticks: 90, ..GOOD }.is_sound());
        assert!(!BoardInfo { electrodes: 3, ..GOOD }.is_sound());
        assert!(BoardInfo { electrodes: 32, ..GOOD }.is_sound());
        assert!(!BoardInfo { electrodes: 33, ..GOOD }.is_sound());
        assert!(!BoardInfo { channels: 0, ..GOOD }.is_sound());
        assert!(
            !BoardInfo {
                gains_milli: [0; 4],
                ..GOOD
            }
            .is_sound()
        );
        assert_eq!(GOOD.gains(), 2);
    }
}
