//! The covariance of what the maps leave over.
//!
//! A press of strength a at a place where the maps' variance is u leaves `S ((1 - p) + a² (p + u))`. What the electronics add is there
//! without a press; what the maps do not tell of a press is as large as the press. S is estimated from what presses leave that were
//! not learned from, and drawn towards two simpler ones: one that turns with the electrodes, and one without correlations.

use super::maps::{Maps, Presses};
use super::orbits::Orbits;
use crate::stats::median;
use nalgebra::{Cholesky, DMatrix, DVector};

/// Residuals beyond this many standard deviations are drawn in.
const LARGEST: f64 = 3.0;
/// Standard deviation over the median of the absolute values of a normal distribution.
const NORMAL: f64 = 1.4826;
/// Prior standard deviation of a press's strength over the usual one, where residuals are taken.
pub(super) const STRENGTH_SD: f64 = 0.3;
/// Part of the measurements that counts as independent when a strength is fitted.
const INDEPENDENT: f64 = 0.2;
/// Degrees of freedom of the residuals' distribution.
pub(super) const FREEDOM: f64 = 8.0;
/// Parts of the rest that are tried as proportional to the press.
const PARTS: [f64; 11] = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0];
/// Presses that the covariance without correlations of single measurements weighs as. What is left lies in few directions, so that the
/// correlations count; of few presses they cannot be told.
const SHRINKING: f64 = 120.0;
/// Parts of the correlations that turn with the electrodes, of which one is chosen.
const TURNING: [f64; 4] = [0.0, 0.4, 0.7, 0.9];
/// Folds of the presses by which it is.
const FOLDS: usize = 5;
/// Least variance of what no press leaves, over that of a usual press: of strengths alike it cannot be told.
const LEAST_AT_REST: f64 = 1e-3;

/// What presses that were not learned from leave over: residuals in the unit of the changes and, for each, the variance of
/// the maps there over the noise's.
pub(super) struct Residuals {
    pub(super) values: DMatrix<f64>,
    pub(super) uncertainty: Vec<f64>,
    pub(super) strengths: Vec<f64>,
}

/// What the maps leave over of a press of the usual strength, and the part of it that is proportional to the press.
#[derive(Clone, Debug)]
pub(super) struct Rest {
    pub(super) covariance: DMatrix<f64>,
    pub(super) proportional: f64,
}

/// Residuals over their standard deviations, drawn in, and these.
struct Scaled {
    values: DMatrix<f64>,
    deviations: Vec<f64>,
    proportional: f64,
}

impl Residuals {
    /// None, of so many presses and measurements.
    pub(super) fn none(presses: usize, measurements: usize) -> Self {
        Self {
            values: DMatrix::zeros(presses, measurements),
            uncertainty: vec![0.0; presses],
            strengths: vec![1.0; presses],
        }
    }

    /// Of presses, against maps that were learned from others.
    pub(super) fn of(maps: &Maps, presses: &Presses) -> Self {
        let mut all = Self::none(presses.len(), maps.scale.len());
        let felt: Vec<[f64; 2]> = (presses.places_mm.iter().zip(&presses.before_mm))
            .map(|(place, before)| maps.felt(*place, *before))
            .collect();
        let expected = maps.at(&felt);
        for (k, felt) in felt.iter().enumerate() {
            let map = expected.column(k).into_owned();
            let change = presses.changes.row(k).transpose() - maps.memory_of(presses.before_mm[k]);
            let strength = strength(maps, &map, &change);
            all.values.set_row(k, &(&change - &map * strength).transpose());
            all.uncertainty[k] = maps.uncertainty(*felt);
            all.strengths[k] = strength;
        }
        all
    }

    /// Those of some presses take the place of what was there.
    pub(super) fn put(&mut self, rows: &[usize], of_rows: &Self) {
        for (from, to) in rows.iter().enumerate() {
            self.values.set_row(*to, &of_rows.values.row(from));
            self.uncertainty[*to] = of_rows.uncertainty[from];
            self.strengths[*to] = of_rows.strengths[from];
        }
    }

    /// Several lists as one.
    pub(super) fn joined(lists: &[Self]) -> Self {
        let rows: Vec<_> = lists.iter().flat_map(|l| l.values.row_iter()).collect();
        Self {
            values: DMatrix::from_rows(&rows),
            uncertainty: lists.iter().flat_map(|l| l.uncertainty.iter().copied()).collect(),
            strengths: lists.iter().flat_map(|l| l.strengths.iter().copied()).collect(),
        }
    }

    /// Over the standard deviation of each row by such a part that is proportional to the press.
    fn over_rows(&self, proportional: f64) -> DMatrix<f64> {
        let mut scaled = self.values.clone();
        for (k, mut row) in scaled.row_iter_mut().enumerate() {
            row /= variance(proportional, &[(self.strengths[k], self.uncertainty[k])]).sqrt();
        }
        scaled
    }

