//! A matrix decomposed once, for problems with some of its rows, or some directions of its values, left out.

use crate::linalg::eigen::symmetric_eigen;
use crate::solvers::Problem;
use nalgebra::{Cholesky, DMatrix, DVector};
use std::sync::Arc;

/// `A = B D`: columns B that span those of A (`values x rank`), as long as the singular values, and orthonormal rows D
/// (`rank x cells`). After [`Factored::scaled`] these rows are not orthonormal any more, and their products are kept.
///
/// What is left out of A's values is left out of B: `f(A) P = f(B) D P` for every linear f and scales P of the cells. It is
/// decomposed without a matrix of all values and cells.
#[derive(Clone, Debug)]
pub struct Factored {
    columns: Arc<DMatrix<f64>>,
    directions: DMatrix<f64>,
    /// Cholesky factor of the rows' products with one another; none where they are orthonormal to rounding.
    lower: Option<DMatrix<f64>>,
    finite: bool,
}

impl Factored {
    /// Decomposes a matrix, `values x cells`, with the rank tolerance of [`Problem::new`]. One with a number that is not finite has
    /// rank 0.
    pub fn new(a: &DMatrix<f64>, rank_tolerance: f64) -> Self {
        let problem = Problem::new(a, rank_tolerance);
        let mut columns = problem.basis().into_owned();
        let mut directions = problem.a().clone();
        for (k, mut row) in directions.row_iter_mut().enumerate() {
            let length = row.norm();
            row /= length;
            columns.column_mut(k).scale_mut(length);
        }
        Self {
            columns: Arc::new(columns),
            directions,
            lower: None,
            finite: problem.is_finite(),
        }
    }

    /// The same of A with its columns multiplied by `scales` above 0. Where the scaled rows are not finite, or are dependent, the rank is 0.
    pub fn scaled(&self, scales: &[f64]) -> Self {
        let mut directions = self.directions.clone();
        for (mut column, scale) in directions.column_iter_mut().zip(scales) {
            column *= *scale;
        }
        // Near the identity where the scales are near 1.
        let Some(factor) = Cholesky::new(&directions * directions.transpose()) else {
            return Self {
                columns: Arc::new(DMatrix::zeros(self.columns.nrows(), 0)),
                directions: DMatrix::zeros(0, directions.ncols()),
                lower: None,
                finite: self.finite,
            };
        };
        Self {
            columns: Arc::clone(&self.columns),
            directions,
            lower: Some(factor.l()),
            finite: self.finite,
        }
    }

    /// The problem of another matrix: `leave_out` changes A's columns in place, each by the same linear map. The rank tolerance is that of
    /// [`Problem::new`].
    pub fn problem(&self, leave_out: impl FnOnce(&mut DMatrix<f64>), rank_tolerance: f64) -> Problem {
        let mut columns = DMatrix::clone(&self.columns);
        leave_out(&mut columns);
        let (values, cells) = (columns.nrows(), self.directions.ncols());
        let nothing = || Problem::nothing(values, cells, self.finite);
        let largest = if columns.is_empty() { 0.0 } else { columns.amax() };
        if !(largest > 0.0) {
            return nothing();
        }
        columns /= largest;
        // Products of the columns with one another are all that the long columns are needed for, but for the basis.
        let products = columns.transpose() * &columns;
        let scaled = match &self.lower {
            Some(lower) => lower.transpose() * &products * lower,
            None => products.clone(),
        };
        let Some(eigen) = symmetric_eigen(scaled) else {
            return Problem::nothing(values, cells, false);
        };
        let lengths: Vec<f64> = eigen.eigenvalues.iter().map(|v| v.max(0.0).sqrt()).collect();
        let kept = Problem::kept(&lengths, rank_tolerance);
        let turned = eigen.eigenvectors.select_columns(&kept);
        let mut by = match &self.lower {
            Some(lower) => lower * turned,
            None => turned,
        };
        for (mut column, k) in by.column_iter_mut().zip(&kept) {
            column /= lengths[*k];
        }
        let basis = &columns * &by;
        let reduced = (by.transpose() * products * largest) * &self.directions;
        let singular = DVector::from_iterator(kept.len(), kept.iter().map(|k| lengths[*k] * largest));
        Problem::assemble(reduced, singular, basis, self.finite)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng, rngs::StdRng};

