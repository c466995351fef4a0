//! Codes of more than 12 bits: the same signal gives the same values, finer, and no sum overflows.

use firmware::{
    Block, Folded, HALF, MAX_CHANNELS, Phasor, QUARTER_SAMPLES, Rails, SAMPLES_PER_PERIOD, SINE, full_scale,
    max_periods,
};
use proptest::collection::vec;
use proptest::prelude::*;
use protocol::QUARTERS;
use std::f64::consts::TAU;

const N: usize = SAMPLES_PER_PERIOD;

fn block(samples: &[u16], channels: u8, rails: Rails) -> Block<'_> {
    Block {
        samples,
        channels,
        sequence: 0,
        time: 0,
        rails,
    }
}

fn folded(bits: u8, samples: &[u16], channels: u8) -> Folded {
    let mut f = Folded::of_bits(bits);
    f.reset(channels);
    f.add(&block(samples, channels, Rails::Unknown)).unwrap();
    f
}

/// Codes of so many bits of a signal in parts of the range.
fn codes(bits: u8, periods: usize, signal: impl Fn(usize) -> f64) -> Vec<u16> {
    let full = f64::from(full_scale(bits));
    (0..N * periods)
        .map(|k| (signal(k) * full).round().clamp(0.0, full) as u16)
        .collect()
}

/// Sine and cosine of a phase, in 2^-30.
fn reference(k: usize) -> (i128, i128) {
    let entry = |k: usize| {
        let sign = if k % N < HALF { 1 } else { -1 };
        sign * i128::from(SINE[k % HALF])
    };
    (entry(k), entry(k + N / 4))
}

proptest! {
    /// A converter of 12 bits whose codes are shifted left is one of more bits that shows nothing below: everything is the same
    /// to the last bit.
    #[test]
    fn shifted_codes_give_the_same_values(
        bits in 13..=16u8,
        channels in 1..=MAX_CHANNELS,
        periods in 1..4usize,
        noise in vec(1..4095u16, 4 * N * MAX_CHANNELS),
    ) {
        let narrow = &noise[..periods * N * channels];
        let wide: Vec<u16> = narrow.iter().map(|c| c << (bits - 12)).collect();
        let (a, b) = (folded(12, narrow, channels as u8), folded(bits, &wide, channels as u8));
        for c in 0..channels {
            prop_assert_eq!(a.correlate(c), b.correlate(c));
            prop_assert_eq!((a.railed(c), b.railed(c)), (false, false));
            prop_assert_eq!(a.period(c).map(|sum| sum << (bits - 12)), b.period(c));
        }
    }

    /// The same signal through 12 and through more bits: the values differ by what 12 bits cannot show.
    #[test]
    fn more_bits_of_one_signal_differ_by_the_quantisation(
        bits in 13..=16u8,
        amplitude in 0.0..0.499f64,
        phase in -4.0..4.0f64,
        periods in 1..5usize,
    ) {
        let signal = |k: usize| 0.5 + amplitude * (TAU * k as f64 / N as f64 + phase).sin();
        // In parts of the range.
        let range = |bits: u8| f64::from(full_scale(bits)) / f64::from(1u16 << (bits - 12));
        let value = |bits| {
            let f = folded(bits, &codes(bits, periods, signal), 1);
            let phasor = f.correlate(0).0;
            let (i, q) = (phasor.in_phase_value(f.periods()), phasor.quadrature_value(f.periods()));
            [i.0.codes() / range(bits), q.0.codes() / range(bits)]
        };
        // Half a code of each sample, all to the worse side: 2/16 of the sum of 16 |sin|, and half a step of the value.
        let sines: f64 = (0..N).map(|k| (TAU * k as f64 / N as f64).sin().abs()).sum();
        let bound = |bits: u8| {
            let code = 0.5 * 2.0 / N as f64 * sines / f64::from(full_scale(bits));
            code + 0.5 / 16.0 / range(bits)
        };
        let exact = [amplitude * phase.cos(), amplitude * phase.sin()];
        for ((narrow, wide), exact) in value(12).into_iter().zip(value(bits)).zip(exact) {
            prop_assert!((narrow - wide).abs() <= bound(12) + bound(bits), "{narrow} {wide}");
            prop_assert!((wide - exact).abs() <= bound(bits), "{wide} {exact}");
        }
    }

    /// A value is the exact correlation of the codes, rounded to the nearest 65,536th of the range.
    #[test]
    fn values_are_rounded_once(
        bits in 13..=16u8,
        channels in 1..=MAX_CHANNELS,
        periods in 1..4usize,
        noise in vec(any::<u16>(), 4 * N * MAX_CHANNELS),
        cut in 0..16usize,
    ) {
        let highest = full_scale(bits);
        let samples: Vec<u16> = noise[..periods * N * channels].iter().map(|c| c & highest).collect();
        let mut f = Folded::of_bits(bits);
        f.reset(channels as u8);
        let cut = cut.min(QUARTERS as usize * periods) * QUARTER_SAMPLES;
        let (a, b) = samples.split_at(cut * channels);
        for (part, time) in [(a, 0), (b, cut as u64)].into_iter().filter(|(p, _)| !p.is_empty()) {
            f.add(&Block { time, ..block(part, channels as u8, Rails::Unknown) }).unwrap();
        }
        for c in 0..channels {
            let (mut sine, mut cosine, mut railed) = (0, 0, false);
            for (k, row) in samples.chunks(channels).enumerate() {
                let (s, q) = reference(k);
                sine += i128::from(row[c]) * s;
                cosine += i128::from(row[c]) * q;
                railed |= row[c] == 0 || row[c] == highest;
            }
            // 8 * 2^30 a period and code; 2^(16 - bits) values' units in a code.
            let unit = (periods as i128) << (33 - (16 - u32::from(bits)));
            let nearest = |sum: i128| ((2 * sum.abs() + unit) / (2 * unit) * sum.signum()).clamp(-32_768, 32_767);
            let p: Phasor = f.correlate(c).0;
            prop_assert_eq!(i128::from(p.in_phase_value(periods as u16).0.sixteenths()), nearest(sine));
            prop_assert_eq!(i128::from(p.quadrature_value(periods as u16).0.sixteenths()), nearest(cosine));
            prop_assert_eq!(f.railed(c), railed);
        }
        // A converter that has looked for rails itself is believed.
        let mut believed = Folded::of_bits(bits);
        believed.reset(channels as u8);
        believed.add(&block(&samples, channels as u8, Rails::Clear)).unwrap();
        for c in 0..channels {
            prop_assert_eq!(believed.correlate(c), f.correlate(c));
            prop_assert!(!believed.railed(c));
        }
    }
}

