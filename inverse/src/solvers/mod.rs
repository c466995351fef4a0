//! From a normalised difference to a picture of the resistivity's rise: the solvers.
//!
//! All solve for x, the relative rise in resistivity of every cell, from `A x = b`, where A is the weighted sensitivity
//! and b the weighted difference.
#![allow(
    clippy::neg_cmp_op_on_partial_ord,
    reason = "a comparison with a number that is none must fail"
)]

mod active_set;
mod column_search;
mod factor;
mod lawson_hanson;
mod method;
mod newton;
mod nnls;
mod passive_set;
mod problem;
mod products;
mod projector;
mod queue;
mod stacked;
#[cfg(test)]
mod tests;
mod tikhonov;

pub use crate::solvers::lawson_hanson::lawson_hanson;
pub use crate::solvers::method::{Method, UnknownMethod};
pub use crate::solvers::nnls::{Nnls, NnlsOptions};
pub use crate::solvers::problem::Problem;
pub use crate::solvers::projector::Projector;
pub use crate::solvers::tikhonov::{discrepancy_ridge, pseudo_inverse, tikhonov};

use nalgebra::DVector;

/// How a solve ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Status {
    /// To the tolerance asked for.
    #[default]
    Converged,
    /// The iteration limit came first; the proof tells how far off the solution is.
    Stopped,
    /// The input held a number that is not finite; the solution is zero.
    BadInput,
}

/// A solution with its proof.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// Relative rise in resistivity of every cell.
    pub x: DVector<f64>,
    /// `|A x - b| / |b|` over all rows given; 0 for b = 0.
    pub residual: f64,
    /// How far x is from satisfying its optimality conditions, relative to the largest entry of x (see each solver).
    pub gap: f64,
    /// Iterations taken.
    pub iterations: usize,
    /// How it ended.
    pub status: Status,
}

impl Solution {
    /// Solves for a right-hand side in units of its largest entry, so that none overflows; what is too large for a number
    /// all the same ends as [`Status::Stopped`] with x = 0.
    fn in_units(problem: &Problem, b: &DVector<f64>, solve: impl Fn(&DVector<f64>) -> Self) -> Self {
        if !problem.is_finite() || !b.iter().all(|v| v.is_finite()) {
            return Self::zero(problem.cells(), Status::BadInput);
        }
        let largest = b.amax();
        if largest < f64::MIN_POSITIVE || problem.rank() == 0 {
            let nothing = Self::zero(problem.cells(), Status::Converged);
            let residual = f64::from(largest >= f64::MIN_POSITIVE);
            return Self { residual, ..nothing };
        }
        let mut solution = solve(&(b / largest));
        solution.x *= largest;
        if solution.x.iter().all(|x| x.is_finite()) && solution.residual.is_finite() && !solution.gap.is_nan() {
            return solution;
        }
        Self {
            residual: 1.0,
            gap: f64::INFINITY,
            ..Self::zero(problem.cells(), Status::Stopped)
        }
    }

    pub(crate) fn zero(cells: usize, status: Status) -> Self {
        Self {
            x: DVector::zeros(cells),
            residual: 0.0,
            gap: 0.0,
            iterations: 0,
            status,
        }
    }
}

/// What a solve reports beside x, which the caller holds: see [`Solution`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// `|A x - b| / |b|` over all rows given; 0 for b = 0.
    pub residual: f64,
    /// How far x is from satisfying its optimality conditions, relative to its largest entry.
    pub gap: f64,
    /// Iterations taken.
    pub iterations: usize,
    /// How it ended.
    pub status: Status,
}

impl Outcome {
    /// Of x = 0.
    pub(crate) fn nothing(status: Status, residual: f64) -> Self {
        Self {
            residual,
            gap: 0.0,
            iterations: 0,
            status,
        }
    }
}
