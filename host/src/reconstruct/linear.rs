//! Linear reconstructions: ridge regression and the generalised inverse.

use super::{Problem, Solution, Status};
use nalgebra::DVector;

/// `min |A x - b|^2 + ridge^2 |x|^2`, no sign constraint.
///
/// The solution's `gap` is the norm of the normal equations' residual over that of `A^T b`.
pub fn tikhonov(problem: &Problem, b: &DVector<f64>, ridge: f64) -> Solution {
    filtered(problem, b, |s| s / (s * s + ridge * ridge), ridge)
}

/// `A^+ b`: the least squares solution of least norm, with nothing damped.
///
/// The solution's `gap` is the norm of the normal equations' residual over that of `A^T b`.
pub fn pseudo_inverse(problem: &Problem, b: &DVector<f64>) -> Solution {
    filtered(problem, b, |s| 1.0 / s, 0.0)
}

/// The reduced matrix is `Sigma V^T`, so that `x = V f(Sigma) b` is `a^T (f(Sigma) / Sigma) b`.
fn filtered(problem: &Problem, b: &DVector<f64>, filter: impl Fn(f64) -> f64, ridge: f64) -> Solution {
    if !problem.is_finite() || !b.iter().all(|v| v.is_finite()) {
        return Solution::zero(problem.cells(), Status::BadInput);
    }
    let (small, dropped) = problem.reduce(b);
    let weighted = small.zip_map(problem.singular(), |v, s| v * filter(s) / s);
    let x = problem.a().tr_mul(&weighted);
    let residual = &small - problem.a() * &x;
    let right = problem.a().tr_mul(&small).norm();
    let normal = (problem.a().tr_mul(&residual) - &x * (ridge * ridge)).norm();
    Solution {
        residual: Problem::relative_residual(residual.norm(), dropped, b),
        gap: if right > 0.0 { normal / right } else { 0.0 },
        x,
        iterations: 1,
        status: Status::Converged,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

    #[test]
    fn agree_with_dense_formulas() {
        let a = DMatrix::from_fn(6, 9, |i, j| ((3 * i + 5 * j) as f64).sin());
        let b = DVector::from_fn(6, |i, _| (i as f64).cos());
        let problem = Problem::new(&a, 0.0);
        let x = tikhonov(&problem, &b, 0.3);
        let dense = (a.tr_mul(&a) + DMatrix::identity(9, 9) * 0.09).try_inverse().unwrap() * a.tr_mul(&b);
        assert!((x.x - dense).amax() < 1e-9);
        assert!(x.gap < 1e-9);
        // sin(3 i + 5 j) has rank 2.
        assert_eq!(problem.rank(), 2);
        let p = pseudo_inverse(&problem, &b);
        let dense = a.clone().pseudo_inverse(1e-9).unwrap() * &b;
        assert!((p.x - dense).amax() < 1e-9);
    }
}
