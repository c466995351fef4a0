//! The change test against the distribution that theory gives it.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a failure here is a failed test")]

use firmware::{ChangeTest, LEVEL_ONE};
use protocol::{Value, Watch};
use std::f64::consts::TAU;

/// Values of the paper's watch, in two slots.
const SLOT: usize = 6;
const VALUES: usize = 2 * SLOT;

/// Seeded normal numbers (Box and Muller's transformation).
struct Noise(u64);

impl Noise {
    fn uniform(&mut self) -> f64 {
        // SplitMix64 (Steele et al. 2014).
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let x = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (((x ^ (x >> 31)) >> 11) as f64 + 0.5) / 2f64.powi(53)
    }

    /// A scan: resting values, `deviation` in units of a value, and a change of `signal` times the noise in norm.
    fn scan(&mut self, deviation: f64, signal: f64) -> [Value; VALUES] {
        let change = signal * (deviation * deviation + 1.0 / 12.0).sqrt() / (VALUES as f64).sqrt();
        let mut out = [Value::new(0); VALUES];
        for (k, pair) in out.chunks_mut(2).enumerate() {
            let radius = (-2.0 * self.uniform().ln()).sqrt();
            let (sin, cos) = (TAU * self.uniform()).sin_cos();
            for (value, normal) in pair.iter_mut().zip([cos, sin]) {
                // Rest anywhere between two steps.
                let rest = 9000.0 - 1234.567 * k as f64;
                *value = Value::new((rest + deviation * radius * normal + change).round() as i16);
            }
        }
        out
    }
}

/// A test that has learned from so many scans, and is then shown scans with a change; the levels after each whole scan.
fn levels(noise: &mut Noise, learn: u16, scans: usize, deviation: f64, signal: f64) -> impl Iterator<Item = u16> {
    let mut test = ChangeTest::new();
    test.learn(learn, VALUES, 2);
    while !test.is_ready() {
        test.learn_from(&noise.scan(deviation, 0.0), [SLOT, VALUES].into_iter());
    }
    (0..scans).map(move |_| {
        let values = noise.scan(deviation, signal);
        test.put(0, 0, &values[..SLOT]);
        test.put(1, SLOT, &values[SLOT..]);
        test.level()
    })
}

/// Chance that chi-square with 12 degrees of freedom exceeds x: six terms of a Poisson sum.
fn exceeds(x: f64) -> f64 {
    let y = x / 2.0;
    let (mut term, mut sum) = (1.0, 1.0);
    for k in 1..6 {
        term *= y / f64::from(k);
        sum += term;
    }
    sum * (-y).exp()
}

#[test]
fn untouched_the_level_has_the_distribution_of_chi_square() {
    for deviation in [2.6, 1.0, 40.0] {
        // Learned from so many scans that the variance is as good as known.
        let mut noise = Noise(11);
        let n = 200_000;
        let list: Vec<f64> = levels(&mut noise, 20_000, n, deviation, 0.0)
            .map(|l| f64::from(l) / f64::from(LEVEL_ONE))
            .collect();
        let mean = list.iter().sum::<f64>() / n as f64;
        // Rounding down to 256ths, and up to 2 % for the cut variance of the smallest noise.
        assert!((mean - 1.0).abs() < 0.03, "{deviation}: {mean}");
        for x in [15.0, 20.0, 26.0, 33.0] {
            let found = list.iter().filter(|l| **l * VALUES as f64 > x).count() as f64 / n as f64;
            let theory = exceeds(x);
            let error = 5.0 * (theory / n as f64).sqrt() + 0.15 * theory;
            assert!(
                (found - theory).abs() < error,
                "{deviation} {x}: {found:.2e} {theory:.2e}"
            );
        }
    }
}

#[test]
fn a_million_scans_without_a_touch_wake_nobody() {
    let watch = Watch::paper();
    // What theory expects of a million, were the noise known: nothing.
    let x = f64::from(watch.threshold) / 256.0 * VALUES as f64;
    assert!(exceeds(x) < 1e-10, "{:e}", exceeds(x));
    // And with the noise learned from as few scans as the watch takes, ten boards that learn a hundred thousand scans
    // each.
    let mut noise = Noise(12);
    let (mut wakes, mut highest) = (0, 0);
    for _ in 0..10 {
        for level in levels(&mut noise, watch.learn_scans, 100_000, 2.6, 0.0) {
            wakes += u32::from(level >= watch.threshold);
            highest = highest.max(level);
        }
    }
    println!(
        "false wakes in a million scans: {wakes}; highest level {:.2}",
        f64::from(highest) / 256.0
    );
    assert_eq!(wakes, 0);
}

/// Chance that chi-square with 12 degrees of freedom and non-centrality `l` stays below x: a Poisson mixture of central ones.
fn stays_below(x: f64, l: f64) -> f64 {
    let (y, m) = (x / 2.0, l / 2.0);
    // Central with 12 + 2 j degrees: 1 - exp(-y) sum over k < 6 + j of y^k / k!, here through logarithms.
    let mut log_factorial = 0.0;
    let mut tail = vec![0.0f64];
    for k in 0..600 {
        if k > 0 {
            log_factorial += f64::from(k).ln();
        }
        tail.push(tail.last().unwrap() + (f64::from(k) * y.ln() - y - log_factorial).exp());
    }
    let (mut log_factorial, mut sum) = (0.0, 0.0);
    for j in 0..590usize {
        if j > 0 {
            log_factorial += (j as f64).ln();
        }
        sum += (j as f64 * m.ln() - m - log_factorial).exp() * (1.0 - tail[6 + j]);
    }
    sum
}

