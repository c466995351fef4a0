//! What the lock-in makes of a window, without its samples: the same law at the level of values.
//!
//! Between sheet and value everything is linear but the converter. Of what has no noise (wave, transients, interfering lines) the
//! phasor is computed as the lock-in would. White noise of variance v in each of n samples is noise of variance `2 v / n` in either
//! part of a phasor; a converter's rounding is such noise of `step^2 / 12` as long as other noise spreads it over a step or so
//! (Widrow and Kollar 2008, chapter 4). 1/f noise is a sum of noises that hold their values: what the lock-in makes of each
//! depends on where in the window it steps. Jitter is noise in step with the slope. Where a converter is no straight line, or noise decides whether
//! something meets an end of its range, there is no such law, and [`Analog::readings`] says so.

use super::{Analog, Routing, decay, of_channel};
use crate::clock::PERIOD_SAMPLES;
use crate::noise::Noise;
use crate::wave::EXCITATION_HZ;
use firmware::{MAX_CHANNELS, Reading, SAMPLES_PER_PERIOD, full_scale};
use protocol::Variance;
use std::f64::consts::TAU;

/// Part of a transient's beginning below which it is over, for a value.
const GONE: f64 = 1e-9;
/// Least noise of a sample with which rounding is noise, in steps of the converter (standard deviation). At 0.3 a sine's amplitude
/// is off by at most 0.06 steps, where it is smaller than a step.
const DITHER: f64 = 0.3;
/// Standard deviations of noise that may not meet an end of the range.
const FAR: f64 = 6.0;

/// Octaves of the simulator's 1/f noise that step within a window now and then; the others hold for seconds.
const OCTAVES: u32 = 16;

/// In-phase and quadrature amplitude.
type Parts = [f64; 2];

/// What is the same in all windows.
#[derive(Clone, Debug)]
pub(crate) struct LockIn {
    /// Sine and cosine of the reference.
    reference: [Parts; SAMPLES_PER_PERIOD],
    /// Cosine and sine of the angle by which each channel is late.
    late: [Parts; MAX_CHANNELS],
    /// Of a sample, squared codes of 12 bits: white noise of each channel with rounding, and 1/f noise in an octave.
    white: f64,
    flicker: f64,
    noise: Noise,
    windows: u64,
}

impl LockIn {
    pub(crate) fn new(analog: &Analog) -> Self {
        let e = &analog.electronics;
        let reference = std::array::from_fn(|k| {
            let (sin, cos) = libm::sincos(TAU * k as f64 / SAMPLES_PER_PERIOD as f64);
            [sin, cos]
        });
        let step = analog.converter.step() / e.codes_in_one();
        Self {
            reference,
            late: std::array::from_fn(|channel| {
                let turns = e.late_ticks(channel) / f64::from(crate::clock::TICKS_PER_SAMPLE);
                let (sin, cos) = libm::sincos(TAU * turns / PERIOD_SAMPLES as f64);
                [cos, sin]
            }),
            white: e.noise_codes.powi(2) + step * step / 12.0,
            // log2(10) octaves make a decade.
            flicker: e.flicker_codes.powi(2) / std::f64::consts::LOG2_10,
            noise: Noise::new(e.seed ^ 0x10C1_4E12),
            windows: 0,
        }
    }

    /// Variances of the parts, and the covariance between them, that noise of variance 1 in every octave of `Flicker` makes.
    fn of_octaves(&self, first: u64, samples: u64) -> [f64; 3] {
        let mut out = [0.0; 3];
        for octave in 0..OCTAVES {
            let mut held = [0.0; 2];
            for time in first..first + samples {
                let reference = self.reference[(time % PERIOD_SAMPLES) as usize];
                held = [held[0] + reference[0], held[1] + reference[1]];
                if (time + 1) >> octave != time >> octave || time + 1 == first + samples {
                    let [sine, cosine] = std::mem::take(&mut held);
                    out = [out[0] + sine * sine, out[1] + sine * cosine, out[2] + cosine * cosine];
                }
            }
        }
        out.map(|sum| sum * (2.0 / samples as f64).powi(2))
    }

