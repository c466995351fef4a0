//! The lock-in against theory: what it must reject it rejects, what it must show it shows, to the last bit.

use firmware::{
    Block, COSINE, FRACTION, FULL_SCALE, FoldError, Folded, HALF, MAX_CHANNELS, MAX_PERIODS, Phasor, QUARTER_SAMPLES,
    Rails, Rotation, SAMPLES_PER_PERIOD, SINE, Scatter,
};
use proptest::collection::vec;
use proptest::prelude::*;
use protocol::{Value, Variance};
use std::f64::consts::{PI, TAU};

const N: usize = SAMPLES_PER_PERIOD;

fn block(samples: &[u16], channels: u8) -> Block<'_> {
    block_at(samples, channels, 0)
}

fn block_at(samples: &[u16], channels: u8, time: u64) -> Block<'_> {
    Block {
        samples,
        channels,
        sequence: 0,
        time,
        rails: Rails::Unknown,
    }
}

fn folded(samples: &[u16], channels: u8) -> Folded {
    let mut f = Folded::new();
    f.reset(channels);
    f.add(&block(samples, channels)).unwrap();
    f
}

/// In-phase and quadrature value of the only channel.
fn values(f: &Folded) -> (Value, Value, bool) {
    let (p, _) = f.correlate(0);
    let (i, a) = p.in_phase_value(f.periods());
    let (q, b) = p.quadrature_value(f.periods());
    (i, q, a && b)
}

/// Sine and cosine of all 16 phases.
fn reference(k: usize) -> (i64, i64) {
    let sign = if k % N < HALF { 1 } else { -1 };
    (sign * i64::from(SINE[k % HALF]), sign * i64::from(COSINE[k % HALF]))
}

/// Folds a signal in codes at the overflow bound: as many periods as a plan can count, in each phase the sum of that many
/// samples, rounded once. So fine a signal cannot be told from one that was never rounded.
fn at_the_bound(signal: impl Fn(f64) -> f64) -> Folded {
    let sums: Vec<u64> = (0..N)
        .map(|k| (signal(TAU * k as f64 / N as f64) * f64::from(MAX_PERIODS)).round() as u64)
        .collect();
    // As real samples would make it: period after period of codes whose sums are these.
    let mut f = Folded::new();
    let mut samples = vec![0; N * 1024];
    let mut left = sums;
    let mut periods = u64::from(MAX_PERIODS);
    while periods > 0 {
        let now = periods.min(1024) as usize;
        for row in samples.chunks_exact_mut(N).take(now) {
            for (sample, left) in row.iter_mut().zip(&mut left) {
                *sample = left.div_ceil(periods) as u16;
                *left -= u64::from(*sample);
            }
            periods -= 1;
        }
        f.add(&block(&samples[..now * N], 1)).unwrap();
    }
    assert_eq!(left, [0; N]);
    f
}

/// Periods in [`dithered`], and the steps it makes of one code.
const STEPS: usize = 1024;

/// Sixteen samples of a signal in codes, each rounded down after adding 0, 1/1024, 2/1024, ... in period after period:
/// folded, the signal is there to a thousandth of a code.
fn dithered(signal: impl Fn(f64) -> f64) -> Vec<u16> {
    (0..STEPS)
        .flat_map(|p| (0..N).map(move |k| (p as f64 / STEPS as f64, k as f64 / N as f64)))
        .map(|(up, turn)| (signal(TAU * turn) + up).floor() as u16)
        .collect()
}

#[test]
fn any_constant_is_rejected_exactly() {
    for code in 0..=FULL_SCALE {
        let f = folded(&[code; N], 1);
        assert_eq!(f.correlate(0).0, Phasor::default(), "{code}");
        assert_eq!(f.railed(0), code == 0 || code == FULL_SCALE, "{code}");
    }
}

