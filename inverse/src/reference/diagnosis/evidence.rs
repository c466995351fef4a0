//! How probable a frame is with a fault.
//!
//! What touches and drift do to a frame is Gaussian: `y = y_fault + S x + d + e`, with the rises `x` of the cells, the sizes of the
//! drift's shapes and the noise independent. With the covariance `C` of all but the fault, a fault that predicts a frame has the cost
//! `(y - y_fault)' C⁻¹ (y - y_fault) / 2`. A fault that leaves some values U free, anywhere in the range F, has (with `W = C⁻¹`, by
//! the block inverse) the cost of the others, `(r' W r - (W r)_U' W_UU⁻¹ (W r)_U + ln |W_UU|) / 2`, and `y² / 2 F² + ln F` of each
//! free value (Bishop 2006, 2.3).
//!
//! The covariance has few columns and a diagonal ([`LowRankInverse`]).

use super::super::low_rank::LowRankInverse;
use super::covariance::Covariance;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// A frame and the covariance of what touches, drift and noise do to it.
pub(crate) struct Evidence {
    y: DVector<f64>,
    /// The inverse of the covariance.
    w: LowRankInverse,
    /// The product of W with the frame.
    wy: DVector<f64>,
    /// Range of a value that is free, V.
    range_v: f64,
}

/// What tells the cost of a prediction p of a frame, of whatever size.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Products {
    /// p' W y.
    pub(crate) linear: f64,
    /// p' W p.
    pub(crate) square: f64,
}

impl Evidence {
    /// `covariance`: of touches and drift, with the rises `scale` times as large. `own`: standard deviation of every value's own noise
    /// and model error, V; not finite for a value that takes no part. None where the covariance is none.
    pub(crate) fn new(
        y: &DVector<f64>,
        (covariance, scale): (&mut Covariance, f64),
        own: &[f64],
        range_v: f64,
    ) -> Option<Self> {
        let y = DVector::from_fn(own.len(), |k, _| if own[k].is_finite() { y[k] } else { 0.0 });
        let least = own
            .iter()
            .filter(|sd| sd.is_finite())
            .fold(f64::INFINITY, |m, sd| m.min(*sd));
        let w = LowRankInverse::new(&covariance.columns(scale, least), own)?;
        let wy = w.times(&y);
        Some(Self { y, w, wy, range_v })
    }

    /// Cost of touches alone.
    pub(crate) fn of_touches(&self) -> f64 {
        0.5 * self.y.dot(&self.wy)
    }

    /// The same as another covariance has it: comparable with the costs of that one.
    pub(crate) fn of_touches_beside(&self, other: &Self) -> f64 {
        self.of_touches() + self.wider_than(other)
    }

    /// What costs have to be made larger by, to be comparable with those of another covariance.
    pub(crate) fn wider_than(&self, other: &Self) -> f64 {
        0.5 * (self.w.log_det - other.w.log_det)
    }

    /// Cost of a fault that predicts a frame (V, the change). Values that take no part are not looked at.
    pub(crate) fn of(&self, predicted: &DVector<f64>) -> f64 {
        self.cost(&self.products_of(predicted.as_slice(), (&self.w.g * predicted).norm_squared()))
    }

    /// The cost of what has these products: r' W r / 2 with r = y - p.
    pub(crate) fn cost(&self, of: &Products) -> f64 {
        self.of_touches() - of.linear + 0.5 * of.square
    }

    /// What tells the cost of every column.
    pub(crate) fn products(&self, predicted: &DMatrix<f64>) -> Vec<Products> {
        let along = &self.w.g * predicted;
        let columns = predicted.column_iter().zip(along.column_iter());
        columns
            .map(|(p, along)| self.products_of(p.as_slice(), along.norm_squared()))
            .collect()
    }

