//! The inverse of a covariance `C = U U' + D` of few columns U and a diagonal D.
//!
//! With `M = I + U' D⁻¹ U = L L'` and `G = L⁻¹ U' D⁻¹` it is `W = D⁻¹ - G' G` (Woodbury): nothing as large as C is factorised or
//! stored.

use nalgebra::{Cholesky, DMatrix, DVector};

/// The inverse W, for values of which some may take no part.
pub(super) struct LowRankInverse {
    /// The diagonal of D⁻¹; 0 for a value that takes no part.
    pub(super) own: DVector<f64>,
    pub(super) g: DMatrix<f64>,
    /// Logarithm of the determinant of C, of the values that take part.
    pub(super) log_det: f64,
}

impl LowRankInverse {
    /// `u`: a row for each value. `own_sd`: the square roots of D; not finite for a value that takes no part. None where the columns
    /// are not finite.
    pub(super) fn new(u: &DMatrix<f64>, own_sd: &[f64]) -> Option<Self> {
        let inverse = |sd: &f64| if sd.is_finite() { sd.powi(-2) } else { 0.0 };
        let own = DVector::from_iterator(own_sd.len(), own_sd.iter().map(inverse));
        let mut weighted = u.transpose();
        for (mut column, inverse) in weighted.column_iter_mut().zip(&own) {
            column *= *inverse;
        }
        let m = &weighted * u;
        let factor = Cholesky::new(DMatrix::identity(m.nrows(), m.nrows()) + m)?;
        let lower = factor.l_dirty();
        let own_log_det: f64 = own_sd.iter().filter(|sd| sd.is_finite()).map(|sd| 2.0 * sd.ln()).sum();
        let log_det = own_log_det + 2.0 * lower.diagonal().iter().map(|v| v.ln()).sum::<f64>();
        let mut inverse = DMatrix::identity(lower.nrows(), lower.nrows());
        lower.solve_lower_triangular_mut(&mut inverse);
        Some(Self {
            own,
            g: inverse * weighted,
            log_det,
        })
    }

    /// The product of W with a column.
    pub(super) fn times(&self, column: &DVector<f64>) -> DVector<f64> {
        self.own.component_mul(column) - self.g.tr_mul(&(&self.g * column))
    }

    /// An element of the diagonal of W.
    pub(super) fn diagonal(&self, k: usize) -> f64 {
        self.own[k] - self.g.column(k).norm_squared()
    }

    /// `a' W a` for a column that is zero but at these values.
    pub(super) fn square(&self, a: &[(usize, f64)]) -> f64 {
        let mut along = DVector::zeros(self.g.nrows());
        for (k, a) in a {
            along.axpy(*a, &self.g.column(*k), 1.0);
        }
        a.iter().map(|(k, a)| a * a * self.own[*k]).sum::<f64>() - along.norm_squared()
    }

    /// The block of W of these values.
    pub(super) fn block(&self, values: &[usize]) -> DMatrix<f64> {
        let g = self.g.select_columns(values);
        let mut of = g.transpose() * -g;
        for (i, k) in values.iter().enumerate() {
            of[(i, i)] += self.own[*k];
        }
        of
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every part is that of the matrix inverted as it stands.
    #[test]
    fn parts_are_those_of_the_inverse_written_out() {
        let n = 9;
        let u = DMatrix::from_fn(n, 3, |i, k| ((3 * i + 5 * k) as f64).sin());
        let own_sd: Vec<f64> = (0..n).map(|k| 0.2 + 0.1 * k as f64).collect();
        let c = &u * u.transpose() + DMatrix::from_diagonal(&DVector::from_fn(n, |k, _| own_sd[k].powi(2)));
        let whole = c.clone().try_inverse().unwrap();
        let w = LowRankInverse::new(&u, &own_sd).unwrap();
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-10 * b.abs().max(1.0), "{a} {b}");
        near(w.log_det, c.determinant().ln());
        let all: Vec<usize> = (0..n).collect();
        near((w.block(&all) - &whole).amax(), 0.0);
        let a = DVector::from_fn(n, |k, _| if k % 4 == 1 { k as f64 } else { 0.0 });
        near((w.times(&a) - &whole * &a).amax(), 0.0);
        near(w.square(&[(1, 1.0), (5, 5.0)]), a.dot(&(&whole * &a)));
        near(w.diagonal(4), whole[(4, 4)]);
        near(w.block(&[2, 7])[(0, 1)], whole[(2, 7)]);
    }
}
