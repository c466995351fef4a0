//! What a solve returns: x, the residual, and a gap that proves how far x is from the optimum.

use crate::solvers::problem::Problem;
use nalgebra::DVector;

/// How a solve ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Status {
    /// The gap is at most the tolerance asked for.
    #[default]
    Converged,
    /// The iteration limit came first; the gap says how far off the solution is.
    Stopped,
    /// The input held a number that is not finite, or did not fit; the solution is zero.
    BadInput,
}

/// A solution with the gap that proves it.
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
    /// Solves for a right-hand side in units of its largest entry, so that nothing overflows on the way.
    ///
    /// A solution that is too large for a number all the same ends as [`Status::Stopped`] with x = 0.
    pub(super) fn in_units(problem: &Problem, b: &DVector<f64>, solve: impl Fn(&DVector<f64>) -> Self) -> Self {
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

    /// x = 0, exact.
    pub(super) fn zero(cells: usize, status: Status) -> Self {
        Self {
            x: DVector::zeros(cells),
            residual: 0.0,
            gap: 0.0,
            iterations: 0,
            status,
        }
    }
}

/// What a solve reports beside x, where the caller holds x: see [`Solution`].
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
    /// Of x = 0, with the residual that it leaves.
    pub(super) fn nothing(status: Status, residual: f64) -> Self {
        Self {
            residual,
            gap: 0.0,
            iterations: 0,
            status,
        }
    }
}

/// How the run of an inner solver ended, for a right-hand side of norm 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct Run {
    /// Steps taken.
    pub(super) steps: usize,
    /// The gap: with a ridge a bound on the largest `|x - max(0, A^T (b - A x) / ridge^2)|` over the largest x, without
    /// one the largest `|min(x_j |a_j|, -g_j / |a_j|)|`.
    pub(super) gap: f64,
    /// The gap that rounding alone can make.
    pub(super) rounding: f64,
}
