//! Few columns with the products of many.

use nalgebra::{DMatrix, DMatrixView};

/// Columns L of which `L L'` is `A A'`, the most important first, and the largest element of the diagonal that is left over by the
/// first 0, 1, 2 ... of them.
///
/// They are columns of the Cholesky factor, taken by the largest element of the diagonal that is left (Harbrecht, Peters and Schneider
/// 2012), until that is at most `least` of the largest. `A A'` is never written out.
pub(crate) fn pivoted_cholesky(a: &DMatrix<f64>, least: f64) -> (DMatrix<f64>, Vec<f64>) {
    let mut pivoted = Pivoted::new(a.clone());
    pivoted.extend(least * pivoted.left[0]);
    let count = pivoted.left.len() - 1;
    (pivoted.columns.resize_horizontally(count, 0.0), pivoted.left)
}

/// These columns as far as they were needed: more are made when they are.
pub(crate) struct Pivoted {
    a: DMatrix<f64>,
    /// What is left of the diagonal.
    diagonal: Vec<f64>,
    /// Room for all; the first ones are made.
    columns: DMatrix<f64>,
    left: Vec<f64>,
}

impl Pivoted {
    /// None yet, of `A A'`.
    pub(crate) fn new(a: DMatrix<f64>) -> Self {
        let n = a.nrows();
        let diagonal: Vec<f64> = a.row_iter().map(|row| row.norm_squared()).collect();
        Self {
            columns: DMatrix::zeros(n, n.min(a.ncols())),
            left: vec![largest(&diagonal).map_or(0.0, |k| diagonal[k])],
            diagonal,
            a,
        }
    }

    /// The largest element of the diagonal.
    pub(crate) fn largest(&self) -> f64 {
        self.left[0]
    }

    /// The first columns, until no element of the diagonal is left that is larger than `limit`, or all.
    pub(crate) fn until(&mut self, limit: f64) -> DMatrixView<'_, f64> {
        self.extend(limit);
        let count = self.left.iter().position(|left| *left <= limit);
        self.columns.columns(0, count.unwrap_or(self.left.len() - 1))
    }

    fn extend(&mut self, limit: f64) {
        let Self {
            a,
            diagonal,
            columns,
            left,
        } = self;
        while let Some(pivot) = largest(diagonal).filter(|k| diagonal[*k] > limit && left.len() <= columns.ncols()) {
            let count = left.len() - 1;
            let mut column = &*a * a.row(pivot).transpose();
            let before = columns.columns(0, count);
            column -= before * before.row(pivot).transpose();
            column /= diagonal[pivot].sqrt();
            for (diagonal, c) in diagonal.iter_mut().zip(&column) {
                *diagonal = (*diagonal - c * c).max(0.0);
            }
            diagonal[pivot] = 0.0;
            columns.set_column(count, &column);
            left.push(largest(diagonal).map_or(0.0, |k| diagonal[k]));
        }
    }
}

fn largest(diagonal: &[f64]) -> Option<usize> {
    (0..diagonal.len()).max_by(|a, b| diagonal[*a].total_cmp(&diagonal[*b]))
}

/// Columns of a matrix that span all others but for a part of `least` of the largest, as squares, from the products of all columns with
/// one another; and the Cholesky factor of their own products.
pub(crate) fn pivoted_columns(products: &DMatrix<f64>, least: f64) -> (Vec<usize>, DMatrix<f64>) {
    let n = products.nrows();
    let mut left: Vec<f64> = products.diagonal().iter().copied().collect();
    let largest = |left: &[f64]| (0..n).max_by(|a, b| left[*a].total_cmp(&left[*b]));
    let limit = least * largest(&left).map_or(0.0, |k| left[k]);
    let mut pivots = Vec::new();
    // Row by row: a pivot's row holds what the pivots before it have of it.
    let mut rows = DMatrix::zeros(n, n);
    while let Some(pivot) = largest(&left).filter(|k| left[*k] > limit && pivots.len() < n) {
        let count = pivots.len();
        let mut column = products.column(pivot).into_owned();
        let before = rows.columns(0, count);
        let own = before.row(pivot).transpose();
        column.gemv(-1.0, &before, &own, 1.0);
        column /= left[pivot].sqrt();
        for (left, c) in left.iter_mut().zip(&column) {
            *left = (*left - c * c).max(0.0);
        }
        left[pivot] = 0.0;
        rows.set_column(count, &column);
        pivots.push(pivot);
    }
    let factor = DMatrix::from_fn(pivots.len(), pivots.len(), |i, k| {
        if k <= i { rows[(pivots[i], k)] } else { 0.0 }
    });
    (pivots, factor)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The columns that are chosen span a matrix of low rank, and the factor is that of their products.
    #[test]
    fn few_columns_span_the_others() {
        let thin = |rows, columns, by: f64| {
            DMatrix::from_fn(rows, columns, |i, j| (by * (i * i + 7 * j + i * j) as f64).sin())
        };
        let a = thin(40, 6, 0.37) * thin(6, 25, 0.61);
        let (columns, factor) = pivoted_columns(&a.tr_mul(&a), 1e-13);
        assert_eq!(columns.len(), 6);
        let chosen = a.select_columns(&columns);
        let products = chosen.tr_mul(&chosen);
        assert!((&factor * factor.transpose() - &products).amax() < 1e-9 * products.amax());
        let by = products.try_inverse().unwrap() * chosen.tr_mul(&a);
        assert!((chosen * by - &a).amax() < 1e-6 * a.amax());
    }

    /// Columns that are made later, when more are asked for, are those that are made at once.
    #[test]
    fn columns_are_the_same_whenever_they_are_made() {
        let a = DMatrix::from_fn(30, 18, |i, j| (-(i as f64 / 5.0 - j as f64 / 3.0).powi(2)).exp());
        let (columns, left) = pivoted_cholesky(&a, 1e-12);
        let mut pivoted = Pivoted::new(a);
        let mut before = 0;
        for count in [2, 5, 9] {
            let some = pivoted.until(left[count]);
            assert!(some.ncols() == count && some == columns.columns(0, count));
            before = before.max(count);
            assert_eq!(pivoted.left.len() - 1, before, "more were made than asked for");
        }
        assert_eq!(pivoted.until(left[3]).ncols(), 3);
        assert_eq!(pivoted.until(1e-12 * pivoted.largest()), columns);
    }
}
