//! Orthonormal vectors by the method of Gram and Schmidt, and what of a vector lies outside their span.

use crate::linalg::vector::{dot, square};
use nalgebra::{DMatrix, DMatrixView};

/// Share of a vector's square that has to be new for the vector to enter a [`Basis`].
///
/// The value is numerics: 1e-6 of the length, far above the rounding of shapes that are alike.
const LEAST_NEW: f64 = 1e-12;

/// Orthonormal vectors of one length. Nothing is allocated once it is as large as it gets.
#[derive(Clone, Debug, Default)]
pub(crate) struct Basis {
    /// One after the other.
    columns: Vec<f64>,
}

impl Basis {
    /// Adds the direction in which a vector leaves the span; none where it depends on the vectors before it.
    pub(crate) fn add(&mut self, v: &[f64]) {
        let start = self.columns.len();
        self.columns.extend_from_slice(v);
        let (before, new) = self.columns.split_at_mut(start);
        match orthogonalise(before, new, LEAST_NEW) {
            Some(rest) => new.iter_mut().for_each(|v| *v /= rest.sqrt()),
            None => self.columns.truncate(start),
        }
    }

    /// Forgets all vectors.
    pub(crate) fn clear(&mut self) {
        self.columns.clear();
    }

    /// The vectors, one after the other.
    pub(crate) fn columns(&self) -> &[f64] {
        &self.columns
    }

    /// Projects a vector onto the complement of the span, in place; returns the square of what remains.
    pub(crate) fn outside(&self, v: &mut [f64]) -> f64 {
        take_away(&self.columns, v);
        square(v)
    }

    /// The same of every column of a matrix, by products of matrices.
    pub(crate) fn outside_all(&self, matrix: &mut DMatrix<f64>) {
        let rows = matrix.nrows();
        let count = self.columns.len() / rows.max(1);
        let own = DMatrixView::from_slice(&self.columns, rows, count);
        let along = own.transpose() * &*matrix;
        matrix.gemm(-1.0, &own, &along, 1.0);
    }
}

/// Makes a vector orthogonal to orthonormal ones of the same length, which stand one after the other in `before`.
///
/// Returns the square of what remains; scaling to norm 1 is the caller's. `None` where at most `least_new` of the
/// vector's square remains: the vector then counts as dependent. A larger `least_new` keeps fewer directions, all of
/// them surer. A smaller one keeps directions of which rounding is a larger part. Below about 1e-30 rounding itself is
/// kept.
pub(crate) fn orthogonalise(before: &[f64], v: &mut [f64], least_new: f64) -> Option<f64> {
    let whole = square(v);
    // Twice: the vector is then orthogonal to rounding.
    take_away(before, v);
    take_away(before, v);
    let rest = square(v);
    (rest > least_new * whole).then_some(rest)
}

/// Takes away the part of a vector along each of the orthonormal `columns`.
fn take_away(columns: &[f64], v: &mut [f64]) {
    for q in columns.chunks_exact(v.len().max(1)) {
        let part = dot(q, v);
        v.iter_mut().zip(q).for_each(|(v, q)| *v -= part * q);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_new_of_a_vector_is_told_from_what_is_not() {
        let mut basis = Basis::default();
        basis.add(&[2.0, 0.0, 0.0]);
        basis.add(&[1.0, 3.0, 0.0]);
        // In the span of the first two: nothing new.
        basis.add(&[5.0, -7.0, 0.0]);
        assert_eq!(basis.columns, [1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        let mut v = [3.0, 4.0, 2.0];
        assert_eq!(basis.outside(&mut v), 4.0);
        assert_eq!(v, [0.0, 0.0, 2.0]);
        let mut both = DMatrix::from_row_slice(3, 2, &[3.0, -1.0, 4.0, 0.5, 2.0, 7.0]);
        basis.outside_all(&mut both);
        assert_eq!(both, DMatrix::from_row_slice(3, 2, &[0.0, 0.0, 0.0, 0.0, 2.0, 7.0]));
        Basis::default().outside_all(&mut both);
        assert_eq!(both[(2, 1)], 7.0);
    }

    #[test]
    fn the_threshold_decides_what_is_dependent() {
        let before = [1.0, 0.0];
        // 1e-14 of its square is new.
        let nearly = [1.0, 1e-7];
        assert!(orthogonalise(&before, &mut nearly.clone(), 1e-12).is_none());
        let rest = orthogonalise(&before, &mut nearly.clone(), 1e-18);
        assert!(rest.is_some_and(|rest| (rest / 1e-14 - 1.0).abs() < 1e-9));
    }
}
