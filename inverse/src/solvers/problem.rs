//! A least squares problem reduced once to its row space.

use crate::linalg::columns::Columns;
use crate::linalg::pivoted::pivoted_cholesky;
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use std::sync::Arc;

/// Singular values below this fraction of the largest are rounding. The reduction works on `A A^T`, which has half of
/// the digits.
const LEAST_SINGULAR: f64 = 1e-7;
/// What is left of `A A^T` below this part of its largest element is rounding.
const ROUNDING: f64 = 1e-15;

/// `A x = b` with the rows of A replaced by an orthonormal basis of their span. Immutable; clones share their storage.
///
/// The 208 values of an adjacent frame have rank 104 for a current drive and 118 for a voltage drive. Half of the rows
/// carry nothing but noise, which no x can explain. The norm of the part of b outside the span is kept, so that
/// residuals are those of the whole problem.
#[derive(Clone, Debug)]
pub struct Problem {
    a: Arc<DMatrix<f64>>,
    singular: DVector<f64>,
    /// Orthonormal columns, `rows x rank`: b is reduced by its transpose.
    basis: Arc<DMatrix<f64>>,
    /// The reduced matrix over its largest singular value, in the layout of the kernels.
    columns: Arc<Columns>,
    /// The basis in the same layout.
    basis_columns: Arc<Columns>,
    finite: bool,
}

impl Problem {
    /// Reduces a matrix, `values x cells`. Directions with a singular value of at most `rank_tolerance` times the
    /// largest are left out. A tolerance below 1e-7 counts as 1e-7, since smaller singular values are rounding.
    ///
    /// A matrix with a number that is not finite has rank 0, and every solve of it ends as
    /// [`Status::BadInput`](crate::solvers::Status::BadInput).
    pub fn new(a: &DMatrix<f64>, rank_tolerance: f64) -> Self {
        let finite = a.iter().all(|v| v.is_finite());
        let scale = if finite && !a.is_empty() { a.amax() } else { 0.0 };
        if scale < f64::MIN_POSITIVE {
            return Self::nothing(a.nrows(), a.ncols(), finite);
        }
        let scaled = a / scale;
        let few = pivoted_cholesky(&scaled, ROUNDING).0.qr();
        let r = few.r();
        let eigen = SymmetricEigen::new(&r * r.transpose());
        let values: Vec<f64> = eigen.eigenvalues.iter().map(|v| v.max(0.0).sqrt()).collect();
        let kept = Self::kept(&values, rank_tolerance);
        let basis = few.q() * eigen.eigenvectors.select_columns(&kept);
        let singular = DVector::from_iterator(kept.len(), kept.iter().map(|k| values[*k] * scale));
        Self::assemble(basis.transpose() * a, singular, basis, finite)
    }

    /// A problem of rank 0.
    pub(super) fn nothing(rows: usize, cells: usize, finite: bool) -> Self {
        let basis = DMatrix::zeros(rows, 0);
        Self::assemble(DMatrix::zeros(0, cells), DVector::zeros(0), basis, finite)
    }

    /// Places of the singular values that are kept, the largest first.
    pub(super) fn kept(singular: &[f64], rank_tolerance: f64) -> Vec<usize> {
        let mut order: Vec<usize> = (0..singular.len()).collect();
        order.sort_by(|i, j| singular[*j].total_cmp(&singular[*i]));
        let limit = rank_tolerance.max(LEAST_SINGULAR) * order.first().map_or(0.0, |k| singular[*k]);
        order.retain(|k| singular[*k] > limit);
        order
    }

    pub(super) fn assemble(a: DMatrix<f64>, singular: DVector<f64>, basis: DMatrix<f64>, finite: bool) -> Self {
        let scale = if singular.is_empty() { 1.0 } else { singular[0] };
        Self {
            columns: Arc::new(Columns::new(&a, scale)),
            basis_columns: Arc::new(Columns::new(&basis, 1.0)),
            a: Arc::new(a),
            singular,
            basis: Arc::new(basis),
            finite,
        }
    }

