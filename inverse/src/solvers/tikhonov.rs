//! Linear reconstructions: ridge regression and the generalised inverse.

use crate::solvers::{Problem, Solution, Status};
use nalgebra::DVector;

/// `min |A x - b|^2 + ridge^2 |x|^2`, no sign constraint.
///
/// The solution's `gap` is the norm of the normal equations' residual over that of `A^T b`.
pub fn tikhonov(problem: &Problem, b: &DVector<f64>, ridge: f64) -> Solution {
    filtered(problem, b, |s| s / (s * s + ridge * ridge), ridge)
}

/// The ridge at which [`tikhonov`] leaves of a frame what is noise: `|A x - b|^2 = rank sigma^2` over the reduced rows, for
/// values of b with a standard deviation of `sigma` (the discrepancy principle: V. A. Morozov, 1966).
///
/// Infinite where the whole frame is not more than its noise or not finite, and 0 without noise.
pub fn discrepancy_ridge(problem: &Problem, b: &DVector<f64>, sigma: f64) -> f64 {
    let largest = b.amax();
    if !largest.is_finite() || largest < f64::MIN_POSITIVE || problem.rank() == 0 {
        return f64::INFINITY;
    }
    // In units of the largest value, so that no square overflows.
    let ((small, _), sigma) = (problem.reduce(&(b / largest)), sigma / largest);
    let noise = small.len() as f64 * sigma * sigma;
    if !(noise > 0.0) {
        return 0.0;
    }
    if !(small.norm_squared() > noise) {
        return f64::INFINITY;
    }
    // What is left grows with the ridge: halve the interval of its logarithm.
    let left = |ridge: f64| -> f64 {
        let part = |s: f64| 1.0 / (1.0 + (s / ridge).powi(2));
        let each = small.iter().zip(problem.singular());
        each.map(|(v, s)| (v * part(*s)).powi(2)).sum()
    };
    let [largest, least] = [problem.singular().max(), problem.singular().min()];
    let (mut low, mut high) = (least.ln() - FAR, largest.ln() + FAR);
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (low + high);
        if left(middle.exp()) > noise {
            high = middle;
        } else {
            low = middle;
        }
    }
    (0.5 * (low + high)).exp()
}

/// How far (in natural logarithms) beyond the singular values a ridge is sought.
const FAR: f64 = 30.0;
/// Enough for full precision of a logarithm below 100.
const BISECTIONS: usize = 60;

/// `A^+ b`: the least squares solution of least norm, with nothing damped.
///
/// The solution's `gap` is the norm of the normal equations' residual over that of `A^T b`.
pub fn pseudo_inverse(problem: &Problem, b: &DVector<f64>) -> Solution {
    filtered(problem, b, |s| 1.0 / s, 0.0)
}

/// The reduced matrix is `Sigma V^T`, so that `x = V f(Sigma) b` is `a^T (f(Sigma) / Sigma) b`.
fn filtered(problem: &Problem, b: &DVector<f64>, filter: impl Fn(f64) -> f64, ridge: f64) -> Solution {
    Solution::in_units(problem, b, |b| solve(problem, b, &filter, ridge))
}

fn solve(problem: &Problem, b: &DVector<f64>, filter: impl Fn(f64) -> f64, ridge: f64) -> Solution {
    let (small, dropped) = problem.reduce(b);
    let weighted = small.zip_map(problem.singular(), |v, s| v * filter(s) / s);
    let x = problem.a().tr_mul(&weighted);
    let residual = &small - problem.a() * &x;
    let right = problem.a().tr_mul(&small).norm();
    let damped = if ridge.is_finite() {
        &x * (ridge * ridge)
    } else {
        // The limit of an infinite ridge times an x of zero.
        problem.a().tr_mul(&small)
    };
    let normal = (problem.a().tr_mul(&residual) - damped).norm();
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

    /// What the ridge found leaves is the noise, whatever the scale; nothing but noise is smoothed away.
    #[test]
    fn the_discrepancy_is_the_noise() {
        let a = DMatrix::from_fn(8, 30, |i, j| {
            ((i * i + 2) as f64 * 0.3 * (j as f64 + 0.7)).sin() * 0.4_f64.powi(i as i32)
        });
        let problem = Problem::new(&a, 0.0);
        for scale in [1e-9, 1.0, 1e9] {
            let b = DVector::from_fn(8, |i, _| scale * (i as f64 + 1.0).cos());
            let sigma = 0.2 * b.norm() / (8.0_f64).sqrt();
            let ridge = discrepancy_ridge(&problem, &b, sigma);
            let left = (&a * tikhonov(&problem, &b, ridge).x - &b).norm_squared();
            assert!((left / (8.0 * sigma * sigma) - 1.0).abs() < 1e-6, "{scale}: {left}");
            assert_eq!(discrepancy_ridge(&problem, &b, 6.0 * sigma), f64::INFINITY);
            assert_eq!(tikhonov(&problem, &b, f64::INFINITY).x.amax(), 0.0);
            assert_eq!(discrepancy_ridge(&problem, &b, 0.0), 0.0);
        }
    }

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