#[test]
fn touches_are_missed_as_often_as_theory_says() {
    let threshold = Watch::paper().threshold;
    let x = f64::from(threshold) / 256.0 * VALUES as f64;
    for (signal, scans) in [(6.0, 100_000), (7.94, 100_000), (10.0, 400_000)] {
        let mut noise = Noise(13);
        let missed = levels(&mut noise, 20_000, scans, 2.6, signal)
            .filter(|l| *l < threshold)
            .count();
        let (found, theory) = (missed as f64 / scans as f64, stays_below(x, signal * signal));
        // Five standard errors, and the little that learning makes the noise too large.
        let error = 5.0 * (theory * (1.0 - theory) / scans as f64).sqrt() + 0.06 * theory + 0.02 * (1.0 - theory);
        assert!((found - theory).abs() < error, "{signal}: {found} {theory}");
    }
}

#[test]
fn of_a_million_scans_of_a_light_touch_none_is_missed() {
    let watch = Watch::paper();
    // The least visible touch of 25 N is 129 times the noise; of 5 N, where the rubber is linear, 25.8 times, of 2.5 N 12.9.
    for (signal, scans, most) in [(25.8, 1_000_000, 0), (12.9, 1_000_000, 200)] {
        let mut noise = Noise(13);
        let mut missed = 0;
        for _ in 0..10 {
            missed += levels(&mut noise, watch.learn_scans, scans / 10, 2.6, signal)
                .filter(|l| *l < watch.threshold)
                .count();
        }
        println!("a touch of {signal} times the noise: {missed} missed of {scans} scans");
        assert!(missed <= most, "{signal}: {missed}");
    }
}

#[test]
fn the_baseline_follows_a_drift_and_not_a_touch() {
    let mut noise = Noise(14);
    let mut test = ChangeTest::new();
    test.learn(64, VALUES, 2);
    while !test.is_ready() {
        test.learn_from(&noise.scan(2.6, 0.0), [SLOT, VALUES].into_iter());
    }
    let before = test.baseline();
    let mut wakes = 0;
    // In 300,000 scans (a quarter of an hour) the values drift by four times their noise.
    let (n, drift) = (300_000, 10.0);
    for k in 0..n {
        let shift = drift * f64::from(k) / f64::from(n);
        let values = noise
            .scan(2.6, 0.0)
            .map(|v| Value::new(v.sixteenths() + shift.round() as i16));
        test.put(0, 0, &values[..SLOT]);
        test.put(1, SLOT, &values[SLOT..]);
        wakes += u32::from(test.level() >= Watch::paper().threshold);
        test.follow(&values);
    }
    assert_eq!(wakes, 0);
    // It lags by one time constant of the drift: 65536 scans.
    for (a, b) in before.values.iter().zip(test.baseline().values) {
        let moved = f64::from(b.sixteenths() - a.sixteenths());
        let theory = drift * (1.0 - 65_536.0 / 300_000.0 * (1.0 - (-300_000.0f64 / 65_536.0).exp()));
        assert!((moved - theory).abs() < 2.0, "{moved} {theory}");
    }
}

#[test]
fn a_noisy_value_counts_for_less_and_a_lucky_one_not_for_more() {
    let mut test = ChangeTest::new();
    test.learn(4, 4, 1);
    // Variances 0, 0, 64 * 16 / 12 * 16 of sixteenths and 0.
    for k in 0..4i16 {
        let noisy = Value::new(100 + if k % 2 == 0 { 8 } else { -8 });
        test.learn_from(&[Value::new(5), Value::new(6), noisy, Value::new(7)], [4].into_iter());
    }
    let baseline = test.baseline();
    assert_eq!(baseline.scans, 4);
    assert_eq!(
        baseline.values.iter().map(|v| v.sixteenths()).collect::<Vec<_>>(),
        [5, 6, 100, 7]
    );
    // The sample variance of +-8 is 64 * 4 / 3 = 85.3, in sixteenths 1365; the mean over the slot is 1368 / 4.
    let [a, b, noisy, c] = baseline.variance[..] else {
        panic!()
    };
    assert_eq!(noisy, 1365);
    assert_eq!([a, b, c], [(1365 + 3 * 4) / 4; 3]);
}

#[test]
fn nothing_overflows_whatever_the_values_are() {
    for (rest, then) in [(i16::MIN, i16::MAX), (i16::MAX, i16::MIN), (0, 0)] {
        let mut test = ChangeTest::new();
        test.learn(u16::MAX, 48, 8);
        let all = [Value::new(rest); 48];
        for k in 0..u16::MAX {
            let swing = if k % 2 == 0 { rest } else { !rest };
            let values = if then == 0 { [Value::new(swing); 48] } else { all };
            test.learn_from(&values, (1..=8).map(|s| 6 * s));
        }
        assert!(test.is_ready());
        for slot in 0..8 {
            test.put(slot, 6 * slot, &[Value::new(then); 6]);
        }
        test.follow(&[Value::new(then); 48]);
        assert_eq!(test.level() == u16::MAX, then != 0);
    }
}
