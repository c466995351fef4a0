//! Source, switches, amplifiers and converter: what they are, flaws and all. [`crate::Analog`] computes with it.

use crate::electronics_error::{ElectronicsError, in_range};
use crate::interference::Line;
use firmware::{LEAST_BITS, MAX_CHANNELS, MOST_BITS};
use serde::{Deserialize, Serialize};

/// The board's analogue part, constant while it runs. Every flaw has a value with which it is absent, and costs nothing
/// then.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Electronics {
    /// Amplitude of the source at full scale, V.
    pub excitation_v: f64,
    /// Gain between the source and the converter where the source itself is measured, in thousandths.
    pub source_gain_milli: u32,
    /// Steps of the source's DAC in a period; 0: a pure sine.
    pub source_steps: u16,
    /// Bits of the source's DAC, whose range is twice the full-scale amplitude; 0: as many as it takes.
    pub source_bits: u8,
    /// Corner of the second-order low-pass (Butterworth) behind the source's DAC, Hz; 0: none. The board makes up for its
    /// loss and delay at the nominal excitation.
    pub source_filter_hz: f64,
    /// How much faster than it says the board's crystal runs, millionths.
    pub crystal_ppm: f64,

    /// The analogue supply, V; absent: neither source nor amplifiers ever come near it.
    pub supply_v: Option<f64>,
    /// Whether both ends of the drive move, against each other, about the middle of the supply. Else the negative end rests
    /// there and the positive one moves by all of the drive.
    pub push_pull: bool,
    /// How near to the supply's ends an op-amp's output comes, V: the source's, and the amplifiers' of all gains but number 0.
    pub op_amp_margin_v: f64,
    /// How far above its inputs the first stage of the amplifier of gain 0 works, V.
    pub inner_shift_v: f64,
    /// How near to the supply's ends the outputs of that amplifier come, those of its first stage and its own, V. Beyond, its
    /// output looks right and is wrong.
    pub inner_margin_v: f64,
    /// White noise between the drive's ends, V rms in each sample.
    pub drive_noise_v: f64,
    /// White noise of the supply, V rms in each sample.
    pub supply_noise_v: f64,
    /// Part of the supply's noise that is between the drive's ends.
    pub supply_to_drive: f64,
    /// Part of it that every channel has besides, at the converter.
    pub supply_to_channels: f64,

    /// Whether one channel behind multiplexers measures one pair after the other. Else every electrode has a channel.
    pub one_channel: bool,
    /// Channels that a converter takes in turn, 1 to 16; the next as many are another one's, at the same instants.
    pub in_turn: u8,
    /// Timer ticks from the conversion of one channel to that of the next one.
    pub skew_ticks: u16,
    /// Resistance of one closed switch, ohm; the drive current passes two.
    pub switch_ohm: f64,
    /// Time in which nothing is connected when the switches change (break before make), s. The amplifiers' inputs go
    /// to their resting level meanwhile.
    pub break_s: f64,
    /// Time constant of the channels' low-pass: with it a channel approaches its new voltage after a switch, s. What it costs
    /// at the nominal excitation is part of the gains.
    pub settling_s: f64,
    /// What the switches' charge adds to every channel at the moment of switching, V at the converter.
    pub injection_v: f64,

    /// Gains between sense pair and converter that a route chooses from, in thousandths, at most four. The amplifiers'
    /// resting output is the middle of the converter's range.
    pub gains_milli: Vec<u32>,
    /// Relative error of the amplifiers' gains: none, one for all channels, or one for each; what is missing is 0.
    pub gain_error: Vec<f64>,
    /// Offsets of the amplifiers, V at the converter: none, one for all channels, or one for each; what is missing is 0.
    pub offset_v: Vec<f64>,
    /// How far from its resting level an amplifier's output goes, V; absent: beyond the converter's range.
    pub swing_v: Option<f64>,
    /// Part of a channel's voltage that its two neighbours see in addition to their own.
    pub crosstalk: f64,

    /// White noise of each sample, converter codes rms.
    pub noise_codes: f64,
    /// 1/f noise of each amplifier, converter codes rms in a decade of frequency.
    pub flicker_codes: f64,
    /// Random departure of each conversion from its time, s rms.
    pub jitter_s: f64,
    /// Interfering lines: the mains, a motor.
    pub interference: Vec<Line>,

    /// Voltage between the converter's lowest and highest code, V.
    pub adc_span_v: f64,
    /// Bits of the converter, 1 to 16. It gives 12 at least; those that it does not really have are 0. Everything else that
    /// is said in codes is in codes of 12 bits.
    pub adc_bits: u8,
    /// Integral nonlinearity, codes: the peak of an S-shaped departure of the converter's characteristic.
    pub inl_codes: f64,
    /// Differential nonlinearity, codes: the largest departure of a code's width from one.
    pub dnl_codes: f64,

    /// Seed of all that is random. Not part of a file: a scene has one for everything.
    #[serde(skip)]
    pub seed: u64,
}

