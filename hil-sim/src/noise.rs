//! Noise that is a function of time: the same seed, sample and channel give the same value, in any order of asking and on
//! any machine. The logarithms and sines are libm's, since those of platforms differ in their last bits.

use firmware::MAX_CHANNELS;
use std::f64::consts::TAU;

/// A source of normal noise with mean 0 and variance 1.
#[derive(Clone, Copy, Debug)]
pub struct Noise {
    seed: u64,
}

impl Noise {
    /// A source; different seeds give unrelated noise.
    pub fn new(seed: u64) -> Self {
        Self { seed: mix(seed) }
    }

    /// The noise of every channel at one sample: `out[channel]`.
    pub fn fill(&self, sample: u64, out: &mut [f64]) {
        let start = mix(self.seed ^ sample);
        for (k, pair) in out.chunks_mut(2).enumerate() {
            // Box and Muller's transformation makes two of two.
            let a = mix(start.wrapping_add(2 * k as u64));
            let b = mix(start.wrapping_add(2 * k as u64 + 1));
            let radius = (-2.0 * libm::log(unit(a))).sqrt();
            let (sin, cos) = libm::sincos(TAU * unit(b));
            for (value, part) in pair.iter_mut().zip([cos, sin]) {
                *value = radius * part;
            }
        }
    }
}

/// Octaves of [`Flicker`]: at 59 kHz down to 1/142 Hz.
const OCTAVES: usize = 24;

/// Noise with a power density of 1/f and the same power, 1, in every decade. The density has some 5 % of ripple and is a
/// fifth less just below half the sample rate. The noise is a sum of white noises that hold their values for 1, 2, 4, ... samples (Voss, after
/// Gardner 1978). Each with variance s has the one-sided density `2 s T sinc(f T)^2`, T its time; over all octaves that is
/// `s / (f ln 2)`: s in every octave.
#[derive(Clone, Debug)]
pub(crate) struct Flicker {
    octaves: [Noise; OCTAVES],
    /// What each octave holds now, and in which of its times that is.
    held: [(Option<u64>, [f64; MAX_CHANNELS]); OCTAVES],
}

impl Flicker {
    pub(crate) fn new(seed: u64) -> Self {
        Self {
            octaves: std::array::from_fn(|k| Noise::new(mix(seed).wrapping_add(k as u64))),
            held: [(None, [0.0; MAX_CHANNELS]); OCTAVES],
        }
    }

    /// The noise of every channel at one sample.
    pub(crate) fn fill(&mut self, sample: u64, out: &mut [f64; MAX_CHANNELS]) {
        *out = [0.0; MAX_CHANNELS];
        for (k, (octave, (time, values))) in self.octaves.iter().zip(&mut self.held).enumerate() {
            if *time != Some(sample >> k) {
                *time = Some(sample >> k);
                octave.fill(sample >> k, values);
            }
            for (sum, v) in out.iter_mut().zip(values.iter()) {
                *sum += v;
            }
        }
        // A decade has log2(10) octaves.
        let scale = 1.0 / std::f64::consts::LOG2_10.sqrt();
        out.iter_mut().for_each(|v| *v *= scale);
    }
}

/// Uniform in (0, 1].
pub(crate) fn unit(bits: u64) -> f64 {
    ((bits >> 11) + 1) as f64 / (1u64 << 53) as f64
}

/// A permutation of the 64-bit numbers that scatters neighbours (the finaliser of SplitMix64, Steele et al. 2014).
pub(crate) fn mix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    x ^ (x >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Moments of a million values: standard errors 0.001, 0.0014, 0.0024 and 0.005; five of them are allowed.
    #[test]
    fn the_noise_is_standard_normal() {
        let noise = Noise::new(1);
        let mut row = [0.0; 16];
        let (mut sums, n) = ([0.0; 4], 1e6);
        for t in 0..62_500 {
            noise.fill(t, &mut row);
            for v in row {
                let mut power = 1.0;
                for s in &mut sums {
                    power *= v;
                    *s += power;
                }
            }
        }
        let expected = [0.0, 1.0, 0.0, 3.0];
        let bound = [0.005, 0.007, 0.0195, 0.049];
        for k in 0..4 {
            assert!((sums[k] / n - expected[k]).abs() < bound[k], "{k}: {}", sums[k] / n);
        }
    }

    #[test]
    fn neighbouring_samples_channels_and_seeds_are_unrelated() {
        let (a, b) = (Noise::new(1), Noise::new(2));
        let n = 100_000;
        let mut sums = [0.0; 3];
        let (mut x, mut y, mut z) = ([0.0; 4], [0.0; 4], [0.0; 4]);
        for t in 0..n {
            a.fill(t, &mut x);
            a.fill(t + 1, &mut y);
            b.fill(t, &mut z);
            sums[0] += x[0] * x[1];
            sums[1] += x[0] * y[0];
            sums[2] += x[0] * z[0];
        }
        for s in sums {
            assert!((s / n as f64).abs() < 5.0 / (n as f64).sqrt(), "{sums:?}");
        }
    }

    #[test]
    fn a_row_of_any_length_starts_alike() {
        let noise = Noise::new(7);
        let (mut one, mut all) = ([0.0], [0.0; 16]);
        noise.fill(99, &mut one);
        noise.fill(99, &mut all);
        assert_eq!(one[0], all[0]);
    }
}