    /// 30 values of rank 12 with singular values over four decades.
    fn matrix(rng: &mut StdRng) -> DMatrix<f64> {
        let mut random = |rows, columns| DMatrix::from_fn(rows, columns, |_, _| rng.random_range(-1.0..1.0));
        let mut left: DMatrix<f64> = random(30, 12);
        for (k, mut column) in left.column_iter_mut().enumerate() {
            column *= 10f64.powf(-(k as f64) / 3.0);
        }
        left * random(12, 50)
    }

    /// A map of every column.
    fn of_all(map: impl Fn(&mut [f64])) -> impl FnOnce(&mut DMatrix<f64>) {
        move |matrix| {
            matrix
                .column_iter_mut()
                .for_each(|mut column| map(column.as_mut_slice()))
        }
    }

    /// Whatever is left out: the problem is that of the whole matrix without it.
    #[test]
    fn what_is_left_out_of_the_basis_is_left_out_of_the_matrix() {
        let mut rng = StdRng::seed_from_u64(8);
        let a = matrix(&mut rng);
        let factored = Factored::new(&a, 0.0);
        let direction: Vec<f64> = (0..30).map(|_| rng.random_range(-1.0..1.0)).collect();
        let square: f64 = direction.iter().map(|v| v * v).sum();
        let leave_out = |values: &mut [f64]| {
            for k in [3, 4, 17, 29] {
                values[k] = 0.0;
            }
            let along = values.iter().zip(&direction).map(|(v, d)| v * d).sum::<f64>() / square;
            values.iter_mut().zip(&direction).for_each(|(v, d)| *v -= along * d);
        };
        let scales: Vec<f64> = (0..50).map(|_| rng.random_range(0.5..2.0)).collect();
        let (scaled, even) = (factored.scaled(&scales), vec![1.0; 50]);
        for (factored, scales) in [(&factored, even), (&scaled, scales)] {
            let mut without = a.clone();
            for (mut column, scale) in without.column_iter_mut().zip(&scales) {
                leave_out(column.as_mut_slice());
                column *= *scale;
            }
            for tolerance in [0.0, 1e-2] {
                let (long, short) = (
                    Problem::new(&without, tolerance),
                    factored.problem(of_all(leave_out), tolerance),
                );
                assert_eq!(long.rank(), short.rank());
                for (a, b) in long.singular().iter().zip(short.singular()) {
                    assert!((a / b - 1.0).abs() < 1e-6, "{a} {b}");
                }
                // Directions have no sign: the products say whether they are the same.
                let gram = |p: &Problem| p.a().tr_mul(p.a());
                assert!((gram(&long) - gram(&short)).amax() < 1e-9 * gram(&long).amax());
                let b = DVector::from_fn(30, |_, _| rng.random_range(-1.0..1.0));
                let back = |p: &Problem| p.a().tr_mul(&p.reduce(&b).0);
                assert!((back(&long) - back(&short)).amax() < 1e-7 * back(&long).amax());
            }
        }
    }

    #[test]
    fn of_nothing_nothing_is_left() {
        let mut rng = StdRng::seed_from_u64(9);
        let factored = Factored::new(&matrix(&mut rng), 0.0);
        assert_eq!(factored.problem(|columns| columns.fill(0.0), 0.0).rank(), 0);
        let mut broken = matrix(&mut rng);
        broken[(2, 3)] = f64::NAN;
        assert_eq!(Factored::new(&broken, 0.0).problem(|_| {}, 0.0).rank(), 0);
        let impossible = factored.scaled(&[f64::NAN; 50]);
        assert_eq!(impossible.problem(|_| {}, 0.0).rank(), 0);
    }
}
