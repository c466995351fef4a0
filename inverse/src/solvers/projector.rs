//! The leading directions of a problem, as fast as its kernels are.

use crate::linalg::aligned::Aligned;
use crate::linalg::columns::Columns;
use crate::solvers::Problem;

/// Projects right-hand sides onto the leading directions of a problem: the first values of what
/// [`Problem::reduce`] gives, without an allocation.
#[derive(Clone, Debug)]
pub struct Projector {
    columns: Columns,
    values: Aligned,
    out: Aligned,
    directions: usize,
}

impl Projector {
    /// For the first `directions` of a problem (at most its rank).
    pub fn new(problem: &Problem, directions: usize) -> Self {
        let basis = problem.basis();
        let directions = directions.min(basis.ncols());
        let columns = Columns::new(&basis.columns(0, directions).into_owned(), 1.0);
        Self {
            values: Aligned::zeros(columns.rows()),
            out: Aligned::zeros(columns.cells()),
            columns,
            directions,
        }
    }

    /// How many directions.
    pub fn directions(&self) -> usize {
        self.directions
    }

    /// The projection of the values that `fill` writes.
    pub fn project(&mut self, fill: impl FnOnce(&mut [f64])) -> &[f64] {
        fill(&mut self.values);
        self.columns.dots(&self.values, &mut self.out);
        &self.out[..self.directions]
    }
}
