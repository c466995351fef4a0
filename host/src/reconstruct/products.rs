//! Products of a matrix's columns with one another, kept for the columns that have been asked for.
//!
//! The same cells are chosen frame after frame: a row of products costs one look at the whole matrix the first time, and
//! nothing from then on. That pays while the products fit the second level of cache; larger matrices have none.

use super::aligned::Aligned;
use super::columns::Columns;

/// Most columns of a matrix whose products are kept: 2 MB.
const MOST_CELLS: usize = 512;

/// `a_i . a_j` of columns scaled to norm 1, a row for each column that was wanted.
#[derive(Clone, Debug)]
pub(super) struct Products {
    rows: Vec<f64>,
    known: Vec<bool>,
    work: Aligned,
}

impl Products {
    /// No row yet; none at all for a large matrix.
    pub(super) fn new(columns: &Columns) -> Option<Self> {
        let cells = columns.cells();
        (cells <= MOST_CELLS).then(|| Self {
            rows: vec![0.0; cells * cells],
            known: vec![false; cells],
            work: Aligned::zeros(cells),
        })
    }

    /// Makes sure that a column's row is there. `scales` are one over the columns' norms.
    pub(super) fn want(&mut self, columns: &Columns, scales: &[f64], j: usize) {
        if self.known[j] {
            return;
        }
        columns.dots(columns.column(j), &mut self.work);
        let cells = self.known.len();
        let row = &mut self.rows[j * cells..(j + 1) * cells];
        for (to, (product, scale)) in row.iter_mut().zip(self.work.iter().zip(scales)) {
            *to = product * scale * scales[j];
        }
        self.known[j] = true;
    }

    /// Product of a column whose row is there with any other.
    #[inline(always)]
    pub(super) fn of(&self, known: usize, j: usize) -> f64 {
        self.rows[known * self.known.len() + j]
    }
}
