//! The electronics at work: from what the electrodes see to codes.

use crate::clock::{PERIOD_SAMPLES, TICKS_PER_SAMPLE, seconds};
use crate::electronics::Electronics;
use crate::noise::Noise;
use firmware::{FULL_SCALE, MAX_CHANNELS, Route, Sense};
use forward::{Drive, ElectrodeMatrix, Measurement, Pair};
use std::f64::consts::TAU;

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