#[test]
fn even_harmonics_are_rejected_exactly_whatever_they_are_rounded_to() {
    // They repeat after half a period, where the reference changes its sign.
    for h in (2..=14).step_by(2) {
        let samples: Vec<u16> = (0..N)
            .map(|k| {
                // The angle modulo a turn, so that equal angles are equal numbers.
                let turns = (h * k % N) as f64 / N as f64 + 0.1;
                (2048.0 + 1900.0 * (TAU * turns).sin()).round() as u16
            })
            .collect();
        assert_eq!(folded(&samples, 1).correlate(0).0, Phasor::default(), "{h}");
    }
}

/// The algebra: in the ring of integers with a 16th root of unity z (z^8 = -1, so eight integers are a number), the
/// correlation of every harmonic 2 to 14 with the fundamental is zero, and that of 1, 15 and 17 is not. No rounding anywhere.
#[test]
fn all_harmonics_from_two_to_fourteen_are_orthogonal_in_exact_algebra() {
    for harmonic in 0..=17 {
        // Correlated with z^-k and with z^k, of which sine and cosine are made.
        for turn in [N - 1, 1] {
            let mut sum = [0i32; HALF];
            for k in 0..N {
                let power = (harmonic + turn) * k % N;
                sum[power % HALF] += if power < HALF { 1 } else { -1 };
            }
            let aliases = (harmonic + turn).is_multiple_of(N);
            assert_eq!(sum != [0; HALF], aliases, "{harmonic} {turn}");
            assert!(!aliases || [1, 15, 17].contains(&harmonic), "{harmonic}");
        }
    }
}

#[test]
fn harmonics_two_to_fourteen_leave_nothing_in_the_values_at_any_phase() {
    // Of what the algebra says, the tables' 30 bits leave: sixteen bins, each wrong by half of 2^-30 at most, of amplitude A
    // over 8 A: 2^-30, two millionths of a code at full scale, where a value is rounded to a sixteenth.
    for h in 2..=14 {
        for phase in 0..8 {
            let phase = f64::from(phase) * 0.4;
            let f = at_the_bound(|x| 2047.5 + 2047.0 * (f64::from(h) * x + phase).sin());
            let (p, _) = f.correlate(0);
            // In codes: the tables' share, and half a unit of rounding in each of 16 sums.
            let codes = |sum: i64| sum as f64 / (8.0 * f64::from(MAX_PERIODS) * f64::from(1 << FRACTION));
            let bound = 2047.0 * 2f64.powi(-30) + 1.0 / f64::from(MAX_PERIODS);
            assert!(codes(p.in_phase).abs() < bound, "{h} {phase}: {}", codes(p.in_phase));
            assert!(
                codes(p.quadrature).abs() < bound,
                "{h} {phase}: {}",
                codes(p.quadrature)
            );
            let (i, q, fitted) = values(&f);
            assert_eq!((i.sixteenths(), q.sixteenths(), fitted), (0, 0, true), "{h} {phase}");
        }
    }
}

#[test]
fn a_value_is_the_exact_correlation_of_the_codes_rounded() {
    // The irrational numbers to 60 bits: 2^60 sin(k pi / 8).
    const C: [i128; 4] = [
        0,
        441_203_958_630_471_860,
        815_238_614_083_298_888,
        1_065_160_580_698_383_124,
    ];
    let sine = |k: usize| {
        let k = k % N;
        let quarter = [C[0], C[1], C[2], C[3], 1 << 60, C[3], C[2], C[1]][k % HALF];
        if k < HALF { quarter } else { -quarter }
    };
    for (k, s) in [(1, PI / 8.0), (2, PI / 4.0), (3, 3.0 * PI / 8.0)] {
        assert!((C[k] as f64 / 2f64.powi(60) - s.sin()).abs() < 1e-15);
    }
    let mut state = 1u64;
    for _ in 0..20_000 {
        let samples: Vec<u16> = (0..N)
            .map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (state >> 52) as u16
            })
            .collect();
        let f = folded(&samples, 1);
        let (i, q, fitted) = values(&f);
        for (value, shift) in [(i, 0), (q, 4)] {
            let exact: i128 = (0..N).map(|k| i128::from(samples[k]) * sine(k + shift)).sum();
            // In units of a sixteenth of a code, times 2^59.
            let unit = 1i128 << 59;
            let nearest = (exact.abs() + unit / 2) / unit * exact.signum();
            // Nothing is nearer to a tie than the tables are wrong by, in twenty thousand.
            assert_eq!(i128::from(value.sixteenths()), nearest.clamp(-32_768, 32_767));
        }
        assert!(fitted || i == Value::MAX || i == Value::MIN || q == Value::MAX || q == Value::MIN);
    }
}

