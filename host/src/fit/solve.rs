//! A given number of touches fitted to whitened data: Levenberg's and Marquardt's method on their parameters.

use super::table::TouchTable;
use super::{Disc, FitOptions};
use nalgebra::{DMatrix, DVector};

/// Parameters of a touch, in the order of the Jacobian's columns: x, y, radius, strength.
pub const PARAMETERS: usize = 4;
/// A step that promises less than this of chi-square ends the fit: a thirtieth of a standard deviation.
const LEAST_GAIN: f64 = 1e-3;
const MOST_STEPS: usize = 24;
/// A touch moves at most this part of its expected radius in one step.
const LONGEST_STEP: f64 = 0.5;

/// A fit of some touches.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The touches, strengths in units of the noise.
    pub discs: Vec<Disc>,
    /// Sum of squares of the residual, in units of the noise's variance.
    pub square: f64,
    /// The same with the penalty of the priors: what is minimised.
    pub objective: f64,
    /// What is left of the data.
    pub residual: Vec<f64>,
    /// Columns of the Jacobian, one after the other.
    jacobian: Vec<f64>,
    normal: DMatrix<f64>,
}

impl Fit {
    /// How the data answer to the parameters: a column each, touch by touch in the order of [`PARAMETERS`].
    pub fn slopes(&self) -> DMatrix<f64> {
        DMatrix::from_column_slice(self.residual.len(), PARAMETERS * self.discs.len(), &self.jacobian)
    }

    /// Covariance of all parameters for noise of unit variance, touch by touch in the order of [`PARAMETERS`].
    pub fn covariance(&self) -> Option<DMatrix<f64>> {
        scaled_cholesky(&self.normal, 0.0).map(|(factor, scale)| {
            let mut inverse = factor.inverse();
            for i in 0..inverse.nrows() {
                for j in 0..inverse.ncols() {
                    inverse[(i, j)] *= scale[i] * scale[j];
                }
            }
            inverse
        })
    }
}

/// Cholesky factor of the matrix with its diagonal scaled to `1 + damping`, and the scales.
fn scaled_cholesky(
    normal: &DMatrix<f64>,
    damping: f64,
) -> Option<(nalgebra::Cholesky<f64, nalgebra::Dyn>, DVector<f64>)> {
    let scale = normal.diagonal().map(|d| if d > 0.0 { 1.0 / d.sqrt() } else { 1.0 });
    let mut a = normal.clone();
    for i in 0..a.nrows() {
        for j in 0..a.ncols() {
            a[(i, j)] *= scale[i] * scale[j];
        }
        // A whisker of damping keeps a singular problem solvable.
        a[(i, i)] += damping + 1e-12;
    }
    a.cholesky().map(|c| (c, scale))
}

/// The touches' model against the data: residual, Jacobian, normal equations.
pub(super) fn evaluate(table: &TouchTable, options: &FitOptions, data: &[f64], discs: &[Disc]) -> Fit {
    let n = table.length();
    let mut jacobian = vec![0.0; PARAMETERS * n * discs.len()];
    let mut residual = data.to_vec();
    let mut penalty = 0.0;
    for (d, block) in discs.iter().zip(jacobian.chunks_exact_mut(PARAMETERS * n)) {
        let (x, rest) = block.split_at_mut(n);
        let (y, rest) = rest.split_at_mut(n);
        let (radius, strength) = rest.split_at_mut(n);
        table.at(d.at, d.radius, [&mut *strength, &mut *x, &mut *y, &mut *radius]);
        for (r, t) in residual.iter_mut().zip(strength.iter()) {
            *r -= d.strength * t;
        }
        for column in [x, y, radius] {
            column.iter_mut().for_each(|v| *v *= d.strength);
        }
        penalty += ((d.radius - options.radius_mm) / options.radius_sd_mm).powi(2);
    }
    let columns = PARAMETERS * discs.len();
    let mut normal = DMatrix::zeros(columns, columns);
    for i in 0..columns {
        for j in 0..=i {
            let v = dot(&jacobian[i * n..(i + 1) * n], &jacobian[j * n..(j + 1) * n]);
            normal[(i, j)] = v;
            normal[(j, i)] = v;
        }
    }
    for k in 0..discs.len() {
        normal[(PARAMETERS * k + 2, PARAMETERS * k + 2)] += options.radius_sd_mm.powi(-2);
    }
    let square = dot(&residual, &residual);
    Fit {
        discs: discs.to_vec(),
        square,
        objective: square + penalty,
        residual,
        jacobian,
        normal,
    }
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    // Four sums side by side: the compiler may not reorder one.
    let (mut s, mut i) = ([0.0; 4], 0);
    let n = a.len().min(b.len());
    while i + 4 <= n {
        for k in 0..4 {
            s[k] += a[i + k] * b[i + k];
        }
        i += 4;
    }
    let tail: f64 = a[i..n].iter().zip(&b[i..n]).map(|(a, b)| a * b).sum();
    s[0] + s[1] + s[2] + s[3] + tail
}

/// Fits touches from a start. `None` when a number is not finite.
pub fn fit(table: &TouchTable, options: &FitOptions, data: &[f64], start: &[Disc]) -> Option<Fit> {
    let mut best = evaluate(table, options, data, start);
    let n = table.length();
    let [smallest, largest] = table.radii_mm();
    let mut damping = 1e-3;
    for _ in 0..MOST_STEPS {
        if best.discs.is_empty() || !best.objective.is_finite() {
            break;
        }
        let columns = best.normal.nrows();
        let mut gradient = DVector::from_fn(columns, |k, _| dot(&best.jacobian[k * n..(k + 1) * n], &best.residual));
        for (k, d) in best.discs.iter().enumerate() {
            gradient[PARAMETERS * k + 2] -= (d.radius - options.radius_mm) / options.radius_sd_mm.powi(2);
        }
        let (factor, scale) = scaled_cholesky(&best.normal, damping)?;
        let step = factor.solve(&gradient.component_mul(&scale)).component_mul(&scale);
        let promise = step.dot(&gradient);
        if !promise.is_finite() || promise < LEAST_GAIN {
            break;
        }
        let discs: Vec<Disc> = best
            .discs
            .iter()
            .enumerate()
            .map(|(k, d)| {
                let s = &step.as_slice()[PARAMETERS * k..PARAMETERS * (k + 1)];
                let length = s[0].hypot(s[1]);
                let shorten = (LONGEST_STEP * options.radius_mm / length.max(f64::MIN_POSITIVE)).min(1.0);
                let moved = [d.at[0] + shorten * s[0], d.at[1] + shorten * s[1]];
                Disc {
                    at: if table.holds(moved) { moved } else { d.at },
                    radius: (d.radius + s[2]).clamp(smallest, largest),
                    // A strength stays positive: it may fall to a tenth in one step.
                    strength: (d.strength + s[3]).max(0.1 * d.strength),
                }
            })
            .collect();
        let next = evaluate(table, options, data, &discs);
        if next.objective < best.objective {
            let gain = best.objective - next.objective;
            best = next;
            damping = (0.2 * damping).max(1e-7);
            if gain < LEAST_GAIN {
                break;
            }
        } else {
            damping *= 8.0;
            if damping > 1e6 {
                break;
            }
        }
    }
    best.objective.is_finite().then_some(best)
}
