//! Products of a matrix's columns with one another, for matrices so small that they fit the second level of cache.

use crate::linalg::aligned::Aligned;
use crate::linalg::columns::Columns;
use crate::linalg::kernels::add_columns;

/// Most columns of a matrix whose products pay: 2 MB.
pub(super) const MOST_CELLS: usize = 512;

/// `a_i . a_j` of columns scaled to norm 1.
#[derive(Clone, Debug)]
pub(super) struct Products {
    rows: Aligned,
    cells: usize,
}

impl Products {
    /// `scales` are one over the columns' norms.
    pub(super) fn new(columns: &Columns, scales: &[f64]) -> Self {
        let cells = columns.cells();
        let (mut rows, mut work) = (Aligned::zeros(cells * cells), Aligned::zeros(cells));
        for (row, (j, scale)) in rows.chunks_exact_mut(cells.max(1)).zip(scales.iter().enumerate()) {
            columns.dots(columns.column(j), &mut work);
            for (to, (product, other)) in row.iter_mut().zip(work.iter().zip(scales)) {
                *to = product * other * scale;
            }
        }
        Self { rows, cells }
    }

    /// `y += sum of x_j row_j` over a list of `(j, x_j)`.
    pub(super) fn add(&self, columns: &Columns, list: &[(usize, f64)], y: &mut [f64]) {
        add_columns(columns.arch(), &self.rows, list, y);
    }

    /// Products of a column with all.
    #[inline(always)]
    pub(super) fn of(&self, j: usize) -> &[f64] {
        &self.rows[j * self.cells..(j + 1) * self.cells]
    }
}