#[test]
fn the_fifteenth_and_seventeenth_look_like_the_first() {
    // That is the analog filter's duty: 16 samples a period cannot tell them.
    for (h, sign) in [(15.0, -1.0), (17.0, 1.0)] {
        let f = folded(&dithered(|x| 2048.0 + 1000.0 * (h * x).sin()), 1);
        let (in_phase, _, _) = values(&f);
        assert!((in_phase.codes() - sign * 1000.0).abs() < 0.1, "{h}");
    }
}

#[test]
fn mains_leaks_as_theory_says() {
    // A sine of frequency g through a correlation of M periods of 16 samples at f: the sum over n of
    // sin(2 pi g n / 16 f + phi) sin(2 pi n / 16), two geometric series. 50 and 60 Hz and a harmonic, against 3684.2 Hz.
    let f0 = 84e6 / (16.0 * 1425.0);
    for (hz, periods) in [(50.0, 1), (50.0, 6), (60.0, 6), (150.0, 64), (50.0, 74)] {
        let ratio: f64 = hz / f0;
        let mut worst = (0.0f64, 0.0f64);
        for step in 0..16 {
            let phi = TAU * f64::from(step) / 16.0;
            let signal = |n: usize| 2048.0 + 500.0 * (TAU * ratio * n as f64 / N as f64 + phi).sin();
            let samples: Vec<u16> = (0..periods * N).map(|n| signal(n).round() as u16).collect();
            let (value, _, _) = values(&folded(&samples, 1));
            let half = |w: f64| {
                // Sum over n < L of cos(w n + phi), closed.
                let l = (periods * N) as f64;
                (w * l / 2.0).sin() / (w / 2.0).sin() * (w * (l - 1.0) / 2.0 + phi).cos()
            };
            let (w, r) = (TAU / N as f64, TAU * ratio / N as f64);
            let theory = 500.0 * (half(r - w) - half(r + w)) / 2.0 / (8.0 * periods as f64);
            // Rounding each sample: 0.29 code, averaged.
            assert!(
                (value.codes() - theory).abs() < 0.25,
                "{hz} {periods}: {} {theory}",
                value.codes()
            );
            worst = (worst.0.max(value.codes().abs()), worst.1.max(theory.abs()));
        }
        // 74 periods are 20.1 ms, a whole period of mains: next to nothing is left.
        assert!(periods != 74 || worst.1 < 0.2, "{worst:?}");
    }
}

#[test]
fn a_clipped_sine_reads_what_theory_says_and_is_flagged() {
    // Amplitude A clipped at c: the fundamental is (2/pi) A (asin(c/A) + c/A sqrt(1 - (c/A)^2)).
    for a in [500.0, 999.0, 1100.0, 1300.0, 1750.0] {
        let clip = 1000.0f64;
        let f = folded(&dithered(|x| 2047.0 + (a * x.sin()).clamp(-clip, clip)), 1);
        let u = (clip / a).min(1.0);
        let theory = a * 2.0 / PI * (u.asin() + u * (1.0 - u * u).sqrt());
        let (value, _, _) = values(&f);
        // Clipping makes 15f and 17f, which fold in: about 1 % here.
        assert!(
            (value.codes() / theory - 1.0).abs() < 0.015,
            "{a}: {} {theory}",
            value.codes()
        );
        assert!(!f.railed(0));
    }
    // The converter's own rails are seen at the first sample that touches one.
    for (a, touches) in [(2040.0, false), (2046.0, false), (2048.0, true), (2600.0, true)] {
        let f = folded(&dithered(|x| (2047.0 + a * x.sin()).clamp(0.0, 4095.0).min(4094.9)), 1);
        assert_eq!(f.railed(0), touches, "{a}");
    }
}

