//! The ridge as further rows, for ridges so small that rounding spoils the way through measurement space.
//!
//! Newton's point is the residual over the squared ridge: where a ridge is small beside what the frame leaves unexplained,
//! its digits are lost in x. Then `|A x - b|^2 + ridge^2 |x|^2` is solved as the plain problem of `A` over `ridge I`: slower,
//! and in a workspace of its own, but no ridge is too small for it.

use crate::linalg::aligned::Aligned;
use crate::linalg::columns::Columns;
use crate::solvers::active_set::Plain;
use crate::solvers::newton::Run;
use crate::solvers::problem::Problem;
use nalgebra::DMatrix;

/// The plain problem of one matrix and one ridge.
#[derive(Clone, Debug)]
pub(super) struct Stacked {
    square: f64,
    rank: usize,
    columns: Columns,
    plain: Plain,
    right: Aligned,
}

impl Stacked {
    /// For a squared ridge over the squared largest singular value.
    pub(super) fn new(problem: &Problem, square: f64) -> Self {
        let (rank, cells, sigma) = (problem.rank(), problem.cells(), problem.singular()[0]);
        let mut whole = DMatrix::zeros(rank + cells, cells);
        whole.rows_mut(0, rank).copy_from(problem.a());
        whole.rows_mut(rank, cells).fill_diagonal(square.sqrt() * sigma);
        let columns = Columns::new(&whole, sigma);
        Self {
            square,
            rank,
            plain: Plain::new(&columns),
            right: Aligned::zeros(columns.rows()),
            columns,
        }
    }

    /// The squared ridge.
    pub(super) fn square(&self) -> f64 {
        self.square
    }

    /// Solves for a right-hand side of norm 1, writes x times `scale` and returns the norm of `b - A x`.
    pub(super) fn run(&mut self, b: &[f64], tolerance: f64, scale: f64, x: &mut [f64]) -> (Run, f64) {
        self.right.fill(0.0);
        for (right, b) in self.right.iter_mut().zip(b).take(self.rank) {
            *right = *b;
        }
        let run = self.plain.run(&self.columns, &self.right, tolerance);
        self.plain.write(scale, x);
        (run, self.plain.residual_norm_of(self.rank))
    }
}
