//! The covariance of what the maps leave over.

use super::maps::{Maps, Presses};
use crate::stats::median;
use nalgebra::{DMatrix, DVector};

/// Presses that the covariance without correlations weighs as. What is left lies in few directions, so that the
/// correlations count; of few presses they cannot be told.
const SHRINKING: f64 = 120.0;
/// Residuals beyond this many standard deviations are drawn in.
const LARGEST: f64 = 3.0;
/// Standard deviation over the median of the absolute values of a normal distribution.
const NORMAL: f64 = 1.4826;
/// Prior standard deviation of a press's strength over the usual one, where residuals are taken.
pub(super) const STRENGTH_SD: f64 = 0.3;
/// Part of the measurements that counts as independent when a strength is fitted.
const INDEPENDENT: f64 = 0.2;

/// What presses that were not learned from leave over: residuals in the unit of the changes and, for each, the variance of
/// the maps there over the noise's.
pub(super) struct Residuals {
    pub(super) values: DMatrix<f64>,
    pub(super) uncertainty: Vec<f64>,
}

impl Residuals {
    /// Of presses, against maps that were learned from others.
    pub(super) fn of(maps: &Maps, presses: &Presses) -> Self {
        let count = presses.len();
        let mut values = DMatrix::zeros(count, maps.scale.len());
        let mut uncertainty = Vec::new();
        let expected = maps.at(&presses.places_mm);
        for k in 0..count {
            let map = expected.column(k).into_owned();
            let change = presses.changes.row(k).transpose() - maps.memory_of(presses.before_mm[k]);
            let strength = strength(maps, &map, &change);
            values.set_row(k, &(&change - &map * strength).transpose());
            uncertainty.push(maps.uncertainty(presses.places_mm[k]));
        }
        Self { values, uncertainty }
    }

    /// Several lists as one.
    pub(super) fn joined(lists: &[Self]) -> Self {
        let rows: Vec<_> = lists.iter().flat_map(|l| l.values.row_iter()).collect();
        Self {
            values: DMatrix::from_rows(&rows),
            uncertainty: lists.iter().flat_map(|l| l.uncertainty.iter().copied()).collect(),
        }
    }

    /// A robust covariance of them where the maps are certain.
    pub(super) fn covariance(&self) -> DMatrix<f64> {
        let mut scaled = self.values.clone();
        let (count, channels) = scaled.shape();
        for (mut row, uncertainty) in scaled.row_iter_mut().zip(&self.uncertainty) {
            row /= (1.0 + uncertainty).sqrt();
        }
        let mut deviations = vec![0.0; channels];
        for (c, mut column) in scaled.column_iter_mut().enumerate() {
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
        let kept = count as f64 / (SHRINKING + count as f64);
        let mut covariance = scaled.tr_mul(&scaled) / count as f64;
        for i in 0..channels {
            for j in 0..channels {
                let c = &mut covariance[(i, j)];
                *c = deviations[i] * deviations[j] * if i == j { c.max(1e-6) } else { kept * *c };
            }
        }
        covariance
    }
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