    /// The same problem without the directions whose singular value is below `fraction` of the largest.
    pub fn without(&self, fraction: f64) -> Self {
        let limit = fraction * self.singular.iter().copied().fold(0.0, f64::max);
        let kept = self.singular.iter().filter(|s| **s >= limit).count();
        if kept == self.rank() {
            return self.clone();
        }
        Self::assemble(
            self.a.rows(0, kept).into_owned(),
            self.singular.rows(0, kept).into_owned(),
            self.basis.columns(0, kept).into_owned(),
            self.finite,
        )
    }

    /// The same problem with a second set of cells, which lower the resistivity at `weight` times the effect. x then
    /// holds the rises, followed by the falls over `weight`.
    pub fn with_falls(&self, weight: f64) -> Self {
        let (rank, cells) = (self.rank(), self.cells());
        let mut a = DMatrix::zeros(rank, 2 * cells);
        a.columns_mut(0, cells).copy_from(&*self.a);
        a.columns_mut(cells, cells).copy_from(&(&*self.a * -weight));
        Self::assemble(
            a,
            &self.singular * 1.0_f64.hypot(weight),
            self.basis.as_ref().clone(),
            self.finite && weight.is_finite(),
        )
    }

    /// Reduced matrix, `rank x cells`.
    pub fn a(&self) -> &DMatrix<f64> {
        &self.a
    }

    /// Singular values of A, largest first, `rank` of them.
    pub fn singular(&self) -> &DVector<f64> {
        &self.singular
    }

    /// Rank: the number of directions kept.
    pub fn rank(&self) -> usize {
        self.a.nrows()
    }

    /// Number of cells.
    pub fn cells(&self) -> usize {
        self.a.ncols()
    }

    /// Number of rows before the reduction.
    pub fn rows(&self) -> usize {
        self.basis.nrows()
    }

    /// Rank and cells, rounded up to whole registers: the lengths for [`Problem::back_project`].
    pub fn padded(&self) -> (usize, usize) {
        (self.columns.rows(), self.columns.cells())
    }

    /// `A^T r` over A's largest singular value, by the solvers' own kernel. Every solver needs this product at least
    /// once a frame.
    ///
    /// `r` and `out` have the [padded](Problem::padded) lengths; with others `out` stays as it is.
    pub fn back_project(&self, r: &[f64], out: &mut [f64]) {
        if (r.len(), out.len()) == self.padded() {
            self.columns.dots(r, out);
        }
    }

    /// Whether the whole matrix was finite.
    pub(super) fn is_finite(&self) -> bool {
        self.finite
    }

    /// The reduced matrix over its largest singular value.
    pub(super) fn columns(&self) -> &Arc<Columns> {
        &self.columns
    }

    /// Orthonormal columns, `rows x rank`, in the order of the singular values.
    pub(super) fn basis(&self) -> &DMatrix<f64> {
        &self.basis
    }

    /// The basis in the layout of the kernels.
    pub(super) fn basis_columns(&self) -> &Arc<Columns> {
        &self.basis_columns
    }

    /// The reduced right-hand side, and the norm of the part outside the span.
    pub fn reduce(&self, b: &DVector<f64>) -> (DVector<f64>, f64) {
        let reduced = self.basis.tr_mul(b);
        let dropped = (b.norm_squared() - reduced.norm_squared()).max(0.0).sqrt();
        (reduced, dropped)
    }

    /// The reduced right-hand sides, one in each column.
    pub fn reduce_all(&self, b: &DMatrix<f64>) -> DMatrix<f64> {
        self.basis.transpose() * b
    }

    /// The matrix that reduces a right-hand side whose rows are to be weighted by these weights first, `rank x rows`.
    pub fn reduction(&self, weights: &[f64]) -> DMatrix<f64> {
        let mut out = self.basis.transpose();
        for (mut column, weight) in out.column_iter_mut().zip(weights) {
            column *= *weight;
        }
        out
    }

    /// `|A x - b| / |b|` of the whole problem, from the norms of the reduced residual and of the part outside the span.
    pub fn relative_residual(reduced: f64, dropped: f64, b: &DVector<f64>) -> f64 {
        let norm = b.norm();
        if norm > 0.0 { reduced.hypot(dropped) / norm } else { 0.0 }
    }
}
