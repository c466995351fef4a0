//! Eigenvectors of symmetric matrices, in a bounded number of steps.

use nalgebra::{DMatrix, Dyn, SymmetricEigen};

/// Steps for each row after which the algorithm is given up. Two or three are usual.
const MOST_STEPS: usize = 100;

/// `None` where a number is not finite, or the algorithm does not come to its end: nothing proves that it does.
pub(crate) fn symmetric_eigen(matrix: DMatrix<f64>) -> Option<SymmetricEigen<f64, Dyn>> {
    let most = MOST_STEPS * (matrix.nrows() + 1);
    let finite = matrix.iter().all(|v| v.is_finite());
    finite
        .then_some(matrix)
        .and_then(|matrix| SymmetricEigen::try_new(matrix, f64::EPSILON, most))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Whatever rows are zero, twice there or tiny: it ends, and the vectors make the matrix again.
        #[test]
        fn vectors_make_the_matrix_again(
            values in proptest::collection::vec(-1.0..1.0_f64, 12 * 12),
            kinds in proptest::collection::vec(0..5_usize, 12),
        ) {
            let mut rows = DMatrix::from_vec(12, 12, values);
            for (k, kind) in kinds.iter().enumerate() {
                match kind {
                    0 => rows.row_mut(k).fill(0.0),
                    1 => rows.row_mut(k).scale_mut(1e-160),
                    2 => {
                        let other = rows.row((k + 5) % 12).into_owned();
                        rows.set_row(k, &other);
                    }
                    _ => {}
                }
            }
            let square = &rows * rows.transpose();
            let eigen = symmetric_eigen(square.clone()).unwrap();
            let off = (eigen.recompose() - &square).amax();
            if square.amax() >= f64::MIN_POSITIVE {
                prop_assert!(off <= 1e-13 * square.amax());
            } else {
                // Such numbers have a last bit in place of digits. Each of 12 products and sums may lose one.
                prop_assert!(off <= 2.0 * 12.0 * f64::from_bits(1));
            }
            rows[(3, 4)] = f64::NAN;
            prop_assert!(symmetric_eigen(rows).is_none());
        }
    }
}