impl Default for Electronics {
    /// The paper's source (4.5 V peak to peak), and what it leaves open:
    /// - gain 0 puts the largest sense voltage of the paper's untouched sheet at 80 % of the range;
    /// - gain 1 does so with the drive pair's own voltage;
    /// - 10 us of settling is an amplifier and filter of 16 kHz, and 40 mV a multiplexer of some picocoulomb;
    /// - 60 ticks of 84 MHz are a conversion of 15 clocks of a converter at 21 MHz;
    /// - the noise makes the paper's way of measuring have the paper's 27 dB.
    ///
    /// Everything else is absent.
    fn default() -> Self {
        Self {
            excitation_v: 2.25,
            source_gain_milli: 586,
            source_steps: 0,
            source_bits: 0,
            source_filter_hz: 0.0,
            crystal_ppm: 0.0,
            supply_v: None,
            push_pull: true,
            op_amp_margin_v: 0.0,
            inner_shift_v: 0.0,
            inner_margin_v: 0.0,
            drive_noise_v: 0.0,
            supply_noise_v: 0.0,
            supply_to_drive: 0.0,
            supply_to_channels: 0.0,
            one_channel: false,
            in_turn: 16,
            skew_ticks: 60,
            switch_ohm: 70.0,
            break_s: 0.0,
            settling_s: 10e-6,
            injection_v: 0.04,
            gains_milli: vec![13_000, 600],
            gain_error: Vec::new(),
            offset_v: Vec::new(),
            swing_v: None,
            crosstalk: 0.0,
            noise_codes: 0.365,
            flicker_codes: 0.0,
            jitter_s: 0.0,
            interference: Vec::new(),
            adc_span_v: 3.3,
            adc_bits: 12,
            inl_codes: 0.0,
            dnl_codes: 0.0,
            seed: 1,
        }
    }
}

/// The smallest number above zero, for ranges without it.
const SOME: f64 = f64::MIN_POSITIVE;

impl Electronics {
    /// The same without any flaw: no noise, no transient, a pure sine; only the converter still rounds.
    pub fn ideal() -> Self {
        Self {
            settling_s: 0.0,
            injection_v: 0.0,
            noise_codes: 0.0,
            ..Self::default()
        }
    }

    /// The board of docs/board.md, at 5.00 V of USB: what its parts give by calculation, and in ngspice where both differ.
    /// `hardware/check.py` holds the numbers against the circuit. Nobody has measured a built board.
    /// - 5.00 V lose 30 mV in the filter of the analogue supply;
    /// - the amplifier's first stage lies 0.8 V above its inputs and comes to 0.1 V from the supply's ends (INA826), op-amps
    ///   come to 20 mV (MCP602x);
    /// - the converter's own noise of 0.4 codes is with the prefetch off, as measured by others on such chips; 0.06 codes of
    ///   the amplifiers do not show in it;
    /// - 2 mV of supply noise are 10 uV in the root of a hertz, a switching supply's, in half the sample rate;
    /// - charge of the switches: 15 pC into a metre of wire, 100 pF behind 1 kilohm, are over after 0.5 us.
    pub fn drawn_board() -> Self {
        Self {
            source_gain_milli: 285,
            source_steps: 16,
            source_bits: 12,
            source_filter_hz: 10_070.0,
            supply_v: Some(4.97),
            push_pull: true,
            op_amp_margin_v: 0.02,
            inner_shift_v: 0.8,
            inner_margin_v: 0.1,
            drive_noise_v: 66e-6,
            supply_noise_v: 2e-3,
            supply_to_drive: 1.3e-4,
            supply_to_channels: 6.7e-5,
            one_channel: true,
            in_turn: 16,
            skew_ticks: 0,
            switch_ohm: 100.0,
            break_s: 0.24e-6,
            settling_s: 10.744e-6,
            injection_v: 0.0,
            gains_milli: vec![12_600, 584],
            noise_codes: 0.4,
            ..Self::default()
        }
    }

    /// The board of docs/board.md with sixteen channels: the drawn board's parts, an amplifier for every neighbouring pair, and
    /// two converters of 16 bits side by side.
    /// - each takes eight channels, one every microsecond: 84 ticks of 84 MHz;
    /// - what one channel sees is converted by a third one later in the row, with faster filters: other gains;
    /// - the converters' noise is that of the drawn board's, 0.4 codes of 12 bits: assumed, nobody has measured it.
    pub fn drawn_sixteen() -> Self {
        Self {
            source_gain_milli: 288,
            one_channel: false,
            in_turn: 8,
            skew_ticks: 84,
            gains_milli: vec![12_600, 588],
            adc_bits: 16,
            ..Self::drawn_board()
        }
    }

