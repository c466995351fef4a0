//! The change test against the distribution that theory gives it.

use firmware::{ChangeTest, LEVEL_ONE};
use protocol::{Value, Watch};
use std::f64::consts::TAU;

/// How many slots a watch has, and how many values each.
#[derive(Clone, Copy)]
struct Shape {
    slots: usize,
    of_each: usize,
}

/// Of the paper's watch, and of the one for a single channel.
const PAPER: Shape = Shape { slots: 2, of_each: 6 };
const SEQUENTIAL: Shape = Shape { slots: 8, of_each: 1 };

impl Shape {
    fn values(self) -> usize {
        self.slots * self.of_each
    }

    fn ends(self) -> impl Iterator<Item = usize> {
        (1..=self.slots).map(move |s| s * self.of_each)
    }

    /// A test that is about to learn.
    fn test(self, scans: u16) -> ChangeTest {
        let mut test = ChangeTest::new();
        test.learn(scans, self.values(), self.slots);
        test
    }

    /// Shows a test a whole scan; the level after it.
    fn show(self, test: &mut ChangeTest, values: &[Value]) -> u16 {
        for (slot, part) in values.chunks(self.of_each).enumerate() {
            test.put(slot, slot * self.of_each, part);
        }
        test.level()
    }
}

/// Both watches with their shapes.
fn watches() -> [(Watch, Shape); 2] {
    let watches = [(Watch::paper(), PAPER), (Watch::sequential(), SEQUENTIAL)];
    for (watch, shape) in &watches {
        let sizes = watch.slots.iter().map(|s| s.sense.count_ones() as usize);
        assert_eq!(sizes.collect::<Vec<_>>(), vec![shape.of_each; shape.slots]);
    }
    watches
}

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
    fn scan(&mut self, shape: Shape, deviation: f64, signal: f64) -> Vec<Value> {
        let n = shape.values();
        let change = signal * (deviation * deviation + 1.0 / 12.0).sqrt() / (n as f64).sqrt();
        let mut out = vec![Value::new(0); n];
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
fn levels(
    noise: &mut Noise,
    shape: Shape,
    learn: u16,
    scans: usize,
    deviation: f64,
    signal: f64,
) -> impl Iterator<Item = u16> {
    let mut test = shape.test(learn);
    while !test.is_ready() {
        test.learn_from(&noise.scan(shape, deviation, 0.0), shape.ends());
    }
    (0..scans).map(move |_| {
        let values = noise.scan(shape, deviation, signal);
        shape.show(&mut test, &values)
    })
}

/// Chance that chi-square with n degrees of freedom, an even number, exceeds x: n / 2 terms of a Poisson sum.
fn exceeds(n: usize, x: f64) -> f64 {
    let y = x / 2.0;
    let (mut term, mut sum) = (1.0, 1.0);
    for k in 1..n / 2 {
        term *= y / k as f64;
        sum += term;
    }
    sum * (-y).exp()
}

#[test]
fn untouched_the_level_has_the_distribution_of_chi_square() {
    for (shape, deviation) in [(PAPER, 2.6), (PAPER, 1.0), (PAPER, 40.0), (SEQUENTIAL, 2.6)] {
        // Learned from so many scans that the variance is as good as known.
        let mut noise = Noise(11);
        let n = 200_000;
        let list: Vec<f64> = levels(&mut noise, shape, 20_000, n, deviation, 0.0)
            .map(|l| f64::from(l) / f64::from(LEVEL_ONE))
            .collect();
        let mean = list.iter().sum::<f64>() / n as f64;
        // Rounding down to 256ths, and up to 2 % for the cut variance of the smallest noise.
        assert!((mean - 1.0).abs() < 0.03, "{deviation}: {mean}");
        for x in [15.0, 20.0, 26.0, 33.0] {
            let found = list.iter().filter(|l| **l * shape.values() as f64 > x).count() as f64 / n as f64;
            let theory = exceeds(shape.values(), x);
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
    for (watch, shape) in watches() {
        // What theory expects of a million, were the noise known: nothing.
        let x = f64::from(watch.threshold) / 256.0 * shape.values() as f64;
        assert!(exceeds(shape.values(), x) < 1e-10, "{:e}", exceeds(shape.values(), x));
        // And with the noise learned from as few scans as the watch takes, ten boards that learn a hundred thousand scans
        // each.
        let mut noise = Noise(12);
        let (mut wakes, mut highest) = (0, 0);
        for _ in 0..10 {
            for level in levels(&mut noise, shape, watch.learn_scans, 100_000, 2.6, 0.0) {
                wakes += u32::from(level >= watch.threshold);
                highest = highest.max(level);
            }
        }
        println!(
            "{} values, chance of a false wake {:.0e}: false wakes in a million scans: {wakes}; highest level {:.2} of {:.2}",
            shape.values(),
            exceeds(shape.values(), x),
            f64::from(highest) / 256.0,
            f64::from(watch.threshold) / 256.0
        );
        assert_eq!(wakes, 0);
    }
}

/// Chance that chi-square with n degrees of freedom, an even number, and non-centrality `l` stays below x: a Poisson mixture
/// of central ones.
fn stays_below(n: usize, x: f64, l: f64) -> f64 {
    let (y, m) = (x / 2.0, l / 2.0);
    // Central with n + 2 j degrees: 1 - exp(-y) sum over k < n / 2 + j of y^k / k!, here through logarithms.
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
        sum += (j as f64 * m.ln() - m - log_factorial).exp() * (1.0 - tail[n / 2 + j]);
    }
    sum
}

#[test]
fn touches_are_missed_as_often_as_theory_says() {
    for (watch, shape) in watches() {
        let x = f64::from(watch.threshold) / 256.0 * shape.values() as f64;
        for (signal, scans) in [(6.0, 100_000), (7.94, 100_000), (10.0, 400_000)] {
            let mut noise = Noise(13);
            let missed = levels(&mut noise, shape, 20_000, scans, 2.6, signal)
                .filter(|l| *l < watch.threshold)
                .count();
            let found = missed as f64 / scans as f64;
            let theory = stays_below(shape.values(), x, signal * signal);
            // Five standard errors, and the little that learning makes the noise too large.
            let error = 5.0 * (theory * (1.0 - theory) / scans as f64).sqrt() + 0.06 * theory + 0.02 * (1.0 - theory);
            assert!((found - theory).abs() < error, "{signal}: {found} {theory}");
        }
    }
}

#[test]
fn of_a_million_scans_of_a_light_touch_none_is_missed() {
    // The least visible touch of 25 N is 141 and 181 times the noise of the drawn boards (hil-sim/tests/suite/visibility.rs); of
    // 5 N, where the rubber is linear, a fifth of that, of 2.5 N a tenth.
    for ((watch, shape), full) in watches().into_iter().zip([141.0, 181.0]) {
        for (force_n, most) in [(5.0, 0), (2.5, 200)] {
            let signal = full * force_n / 25.0;
            let mut noise = Noise(13);
            let mut missed = 0;
            for _ in 0..10 {
                missed += levels(&mut noise, shape, watch.learn_scans, 100_000, 2.6, signal)
                    .filter(|l| *l < watch.threshold)
                    .count();
            }
            println!(
                "{} values, {force_n} N, {signal:.1} times the noise: {missed} missed of a million scans",
                shape.values()
            );
            assert!(missed <= most, "{signal}: {missed}");
        }
    }
}

#[test]
fn the_baseline_follows_a_drift_and_not_a_touch() {
    let mut noise = Noise(14);
    let mut test = PAPER.test(64);
    while !test.is_ready() {
        test.learn_from(&noise.scan(PAPER, 2.6, 0.0), PAPER.ends());
    }
    let before = test.baseline();
    let mut wakes = 0;
    // In 300,000 scans (a quarter of an hour) the values drift by four times their noise.
    let (n, drift) = (300_000, 10.0);
    for k in 0..n {
        let shift = drift * f64::from(k) / f64::from(n);
        let mut values = noise.scan(PAPER, 2.6, 0.0);
        for v in &mut values {
            *v = Value::new(v.sixteenths() + shift.round() as i16);
        }
        wakes += u32::from(PAPER.show(&mut test, &values) >= Watch::paper().threshold);
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
