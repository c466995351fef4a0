//! A least squares problem reduced once to its row space.

use crate::linalg::columns::Columns;
use crate::linalg::eigen::symmetric_eigen;
use crate::linalg::pivoted::{pivoted_cholesky, pivoted_columns};
use nalgebra::{Cholesky, DMatrix, DMatrixView, DVector, Dyn, U1};
use std::sync::Arc;

/// Singular values below this fraction of the largest are rounding. The reduction works on `A A^T`, which has half of
/// the digits.
const LEAST_SINGULAR: f64 = 1e-7;
/// What is left of `A A^T` below this part of its largest element is rounding.
const ROUNDING: f64 = 1e-15;

/// Matrices of more rows are reduced by products of matrices, where the tolerance leaves room for their rounding.
const MANY_ROWS: usize = 512;
/// Columns that span all others leave this part of the rank tolerance at most.
const LEAST_SHARE: f64 = 0.1;

/// Columns made orthonormal by the factor L of their products L L'.
fn orthonormal(columns: &DMatrix<f64>, lower: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let mut inverse = DMatrix::identity(lower.nrows(), lower.nrows());
    lower
        .solve_lower_triangular_mut(&mut inverse)
        .then(|| columns * inverse.transpose())
}

/// `A x = b` with the rows of A replaced by an orthonormal basis of their span. Immutable; clones share their storage.
///
/// The 208 values of an adjacent frame have rank 104 for a current drive and 118 for a voltage drive. Half of the rows
/// carry nothing but noise, which no x can explain. The norm of the part of b outside the span is kept, so that
/// residuals are those of the whole problem.
#[derive(Clone, Debug)]
pub struct Problem {
    a: Arc<DMatrix<f64>>,
    singular: DVector<f64>,
    rows: usize,
    /// The reduced matrix over its largest singular value, in the layout of the kernels.
    columns: Arc<Columns>,
    /// Orthonormal columns in the same layout, of which the first `rank` count: b is reduced by their transpose. Problems made of this
    /// one share them.
    basis: Arc<Columns>,
    finite: bool,
}

impl Problem {
    /// Reduces a matrix, `values x cells`. Directions with a singular value of at most `rank_tolerance` times the
    /// largest are left out. A tolerance below 1e-7 counts as 1e-7, since smaller singular values are rounding.
    ///
    /// A matrix with a number that is not finite, or whose eigenvectors are not found, has rank 0. Every solve of it ends as
    /// [`Status::BadInput`](crate::solvers::Status::BadInput).
    pub fn new(a: &DMatrix<f64>, rank_tolerance: f64) -> Self {
        let finite = a.iter().all(|v| v.is_finite());
        let scale = if finite && !a.is_empty() { a.amax() } else { 0.0 };
        if scale < f64::MIN_POSITIVE {
            return Self::nothing(a.nrows(), a.ncols(), finite);
        }
        let scaled = a / scale;
        if scaled.nrows() > MANY_ROWS && rank_tolerance > LEAST_SINGULAR {
            return Self::of_many_rows(&scaled, scale, rank_tolerance);
        }
        let few = pivoted_cholesky(&scaled, ROUNDING).0.qr();
        let r = few.r();
        let Some(eigen) = symmetric_eigen(&r * r.transpose()) else {
            return Self::nothing(a.nrows(), a.ncols(), false);
        };
        let values: Vec<f64> = eigen.eigenvalues.iter().map(|v| v.max(0.0).sqrt()).collect();
        let kept = Self::kept(&values, rank_tolerance);
        let basis = few.q() * eigen.eigenvectors.select_columns(&kept);
        let singular = DVector::from_iterator(kept.len(), kept.iter().map(|k| values[*k] * scale));
        Self::assemble(basis.transpose() * a, singular, basis, finite)
    }