    /// What the lock-in makes of a period.
    fn of_period(&self, period: &[f64; SAMPLES_PER_PERIOD]) -> Parts {
        let mut sum = [0.0; 2];
        for (v, reference) in period.iter().zip(&self.reference) {
            sum[0] += v * reference[0];
            sum[1] += v * reference[1];
        }
        sum.map(|part| part * 2.0 / SAMPLES_PER_PERIOD as f64)
    }
}

impl Analog {
    /// Codes of 12 bits in a volt at the converter.
    fn codes_per_volt(&self) -> f64 {
        let e = &self.electronics;
        f64::from(full_scale(e.code_bits())) / e.codes_in_one() / e.adc_span_v
    }

    /// A period of a channel as it settles, V from the middle of the range.
    fn settled_v(&self, channel: usize, routing: &Routing) -> [f64; SAMPLES_PER_PERIOD] {
        let rest_v = of_channel(&self.electronics.offset_v, channel) + routing.rest_v;
        std::array::from_fn(|k| {
            let bent_v = routing.bent_v.as_ref().map_or(0.0, |bent| bent[channel][k]);
            routing.amplitude_v[channel] * self.wave.value(channel, k) + bent_v + rest_v
        })
    }

    /// Adds what transients and lines make of a window, V, and returns their largest voltage.
    fn beside_v(&self, lock_in: &LockIn, (first, samples): (u64, u64), routing: &Routing, out: &mut [Parts]) -> f64 {
        let channels = out.len().min(MAX_CHANNELS);
        let mut add = |time: u64, channel: usize, v: f64| {
            let reference = lock_in.reference[(time % PERIOD_SAMPLES) as usize];
            let part = 2.0 / samples as f64 * v;
            for (sum, reference) in out[channel].iter_mut().zip(reference) {
                *sum += part * reference;
            }
        };
        let (mut transient_v, mut lines_v) = (0.0_f64, 0.0_f64);
        for time in first..first + samples {
            let since_s = time.saturating_sub(routing.switched_at) as f64 * self.sample_s;
            if since_s > routing.open_s && decay(since_s - routing.open_s, self.electronics.settling_s) < GONE {
                break;
            }
            let phase = (time % PERIOD_SAMPLES) as usize;
            for channel in 0..channels {
                let bent_v = routing.bent_v.as_ref().map_or(0.0, |b| b[channel][phase]);
                let steady_v = routing.amplitude_v[channel] * self.wave.value(channel, phase) + bent_v;
                let v = self.voltage_v(time, channel, routing) - steady_v;
                transient_v = transient_v.max(v.abs());
                add(time, channel, v);
            }
        }
        if !self.lines.is_empty() {
            for time in first..first + samples {
                let mut volts = [0.0; MAX_CHANNELS];
                for line in &self.lines {
                    line.add(self.true_s(time), &routing.chords, &mut volts[..channels]);
                }
                for (channel, v) in volts.iter().enumerate().take(channels) {
                    lines_v = lines_v.max(v.abs());
                    add(time, channel, *v);
                }
            }
        }
        transient_v + lines_v
    }

    /// Whether a channel with so much beside its own period, and noise of this variance, meets an end of the range: never, in every
    /// period, or as noise will have it.
    fn meets_an_end(&self, period_v: &[f64; SAMPLES_PER_PERIOD], beside_v: f64, noise_codes2: f64) -> Option<bool> {
        let code_v = 1.0 / self.codes_per_volt();
        let range_v = 0.5 * self.electronics.adc_span_v;
        let most_v = period_v.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        let doubt_v = beside_v + FAR * noise_codes2.sqrt() * code_v + code_v;
        match self.electronics.swing_v {
            _ if most_v + doubt_v < self.electronics.swing_v.map_or(range_v, |v| v.min(range_v)) => Some(false),
            // An amplifier that goes no further than the converter shows no rail.
            None if most_v - doubt_v > range_v => Some(true),
            _ => None,
        }
    }