#[test]
fn jitter_of_the_samples_attenuates_and_adds_noise_as_theory_says() {
    // Normal jitter of standard deviation s (radians of the excitation): the mean falls by exp(-s^2 / 2); the noise of one
    // value is that of the slope, A s / sqrt(2) per sample (first order), correlated with the sine: cos^2 sin^2.
    let mut state = 7u64;
    let mut uniform = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        ((state >> 11) as f64 + 0.5) / 2f64.powi(53)
    };
    let mut normal = || (-2.0 * uniform().ln()).sqrt() * (TAU * uniform()).cos();
    let (a, s) = (1800.0, 0.02);
    let list: Vec<f64> = (0..4000)
        .map(|_| {
            let samples: Vec<u16> = (0..N)
                .map(|k| (2048.0 + a * (TAU * k as f64 / N as f64 + s * normal()).sin()).round() as u16)
                .collect();
            values(&folded(&samples, 1)).0.codes()
        })
        .collect();
    let mean = list.iter().sum::<f64>() / list.len() as f64;
    let variance = list.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (list.len() - 1) as f64;
    // Sum over 16 samples of (A s cos sin)^2 = A^2 s^2 * 16 / 8; over 8^2.
    let theory = (a * s).powi(2) * 2.0 / 64.0;
    let deviation = (theory / list.len() as f64).sqrt();
    assert!((mean - a * (-s * s / 2.0f64).exp()).abs() < 5.0 * deviation, "{mean}");
    assert!(
        (variance / theory - 1.0).abs() < 5.0 * (2.0 / list.len() as f64).sqrt(),
        "{variance} {theory}"
    );
}

#[test]
fn a_crystals_error_changes_nothing_and_two_crystals_would() {
    // One timer makes source and samples: whatever its error, sample k is at phase k / 16, and the values are the same.
    // With a source of its own, off by e, M periods read sinc(M e) of the amplitude.
    let samples = |e: f64, periods: usize| -> Vec<u16> {
        (0..periods * N)
            .map(|n| (2048.0 + 1500.0 * (TAU * (1.0 + e) * n as f64 / N as f64).sin()).round() as u16)
            .collect()
    };
    let common = values(&folded(&samples(0.0, 64), 1)).0.codes();
    // The same samples in every period dither nothing: half a code at most in each.
    assert!((common - 1500.0).abs() < 0.35);
    for (e, periods) in [(100e-6, 64), (1e-3, 64), (1e-3, 250)] {
        let x = PI * e * periods as f64;
        let (i, q, _) = values(&folded(&samples(e, periods), 1));
        let theory = 1500.0 * x.sin() / x;
        assert!((i.codes().hypot(q.codes()) - theory).abs() < 1.0, "{e} {periods}");
    }
}

#[test]
fn a_window_may_begin_at_any_quarter() {
    let signal = |n: u64| (2048.0 + 1234.0 * (TAU * n as f64 / N as f64 + 0.3).sin()).round() as u16;
    let whole = folded(&(0..5 * N as u64).map(signal).collect::<Vec<_>>(), 1);
    for quarter in 0..4 {
        let start = (quarter * QUARTER_SAMPLES) as u64;
        let samples: Vec<u16> = (start..start + 5 * N as u64).map(signal).collect();
        // In one block, and cut in two at a quarter.
        for cut in [0, QUARTER_SAMPLES, 3 * N, 4 * N + 2 * QUARTER_SAMPLES] {
            let mut f = Folded::new();
            let (a, b) = samples.split_at(cut);
            for (part, at) in [(a, start), (b, start + cut as u64)]
                .into_iter()
                .filter(|(p, _)| !p.is_empty())
            {
                f.add(&block_at(part, 1, at)).unwrap();
            }
            assert_eq!(f.period(0), whole.period(0));
            assert_eq!(f.correlate(0), whole.correlate(0));
        }
    }
}