    /// The same for a matrix of many rows, over `scale`, and a tolerance that needs no last digits: by products of matrices alone.
    ///
    /// A few columns span the others; they are made orthonormal by the Cholesky factor of their products, twice (Yamamoto et al. 2015).
    fn of_many_rows(scaled: &DMatrix<f64>, scale: f64, rank_tolerance: f64) -> Self {
        let nothing = || Self::nothing(scaled.nrows(), scaled.ncols(), true);
        // Not by `tr_mul`, which takes one product after another and no blocks.
        let across = scaled.transpose() * scaled;
        let (columns, factor) = pivoted_columns(&across, (LEAST_SHARE * rank_tolerance).powi(2));
        let Some(once) = orthonormal(&scaled.select_columns(&columns), factor) else {
            return nothing();
        };
        let Some(span) = Cholesky::new(once.transpose() * &once).and_then(|again| orthonormal(&once, again.l())) else {
            return nothing();
        };
        let within = span.transpose() * scaled;
        let Some(eigen) = symmetric_eigen(&within * within.transpose()) else {
            return Self::nothing(scaled.nrows(), scaled.ncols(), false);
        };
        let values: Vec<f64> = eigen.eigenvalues.iter().map(|v| v.max(0.0).sqrt()).collect();
        let kept = Self::kept(&values, rank_tolerance);
        let turned = eigen.eigenvectors.select_columns(&kept);
        let singular = DVector::from_iterator(kept.len(), kept.iter().map(|k| values[*k] * scale));
        Self::assemble(turned.transpose() * &within * scale, singular, span * turned, true)
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
            rows: basis.nrows(),
            basis: Arc::new(Columns::new(&basis, 1.0)),
            a: Arc::new(a),
            singular,
            finite,
        }
    }

    /// Rank of [`Problem::without`].
    pub fn rank_without(&self, fraction: f64) -> usize {
        let limit = fraction * self.singular.iter().copied().fold(0.0, f64::max);
        self.singular.iter().filter(|s| **s >= limit).count()
    }

    /// The same problem without the directions whose singular value is below `fraction` of the largest.
    pub fn without(&self, fraction: f64) -> Self {
        let kept = self.rank_without(fraction);
        if kept == self.rank() {
            return self.clone();
        }
        let (a, singular) = (self.a.rows(0, kept), self.singular.rows(0, kept));
        let (a, singular) = (a.into_owned(), singular.into_owned());
        let scale = if singular.is_empty() { 1.0 } else { singular[0] };
        Self {
            columns: Arc::new(Columns::new(&a, scale)),
            rows: self.rows,
            basis: Arc::clone(&self.basis),
            a: Arc::new(a),
            singular,
            finite: self.finite,
        }
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
        self.rows
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
    pub(crate) fn basis(&self) -> DMatrixView<'_, f64, U1, Dyn> {
        self.basis.leading(self.rows, self.rank())
    }

    /// The values of one of these.
    pub(crate) fn direction(&self, k: usize) -> &[f64] {
        &self.basis.column(k)[..self.rows]
    }

    /// The basis in the layout of the kernels, with columns after the first `rank` that do not count.
    pub(super) fn basis_columns(&self) -> &Arc<Columns> {
        &self.basis
    }

    /// The reduced right-hand side, and the norm of the part outside the span.
    pub fn reduce(&self, b: &DVector<f64>) -> (DVector<f64>, f64) {
        let reduced = self.basis().tr_mul(b);
        let dropped = (b.norm_squared() - reduced.norm_squared()).max(0.0).sqrt();
        (reduced, dropped)
    }

    /// The reduced right-hand sides, one in each column.
    pub fn reduce_all(&self, b: &DMatrix<f64>) -> DMatrix<f64> {
        self.basis().transpose() * b
    }

    /// The matrix that reduces a right-hand side whose rows are to be weighted by these weights first, `rank x rows`.
    pub fn reduction(&self, weights: &[f64]) -> DMatrix<f64> {
        let mut out = self.basis().transpose();
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solvers::{Nnls, NnlsOptions, Projector};

    /// Of many rows: directions, singular values and products are those of the singular value decomposition.
    #[test]
    fn many_rows_are_reduced_as_few_are() {
        let (rows, cells) = (MANY_ROWS + 40, 90);
        let wave = |rows, columns, by: f64| {
            DMatrix::from_fn(rows, columns, |i, j| (by * (3 * i + 7 * j + i * j) as f64).sin())
        };
        let mut left = wave(rows, 70, 0.31);
        for (k, mut column) in left.column_iter_mut().enumerate() {
            column *= 10f64.powf(-(k as f64) / 8.0);
        }
        let a = left * wave(70, cells, 0.17);
        let tolerance = 1e-5;
        let problem = Problem::new(&a, tolerance);
        let svd = a.clone().svd(true, true);
        let of_svd: Vec<f64> = svd.singular_values.iter().copied().collect();
        let rank = of_svd.iter().filter(|s| **s > tolerance * of_svd[0]).count();
        assert_eq!(problem.rank(), rank);
        assert!(rank > 20 && rank < 60, "{rank}");
        for (s, expected) in problem.singular().iter().zip(&of_svd) {
            assert!((s / expected - 1.0).abs() < 0.01, "{s} {expected}");
        }
        let own = problem.basis().tr_mul(&problem.basis());
        assert!((own - DMatrix::identity(rank, rank)).amax() < 1e-10);
        // What is left out is below the tolerance, and the rest is the matrix seen along the basis.
        assert!((problem.basis().tr_mul(&a) - problem.a()).amax() < 1e-10 * a.amax());
        let off = &a - problem.basis() * problem.a();
        assert!(off.norm() < 3.0 * tolerance * of_svd[0], "{}", off.norm() / of_svd[0]);
    }

    /// Directions that are left out are in the basis that problems share, and change nothing: what is projected and solved is that of the
    /// matrix which has only the others.
    #[test]
    fn directions_that_are_left_out_do_not_count() {
        let (rows, cells) = (20, 30);
        let wave = |rows, columns, by: f64| {
            DMatrix::from_fn(rows, columns, |i, j| (by * (3 * i + 7 * j + i * j) as f64).sin())
        };
        let mut left = wave(rows, 12, 0.31);
        for (k, mut column) in left.column_iter_mut().enumerate() {
            column *= 10f64.powf(-(k as f64) / 3.0);
        }
        let whole = Problem::new(&(left * wave(12, cells, 0.17)), 0.0);
        let few = whole.without(1e-2);
        assert!(few.rank() > 2 && few.rank() < whole.rank() && !few.rank().is_multiple_of(8));
        let alone = Problem::new(&(few.basis() * few.a()), 1e-5);
        assert_eq!(alone.rank(), few.rank());
        let b = DVector::from_fn(rows, |k, _| (0.7 * (k * k) as f64).cos());
        let options = NnlsOptions {
            ridge: 1e-2 * few.singular()[0],
            tolerance: 1e-10,
            most_steps: 200,
        };
        let solve = |problem: &Problem| Nnls::new(options).solve(problem, &b);
        let off = solve(&few).x - solve(&alone).x;
        assert!(
            off.amax() < 1e-8 && (solve(&few).residual - solve(&alone).residual).abs() < 1e-9,
            "{}",
            off.amax()
        );
        let mut projector = Projector::new(&whole, few.rank());
        let projected = projector
            .project(|to| to[..rows].copy_from_slice(b.as_slice()))
            .to_vec();
        assert_eq!(projected.len(), few.rank());
        assert!((few.reduce(&b).0 - DVector::from_vec(projected)).amax() < 1e-12);
    }
}
