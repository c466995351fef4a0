//! Source, switches, amplifiers and converter: from what the electrodes see to codes.

use crate::clock::{PERIOD_SAMPLES, TICKS_PER_SAMPLE, seconds};
use crate::noise::Noise;
use firmware::{FULL_SCALE, MAX_CHANNELS, Route, Sense};
use forward::{Drive, ElectrodeMatrix, Measurement, Pair};
use std::f64::consts::TAU;

/// The board's analogue part, constant while it runs.
#[derive(Clone, Debug, PartialEq)]
pub struct Electronics {
    /// Amplitude of the source at full scale, V.
    pub excitation_v: f64,
    /// Gain between the source and the converter where the source itself is measured, in thousandths.
    pub source_gain_milli: u32,
    /// Timer ticks from the conversion of one channel to that of the next: one converter takes them in turn.
    pub skew_ticks: u16,
    /// Resistance of one closed switch, ohm; the drive current passes two.
    pub switch_ohm: f64,
    /// Gains between sense pair and converter that a route chooses from, in thousandths, at most four. The amplifiers'
    /// resting output is the middle of the converter's range.
    pub gains_milli: Vec<u32>,
    /// Voltage between the converter's lowest and highest code, V.
    pub adc_span_v: f64,
    /// Time constant with which a channel approaches its new voltage after a switch, s.
    pub settling_s: f64,
    /// What the switches' charge adds to every channel at the moment of switching, V at the converter.
    pub injection_v: f64,
    /// White noise of each sample, converter codes rms.
    pub noise_codes: f64,
    /// Seed of the noise.
    pub seed: u64,
}

impl Default for Electronics {
    /// The paper's source (4.5 V peak to peak), and what it leaves open:
    /// - gain 0 puts the largest sense voltage of the paper's untouched sheet at 80 % of the range, gain 1 the drive
    ///   pair's own voltage;
    /// - 10 us of settling is an amplifier and filter of 16 kHz, and 40 mV a multiplexer of some picocoulomb;
    /// - 60 ticks of 84 MHz are a conversion of 15 clocks of a converter at 21 MHz;
    /// - the noise makes the paper's way of measuring have the paper's 27 dB.
    fn default() -> Self {
        Self {
            excitation_v: 2.25,
            source_gain_milli: 586,
            skew_ticks: 60,
            switch_ohm: 70.0,
            gains_milli: vec![13_000, 600],
            adc_span_v: 3.3,
            settling_s: 10e-6,
            injection_v: 0.04,
            noise_codes: 0.365,
            seed: 1,
        }
    }
}

/// What the channels are connected to, and what is left of what they were connected to before.
#[derive(Clone, Debug)]
pub struct Routing {
    /// Amplitude of each channel, V at the converter.
    pub amplitude_v: [f64; MAX_CHANNELS],
    /// How far each channel was from its new voltage when it was switched, V at the converter.
    pub residue_v: [f64; MAX_CHANNELS],
    /// When that was, in samples since power-up.
    pub switched_at: u64,
}

impl Default for Routing {
    fn default() -> Self {
        Self {
            amplitude_v: [0.0; MAX_CHANNELS],
            residue_v: [0.0; MAX_CHANNELS],
            switched_at: 0,
        }
    }
}

impl Electronics {
    /// Amplitude of every channel of a route on this sheet with the source at `permille` of full scale, V at the converter;
    /// 0 for channels that do not exist. `None` for a gain that does not exist.
    pub fn amplitudes_v(&self, sheet: &ElectrodeMatrix, route: &Route, permille: u16) -> Option<[f64; MAX_CHANNELS]> {
        let source_v = self.excitation_v * f64::from(permille) / 1000.0;
        let gain = f64::from(*self.gains_milli.get(usize::from(route.gain))?) / 1000.0;
        let drive = Drive::Voltage {
            amplitude_v: source_v,
            switch_ohm: self.switch_ohm,
        };
        let pair = |p: protocol::Pair| Pair::new(p.plus.into(), p.minus.into());
        let voltage = |sense| {
            let drive_pair = pair(route.drive);
            gain * drive.voltage_v(
                sheet,
                Measurement {
                    drive: drive_pair,
                    sense,
                },
            )
        };
        let mut out = [0.0; MAX_CHANNELS];
        match route.sense {
            Sense::Source => out[0] = source_v * f64::from(self.source_gain_milli) / 1000.0,
            Sense::One(sense) => out[0] = voltage(pair(sense)),
            Sense::All { step } => {
                let electrodes = sheet.electrodes();
                for (n, v) in out.iter_mut().enumerate().take(electrodes) {
                    *v = voltage(Pair::new((n + usize::from(step)) % electrodes, n));
                }
            }
        }
        Some(out)
    }

    /// Voltage of a channel when it is converted in the row of this time, V at the converter from the middle of its range,
    /// without noise.
    pub fn voltage_v(&self, time: u64, channel: usize, routing: &Routing) -> f64 {
        let late = (channel * usize::from(self.skew_ticks)) as f64 / f64::from(TICKS_PER_SAMPLE);
        self.voltage_at_v(time, late, channel, routing)
    }

    /// The same, `late` samples after a time.
    fn voltage_at_v(&self, time: u64, late: f64, channel: usize, routing: &Routing) -> f64 {
        let phase = TAU * ((time % PERIOD_SAMPLES) as f64 + late) / PERIOD_SAMPLES as f64;
        let since_s = seconds(time.saturating_sub(routing.switched_at)) + late * seconds(1);
        let left = if self.settling_s > 0.0 {
            (-since_s / self.settling_s).exp()
        } else {
            0.0
        };
        routing.amplitude_v[channel] * phase.sin() + routing.residue_v[channel] * left
    }

    /// The routing after a switch at `time` to channels of these amplitudes.
    pub fn switched(&self, time: u64, before: &Routing, amplitude_v: [f64; MAX_CHANNELS]) -> Routing {
        let mut after = Routing {
            amplitude_v,
            residue_v: [0.0; MAX_CHANNELS],
            switched_at: time,
        };
        for channel in 0..MAX_CHANNELS {
            after.residue_v[channel] = self.voltage_at_v(time, 0.0, channel, before) + self.injection_v
                - self.voltage_at_v(time, 0.0, channel, &after);
        }
        after
    }

    /// One row of samples: the codes of the channels at a time. The excitation's phase is the time's, since one timer makes
    /// both.
    pub fn sample(&self, time: u64, routing: &Routing, out: &mut [u16]) {
        let mut noise = [0.0; MAX_CHANNELS];
        let used = out.len().min(MAX_CHANNELS);
        Noise::new(self.seed).fill(time, &mut noise[..used]);
        let codes_per_volt = f64::from(FULL_SCALE) / self.adc_span_v;
        for (channel, (code, noise)) in out.iter_mut().zip(noise).enumerate() {
            let volts = self.voltage_v(time, channel, routing);
            let level = volts * codes_per_volt + f64::from(FULL_SCALE) / 2.0 + self.noise_codes * noise;
            *code = level.round().clamp(0.0, f64::from(FULL_SCALE)) as u16;
        }
    }
}