    /// What a window of whole periods gives for every channel; false where only its samples tell.
    pub(crate) fn readings(
        &self,
        lock_in: &mut LockIn,
        (first, periods): (u64, u16),
        routing: &Routing,
        out: &mut [Reading],
    ) -> bool {
        let e = &self.electronics;
        let channels = out.len().min(MAX_CHANNELS);
        let samples = u64::from(periods) * PERIOD_SAMPLES;
        let mut parts = [[0.0; 2]; MAX_CHANNELS];
        let beside_v = self.beside_v(lock_in, (first, samples), routing, &mut parts[..channels]);
        let codes_per_volt = self.codes_per_volt();
        // What all channels have in common: of the drive and of the supply.
        let common = |channel: usize| {
            let part = routing.drive_part[channel];
            let supply = part * e.supply_to_drive + e.supply_to_channels;
            [part * e.drive_noise_v, supply * e.supply_noise_v].map(|v| v * codes_per_volt)
        };
        // What jitter makes of the slope, a cosine of the channel's own time.
        let slope = |channel: usize| codes_per_volt * routing.amplitude_v[channel] * TAU * EXCITATION_HZ * e.jitter_s;
        // Of a sample; of 1/f noise the octaves that step within a window.
        let noises: [f64; MAX_CHANNELS] = std::array::from_fn(|channel| {
            let [drive, supply] = common(channel);
            let steps = lock_in.flicker * (samples as f64).log2();
            lock_in.white + drive * drive + supply * supply + steps + 0.5 * slope(channel).powi(2)
        });
        let step = self.converter.step() / e.codes_in_one();
        let least = noises[..channels].iter().fold(f64::INFINITY, |least, v| least.min(*v));
        if self.converter.is_flawed() || least - step * step / 12.0 < (DITHER * step).powi(2) {
            return false;
        }
        for (channel, (parts, out)) in parts.iter_mut().zip(out.iter_mut()).enumerate() {
            let mut period_v = self.settled_v(channel, routing);
            let Some(clipped) = self.meets_an_end(&period_v, beside_v, noises[channel]) else {
                return false;
            };
            out.clipped = clipped;
            if clipped {
                let range_v = 0.5 * e.adc_span_v;
                period_v.iter_mut().for_each(|v| *v = v.clamp(-range_v, range_v));
                // What is beside does not show above the end.
                *parts = lock_in.of_period(&period_v);
            } else {
                let own = lock_in.of_period(&period_v);
                *parts = std::array::from_fn(|part| parts[part] + own[part]);
            }
        }
        let mut draws = [0.0; 4 + 6 * MAX_CHANNELS];
        let flickers = lock_in.flicker > 0.0;
        let per_channel = 2 + if flickers { 2 } else { 0 } + if e.jitter_s > 0.0 { 2 } else { 0 };
        let [ii, iq, qq] = if flickers {
            lock_in
                .of_octaves(self.absolute(first), samples)
                .map(|v| v * lock_in.flicker)
        } else {
            [0.0; 3]
        };
        lock_in
            .noise
            .fill(lock_in.windows, &mut draws[..4 + per_channel * channels]);
        lock_in.windows += 1;
        let (of_all, own) = draws.split_at(4);
        let n = samples as f64;
        let (white, spread) = ((2.0 * lock_in.white / n).sqrt(), (2.0 / n).sqrt());
        for (channel, (out, own)) in out.iter_mut().zip(own.chunks(per_channel)).enumerate() {
            let [drive, supply] = common(channel);
            let mut codes: Parts = std::array::from_fn(|part| {
                let common = drive * of_all[part] + supply * of_all[2 + part];
                codes_per_volt * parts[channel][part] + white * own[part] + spread * common
            });
            let (_, more) = own.split_at(2);
            let (flicker, jitter) = more.split_at(if flickers { 2 } else { 0 });
            if let [one, other] = *flicker {
                let first = ii.sqrt();
                let second = if first > 0.0 { iq / first } else { 0.0 };
                codes[0] += first * one;
                codes[1] += second * one + (qq - second * second).max(0.0).sqrt() * other;
            }
            if let [sine, cosine] = *jitter {
                let slope = slope(channel);
                let [i, q] = [sine * slope * (0.5 / n).sqrt(), cosine * slope * (1.5 / n).sqrt()];
                let [cos, sin] = lock_in.late[channel];
                codes[0] += i * cos - q * sin;
                codes[1] += q * cos + i * sin;
            }
            let [in_phase, quadrature] = codes.map(|v| (v * f64::from(1u32 << 20)).round() as i32);
            *out = Reading {
                in_phase,
                quadrature,
                noise: Variance::new((256.0 * noises[channel]).round() as u32),
                clipped: out.clipped,
            };
        }
        true
    }
}
