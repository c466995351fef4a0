//! Projection of frames onto the leading directions of a problem, by the solvers' kernels.

use crate::linalg::aligned::Aligned;
use crate::linalg::columns::Columns;
use crate::linalg::kernels::{COLUMNS_AT_ONCE, padded};
use crate::solvers::Problem;
use std::sync::Arc;

/// Projects right-hand sides onto the leading directions of a problem: the first values of [`Problem::reduce`], without
/// an allocation.
#[derive(Clone, Debug)]
pub struct Projector {
    /// Those of the problem, shared.
    columns: Arc<Columns>,
    values: Aligned,
    out: Aligned,
    directions: usize,
}

impl Projector {
    /// For the first `directions` of a problem (at most its rank).
    pub fn new(problem: &Problem, directions: usize) -> Self {
        let columns = Arc::clone(problem.basis_columns());
        let directions = directions.min(problem.rank());
        Self {
            values: Aligned::zeros(columns.rows()),
            out: Aligned::zeros(padded(directions, COLUMNS_AT_ONCE)),
            columns,
            directions,
        }
    }

    /// The number of directions.
    pub fn directions(&self) -> usize {
        self.directions
    }

    /// The projection of the values that `fill` writes into a slice of the problem's rows, padded.
    pub fn project(&mut self, fill: impl FnOnce(&mut [f64])) -> &[f64] {
        fill(&mut self.values);
        self.columns.dots(&self.values, &mut self.out);
        &self.out[..self.directions]
    }
}
