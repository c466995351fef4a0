//! Whether a baseline differs from an earlier one of the same sheet by more than noise and drift.

use crate::reference::baseline::Baseline;
use crate::stats::chi_square_quantile;

/// What two baselines of one untouched sheet may differ by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriftOptions {
    /// Standard deviation of a value's relative change from one start to the next, apart from the common gain.
    ///
    /// More overlooks what rests on the sheet; less warns of plugs put in anew. Assumed: no board has been measured.
    pub restart: f64,
    /// What each hour adds to it.
    ///
    /// More overlooks what rests on the sheet after a night; less warns of contacts that age. Assumed: a tenth of a common
    /// drift of 0.1 % an hour.
    pub per_hour: f64,
    /// Most that it becomes.
    ///
    /// More overlooks a finger of 20 N; less warns after every weekend. Chosen so that such a finger still shows (the test
    /// `a_finger_that_rests_on_the_sheet_is_more_than_drift`).
    pub most: f64,
    /// Probability with which a sheet that only drifted passes.
    ///
    /// More overlooks light touches; less warns of noise.
    pub probability: f64,
}

impl Default for DriftOptions {
    fn default() -> Self {
        Self {
            restart: 5e-4,
            per_hour: 1e-4,
            most: 2e-3,
            probability: 1.0 - 1e-6,
        }
    }
}

/// How a baseline differs from an earlier one. All numbers are relative: 0.01 is one per cent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Departure {
    /// Common gain: the weighted median of new over earlier values.
    pub gain: f64,
    /// Root mean square of the values' changes apart from the gain, weighted as in the test.
    pub change: f64,
    /// What noise and drift make of it.
    pub expected: f64,
    /// The change that is largest against its noise and drift.
    pub largest: f64,
    /// Whether it is more than noise and drift explain.
    pub differs: bool,
}

/// A value's change with its variance.
struct Change {
    ratio: f64,
    variance: f64,
}

impl Departure {
    /// Compares `new` with a baseline `earlier` of the same pattern, taken `age_h` hours before.
    ///
    /// Each value has a variance: the noise of its two means, and drift. The changes apart from their common gain, squared
    /// over these variances, add up to chi-square on a sheet that only drifted. `None` where fewer than two values, or none
    /// of the same pattern, can be compared.
    pub fn of(new: &Baseline, earlier: &Baseline, age_h: f64, options: &DriftOptions) -> Option<Self> {
        if new.values_v.len() != earlier.values_v.len() {
            return None;
        }
        let drift = (options.restart + options.per_hour * age_h.max(0.0)).min(options.most);
        let (noise, noise_before) = (new.value_noise_v(), earlier.value_noise_v());
        let mean = |b: &Baseline, noise: &[f64], k: usize| {
            let noise = noise.get(k).copied().filter(|s| s.is_finite());
            (
                b.values_v[k],
                noise.unwrap_or(b.noise_v).powi(2) / b.frames.max(1) as f64,
            )
        };
        let changes: Vec<Change> = (0..new.values_v.len())
            .filter_map(|k| {
                let ((v, variance), (before, variance_before)) =
                    (mean(new, &noise, k), mean(earlier, &noise_before, k));
                let ratio = v / before;
                let variance = (variance + ratio * ratio * variance_before) / (before * before) + drift * drift;
                let usable = ratio.is_finite() && variance.is_finite() && variance > 0.0;
                usable.then_some(Change { ratio, variance })
            })
            .collect();
        if changes.len() < 2 {
            return None;
        }
        let gain = weighted_median(&changes);
        let score = |c: &Change| (c.ratio - gain).powi(2) / c.variance;
        let sum: f64 = changes.iter().map(score).sum();
        let freedom = changes.len() as f64 - 1.0;
        let weights: f64 = changes.iter().map(|c| 1.0 / c.variance).sum();
        let largest = changes.iter().max_by(|a, b| score(a).total_cmp(&score(b)))?;
        Some(Self {
            gain,
            change: (sum / weights).sqrt(),
            expected: (freedom / weights).sqrt(),
            largest: largest.ratio - gain,
            differs: sum > chi_square_quantile(freedom, options.probability)?,
        })
    }
}