#[test]
fn the_skew_of_channels_is_taken_out() {
    // Channel c is sampled 60 c of 1425 ticks late: 21 degrees for the last one, which alone would cost 5 % in phase.
    for channel in 0..16u32 {
        let ticks = 60 * channel;
        let late = TAU / N as f64 * f64::from(ticks) / 1425.0;
        for (amplitude, phase) in [(1900.0, 0.0), (1900.0, 0.5), (700.0, -2.0)] {
            let f = folded(&dithered(|x| 2048.0 + amplitude * (x + late + phase).sin()), 1);
            let p = f.correlate(0).0.turned_back(Rotation::new(ticks, 1425));
            let (i, q) = (p.in_phase_value(f.periods()).0, p.quadrature_value(f.periods()).0);
            // Half a step of the value, and the dither's thousandth of a code.
            assert!(
                (i.codes() - amplitude * phase.cos()).abs() < 0.5 / 16.0 + 1e-3,
                "{channel}"
            );
            assert!(
                (q.codes() - amplitude * phase.sin()).abs() < 0.5 / 16.0 + 1e-3,
                "{channel}"
            );
        }
    }
}

#[test]
fn the_scatter_is_the_variance_of_a_sample() {
    let mut state = 99u64;
    let mut uniform = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        ((state >> 11) as f64 + 0.5) / 2f64.powi(53)
    };
    // A large sine with white noise of 3 codes: 400 channels with seven degrees of freedom, 2 / 2800 relative variance.
    for periods in [1, 4, 60] {
        let mut scatter = Scatter::default();
        for _ in 0..400 {
            let samples: Vec<u16> = (0..periods * N)
                .map(|n| {
                    let noise = (-2.0 * uniform().ln()).sqrt() * (TAU * uniform()).cos();
                    (2048.0 + 1700.0 * (TAU * n as f64 / N as f64 + 0.2).sin() + 3.0 * noise).round() as u16
                })
                .collect();
            scatter.add(folded(&samples, 1).correlate(0).1);
        }
        // And the rounding's twelfth; the byte is cut by up to an eighth.
        let variance = scatter.variance(periods as u16).codes2();
        let theory = 9.0 + 1.0 / 12.0;
        let low = 1.0 - 0.125 - 5.0 * (2.0f64 / 2800.0).sqrt();
        assert!((low..1.14).contains(&(variance / theory)), "{periods}: {variance}");
    }
    // A pure sine scatters by its rounding alone, a settling tail by much more.
    let sine = folded(&dithered(|x| 2048.0 + 1900.0 * x.sin()), 1).correlate(0).1;
    assert!(sine.variance(STEPS as u16).codes2() < 0.1);
    let tail: Vec<u16> = (0..N as i32)
        .map(|k| (2048.0 + 100.0 * (-f64::from(k)).exp()) as u16)
        .collect();
    assert!(folded(&tail, 1).correlate(0).1.variance(1).codes2() > 100.0);
}

