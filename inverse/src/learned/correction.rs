//! What maps cannot tell, many presses do: the offsets at which presses are located depend on their changes.

use super::kernel_ridge::{KernelRidge, StoredRidge, loss};
use super::locator::Presence;
use super::maps::Presses;
use super::validation::Validation;
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

/// Standard errors by which offsets have to shrink.
const SURELY: f64 = 2.0;

/// Offsets of located presses as a function of their changes, learned from presses that were located by maps of others.
pub(super) struct Correction {
    ridge: KernelRidge,
    /// By how much variances shrink.
    factor: f64,
}

/// It as numbers, for a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StoredCorrection {
    /// By how much variances shrink.
    pub factor: f64,
    /// The regression.
    pub ridge: StoredRidge,
}

impl Correction {
    /// Learns it and corrects the validation by what is learned from the others. `None` where it does not surely help.
    pub(super) fn learn(presses: &Presses, validation: &mut Validation) -> Option<Self> {
        let single: Vec<usize> = (0..presses.len())
            .filter(|k| validation.presences[*k].presses.len() == 1)
            .collect();
        let changes: Vec<Vec<f64>> = single.iter().map(|k| row(&presses.changes, *k)).collect();
        let values: Vec<&[f64]> = changes.iter().map(Vec::as_slice).collect();
        let offsets: Vec<[f64; 2]> = single.iter().map(|k| validation.offsets[*k]).collect();
        let (ridge, left) = KernelRidge::learn(&values, &offsets)?;
        let count = offsets.len() as f64;
        let gains = || left.iter().zip(&offsets).map(|(l, o)| loss(o) - loss(l));
        let mean = gains().sum::<f64>() / count;
        let variance = gains().map(|g| (g - mean).powi(2)).sum::<f64>() / (count * (count - 1.0));
        if mean < SURELY * variance.sqrt() {
            return None;
        }
        for (k, left) in single.iter().zip(left) {
            validation.offsets[*k] = left;
        }
        let growth = validation.growth();
        let factor = growth * growth;
        (factor > 0.0 && factor.is_finite()).then_some(Self { ridge, factor })
    }

    /// Corrects the place of a single press.
    pub(super) fn correct(&self, change: &[f64], presence: &mut Presence) {
        if let [press] = presence.presses.as_mut_slice() {
            let offset = self.ridge.predict(change);
            for (place, offset) in press.place_mm.iter_mut().zip(offset) {
                *place -= offset;
            }
            press
                .covariance_mm2
                .iter_mut()
                .flatten()
                .for_each(|c| *c *= self.factor);
        }
    }

    pub(super) fn stored(&self) -> StoredCorrection {
        StoredCorrection {
            factor: self.factor,
            ridge: self.ridge.stored(),
        }
    }

    /// `None` where the numbers do not fit one another.
    pub(super) fn restore(stored: &StoredCorrection, channels: usize) -> Option<Self> {
        let sound = (1e-9..=1e9).contains(&stored.factor);
        Some(Self {
            ridge: sound.then(|| KernelRidge::restore(&stored.ridge, channels))??,
            factor: stored.factor,
        })
    }
}

fn row(matrix: &DMatrix<f64>, k: usize) -> Vec<f64> {
    matrix.row(k).iter().copied().collect()
}
