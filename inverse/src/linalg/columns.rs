//! A matrix in the layout of the kernels: column by column, padded, scaled.

use crate::linalg::aligned::Aligned;
use crate::linalg::kernels::{self, COLUMNS_AT_ONCE, LANES, VECTORS_AT_ONCE, padded};
use nalgebra::{DMatrix, DMatrixView, Dyn, U1};
use pulp::Arch;

/// A padded copy of a matrix over a scale, which is the largest singular value as a rule. Added rows and columns are
/// zero.
#[derive(Clone, Debug)]
pub(crate) struct Columns {
    arch: Arch,
    rows: usize,
    values: Aligned,
    norms: Vec<f64>,
    largest_norm: f64,
}

impl Columns {
    /// Copies `matrix / scale`.
    pub(crate) fn new(matrix: &DMatrix<f64>, scale: f64) -> Self {
        let rows = padded(matrix.nrows(), LANES);
        let cells = padded(matrix.ncols(), COLUMNS_AT_ONCE);
        let mut values = Aligned::zeros(rows * cells);
        for (to, from) in values.chunks_exact_mut(rows.max(1)).zip(matrix.column_iter()) {
            for (to, from) in to.iter_mut().zip(&from) {
                *to = from / scale;
            }
        }
        let mut norms: Vec<f64> = matrix.column_iter().map(|c| (c / scale).norm()).collect();
        norms.resize(cells, 0.0);
        let largest_norm = norms.iter().copied().fold(0.0, f64::max);
        Self {
            arch: Arch::new(),
            rows,
            values,
            norms,
            largest_norm,
        }
    }

    /// The vector unit in use.
    pub(crate) fn arch(&self) -> Arch {
        self.arch
    }

    /// Number of rows with the padding.
    pub(crate) fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns with the padding.
    pub(crate) fn cells(&self) -> usize {
        self.norms.len()
    }

    /// One column.
    pub(crate) fn column(&self, j: usize) -> &[f64] {
        &self.values[j * self.rows..(j + 1) * self.rows]
    }

    /// The first columns without the padding.
    pub(crate) fn leading(&self, rows: usize, columns: usize) -> DMatrixView<'_, f64, U1, Dyn> {
        let (rows, columns) = (rows.min(self.rows), columns.min(self.cells()));
        DMatrixView::from_slice_with_strides_generic(&self.values, Dyn(rows), Dyn(columns), U1, Dyn(self.rows))
    }

    /// Norms of the columns; 0 for added ones.
    pub(crate) fn norms(&self) -> &[f64] {
        &self.norms
    }

    /// The largest norm of a column.
    pub(crate) fn largest_norm(&self) -> f64 {
        self.largest_norm
    }

    /// `out = A^T v`, for `v` and `out` of padded length.
    pub(crate) fn dots(&self, v: &[f64], out: &mut [f64]) {
        if self.rows > 0 {
            kernels::dots(self.arch, &self.values, v, out);
        }
    }

    /// The same for several vectors, one after the other.
    pub(crate) fn dots_with(&self, vectors: [&[f64]; VECTORS_AT_ONCE], out: &mut [f64]) {
        if self.rows > 0 {
            kernels::dots_with(self.arch, &self.values, vectors, out);
        }
    }

    /// `out_k = a_j . v` for the k-th j of a list.
    pub(crate) fn dots_of(&self, list: &[usize], v: &[f64], out: &mut Vec<f64>) {
        kernels::dots_of(self.arch, &self.values, list, v, out);
    }

    /// `y += A x` for the `(j, x_j)` in the list.
    pub(crate) fn add(&self, list: &[(usize, f64)], y: &mut [f64]) {
        kernels::add_columns(self.arch, &self.values, list, y);
    }
}
