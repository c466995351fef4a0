//! How probable a frame is when some of its values may be anything: one set of values after another.

use super::evidence::Evidence;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// A frame of which some values are free, and what the others tell.
///
/// With `W` the inverse covariance and U free values, the cost of the others is `(r' W r - (W r)_U' W_UU⁻¹ (W r)_U + ln |W_UU|) / 2`.
/// With U free, further values V see `W - W_·U W_UU⁻¹ W_U·` in place of W (Schur's complement): the determinants multiply, and nothing
/// larger than V is factorised.
pub(crate) struct Freed<'a> {
    evidence: &'a Evidence,
    w: DMatrix<f64>,
    /// The product of that with the frame.
    wy: DVector<f64>,
    /// Cost of the values that are not free, and half the logarithm of the determinant.
    others: f64,
    half_log_det: f64,
    /// Cost of those that are.
    own: f64,
}

/// A frame's cost with some values free, and the part of it that the other values have.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cost {
    pub(crate) all: f64,
    pub(crate) others: f64,
}

impl<'a> Freed<'a> {
    /// None free.
    pub(crate) fn none(evidence: &'a Evidence) -> Self {
        Self {
            w: evidence.inverse_covariance(),
            wy: evidence.weighted().clone(),
            others: evidence.of_touches(),
            half_log_det: 0.0,
            own: 0.0,
            evidence,
        }
    }

    /// Values among these that take part and are not free yet.
    fn new_ones(&self, values: &[usize]) -> Vec<usize> {
        values.iter().copied().filter(|k| self.w[(*k, *k)] > 0.0).collect()
    }

    fn factor(&self, values: &[usize]) -> Option<Cholesky<f64, Dyn>> {
        Cholesky::new(DMatrix::from_fn(values.len(), values.len(), |i, j| {
            self.w[(values[i], values[j])]
        }))
    }

    /// The cost with these free as well.
    pub(crate) fn cost(&self, values: &[usize]) -> Cost {
        let values = self.new_ones(values);
        let Some(factor) = self.factor(&values) else {
            return Cost {
                all: f64::INFINITY,
                others: f64::INFINITY,
            };
        };
        let u = DVector::from_fn(values.len(), |i, _| self.wy[values[i]]);
        let others = self.others - 0.5 * u.dot(&factor.solve(&u));
        let own = self.own + self.evidence.own_cost(&values);
        Cost {
            all: others + self.half_log_det + half_log_det(&factor) + own,
            others,
        }
    }

    /// The same with these free as well; none where that cannot be computed.
    pub(crate) fn with(&self, values: &[usize]) -> Option<Self> {
        let values = self.new_ones(values);
        let factor = self.factor(&values)?;
        let mut across = self.w.select_rows(&values);
        factor.l_dirty().solve_lower_triangular_mut(&mut across);
        let mut w = &self.w - across.transpose() * &across;
        let mut along = DVector::from_fn(values.len(), |i, _| self.wy[values[i]]);
        factor.l_dirty().solve_lower_triangular_mut(&mut along);
        let mut wy = &self.wy - across.tr_mul(&along);
        for k in &values {
            // Exactly: what is free says nothing more.
            w.row_mut(*k).fill(0.0);
            w.column_mut(*k).fill(0.0);
            wy[*k] = 0.0;
        }
        Some(Self {
            evidence: self.evidence,
            w,
            wy,
            others: self.others - 0.5 * along.norm_squared(),
            half_log_det: self.half_log_det + half_log_det(&factor),
            own: self.own + self.evidence.own_cost(&values),
        })
    }
}

fn half_log_det(factor: &Cholesky<f64, Dyn>) -> f64 {
    factor.l_dirty().diagonal().iter().map(|v| v.ln()).sum()
}

#[cfg(test)]
mod tests {
    use super::super::covariance::Covariance;
    use super::*;
    use rand::{Rng, SeedableRng, rngs::StdRng};

    /// Values that are freed one set after another cost what they cost together, however they are divided, and so do sets that overlap.
    #[test]
    fn sets_freed_one_after_another_cost_what_they_cost_together() {
        let mut rng = StdRng::seed_from_u64(4);
        let n = 20;
        let mut one = || rng.random_range(-1.0..1.0);
        let shapes = DMatrix::from_fn(n, 12, |_, _| one());
        let y = DVector::from_fn(n, |_, _| one());
        let covariance = Covariance::new(&shapes, DMatrix::zeros(n, 0));
        let mut own: Vec<f64> = (0..n).map(|k| 0.2 + 0.05 * k as f64).collect();
        own[7] = f64::NAN;
        let evidence = Evidence::new(&y, (&covariance, 1.0), &own, 2.0).unwrap();
        let none = Freed::none(&evidence);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9 * b.abs().max(1.0), "{a} {b}");
        near(none.cost(&[]).all, evidence.of_touches());
        let together = [1, 2, 5, 7, 11, 12, 19];
        let (all, others) = evidence.free(&together);
        for (first, second) in [
            (&[][..], &together[..]),
            (&[2, 12, 19][..], &[1, 5, 7, 11][..]),
            (&[1, 2, 5, 7, 11][..], &[5, 7, 11, 12, 19][..]),
        ] {
            let cost = none.with(first).unwrap().cost(second);
            near(cost.all, all);
            near(cost.others, others);
            let three = none.with(first).unwrap().with(second).unwrap().cost(&[]);
            near(three.all, all);
        }
    }
}