/// Two channels share a word while they are summed: at the bound, with all that codes can be beside each other, nothing of one
/// gets into the other, and what is read is the sum.
#[test]
fn many_channels_are_summed_exactly_to_the_bound() {
    let code = |k: usize, c: usize| match (k + c) % 4 {
        0 => FULL_SCALE,
        1 => 0,
        2 => FULL_SCALE - (c as u16),
        _ => ((257 * k + 31 * c) % usize::from(FULL_SCALE)) as u16,
    };
    for channels in [2, 5, 16] {
        let period: Vec<u16> = (0..N).flat_map(|k| (0..channels).map(move |c| code(k, c))).collect();
        let mut f = Folded::new();
        f.reset(channels as u8);
        let chunk = period.repeat(1024);
        let mut left = usize::from(MAX_PERIODS);
        // Pieces of all sizes: whatever is carried over to the high part is carried at other times.
        for size in [1, 14, 15, 16, 31, 1, 1, 7, 1000].into_iter().cycle() {
            let now = left.min(size);
            f.add(&block(&chunk[..now * N * channels], channels as u8)).unwrap();
            left -= now;
            if left == 0 {
                break;
            }
        }
        for c in 0..channels {
            let sums: [u32; N] = std::array::from_fn(|k| u32::from(code(k, c)) * u32::from(MAX_PERIODS));
            assert_eq!(f.period(c), sums, "{channels} {c}");
            // The same as of a single channel that sees the same.
            let alone: Vec<u16> = (0..N).map(|k| code(k, c)).collect();
            assert_eq!(
                f.correlate(c),
                full(&alone.try_into().unwrap()).correlate(0),
                "{channels} {c}"
            );
        }
        assert_eq!(f.period(channels), [0; N]);
        // And nothing of it is left afterwards.
        f.reset(channels as u8);
        f.add(&block(&chunk[..40 * N * channels], channels as u8)).unwrap();
        for c in 0..channels {
            assert_eq!(
                f.period(c),
                std::array::from_fn(|k| 40 * u32::from(code(k, c))),
                "{channels} {c}"
            );
        }
    }
}

proptest! {
    #[test]
    fn amplitude_and_phase_are_right(amplitude in 0.0..2040.0f64, phase in -4.0..4.0f64, offset in -5.0..5.0f64) {
        let f = folded(&dithered(|x| 2047.5 + offset + amplitude * (x + phase).sin()), 1);
        let (in_phase, quadrature, fitted) = values(&f);
        prop_assert!(fitted && !f.railed(0));
        // Half a step of the value, a thousandth of a code of the dither.
        let bound = 0.5 / 16.0 + 1e-3;
        prop_assert!((in_phase.codes() - amplitude * phase.cos()).abs() < bound);
        prop_assert!((quadrature.codes() - amplitude * phase.sin()).abs() < bound);
    }

    #[test]
    fn folding_first_changes_no_bit(
        channels in 1..=MAX_CHANNELS,
        periods in 1..6usize,
        noise in vec(0..=FULL_SCALE, 5 * N * MAX_CHANNELS),
        cut in 0..20usize,
    ) {
        let samples = &noise[..periods * N * channels];
        let mut f = Folded::new();
        f.reset(channels as u8);
        // In one block or in two.
        let cut = cut.min(4 * periods) * QUARTER_SAMPLES;
        let (a, b) = samples.split_at(cut * channels);
        for (part, at) in [(a, 0), (b, cut as u64)].into_iter().filter(|(p, _)| !p.is_empty()) {
            f.add(&block_at(part, channels as u8, at)).unwrap();
        }
        prop_assert_eq!(f.periods(), periods as u16);
        for c in 0..channels {
            let mut direct = Phasor::default();
            let mut railed = false;
            for (k, row) in samples.chunks(channels).enumerate() {
                let (sine, cosine) = reference(k);
                direct.in_phase += i64::from(row[c]) * sine;
                direct.quadrature += i64::from(row[c]) * cosine;
                railed |= row[c] == 0 || row[c] == FULL_SCALE;
            }
            prop_assert_eq!(f.correlate(c).0, direct);
            prop_assert_eq!(f.railed(c), railed);
        }
        // A converter that has looked for rails itself is believed, and changes nothing else.
        let mut believed = Folded::new();
        believed.reset(channels as u8);
        believed.add(&Block { rails: Rails::Clear, ..block(samples, channels as u8) }).unwrap();
        for c in 0..channels {
            prop_assert_eq!(believed.correlate(c), f.correlate(c));
            prop_assert!(!believed.railed(c));
        }
    }
}

