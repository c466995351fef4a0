//! How noisy a frame is, from the frame itself: a sheet is reciprocal, noise is not.
//!
//! Exchanging drive and sense leaves a transfer impedance unchanged. With a voltage drive the measured values differ by
//! the drive currents, `V[m,n] D_m = V[n,m] D_n`, so the change of every current scale (one number for each drive pair)
//! is fitted first; what then still disagrees is noise. An exchanged pair senses where the other drives, so the same
//! numbers hold what the gains of the amplifiers drift by, whatever drives. Of the 104 pairs of an adjacent frame on 16
//! electrodes 89 degrees of freedom are left.

use crate::linalg::eigen::symmetric_eigen;
use crate::reference::noise::{NoiseEstimate, NoiseSource};
use forward::{Pair, Pattern};
use nalgebra::{DMatrix, DVector};

/// Reciprocal pairs of a pattern, ready to judge frames.
#[derive(Clone, Debug)]
pub struct Reciprocity {
    /// Two measurements and the drive pairs (by index) they were driven by.
    pairs: Vec<[usize; 2]>,
    drive_of: Vec<usize>,
    drives: usize,
    /// Standard deviation that one value of a difference has at least, V of the model.
    least_noise: f64,
    prepared: Option<Prepared>,
}

/// What does not change while the same values take part with the same spread.
#[derive(Clone, Debug)]
struct Prepared {
    used: Vec<bool>,
    spread: Vec<f64>,
    weights: Vec<f64>,
    /// Orthonormal columns: what the drive currents can explain, `pairs x rank`.
    explained: DMatrix<f64>,
    /// Part of every pair that it is itself explained by.
    leverage: Vec<f64>,
    least_noise: f64,
    now: Disagreement,
}

impl Reciprocity {
    /// Finds the pairs of a pattern.
    pub fn new(pattern: &Pattern) -> Self {
        let drive_index = |p: Pair| pattern.drives().iter().position(|d| *d == p).unwrap_or(0);
        let drive_of = pattern.measurements().iter().map(|m| drive_index(m.drive)).collect();
        let pairs = pattern
            .reciprocal_indices()
            .into_iter()
            .enumerate()
            .filter_map(|(k, other)| other.filter(|o| k < *o).map(|o| [k, o]))
            .collect();
        Self {
            pairs,
            drive_of,
            drives: pattern.drives().len(),
            least_noise: 0.0,
            prepared: None,
        }
    }

    /// The same of values that are rounded: one of a difference scatters by this at least, V of the model, though pairs agree. On a sheet
    /// that is the same all around both of a pair are rounded alike.
    #[must_use]
    pub fn at_least(self, least_noise: f64) -> Self {
        Self {
            least_noise,
            prepared: None,
            ..self
        }
    }

    /// The noise of a normalised difference `y = V_model (V / V_baseline - 1)`, whose values scatter by the same amount
    /// times `spread` (1 for a value as noisy as the others). Values whose `used` is false take no part.
    ///
    /// `None` when there are too few pairs for an estimate.
    pub fn noise(&self, y: &DVector<f64>, model_v: &[f64], spread: &[f64], used: &[bool]) -> Option<NoiseEstimate> {
        self.disagreement(y, model_v, spread, used)?.noise()
    }

    /// What the reciprocal pairs disagree by, once the gains are fitted. `None` without pairs.
    pub fn disagreement(
        &self,
        y: &DVector<f64>,
        model_v: &[f64],
        spread: &[f64],
        used: &[bool],
    ) -> Option<Disagreement> {
        let mut prepared = self.prepare(model_v, spread, used)?;
        prepared.look(y, model_v);
        Some(prepared.now)
    }

    /// The same, with every pair's leverage: by how much the square falls without a pair is `residual² / (1 - leverage)`.
    ///
    /// Nothing is allocated while the same values take part with the same spread.
    pub fn look(
        &mut self,
        y: &DVector<f64>,
        model_v: &[f64],
        spread: &[f64],
        used: &[bool],
    ) -> Option<(&Disagreement, &[f64])> {
        if !self
            .prepared
            .as_ref()
            .is_some_and(|p| p.used == used && p.spread == spread)
        {
            self.prepared = self.prepare(model_v, spread, used);
        }
        let prepared = self.prepared.as_mut()?;
        prepared.look(y, model_v);
        Some((&prepared.now, &prepared.leverage))
    }

