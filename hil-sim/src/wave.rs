//! The source's sine at the moments of conversion, as its DAC, its filter and the channels' low-pass leave it.

use crate::clock::{PERIOD_SAMPLES, TICKS_PER_SAMPLE, TIMER_HZ};
use crate::electronics::Electronics;
use crate::filter::{Complex, butterworth, hold, low_pass, magnitude, times};
use firmware::{MAX_CHANNELS, SAMPLES_PER_PERIOD};
use std::f64::consts::TAU;

/// The excitation as the timer is meant to make it, Hz.
pub(crate) const EXCITATION_HZ: f64 = TIMER_HZ as f64 / TICKS_PER_SAMPLE as f64 / PERIOD_SAMPLES as f64;

/// The wave, relative to the sine that it should be.
#[derive(Clone, Debug)]
pub(crate) struct Wave {
    /// By channel (which come one after the other) and sample of a period.
    value: [[f64; SAMPLES_PER_PERIOD]; MAX_CHANNELS],
    /// Rise of the fundamental in a second, by channel and sample.
    slope_per_s: [[f64; SAMPLES_PER_PERIOD]; MAX_CHANNELS],
    /// The fundamental: amplitude, and turns by which it is ahead.
    amplitude: f64,
    ahead_turns: f64,
}

impl Wave {
    /// The wave with the source set to `permille` of full scale; the amplitudes that it belongs to are those asked for.
    pub(crate) fn new(e: &Electronics, permille: u16) -> Self {
        let steps = usize::from(e.source_steps);
        let part = if steps == 0 { 0.0 } else { 1.0 / steps as f64 };
        let real_hz = EXCITATION_HZ * (1.0 + 1e-6 * e.crystal_ppm);
        let corner_hz = if steps == 0 { 0.0 } else { e.source_filter_hz };
        let chain = |harmonic: f64, hz: f64| {
            let (re, im) = times(
                butterworth(harmonic * hz, corner_hz),
                low_pass(harmonic * hz, e.settling_s),
            );
            let held = hold(harmonic, part);
            (re * held, im * held)
        };
        // What the board makes up for.
        let nominal = chain(1.0, EXCITATION_HZ);
        let (gain, lag) = (magnitude(nominal), libm::atan2(nominal.1, nominal.0));
        let table = staircase(e, permille);
        // Coefficient of exp(j h x) at the converter, about the phase that the board reckons with.
        let coefficient = |h: usize| {
            let harmonic = h as f64;
            let of_source = match &table {
                None => (0.0, -0.5),
                Some(table) => fourier(table, h),
            };
            let seen = times(of_source, chain(harmonic, real_hz));
            let (sin, cos) = libm::sincos(-harmonic * lag);
            times((seen.0 / gain, seen.1 / gain), (cos, sin))
        };
        let first = coefficient(1);
        // 2 Re(c exp(jx)) = a sin(x + p) with 2 c = a exp(j(p - pi/2)).
        let amplitude = 2.0 * magnitude(first);
        let ahead_turns = libm::atan2(first.0, -first.1) / TAU;
        // A bare staircase has harmonics without end; behind a low-pass they fall quickly enough.
        let bare = corner_hz == 0.0 && e.settling_s == 0.0;
        let harmonics: Vec<Complex> = match &table {
            Some(_) if !bare => (1..=(64 * steps).min(8192)).map(coefficient).collect(),
            _ => Vec::new(),
        };
        let mut wave = Self {
            value: Default::default(),
            slope_per_s: Default::default(),
            amplitude,
            ahead_turns,
        };
        for channel in 0..MAX_CHANNELS {
            let late = e.late_ticks(channel) / f64::from(TICKS_PER_SAMPLE);
            for sample in 0..SAMPLES_PER_PERIOD {
                let turns = (sample as f64 + late) / PERIOD_SAMPLES as f64;
                wave.value[channel][sample] = match &table {
                    None => wave.fundamental(turns),
                    // The board begins half a step early, so that the steps lie about the sine.
                    Some(table) if bare => table[(turns * steps as f64 + 0.5) as usize % steps] / gain,
                    Some(_) => sum(&harmonics, turns),
                };
                wave.slope_per_s[channel][sample] = TAU * real_hz * wave.fundamental(turns + 0.25);
            }
        }
        wave
    }

    pub(crate) fn value(&self, channel: usize, sample: usize) -> f64 {
        self.value[channel][sample]
    }

    pub(crate) fn slope_per_s(&self, channel: usize, sample: usize) -> f64 {
        self.slope_per_s[channel][sample]
    }

    /// The fundamental at any time.
    pub(crate) fn fundamental(&self, turns: f64) -> f64 {
        self.amplitude * libm::sin(TAU * (turns + self.ahead_turns))
    }
}

/// The DAC's values over a period, relative to the amplitude asked for; `None` for a pure sine.
fn staircase(e: &Electronics, permille: u16) -> Option<Vec<f64>> {
    let asked = f64::from(permille.max(1)) / 1000.0;
    let steps = e.source_steps;
    let value = |k| {
        let sine = libm::sin(TAU * f64::from(k) / f64::from(steps));
        if e.source_bits == 0 {
            return sine;
        }
        // Twice the amplitude are all the codes.
        let half = f64::from(1u32 << (e.source_bits - 1));
        (sine * asked * half).round() / half / asked
    };
    (steps > 0).then(|| (0..steps).map(value).collect())
}

/// Fourier coefficient of a period's values, each held about its own time.
fn fourier(table: &[f64], harmonic: usize) -> Complex {
    let n = table.len();
    let (mut re, mut im) = (0.0, 0.0);
    for (k, v) in table.iter().enumerate() {
        let (sin, cos) = libm::sincos(-TAU * (harmonic * k % n) as f64 / n as f64);
        re += v * cos;
        im += v * sin;
    }
    (re / n as f64, im / n as f64)
}

/// `2 Re` of the sum of `c[h - 1] exp(2 pi j h turns)`.
fn sum(harmonics: &[Complex], turns: f64) -> f64 {
    let (sin, cos) = libm::sincos(TAU * turns);
    let mut power = (cos, sin);
    let mut sum = 0.0;
    for c in harmonics {
        sum += times(*c, power).0;
        power = times(power, (cos, sin));
    }
    2.0 * sum
}
