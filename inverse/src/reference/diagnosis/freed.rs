//! How probable a frame is when some of its values may be anything: one set of values after another.

use super::super::low_rank::LowRankInverse;
use super::evidence::Evidence;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// A frame of which some values are free, and what the others tell.
///
/// With `W` the inverse covariance and U free values, the cost of the others is `(r' W r - (W r)_U' W_UU⁻¹ (W r)_U + ln |W_UU|) / 2`.
/// With U free, further values V see `W - W_·U W_UU⁻¹ W_U·` in place of W (Schur's complement): the determinants multiply, and nothing
/// larger than V is factorised. As `W = D⁻¹ - G' G` with a diagonal D, and D⁻¹ has nothing beside the diagonal, that is
/// `D⁻¹ - G' G - H' H` with `H = L⁻¹ G_U' G` and `W_UU = L L'`: a row more for each value that is free, and no matrix of all values.
pub(crate) struct Freed<'a> {
    evidence: &'a Evidence,
    /// The diagonal of D⁻¹; 0 for a value that is free, or takes no part.
    own: DVector<f64>,
    /// H, of all sets of values that are free.
    more: DMatrix<f64>,
    /// The product of the matrix with the frame, but for values that are free.
    wy: DVector<f64>,
    /// Cost of the values that are not free, and half the logarithm of the determinant.
    others: f64,
    half_log_det: f64,
    /// Cost of those that are.
    own_cost: f64,
}

/// The block of some values of the matrix.
struct Factor {
    lower: Cholesky<f64, Dyn>,
    /// Their columns of G and of H.
    g: DMatrix<f64>,
    more: DMatrix<f64>,
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
        let w = evidence.inverse_covariance();
        Self {
            own: w.own.clone(),
            more: DMatrix::zeros(0, w.own.len()),
            wy: evidence.weighted().clone(),
            others: evidence.of_touches(),
            half_log_det: 0.0,
            own_cost: 0.0,
            evidence,
        }
    }

    fn w(&self) -> &'a LowRankInverse {
        self.evidence.inverse_covariance()
    }

    /// Values among these that take part and are not free yet.
    fn new_ones(&self, values: &[usize]) -> Vec<usize> {
        values.iter().copied().filter(|k| self.own[*k] > 0.0).collect()
    }

    /// The factor of the block of these values, and their columns of G and of H.
    fn factor(&self, values: &[usize]) -> Option<Factor> {
        let (g, more) = (self.w().g.select_columns(values), self.more.select_columns(values));
        let mut block = g.transpose() * &g + more.transpose() * &more;
        block.neg_mut();
        for (i, k) in values.iter().enumerate() {
            block[(i, i)] += self.own[*k];
        }
        let lower = Cholesky::new(block)?;
        Some(Factor { lower, g, more })
    }

    /// The cost with these free as well.
    pub(crate) fn cost(&self, values: &[usize]) -> Cost {
        let values = self.new_ones(values);
        let Some(Factor { lower: factor, .. }) = self.factor(&values) else {
            return Cost {
                all: f64::INFINITY,
                others: f64::INFINITY,
            };
        };
        let u = DVector::from_fn(values.len(), |i, _| self.wy[values[i]]);
        let others = self.others - 0.5 * u.dot(&factor.solve(&u));
        let own_cost = self.own_cost + self.evidence.own_cost(&values);
        Cost {
            all: others + self.half_log_det + half_log_det(&factor) + own_cost,
            others,
        }
    }

    /// The value that is furthest from what the others tell.
    pub(crate) fn wildest(&self) -> Option<usize> {
        let used = (0..self.wy.len()).filter(|k| self.own[*k] > 0.0);
        let by = |k: usize| {
            let reached = self.w().g.column(k).norm_squared() + self.more.column(k).norm_squared();
            // What rounding leaves of nothing tells nothing.
            match self.own[k] - reached {
                left if left > f64::EPSILON * self.own[k] => self.wy[k] * self.wy[k] / left,
                _ => 0.0,
            }
        };
        used.max_by(|a, b| by(*a).total_cmp(&by(*b)))
    }

    /// The same with these free as well; none where that cannot be computed.
    pub(crate) fn with(&self, values: &[usize]) -> Option<Self> {
        let values = self.new_ones(values);
        let Factor { lower: factor, g, more } = self.factor(&values)?;
        let lower = factor.l_dirty();
        let mut along = DVector::from_fn(values.len(), |i, _| self.wy[values[i]]);
        lower.solve_lower_triangular_mut(&mut along);
        let solved = |columns: DMatrix<f64>| {
            let mut rows = columns.transpose();
            lower.solve_lower_triangular_mut(&mut rows);
            rows
        };
        let rows = solved(g) * &self.w().g + solved(more) * &self.more;
        let (mut own, wy) = (self.own.clone(), &self.wy + rows.tr_mul(&along));
        values.iter().for_each(|k| own[*k] = 0.0);
        let before = self.more.nrows();
        let mut all = self.more.clone().resize_vertically(before + rows.nrows(), 0.0);
        all.rows_mut(before, rows.nrows()).copy_from(&rows);
        Some(Self {
            evidence: self.evidence,
            own,
            more: all,
            wy,
            others: self.others - 0.5 * along.norm_squared(),
            half_log_det: self.half_log_det + half_log_det(&factor),
            own_cost: self.own_cost + self.evidence.own_cost(&values),
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
        let mut covariance = Covariance::new(shapes, DMatrix::zeros(n, 0));
        let mut own: Vec<f64> = (0..n).map(|k| 0.2 + 0.05 * k as f64).collect();
        own[7] = f64::NAN;
        let evidence = Evidence::new(&y, (&mut covariance, 1.0), &own, 2.0).unwrap();
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