    fn prepare(&self, model_v: &[f64], spread: &[f64], used: &[bool]) -> Option<Prepared> {
        let pairs: Vec<[usize; 2]> = self
            .pairs
            .iter()
            .copied()
            .filter(|[a, b]| used[*a] && used[*b])
            .collect();
        let noise = |k: usize| spread[k] / model_v[k].abs();
        let weights: Vec<f64> = pairs.iter().map(|[a, b]| 1.0 / noise(*a).hypot(noise(*b))).collect();
        let explained = if pairs.is_empty() {
            DMatrix::zeros(0, 0)
        } else {
            let mut design = DMatrix::<f64>::zeros(pairs.len(), self.drives);
            for ((row, p), w) in pairs.iter().enumerate().zip(&weights) {
                design[(row, self.drive_of[p[1]])] += w;
                design[(row, self.drive_of[p[0]])] -= w;
            }
            let normal = design.tr_mul(&design);
            // The scales are determined up to a common one; those of drives without pairs are not: their eigenvalues are 0.
            let eigen = symmetric_eigen(normal)?;
            let least = LEAST_EIGENVALUE * eigen.eigenvalues.amax();
            let kept: Vec<usize> = (0..self.drives).filter(|k| eigen.eigenvalues[*k] > least).collect();
            let mut explained = design * eigen.eigenvectors.select_columns(&kept);
            for (mut column, k) in explained.column_iter_mut().zip(&kept) {
                column /= eigen.eigenvalues[*k].sqrt();
            }
            explained
        };
        Some(Prepared {
            used: used.to_vec(),
            spread: spread.to_vec(),
            leverage: explained.row_iter().map(|r| r.norm_squared()).collect(),
            now: Disagreement {
                residual: DVector::zeros(pairs.len()),
                square: 0.0,
                freedom: pairs.len().saturating_sub(explained.ncols()),
                pairs,
            },
            weights,
            explained,
            least_noise: self.least_noise,
        })
    }
}

impl Prepared {
    fn look(&mut self, y: &DVector<f64>, model_v: &[f64]) {
        // With ratios of voltages reciprocity is exact: ln r[a] - ln r[b] = e[drive of b] - e[drive of a] + noise. (The
        // voltages themselves are not equal on a sheet that is not the same all around: their drive currents differ.)
        let ratio = |k: usize| {
            let change = y[k] / model_v[k];
            if change > LEAST_CHANGE { change.ln_1p() } else { change }
        };
        let now = &mut self.now;
        for ((residual, [a, b]), weight) in now.residual.iter_mut().zip(&now.pairs).zip(&self.weights) {
            *residual = (ratio(*a) - ratio(*b)) * weight;
        }
        // The columns are orthonormal: one after the other takes away what all of them explain.
        for column in self.explained.column_iter() {
            let part = column.dot(&now.residual);
            now.residual.axpy(-part, &column, 1.0);
        }
        let least = self.least_noise.powi(2) * now.freedom as f64;
        now.square = now.residual.norm_squared().max(least);
    }
}

/// Eigenvalues of the drive currents' normal equations below this part of the largest are rounding.
const LEAST_EIGENVALUE: f64 = 1e-10;
/// A change of a voltage below this is no touch: the voltage is gone or turned round.
const LEAST_CHANGE: f64 = -0.9;
/// Fewest degrees of freedom of an estimate of the noise: its standard deviation is then good to a quarter.
pub(crate) const LEAST_FREEDOM: usize = 8;

/// By how much reciprocal pairs disagree.
#[derive(Clone, Debug, PartialEq)]
pub struct Disagreement {
    /// The pairs, by measurement.
    pub pairs: Vec<[usize; 2]>,
    /// Disagreement of every pair over its spread: as noisy as one value of the difference.
    pub residual: DVector<f64>,
    /// Sum of its squares, and no less than the rounding of values makes.
    pub square: f64,
    /// Degrees of freedom left.
    pub freedom: usize,
}

