//! Few columns with the products of many.

use nalgebra::DMatrix;

/// Columns L of which `L L'` is `A A'`, the most important first, and the largest element of the diagonal that is left over by the
/// first 0, 1, 2 ... of them.
///
/// They are columns of the Cholesky factor, taken by the largest element of the diagonal that is left (Harbrecht, Peters and Schneider
/// 2012), until that is at most `least` of the largest. `A A'` is never written out.
pub(crate) fn pivoted_cholesky(a: &DMatrix<f64>, least: f64) -> (DMatrix<f64>, Vec<f64>) {
    let n = a.nrows();
    let mut diagonal: Vec<f64> = a.row_iter().map(|row| row.norm_squared()).collect();
    let largest = |diagonal: &[f64]| (0..n).max_by(|a, b| diagonal[*a].total_cmp(&diagonal[*b]));
    let mut left = vec![largest(&diagonal).map_or(0.0, |k| diagonal[k])];
    let limit = least * left[0];
    let mut columns = DMatrix::zeros(n, n.min(a.ncols()));
    let mut count = 0;
    while let Some(pivot) = largest(&diagonal).filter(|k| diagonal[*k] > limit && count < columns.ncols()) {
        let mut column = a * a.row(pivot).transpose();
        let before = columns.columns(0, count);
        column -= before * before.row(pivot).transpose();
        column /= diagonal[pivot].sqrt();
        for (diagonal, c) in diagonal.iter_mut().zip(&column) {
            *diagonal = (*diagonal - c * c).max(0.0);
        }
        diagonal[pivot] = 0.0;
        columns.set_column(count, &column);
        count += 1;
        left.push(largest(&diagonal).map_or(0.0, |k| diagonal[k]));
    }
    (columns.resize_horizontally(count, 0.0), left)
}
