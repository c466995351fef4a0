//! The lock-in against theory: what it must reject it rejects to the last bit, what it must show it shows exactly.
#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

use firmware::{
    Block, COSINE, FULL_SCALE, FoldError, Folded, MAX_CHANNELS, MAX_PERIODS, Phasor, SAMPLES_PER_PERIOD, SINE,
};
use proptest::collection::vec;
use proptest::prelude::*;

const N: usize = SAMPLES_PER_PERIOD;

fn block(samples: &[u16], channels: u8) -> Block<'_> {
    Block {
        samples,
        channels,
        sequence: 0,
        time: 0,
    }
}

fn folded(samples: &[u16], channels: u8) -> Folded {
    let mut f = Folded::new();
    f.reset(channels);
    f.add(&block(samples, channels)).unwrap();
    f
}

/// Periods in [`dithered`], and the steps it makes of one code.
const STEPS: usize = 1024;

/// Sixteen samples of a signal in codes, each rounded down after adding 0, 1/1024, 2/1024, ... in period after period:
/// folded, the signal is there to a thousandth of a code.
fn dithered(signal: impl Fn(f64) -> f64) -> Vec<u16> {
    (0..STEPS)
        .flat_map(|p| (0..N).map(move |k| (p as f64 / STEPS as f64, k as f64 / N as f64)))
        .map(|(up, turn)| (signal(std::f64::consts::TAU * turn) + up).floor() as u16)
        .collect()
}

#[test]
fn any_constant_is_rejected_exactly() {
    for code in 0..=FULL_SCALE {
        let f = folded(&[code; N], 1);
        assert_eq!(f.correlate(0), Phasor::default(), "{code}");
        assert_eq!(f.railed(0), code == 0 || code == FULL_SCALE, "{code}");
    }
}

#[test]
fn even_harmonics_are_rejected_exactly() {
    // They repeat after half a period, where the reference changes its sign: zero whatever the rounding.
    for h in (2..=14).step_by(2) {
        let samples: Vec<u16> = (0..N)
            .map(|k| {
                // The angle modulo a turn, so that equal angles are equal numbers.
                let turns = (h * k % N) as f64 / N as f64 + 0.1;
                (2048.0 + 1900.0 * (std::f64::consts::TAU * turns).sin()).round() as u16
            })
            .collect();
        assert_eq!(folded(&samples, 1).correlate(0), Phasor::default(), "{h}");
    }
}

#[test]
fn harmonics_two_to_fourteen_leave_nothing_in_the_values() {
    // Q14 cannot hold the square root of one half, which leaves 1.1e-5 of an odd harmonic: 0.022 code of 2000, and a value
    // is rounded to 0.0625.
    for h in 2..=14 {
        let f = folded(&dithered(|x| 2048.0 + 2000.0 * (f64::from(h) * x + 0.7).sin()), 1);
        let (in_phase, quadrature, fitted) = f.correlate(0).values(STEPS as u32);
        assert_eq!((in_phase.sixteenths(), quadrature.sixteenths()), (0, 0), "{h}");
        assert!(fitted);
    }
}

#[test]
fn the_fifteenth_and_seventeenth_look_like_the_first() {
    for (h, sign) in [(15.0, -1.0), (17.0, 1.0)] {
        let f = folded(&dithered(|x| 2048.0 + 1000.0 * (h * x).sin()), 1);
        let (in_phase, _, _) = f.correlate(0).values(STEPS as u32);
        assert!((in_phase.codes() - sign * 1000.0).abs() < 0.1, "{h}");
    }
}

proptest! {
    #[test]
    fn amplitude_and_phase_are_right(amplitude in 0.0..2040.0f64, phase in -4.0..4.0f64, offset in -5.0..5.0f64) {
        let f = folded(&dithered(|x| 2047.5 + offset + amplitude * (x + phase).sin()), 1);
        let (in_phase, quadrature, fitted) = f.correlate(0).values(STEPS as u32);
        prop_assert!(fitted && !f.railed(0));
        // Half a step of the value, a thousandth of a code of the dither, 2e-5 of the table.
        let bound = 0.5 / 16.0 + 1e-3 + 2e-5 * amplitude;
        prop_assert!((in_phase.codes() - amplitude * phase.cos()).abs() < bound);
        prop_assert!((quadrature.codes() - amplitude * phase.sin()).abs() < bound);
    }

    #[test]
    fn folding_first_changes_no_bit(
        channels in 1..=MAX_CHANNELS,
        periods in 1..6usize,
        noise in vec(0..=FULL_SCALE, 5 * N * MAX_CHANNELS),
        cut in 0..5usize,
    ) {
        let samples = &noise[..periods * N * channels];
        let mut f = Folded::new();
        f.reset(channels as u8);
        // In one block or in two.
        let (a, b) = samples.split_at(cut.min(periods) * N * channels);
        for part in [a, b].into_iter().filter(|p| !p.is_empty()) {
            f.add(&block(part, channels as u8)).unwrap();
        }
        prop_assert_eq!(f.periods(), periods as u32);
        for c in 0..channels {
            let mut direct = Phasor::default();
            let mut railed = false;
            for (k, row) in samples.chunks(channels).enumerate() {
                direct.in_phase += i64::from(row[c]) * i64::from(SINE[k % N]);
                direct.quadrature += i64::from(row[c]) * i64::from(COSINE[k % N]);
                railed |= row[c] == 0 || row[c] == FULL_SCALE;
            }
            prop_assert_eq!(f.correlate(c), direct);
            prop_assert_eq!(f.railed(c), railed);
        }
    }
}

#[test]
fn full_scale_at_the_bound_does_not_overflow() {
    let chunk = vec![FULL_SCALE; 1024 * N];
    let mut f = Folded::new();
    for _ in 0..MAX_PERIODS / 1024 {
        f.add(&block(&chunk, 1)).unwrap();
    }
    let rest = (MAX_PERIODS % 1024) as usize;
    f.add(&block(&chunk[..rest * N], 1)).unwrap();
    assert_eq!(f.periods(), MAX_PERIODS);
    let full = u64::from(FULL_SCALE) * u64::from(MAX_PERIODS);
    assert_eq!(f.period(0).map(u64::from), [full; N]);
    assert_eq!(f.correlate(0), Phasor::default());
    assert_eq!(f.add(&block(&chunk[..N], 1)), Err(FoldError::TooManyPeriods));
    assert_eq!(f.periods(), MAX_PERIODS);
}

#[test]
fn the_largest_square_wave_fits_63_bits_and_says_that_it_does_not_fit_a_value() {
    // Its fundamental is 4 / pi times its height: more than any sine that the converter can show.
    let mut f = Folded::new();
    let period: Vec<u16> = (0..N).map(|k| if k < N / 2 { FULL_SCALE } else { 0 }).collect();
    f.add(&block(&period.repeat(4096), 1)).unwrap();
    let (value, _, fitted) = f.correlate(0).values(4096);
    assert!(!fitted && f.railed(0));
    assert_eq!(value, protocol::Value::MAX);
}

#[test]
fn a_block_of_another_shape_is_refused() {
    let samples = [1000; 3 * N];
    let mut f = Folded::new();
    f.reset(2);
    for (len, channels) in [(N, 1), (3 * N, 2), (2 * N - 1, 2), (0, 2)] {
        assert_eq!(f.add(&block(&samples[..len], channels)), Err(FoldError::Shape));
    }
    assert_eq!(f.add(&block(&samples[..2 * N], 2)), Ok(()));
    assert_eq!(f.periods(), 1);
}