impl Disagreement {
    /// The noise of one value; `None` when there are too few pairs for an estimate.
    pub fn noise(&self) -> Option<NoiseEstimate> {
        (self.freedom >= LEAST_FREEDOM && self.square.is_finite()).then(|| NoiseEstimate {
            sigma: (self.square / self.freedom as f64).sqrt(),
            source: NoiseSource::Estimated { freedom: self.freedom },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::field::conductivity_of_discs;
    use forward::{DiscTouch, Drive, Model, ModelOptions, Sheet, Solver};
    use rand::{Rng, SeedableRng};
    use rand_distr::StandardNormal;
    use std::sync::Arc;

    /// White noise of known size on a touched sheet: the touch must not count as noise.
    #[test]
    fn finds_the_noise_of_a_touched_sheet() {
        let model = Arc::new(Model::new(&Sheet::paper(), &ModelOptions::default()).unwrap());
        let mut solver = Solver::new(model.clone()).unwrap();
        let pattern = Pattern::adjacent(16).unwrap();
        for drive in [Drive::PAPER, Drive::Current { amplitude_a: 1e-3 }] {
            let baseline = drive.frame_v(solver.electrode_matrix(), &pattern);
            let touch = DiscTouch {
                centre_mm: [40.0, -20.0],
                radius_mm: 12.5,
                rise: 0.2,
            };
            solver.solve(&conductivity_of_discs(model.mesh(), &[touch])).unwrap();
            let touched = drive.frame_v(solver.electrode_matrix(), &pattern);
            let sigma = 1e-4 * baseline[0];
            let judge = Reciprocity::new(&pattern);
            let mut rng = rand::rngs::StdRng::seed_from_u64(3);
            let mut estimates: Vec<f64> = (0..400)
                .map(|_| {
                    let y = DVector::from_fn(208, |k, _| {
                        let noise: f64 = rng.sample(StandardNormal);
                        touched[k] - baseline[k] + sigma * noise
                    });
                    judge.noise(&y, &baseline, &[1.0; 208], &[true; 208]).unwrap().sigma / sigma
                })
                .collect();
            estimates.sort_by(f64::total_cmp);
            assert!(
                (estimates[200] - 1.0).abs() < 0.02,
                "{drive:?}: median {}",
                estimates[200]
            );
            // Chi-square with 89 degrees of freedom: 1 % quantiles at 0.83 and 1.18.
            assert!(
                estimates[4] > 0.8 && estimates[395] < 1.2,
                "{} {}",
                estimates[4],
                estimates[395]
            );
            solver
                .solve(&vec![[1.0, 0.0, 1.0]; solver.conductivity().len()])
                .unwrap();
        }
    }

    /// Gains of drives and of senses that drift are no disagreement whatever drives; a value that remembers the one before it is.
    #[test]
    fn gains_agree_and_memories_do_not() {
        let model = Arc::new(Model::new(&Sheet::paper(), &ModelOptions::default()).unwrap());
        let mut solver = Solver::new(model.clone()).unwrap();
        let touch = DiscTouch {
            centre_mm: [-20.0, 50.0],
            radius_mm: 12.5,
            rise: 0.2,
        };
        let conductivity = conductivity_of_discs(model.mesh(), &[touch]);
        let pattern = Pattern::adjacent(16).unwrap();
        for drive in [Drive::PAPER, Drive::Current { amplitude_a: 1e-3 }] {
            let untouched = vec![[1.0, 0.0, 1.0]; conductivity.len()];
            let baseline = drive.frame_v(solver.solve(&untouched).unwrap(), &pattern);
            let touched = drive.frame_v(solver.solve(&conductivity).unwrap(), &pattern);
            let gain = |a: usize, b: usize, by: usize| 1.0 + 0.05 * ((by * (a + b)) as f64).sin();
            let drifted: Vec<f64> = (pattern.measurements().iter().zip(&touched))
                .map(|(m, v)| v * gain(m.drive.plus, m.drive.minus, 5) * gain(m.sense.plus, m.sense.minus, 11))
                .collect();
            let remembers: Vec<f64> = std::iter::once(touched[0])
                .chain(touched.windows(2).map(|v| v[1] + 0.01 * (v[0] - v[1])))
                .collect();
            let judge = Reciprocity::new(&pattern);
            let [agrees, disagrees] = [drifted, remembers].map(|frame| {
                let y = DVector::from_fn(frame.len(), |k, _| frame[k] - baseline[k]);
                let found = judge.disagreement(&y, &baseline, &[1.0; 208], &[true; 208]).unwrap();
                assert_eq!(found.freedom, 89);
                (found.square / y.norm_squared()).sqrt()
            });
            assert!(agrees < 1e-6 && disagrees > 0.1, "{drive:?}: {agrees} {disagrees}");
        }
    }
}