/// Square waves at the rails, in phase and half a quarter off, over as many periods as there can be: the sums are exact.
#[test]
fn full_scale_at_the_bound_does_not_overflow() {
    for bits in 12..=16u8 {
        let (highest, periods) = (full_scale(bits), max_periods(bits));
        for (channels, shift) in [(1, 0), (1, 2), (1, 4), (16, 0), (16, 4), (3, 2)] {
            let square: Vec<u16> = (0..N)
                .flat_map(|k| std::iter::repeat_n(if (k + shift) % N < HALF { highest } else { 0 }, channels))
                .collect();
            let mut f = Folded::of_bits(bits);
            f.reset(channels as u8);
            let chunk = square.repeat(usize::from(periods).min(1024));
            let mut left = usize::from(periods);
            while left > 0 {
                let now = left.min(1024);
                f.add(&block(&chunk[..now * N * channels], channels as u8, Rails::Unknown))
                    .unwrap();
                left -= now;
            }
            assert!(
                f.add(&block(&square, channels as u8, Rails::Unknown)).is_err(),
                "{bits}"
            );
            let part = |which: fn((i128, i128)) -> i128| -> i128 {
                let sum: i128 = (0..N)
                    .filter(|k| square[k * channels] > 0)
                    .map(|k| which(reference(k)))
                    .sum();
                // In codes of 12 bits, cut towards zero.
                sum * i128::from(highest) * i128::from(periods) / (1 << (bits - 12))
            };
            for c in [0, channels - 1] {
                let p = f.correlate(c).0;
                assert_eq!(i128::from(p.in_phase), part(|r| r.0), "{bits} {channels}");
                assert_eq!(i128::from(p.quadrature), part(|r| r.1), "{bits} {channels}");
                assert!(f.railed(c));
            }
        }
    }
}