    /// From the norm of G p.
    fn products_of(&self, p: &[f64], along: f64) -> Products {
        let (mut linear, mut square) = (0.0, 0.0);
        for ((p, wy), own) in p.iter().zip(&self.wy).zip(&self.w.own) {
            linear += p * wy;
            square += own * p * p;
        }
        Products {
            linear,
            // What no value tells is no more than rounding.
            square: (square - along).max(f64::EPSILON * square),
        }
    }

    /// Cost of a fault that adds one column of unknown size with this standard deviation, and that size.
    pub(crate) fn along(&self, column: &DVector<f64>, sd: f64) -> (f64, f64) {
        let wc = self.w.times(column);
        let (a, b, variance) = (column.dot(&wc), column.dot(&self.wy), sd * sd);
        let size = variance * b / (1.0 + variance * a);
        (
            self.of_touches() - 0.5 * b * size + 0.5 * (1.0 + variance * a).ln(),
            size,
        )
    }

    /// Cost of what adds columns, each of one standard deviation.
    pub(crate) fn beside(&self, columns: &DMatrix<f64>) -> f64 {
        let along = &self.w.g * columns;
        let mut own = columns.clone();
        own.column_iter_mut()
            .for_each(|mut column| column.component_mul_assign(&self.w.own));
        let spread = DMatrix::identity(columns.ncols(), columns.ncols()) + columns.tr_mul(&own) - along.tr_mul(&along);
        let Some(factor) = Cholesky::new(spread) else {
            return f64::INFINITY;
        };
        let b = columns.tr_mul(&self.wy);
        let log_det: f64 = factor.l_dirty().diagonal().iter().map(|v| v.ln()).sum();
        self.of_touches() - 0.5 * b.dot(&factor.solve(&b)) + log_det
    }

    /// What [`Evidence::along`] is told by in any frame of the same covariance: with `(a, g)` a frame y costs `(a' y)² / 2 - g` less.
    pub(crate) fn score(&self, column: &DVector<f64>, sd: f64) -> (DVector<f64>, f64) {
        let wc = self.w.times(column);
        let spread = 1.0 + sd * sd * column.dot(&wc);
        (wc * (sd / spread.sqrt()), 0.5 * spread.ln())
    }

    /// The inverse of the covariance, 0 where a value takes no part.
    pub(super) fn inverse_covariance(&self) -> &LowRankInverse {
        &self.w
    }

    /// The product of that with the frame.
    pub(super) fn weighted(&self) -> &DVector<f64> {
        &self.wy
    }

    /// Cost of values that are free by themselves.
    pub(super) fn own_cost(&self, values: &[usize]) -> f64 {
        let one = |k: &usize| 0.5 * (self.y[*k] / self.range_v).powi(2) + self.range_v.ln();
        values.iter().map(one).sum()
    }

    /// Cost of a fault that leaves values free, and the part of it that the other values have.
    pub(crate) fn free(&self, values: &[usize]) -> (f64, f64) {
        let values: Vec<usize> = values.iter().copied().filter(|k| self.w.own[*k] > 0.0).collect();
        let Some(factor): Option<Cholesky<f64, Dyn>> = Cholesky::new(self.w.block(&values)) else {
            return (f64::INFINITY, f64::INFINITY);
        };
        let u = DVector::from_fn(values.len(), |i, _| self.wy[values[i]]);
        let gone = u.dot(&factor.solve(&u));
        let log_det: f64 = 2.0 * factor.l_dirty().diagonal().iter().map(|v| v.ln()).sum::<f64>();
        let others = self.of_touches() - 0.5 * gone;
        (others + 0.5 * log_det + self.own_cost(&values), others)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};

    /// A frame, columns of its covariance and that, and every value's own standard deviation.
    fn random(n: usize, seed: u64) -> (DVector<f64>, Covariance, DMatrix<f64>, Vec<f64>) {
        let mut rng = rand::rngs::StdRng::seed_from_u64(seed);
        let mut one = || rng.random_range(-1.0..1.0);
        let s = DMatrix::from_fn(n, n / 2, |_, _| one());
        let y = DVector::from_fn(n, |_, _| one());
        let covariance = Covariance::new(s.clone(), DMatrix::zeros(n, 0));
        let own = (0..n).map(|k| 0.3 + 0.1 * k as f64).collect();
        (y, covariance, &s * s.transpose(), own)
    }

