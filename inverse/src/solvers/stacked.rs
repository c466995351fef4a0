//! The ridge as further rows, for ridges so small that rounding spoils the way through measurement space.
//!
//! Newton's point is the residual over the squared ridge. Where the ridge is small beside the residual of the frame,
//! the point's digits are lost in x. Then `|A x - b|^2 + ridge^2 |x|^2` is solved as the problem without a ridge of `A`
//! over `ridge I`. This takes longer, in a workspace of its own, but no ridge is too small.

use crate::linalg::aligned::Aligned;
use crate::linalg::columns::Columns;
use crate::solvers::active_set::ActiveSet;
use crate::solvers::problem::Problem;
use crate::solvers::solution::Run;
use nalgebra::DMatrix;

/// The stacked problem of one matrix and one ridge.
#[derive(Clone, Debug)]
pub(super) struct Stacked {
    ridge_squared: f64,
    rank: usize,
    columns: Columns,
    solver: ActiveSet,
    right: Aligned,
}

impl Stacked {
    /// For a squared ridge, in units of the squared largest singular value.
    pub(super) fn new(problem: &Problem, ridge_squared: f64) -> Self {
        let (rank, cells, sigma) = (problem.rank(), problem.cells(), problem.singular()[0]);
        let mut whole = DMatrix::zeros(rank + cells, cells);
        whole.rows_mut(0, rank).copy_from(problem.a());
        whole.rows_mut(rank, cells).fill_diagonal(ridge_squared.sqrt() * sigma);
        let columns = Columns::new(&whole, sigma);
        Self {
            ridge_squared,
            rank,
            solver: ActiveSet::new(&columns),
            right: Aligned::zeros(columns.rows()),
            columns,
        }
    }

    /// Forgets the last solve.
    pub(super) fn reset(&mut self) {
        self.solver.reset();
    }

    /// The squared ridge, in the same units.
    pub(super) fn ridge_squared(&self) -> f64 {
        self.ridge_squared
    }

    /// Solves for a right-hand side of norm 1, writes x times `scale` and returns the norm of `b - A x`.
    pub(super) fn run(&mut self, b: &[f64], tolerance: f64, scale: f64, x: &mut [f64]) -> (Run, f64) {
        self.right.fill(0.0);
        for (right, b) in self.right.iter_mut().zip(b).take(self.rank) {
            *right = *b;
        }
        let run = self.solver.run(&self.columns, &self.right, tolerance);
        self.solver.write(scale, x);
        (run, self.solver.residual_norm_of(self.rank))
    }
}