/// The ratio with half of the weights, 1 / standard deviation, below it: few values that differ much do not move it.
fn weighted_median(changes: &[Change]) -> f64 {
    let mut sorted: Vec<(f64, f64)> = changes.iter().map(|c| (c.ratio, c.variance.sqrt().recip())).collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * sorted.iter().map(|(_, w)| w).sum::<f64>();
    let mut sum = 0.0;
    let middle = sorted.iter().find(|(_, weight)| {
        sum += weight;
        sum >= half
    });
    middle.map_or(1.0, |(ratio, _)| *ratio)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::baseline::BaselineTaker;
    use forward::{DiscTouch, Drive, Model, ModelOptions, Pattern, Sheet, Solver};
    use rand::{Rng, SeedableRng};
    use rand_distr::StandardNormal;

    /// The mean of 80 frames with 0.1 % of the mean value as noise; value 3 has ten times as much.
    fn baseline(values: &[f64], seed: u64) -> Baseline {
        let mut rng = rand::rngs::StdRng::seed_from_u64(seed);
        let noise = 1e-3 * values.iter().map(|v| v.abs()).sum::<f64>() / values.len() as f64;
        let mut taker = BaselineTaker::new(values.len(), 80);
        loop {
            let noisy = values.iter().enumerate().map(|(k, v)| {
                let unit: f64 = rng.sample(StandardNormal);
                v + if k == 3 { 10.0 } else { 1.0 } * noise * unit
            });
            if let Some(baseline) = taker.take(&noisy.collect::<Vec<_>>()) {
                return baseline;
            }
        }
    }

    /// The untouched sheet, and with a disc of the radius and the rise that a finger of 20 N has at half its pressure.
    fn sheets() -> [Vec<f64>; 2] {
        let pattern = Pattern::adjacent(16).unwrap();
        let finger = DiscTouch {
            centre_mm: [-35.0, 20.0],
            radius_mm: 6.75,
            rise: 0.3,
        };
        let model = Model::new(&Sheet::paper(), &ModelOptions::for_touches(&[finger])).unwrap();
        let mut solver = Solver::new(model.into()).unwrap();
        let untouched = Drive::PAPER.frame_v(solver.electrode_matrix(), &pattern);
        let touched = Drive::PAPER.frame_v(solver.solve_touches(&[finger]).unwrap(), &pattern);
        [untouched, touched]
    }

    #[test]
    fn noise_a_common_gain_and_drift_are_no_difference() {
        let [values, _] = sheets();
        let options = DriftOptions::default();
        let mut rng = rand::rngs::StdRng::seed_from_u64(1);
        for seed in 0..100 {
            let gain = 1.0 + 0.1 * (seed as f64 / 50.0 - 1.0);
            let drifted: Vec<f64> = values
                .iter()
                .map(|v| {
                    let unit: f64 = rng.sample(StandardNormal);
                    v * gain * (1.0 + unit * (options.restart + 5.0 * options.per_hour))
                })
                .collect();
            let (earlier, new) = (baseline(&values, seed), baseline(&drifted, 1000 + seed));
            let found = Departure::of(&new, &earlier, 5.0, &options).unwrap();
            assert!(!found.differs, "{seed}: {found:?}");
            assert!((found.gain / gain - 1.0).abs() < 1e-3, "{seed}: {found:?}");
            // Its spread is that of the chi-square of 207 degrees of freedom.
            assert!((found.change / found.expected - 1.0).abs() < 0.2, "{seed}: {found:?}");
        }
    }

    #[test]
    fn a_finger_that_rests_on_the_sheet_is_more_than_drift() {
        let ([values, touched], options) = (sheets(), DriftOptions::default());
        for seed in 0..20 {
            // Also when it was there then and is gone now, and after a weekend.
            for (before, now) in [(&values, &touched), (&touched, &values)] {
                for age_h in [0.0, 60.0] {
                    let (earlier, new) = (baseline(before, seed), baseline(now, 1000 + seed));
                    let found = Departure::of(&new, &earlier, age_h, &options).unwrap();
                    assert!(found.differs, "{seed}, {age_h} h: {found:?}");
                }
            }
        }
    }

    #[test]
    fn what_cannot_be_compared_is_not() {
        let options = DriftOptions::default();
        let [values, _] = sheets();
        let (whole, short) = (baseline(&values, 1), baseline(&values[1..], 1));
        assert_eq!(Departure::of(&short, &whole, 0.0, &options), None);
        let mut missing = whole.clone();
        missing.values_v[1..].fill(f64::NAN);
        assert_eq!(Departure::of(&missing, &whole, 0.0, &options), None);
        // Missing values are left out, the others compared.
        let mut some = whole.clone();
        some.values_v[..50].fill(f64::NAN);
        assert!(Departure::of(&some, &whole, 0.0, &options).is_some_and(|d| !d.differs));
    }
}
