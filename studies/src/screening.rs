//! Safe screening from the duality gap: cells that are provably zero before the problem is solved.
//!
//! With a ridge the objective is `P(x) = 1/2 |A x - b|^2 + ridge^2/2 |x|^2` over x >= 0. Its dual is
//! `D(r) = b.r - 1/2 |r|^2 - 1/(2 ridge^2) |max(0, A^T r)|^2`, which is 1-strongly concave. The residual
//! `r* = b - A x*` solves the dual. Therefore `|r - r*| <= sqrt(2 (P(x) - D(r)))` for any x >= 0 and any r. A cell with
//! `a_j.r + |a_j| sqrt(2 gap) <= 0` has `a_j.r* <= 0`, and its x is 0. This is the gap-safe sphere of E. Ndiaye et al.,
//! J. Mach. Learn. Res. 18, 2017, for this problem.
//!
//! The solver does not use it; [`crate::savings`] measures what it would save.

use inverse::solvers::Problem;
use nalgebra::DVector;

/// Cells excluded at a point on the way to the solution.
#[derive(Clone, Debug, PartialEq)]
pub struct Screened {
    /// Duality gap: bound on the distance of the objective from its minimum.
    pub gap: f64,
    /// Which cells are proved to be zero in the solution.
    pub zero: Vec<bool>,
}

/// Units of the last place that rounding may cost the gap.
const ROUNDINGS: f64 = 1e3;

/// Screens at a residual estimate `r` in the reduced space, with the x that belongs to it, `max(0, A^T r) / ridge^2`.
///
/// `b` is the reduced right-hand side, `ridge` is positive.
pub fn screen(problem: &Problem, b: &DVector<f64>, ridge: f64, r: &DVector<f64>) -> Screened {
    let a = problem.a();
    let products = a.tr_mul(r);
    let square = ridge * ridge;
    let x = products.map(|p| p.max(0.0) / square);
    let energy = 0.5 * square * x.norm_squared();
    let primal = 0.5 * (a * &x - b).norm_squared() + energy;
    let dual = b.dot(r) - 0.5 * r.norm_squared() - energy;
    let size = primal.abs() + dual.abs() + energy + 0.5 * b.norm_squared();
    let gap = (primal - dual).max(0.0) + ROUNDINGS * f64::EPSILON * size;
    let reach = (2.0 * gap).sqrt();
    let zero = a
        .column_iter()
        .zip(&products)
        .map(|(c, p)| p + c.norm() * reach <= 0.0)
        .collect();
    Screened { gap, zero }
}

#[cfg(test)]
mod tests {
    use super::*;
    use inverse::solvers::{Nnls, NnlsOptions, Status};
    use nalgebra::DMatrix;
    use proptest::prelude::*;

    proptest! {
        /// No positive cell of the solution is excluded, from any point, near or far. The gap bounds the distance of
        /// the objective from its minimum.
        #[test]
        fn no_positive_cell_is_dropped(
            a in proptest::collection::vec(-1.0..1.0_f64, 8 * 25),
            b in proptest::collection::vec(-1.0..1.0_f64, 8),
            away in proptest::collection::vec(-1.0..1.0_f64, 8),
            ridge in 0.05..3.0_f64,
            far in -12..1_i32,
        ) {
            let problem = Problem::new(&DMatrix::from_vec(8, 25, a), 0.0);
            let b = DVector::from_vec(b);
            let options = NnlsOptions { ridge, tolerance: 1e-13, most_steps: 100 };
            let mut solver = Nnls::new(options);
            let s = solver.solve(&problem, &b);
            prop_assert_eq!(s.status, Status::Converged);
            let (small, _) = problem.reduce(&b);
            let solution = &small - problem.a() * &s.x;
            let dual = solver.dual().unwrap();
            prop_assert!((&dual - &solution).norm() <= 1e-10 * b.norm());
            let r = &solution + DVector::from_vec(away) * 10.0_f64.powi(far);
            let screened = screen(&problem, &small, ridge, &r);
            prop_assert!((&r - &solution).norm() <= (2.0 * screened.gap).sqrt() * (1.0 + 1e-9));
            for (x, zero) in s.x.iter().zip(&screened.zero) {
                // The solver's own x is right to 1e-13 of the largest.
                prop_assert!(!zero || *x <= 1e-12 * s.x.amax());
            }
        }
    }

    /// At the solution itself all cells with a negative `a_j.r` are proved to be zero.
    #[test]
    fn at_the_solution_what_is_negative_is_known() {
        let a = DMatrix::from_fn(6, 40, |i, j| ((3 * i + 7 * j) as f64 + 0.3 * (i * j) as f64).sin());
        let problem = Problem::new(&a, 0.0);
        let b = DVector::from_fn(6, |i, _| (i as f64).cos());
        let options = NnlsOptions {
            ridge: 0.4,
            tolerance: 1e-14,
            most_steps: 100,
        };
        let s = Nnls::new(options).solve(&problem, &b);
        let (small, _) = problem.reduce(&b);
        let r = &small - problem.a() * &s.x;
        let screened = screen(&problem, &small, 0.4, &r);
        let products = problem.a().tr_mul(&r);
        for (p, zero) in products.iter().zip(&screened.zero) {
            assert_eq!(*zero, *p < -1e-5, "{p}");
        }
        assert!(screened.zero.iter().filter(|z| **z).count() > 5);
    }
}
