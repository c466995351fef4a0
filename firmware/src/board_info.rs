//! What a board knows about itself.

use crate::codes::{LEAST_BITS, MOST_BITS, extra_bits, full_scale, max_periods};
use crate::fold::MAX_CHANNELS;
use crate::reference::SAMPLES_PER_PERIOD;
use crate::scan::MAX_AMPLITUDES;
use crate::wiring::Wiring;
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
    /// Channels that one converter takes in turn, 1 or more; the next as many are another one's, at the same instants.
    pub in_turn: u8,
    /// Timer ticks from one conversion to the next one of the same converter and row; 0 where all are converted at once.
    pub skew_ticks: u16,
    /// Bits of a code, 12 to 16. A front end that gives phasors says 12.
    pub adc_bits: u8,
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
        let in_turn = if self.in_turn < self.channels {
            self.in_turn
        } else {
            self.channels
        };
        let in_time = in_turn > 0 && self.skew_ticks as u32 * in_turn as u32 <= self.ticks_per_sample;
        let bits = self.adc_bits >= LEAST_BITS && self.adc_bits <= MOST_BITS;
        let electrodes = self.electrodes >= 4 && self.electrodes <= MAX_ELECTRODES;
        let channels = self.channels >= 1 && self.channels as usize <= MAX_CHANNELS;
        let gains = self.gains() >= 1;
        in_tune && in_time && bits && electrodes && channels && gains
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

    /// What a scan needs to know.
    pub const fn wiring(&self) -> Wiring {
        Wiring {
            electrodes: self.electrodes,
            adc_bits: self.adc_bits,
            in_turn: self.in_turn,
            skew_ticks: self.skew_ticks,
            ticks_per_sample: self.ticks_per_sample,
        }
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

    /// Amplitude in sixteenths of a code of 12 bits that the source shows on [`Sense::Source`](crate::Sense::Source) at full scale.
    pub fn source_full_scale(&self) -> i64 {
        let microvolt = i64::from(self.excitation_uv) * i64::from(self.source_gain_milli) / 1000;
        let span = (i64::from(Value::PER_CODE) * i64::from(full_scale(self.adc_bits))) >> extra_bits(self.adc_bits);
        (microvolt * span).checked_div(i64::from(self.adc_span_uv)).unwrap_or(0)
    }

    /// The largest plan and watch.
    pub fn limits(&self) -> Limits {
        Limits {
            slots: MAX_SLOTS as u8,
            values: MAX_VALUES as u16,
            channels: self.channels.min(MAX_CHANNELS as u8),
            settle_quarters: u16::MAX,
            integrate_periods: max_periods(self.adc_bits),
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
            adc_bits: self.adc_bits,
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
        in_turn: 16,
        skew_ticks: 60,
        adc_bits: 12,
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
        // Two converters side by side have twice the time.
        let two = BoardInfo {
            skew_ticks: 178,
            in_turn: 8,
            ..GOOD
        };
        assert!(two.is_sound() && !BoardInfo { in_turn: 16, ..two }.is_sound());
        assert!(!BoardInfo { in_turn: 0, ..GOOD }.is_sound());
        for bits in 0..=24 {
            let sound = BoardInfo { adc_bits: bits, ..GOOD }.is_sound();
            assert_eq!(sound, (12..=16).contains(&bits), "{bits}");
        }
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