/// Folds the same period as often as a plan can count.
fn full(period: &[u16; N]) -> Folded {
    let chunk = period.repeat(1024);
    let mut f = Folded::new();
    for _ in 0..MAX_PERIODS / 1024 {
        f.add(&block(&chunk, 1)).unwrap();
    }
    let rest = usize::from(MAX_PERIODS % 1024);
    f.add(&block(&chunk[..rest * N], 1)).unwrap();
    assert_eq!(f.periods(), MAX_PERIODS);
    f
}

#[test]
fn full_scale_at_the_bound_does_not_overflow() {
    let mut f = full(&[FULL_SCALE; N]);
    let sum = u64::from(FULL_SCALE) * u64::from(MAX_PERIODS);
    assert_eq!(f.period(0).map(u64::from), [sum; N]);
    assert_eq!(f.correlate(0), (Phasor::default(), folded(&[7; N], 1).correlate(0).1));
    assert_eq!(f.add(&block(&[FULL_SCALE; N], 1)), Err(FoldError::TooManyPeriods));
    assert_eq!(f.periods(), MAX_PERIODS);
}

#[test]
fn the_largest_sums_that_codes_can_make_at_the_bound_are_exact() {
    // Square waves in phase with the references, and an even part as large as it can be: every code at a rail.
    let square = |shift: usize| core::array::from_fn(|k| if (k + shift) % N < HALF { FULL_SCALE } else { 0 });
    let even = core::array::from_fn(|k| if k % HALF < HALF / 2 { FULL_SCALE } else { 0 });
    let sum = i128::from(FULL_SCALE) * i128::from(MAX_PERIODS);
    for (period, odd) in [(square(0), true), (square(4), true), (square(2), true), (even, false)] {
        let f = full(&period);
        let (p, scatter) = f.correlate(0);
        let exact = |which: fn((i64, i64)) -> i64| -> i128 {
            (0..N)
                .map(|k| i128::from(u8::from(period[k] > 0)) * sum * i128::from(which(reference(k))))
                .sum()
        };
        assert_eq!(i128::from(p.in_phase), exact(|r| r.0));
        assert_eq!(i128::from(p.quadrature), exact(|r| r.1));
        // Its fundamental is 4 / pi times its height: more than any sine that the converter can show.
        let (_, _, fitted) = values(&f);
        assert_eq!(fitted, !odd);
        assert!(f.railed(0));
        // Half of the eight sums are twice the height: their variance is its square, beyond what a sample can have.
        let expected = if odd {
            Variance::new(0).codes2()
        } else {
            f64::from(Variance::new(u32::MAX).parts()) / 256.0
        };
        assert_eq!(scatter.variance(MAX_PERIODS).codes2(), expected);
        // The same in one period.
        let once = folded(&period, 1);
        let one = f64::from(FULL_SCALE).powi(2) * 64.0 / 112.0;
        let v = once.correlate(0).1.variance(1).codes2();
        assert!(
            if odd {
                v == Variance::new(0).codes2()
            } else {
                (v / one - 1.0).abs() < 0.125
            },
            "{v}"
        );
    }
}

#[test]
fn a_block_of_another_shape_is_refused() {
    let samples = [1000; 3 * N];
    let mut f = Folded::new();
    f.reset(2);
    for (len, channels) in [(N, 1), (3 * N - 4, 2), (2 * N - 1, 2), (0, 2)] {
        assert_eq!(f.add(&block(&samples[..len], channels)), Err(FoldError::Shape));
    }
    // Nor may it begin between two quarters.
    assert_eq!(f.add(&block_at(&samples[..2 * N], 2, 2)), Err(FoldError::Shape));
    assert_eq!(f.add(&block_at(&samples[..2 * N], 2, 4)), Ok(()));
    assert_eq!(f.periods(), 1);
}