    /// Bits of the codes that the converter gives: [`Electronics::adc_bits`], 12 at least.
    pub fn code_bits(&self) -> u8 {
        self.adc_bits.clamp(LEAST_BITS, MOST_BITS)
    }

    /// Codes that the converter gives in one code of 12 bits.
    pub(crate) fn codes_in_one(&self) -> f64 {
        f64::from(1u16 << (self.code_bits() - LEAST_BITS))
    }

    /// How long after the first one a channel is sampled, in timer ticks.
    pub(crate) fn late_ticks(&self, channel: usize) -> f64 {
        (channel % usize::from(self.in_turn.max(1)) * usize::from(self.skew_ticks)) as f64
    }

    /// Whether such electronics can be.
    ///
    /// # Errors
    /// [`ElectronicsError`] names the field and what it may be.
    pub fn validate(&self) -> Result<(), ElectronicsError> {
        let above = "above 0";
        let not_below = "0 or more, and finite";
        in_range(
            "excitation_v",
            self.excitation_v,
            SOME..=1000.0,
            "above 0, at most 1000",
        )?;
        in_range("adc_span_v", self.adc_span_v, SOME..=1000.0, "above 0, at most 1000")?;
        in_range(
            "crystal_ppm",
            self.crystal_ppm,
            -1e5..=1e5,
            "between -100000 and 100000",
        )?;
        in_range("crosstalk", self.crosstalk, -0.5..=0.5, "between -0.5 and 0.5")?;
        for (field, value) in [
            ("source_filter_hz", self.source_filter_hz),
            ("switch_ohm", self.switch_ohm),
            ("break_s", self.break_s),
            ("settling_s", self.settling_s),
            ("op_amp_margin_v", self.op_amp_margin_v),
            ("inner_shift_v", self.inner_shift_v),
            ("inner_margin_v", self.inner_margin_v),
            ("drive_noise_v", self.drive_noise_v),
            ("supply_noise_v", self.supply_noise_v),
            ("supply_to_drive", self.supply_to_drive),
            ("supply_to_channels", self.supply_to_channels),
            ("noise_codes", self.noise_codes),
            ("flicker_codes", self.flicker_codes),
        ] {
            in_range(field, value, 0.0.., not_below)?;
        }
        in_range("injection_v", self.injection_v, .., "finite")?;
        // The signal is followed to the first order of the departure.
        in_range("jitter_s", self.jitter_s, 0.0..=2e-6, "between 0 and 2e-6")?;
        in_range("inl_codes", self.inl_codes, -64.0..=64.0, "between -64 and 64")?;
        in_range("dnl_codes", self.dnl_codes, 0.0..=4.0, "between 0 and 4")?;
        in_range("adc_bits", self.adc_bits.into(), 1.0..=16.0, "between 1 and 16")?;
        in_range("in_turn", self.in_turn.into(), 1.0..=16.0, "between 1 and 16")?;
        in_range("source_bits", self.source_bits.into(), 0.0..=24.0, "between 0 and 24")?;
        if self.source_steps != 0 {
            in_range(
                "source_steps",
                self.source_steps.into(),
                4.0..=4096.0,
                "0, or between 4 and 4096",
            )?;
        }
        if self.source_steps == 0 && self.source_bits != 0 {
            let allowed = "0 for a pure sine: give source_steps, or leave the bits out";
            in_range("source_bits", self.source_bits.into(), 0.0..=0.0, allowed)?;
        }
        if let Some(supply_v) = self.supply_v {
            // The amplifiers rest in the middle of the converter's range.
            let least = (0.5 * self.adc_span_v).max(2.0 * self.op_amp_margin_v.max(self.inner_margin_v));
            let allowed = "more than half of adc_span_v and twice the margins, at most 1000";
            in_range("supply_v", supply_v, (least + SOME)..=1000.0, allowed)?;
        }
        if let Some(swing_v) = self.swing_v {
            in_range("swing_v", swing_v, SOME.., above)?;
        }
        let length = |field, given, range: std::ops::RangeInclusive<usize>, allowed| {
            if range.contains(&given) {
                Ok(())
            } else {
                Err(ElectronicsError::Length { field, given, allowed })
            }
        };
        length("gains_milli", self.gains_milli.len(), 1..=4, "it must have one to four")?;
        let channels = "it may have none, one for all channels, or one for each of 16";
        for (field, list) in [("gain_error", &self.gain_error), ("offset_v", &self.offset_v)] {
            length(field, list.len(), 0..=MAX_CHANNELS, channels)?;
            for value in list {
                in_range(field, *value, .., "finite")?;
            }
        }
        self.interference.iter().try_for_each(Line::validate)
    }
}