    /// Minus the logarithm of a normal density, without its constant.
    fn cost(y: &DVector<f64>, c: &DMatrix<f64>) -> f64 {
        let inverse = c.clone().try_inverse().unwrap();
        0.5 * (y.transpose() * inverse * y)[0] + 0.5 * c.determinant().ln()
    }

    fn whole(covariance: &DMatrix<f64>, own: &[f64]) -> DMatrix<f64> {
        covariance + DMatrix::from_diagonal(&DVector::from_fn(own.len(), |k, _| own[k] * own[k]))
    }

    /// Every cost is the logarithm of the density of the frame written out.
    #[test]
    fn costs_are_densities() {
        let range_v = 2.0;
        for seed in 0..5 {
            let (y, mut columns, covariance, own) = random(9, seed);
            let c = whole(&covariance, &own);
            let evidence = Evidence::new(&y, (&mut columns, 1.0), &own, range_v).unwrap();
            let constant = 0.5 * c.determinant().ln();
            let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-8 * b.abs().max(1.0), "{a} {b}");
            near(evidence.of_touches() + constant, cost(&y, &c));
            let wider = Evidence::new(&y, (&mut columns, 3.0), &own, range_v).unwrap();
            let c_wider = whole(&(9.0 * &covariance), &own);
            near(wider.of_touches_beside(&evidence) + constant, cost(&y, &c_wider));
            let p = DVector::from_fn(9, |k, _| (k as f64).sin());
            near(evidence.of(&p) + constant, cost(&(&y - &p), &c));
            let both = evidence.products(&DMatrix::from_columns(&[p.clone(), -&p]));
            near(evidence.cost(&both[0]), evidence.of(&p));
            near(evidence.cost(&both[1]) + constant, cost(&(&y + &p), &c));
            let with = &c + 0.49 * &p * p.transpose();
            let along = evidence.along(&p, 0.7).0;
            near(along + constant, cost(&y, &with));
            near(evidence.beside(&DMatrix::from_columns(&[0.7 * &p])), along);
            let two = DMatrix::from_fn(9, 2, |i, k| ((3 * i + 7 * k) as f64).sin());
            near(
                evidence.beside(&two) + constant,
                cost(&y, &(&c + &two * two.transpose())),
            );
            let (by, gain) = evidence.score(&p, 0.7);
            near(evidence.of_touches() - 0.5 * by.dot(&y).powi(2) + gain, along);
            // Free values are independent of the rest, with the variance of the range.
            let free = [1, 4, 5];
            let mut apart = c.clone();
            for k in free {
                apart.row_mut(k).fill(0.0);
                apart.column_mut(k).fill(0.0);
                apart[(k, k)] = range_v * range_v;
            }
            near(evidence.free(&free).0 + constant, cost(&y, &apart));
        }
    }

    /// A value that takes no part changes no difference of costs.
    #[test]
    fn what_takes_no_part_says_nothing() {
        let (y, mut columns, _, mut own) = random(9, 7);
        let p = DVector::from_fn(9, |k, _| (k as f64).cos());
        let mut difference = |y: &DVector<f64>, own: &[f64]| {
            let evidence = Evidence::new(y, (&mut columns, 1.0), own, 2.0).unwrap();
            let mut p = p.clone();
            p[3] = 0.0;
            evidence.of(&p) - evidence.of_touches()
        };
        own[3] = f64::NAN;
        let mut other = y.clone();
        other[3] = 1e3;
        assert!((difference(&y, &own) - difference(&other, &own)).abs() < 1e-9);
    }
}