    fn scaled(&self) -> Scaled {
        let (_, usual) = drawn_in(self.over_rows(0.5));
        let proportional = self.proportional(&usual);
        let (values, deviations) = drawn_in(self.over_rows(proportional));
        Scaled {
            values,
            deviations,
            proportional,
        }
    }

    /// The part of the rest's variance that is proportional to the press's strength squared: the posterior's mean, where all parts are
    /// as probable beforehand.
    fn proportional(&self, deviations: &[f64]) -> f64 {
        let squares: Vec<f64> = (self.values.row_iter())
            .map(|row| {
                let over = row.iter().zip(deviations).map(|(v, d)| v / d).filter(|v| v.is_finite());
                let count = over.clone().count().max(1) as f64;
                over.map(|v| v.clamp(-LARGEST, LARGEST).powi(2)).sum::<f64>() / count
            })
            .collect();
        let likelihood = |part: f64| {
            let variances: Vec<f64> = (self.strengths.iter().zip(&self.uncertainty))
                .map(|(a, u)| variance(part, &[(*a, *u)]))
                .collect();
            let mean = squares.iter().zip(&variances).map(|(s, v)| s / v).sum::<f64>() / squares.len() as f64;
            let logs: f64 = variances.iter().map(|v| (v * mean).ln()).sum();
            -0.5 * FREEDOM * (logs + squares.len() as f64)
        };
        let logs = PARTS.map(likelihood);
        let best = logs.iter().copied().fold(f64::MIN, f64::max);
        let weights = logs.map(|l| (l - best).exp());
        let whole: f64 = weights.iter().sum();
        let mean = weights.iter().zip(PARTS).map(|(w, p)| w * p).sum::<f64>() / whole;
        if mean.is_finite() { mean } else { 0.5 }
    }

    /// The part of the correlations that turns with the electrodes, by which residuals of some presses are told best by those of the
    /// others.
    pub(super) fn turning(&self, orbits: &Orbits) -> f64 {
        if orbits.count == orbits.members.len() {
            return 0.0;
        }
        let scaled = self.scaled().values;
        let count = scaled.nrows();
        let folds = FOLDS.min(count);
        let parts: Vec<(DMatrix<f64>, Moments)> = (0..folds)
            .map(|f| {
                let (out, others): (Vec<usize>, Vec<usize>) = (0..count).partition(|k| k * folds / count == f);
                let moments = Moments::of(&scaled.select_rows(&others), orbits);
                (scaled.select_rows(&out), moments)
            })
            .collect();
        let mut best = (f64::INFINITY, 0.0);
        for turning in TURNING {
            let surprises = parts
                .iter()
                .map(|(out, moments)| surprise(&moments.correlations(turning), out));
            if let Some(sum) = surprises.sum::<Option<f64>>()
                && sum < best.0
            {
                best = (sum, turning);
            }
        }
        best.1
    }

    /// Their robust covariance for a press of the usual strength where the maps are certain.
    pub(super) fn rest(&self, orbits: &Orbits, turning: f64) -> Rest {
        let scaled = self.scaled();
        let mut covariance = Moments::of(&scaled.values, orbits).correlations(turning);
        let d = &scaled.deviations;
        for i in 0..d.len() {
            for j in 0..d.len() {
                covariance[(i, j)] *= d[i] * d[j];
            }
        }
        Rest {
            covariance,
            proportional: scaled.proportional,
        }
    }
}

/// Variance of what presses of some strengths leave at places of some uncertainty, over that of a usual press where the maps are
/// certain.
pub(super) fn variance(proportional: f64, presses: &[(f64, f64)]) -> f64 {
    presses
        .iter()
        .fold(1.0 - proportional, |sum, (a, u)| sum + a * a * (proportional + u))
        .max(LEAST_AT_REST)
}

/// Values over the standard deviations of their columns, those far outside drawn in; and these deviations.
fn drawn_in(mut values: DMatrix<f64>) -> (DMatrix<f64>, Vec<f64>) {
    let mut deviations = vec![0.0; values.ncols()];
    for (c, mut column) in values.column_iter_mut().enumerate() {
        let sizes: Vec<f64> = column.iter().map(|v| v.abs()).collect();
        let limit = LARGEST * NORMAL * median(sizes.iter().copied());
        let finite = || column.iter().filter(|v| v.is_finite());
        let sum: f64 = finite().map(|v| v.clamp(-limit, limit).powi(2)).sum();
        let deviation = (sum / finite().count().max(1) as f64).sqrt().max(f64::MIN_POSITIVE);
        for v in &mut column {
            let over = *v / deviation;
            *v = if over.is_finite() {
                over.clamp(-LARGEST, LARGEST)
            } else {
                0.0
            };
        }
        deviations[c] = deviation;
    }
    let least = 1e-6 * deviations.iter().copied().fold(0.0, f64::max);
    deviations.iter_mut().for_each(|d| *d = d.max(least));
    (values, deviations)
}

/// Mean products of scaled residuals: of every two measurements, and of all that are the same two, turned.
struct Moments {
    presses: f64,
    own: DMatrix<f64>,
    turned: DMatrix<f64>,
}

impl Moments {
    fn of(scaled: &DMatrix<f64>, orbits: &Orbits) -> Self {
        let presses = scaled.nrows().max(1) as f64;
        let own = scaled.tr_mul(scaled) / presses;
        let mut turned = orbits.turned_mean(&own);
        // Correlations that are alike, of variances that each measurement has of its own.
        let sizes: Vec<f64> = (0..own.nrows())
            .map(|k| (own[(k, k)] / turned[(k, k)].max(f64::MIN_POSITIVE)).sqrt())
            .collect();
        for (mut column, size) in turned.column_iter_mut().zip(&sizes) {
            column.iter_mut().zip(&sizes).for_each(|(v, other)| *v *= size * other);
        }
        Self { presses, own, turned }
    }

    fn correlations(&self, turning: f64) -> DMatrix<f64> {
        let seen = self.presses / (self.presses + SHRINKING);
        let turning = (1.0 - seen) * turning;
        let mut out = self.own.clone();
        for (i, mut column) in out.column_iter_mut().enumerate() {
            for (j, v) in column.iter_mut().enumerate() {
                *v = if i == j {
                    v.max(1e-6)
                } else {
                    seen * *v + turning * self.turned[(j, i)]
                };
            }
        }
        out
    }
}

/// How little normal values are expected of rows: twice the negative logarithm of the likelihood, without its constant.
fn surprise(correlations: &DMatrix<f64>, rows: &DMatrix<f64>) -> Option<f64> {
    let factor = Cholesky::new(correlations.clone())?;
    let mut white = rows.transpose();
    factor.l_dirty().solve_lower_triangular_mut(&mut white);
    let logs: f64 = factor.l_dirty().diagonal().iter().map(|d| d.ln()).sum();
    let channels = rows.ncols() as f64;
    // By Student's distribution: no single press decides.
    let squares: f64 = white
        .column_iter()
        .map(|w| (FREEDOM + channels) * (w.norm_squared() / FREEDOM).ln_1p())
        .sum();
    Some(squares + 2.0 * logs * rows.nrows() as f64)
}

/// Strength of a press over the usual one, near 1 where nothing tells it.
fn strength(maps: &Maps, map: &DVector<f64>, change: &DVector<f64>) -> f64 {
    let prior = STRENGTH_SD.powi(-2);
    let (mut along, mut square) = (prior, prior);
    for c in 0..map.len() {
        let weight = INDEPENDENT / (maps.noise[c] * maps.scale[c].powi(2));
        let limit = 6.0 * maps.scale[c];
        if change[c].is_finite() && weight.is_finite() {
            along += weight * map[c] * change[c].clamp(-limit, limit);
            square += weight * map[c] * map[c];
        }
    }
    along / square
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::rngs::StdRng;
    use rand::{Rng, SeedableRng};
    use rand_distr::StandardNormal;

    #[test]
    fn the_part_that_grows_with_presses_is_told_from_the_part_that_does_not() {
        for planted in [0.0, 0.5, 1.0] {
            let mut random = StdRng::seed_from_u64(3);
            let mut residuals = Residuals::none(120, 40);
            for k in 0..120 {
                let strength: f64 = random.random_range(0.4..1.8);
                residuals.strengths[k] = strength;
                let deviation = variance(planted, &[(strength, 0.0)]).sqrt();
                for v in residuals.values.row_mut(k).iter_mut() {
                    *v = deviation * random.sample::<f64, _>(StandardNormal);
                }
            }
            let found = residuals.scaled().proportional;
            assert!((found - planted).abs() < 0.2, "{found} of {planted}");
        }
    }

    #[test]
    fn correlations_that_turn_are_told_by_few_presses() {
        // Measurements of a ring, each like its neighbours.
        let orbits = Orbits::new(forward::Pattern::adjacent(8).unwrap().measurements(), 8, 1);
        let channels = orbits.members.len();
        let mut random = StdRng::seed_from_u64(5);
        let mut rows = |count: usize, smooth: bool| {
            let mut residuals = Residuals::none(count, channels);
            for mut row in residuals.values.row_iter_mut() {
                let own: Vec<f64> = (0..channels).map(|_| random.sample(StandardNormal)).collect();
                let ring: Vec<f64> = (0..8).map(|_| random.sample(StandardNormal)).collect();
                for (c, v) in row.iter_mut().enumerate() {
                    *v = own[c]
                        + if smooth {
                            2.0 * ring[orbits.members[c].turned]
                        } else {
                            0.0
                        };
                }
            }
            residuals
        };
        let few = rows(8, true);
        assert!(few.turning(&orbits) > 0.0);
        let many = rows(300, true).scaled().values;
        let surprise =
            |turning: f64| surprise(&Moments::of(&few.scaled().values, &orbits).correlations(turning), &many);
        assert!(surprise(few.turning(&orbits)).unwrap() < surprise(0.0).unwrap());
    }
}
