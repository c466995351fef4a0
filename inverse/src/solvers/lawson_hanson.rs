//! Non-negative least squares by the active set method of Lawson and Hanson (1974, chapter 23): the paper's solver and
//! the reference for every other.

use crate::solvers::{Problem, Solution, Status};
use nalgebra::{DMatrix, DVector};

/// Least gradient that lets a column of norm 1 enter, over the norm of b: some hundred roundings.
const TOLERANCE: f64 = 1e-13;
/// Least pivot of the QR factor over the largest; with a smaller one the passive set counts as dependent.
const DEPENDENT: f64 = 1e-12;
/// Iterations for each cell after which the method gives up: three, as Lawson and Hanson do.
const ITERATIONS_PER_CELL: usize = 3;

/// `min over x >= 0 of |A x - b|^2`.
///
/// The solution's `gap` is the largest entry of `min(x_j, -g_j / |a_j|^2)`, g the gradient, over the largest of x.
/// Columns of zeros stay at 0. A column that depends on the passive set does not enter, so that the set always has full
/// rank.
pub fn lawson_hanson(problem: &Problem, b: &DVector<f64>) -> Solution {
    Solution::in_units(problem, b, |b| solve(problem, b))
}

fn solve(problem: &Problem, b: &DVector<f64>) -> Solution {
    let (a, cells) = (problem.a(), problem.cells());
    let (small, dropped) = problem.reduce(b);
    let norms: Vec<f64> = a.column_iter().map(|c| c.norm()).collect();
    let tolerance = TOLERANCE * small.norm();
    let mut x = DVector::zeros(cells);
    let mut passive: Vec<usize> = Vec::new();
    // Columns that made the passive set singular. They may enter again once the set has changed.
    let mut rejected = vec![false; cells];
    let mut iterations = 0;
    let mut status = Status::Converged;
    'outer: loop {
        let residual = &small - a * &x;
        let gradient = a.tr_mul(&residual);
        let entering = (0..cells)
            .filter(|j| x[*j] == 0.0 && !rejected[*j] && !passive.contains(j))
            .filter(|j| gradient[*j] > tolerance * norms[*j])
            .max_by(|i, j| (gradient[*i] / norms[*i]).total_cmp(&(gradient[*j] / norms[*j])));
        let Some(entering) = entering else {
            break;
        };
        passive.push(entering);
        loop {
            iterations += 1;
            if iterations > ITERATIONS_PER_CELL * cells.max(100) {
                status = Status::Stopped;
                break 'outer;
            }
            let Some(s) = least_squares(a, &passive, &small) else {
                passive.retain(|j| *j != entering);
                (x[entering], rejected[entering]) = (0.0, true);
                continue 'outer;
            };
            if s.iter().all(|v| *v > 0.0) {
                for (j, v) in passive.iter().zip(&s) {
                    x[*j] = *v;
                }
                rejected.fill(false);
                break;
            }
            // A new column whose own step is not positive entered by rounding only.
            if x[entering] == 0.0 && s.last().is_some_and(|v| *v <= 0.0) && passive.last() == Some(&entering) {
                passive.pop();
                rejected[entering] = true;
                continue 'outer;
            }
            let step = passive
                .iter()
                .zip(&s)
                .filter(|(_, v)| **v <= 0.0)
                .map(|(j, v)| x[*j] / (x[*j] - v))
                .fold(1.0, f64::min);
            for (j, v) in passive.iter().zip(&s) {
                x[*j] += step * (v - x[*j]);
                if x[*j] <= 1e-15 * v.abs().max(f64::MIN_POSITIVE) {
                    x[*j] = 0.0;
                }
            }
            let blocking: Vec<usize> = passive
                .iter()
                .zip(&s)
                .filter(|(j, v)| **v <= 0.0 && x[**j] <= 1e-14 * x.amax())
                .map(|(j, _)| *j)
                .collect();
            for j in blocking {
                x[j] = 0.0;
            }
            passive.retain(|j| x[*j] > 0.0);
            if passive.is_empty() {
                continue 'outer;
            }
        }
    }
    let residual = &small - a * &x;
    let gradient = a.tr_mul(&residual);
    let largest = x.amax();
    let violation = (0..cells)
        .filter(|j| norms[*j] > 0.0)
        .map(|j| x[j].min(-gradient[j] / (norms[j] * norms[j])).abs())
        .fold(0.0, f64::max);
    Solution {
        residual: Problem::relative_residual(residual.norm(), dropped, b),
        gap: if largest > 0.0 { violation / largest } else { 0.0 },
        x,
        iterations,
        status,
    }
}

/// Least squares on some columns; `None` when they are dependent.
fn least_squares(a: &DMatrix<f64>, passive: &[usize], b: &DVector<f64>) -> Option<Vec<f64>> {
    if passive.len() > a.nrows() {
        return None;
    }
    let qr = a.select_columns(passive).qr();
    let r = qr.r();
    let (mut low, mut high) = (f64::INFINITY, 0.0_f64);
    for k in 0..passive.len() {
        low = low.min(r[(k, k)].abs());
        high = high.max(r[(k, k)].abs());
    }
    if low <= DEPENDENT * high {
        return None;
    }
    let mut rhs = b.clone();
    qr.q_tr_mul(&mut rhs);
    r.solve_upper_triangular(&rhs.rows(0, passive.len()).clone_owned())
        .map(|s| s.as_slice().to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn satisfies_the_optimality_conditions(
            a in proptest::collection::vec(-1.0..1.0_f64, 12 * 9),
            b in proptest::collection::vec(-1.0..1.0_f64, 12),
        ) {
            let a = DMatrix::from_vec(12, 9, a);
            let b = DVector::from_vec(b);
            let s = lawson_hanson(&Problem::new(&a, 0.0), &b);
            prop_assert_eq!(s.status, Status::Converged);
            let g = a.tr_mul(&(&a * &s.x - &b));
            for j in 0..9 {
                prop_assert!(s.x[j] >= 0.0);
                prop_assert!(g[j] >= -1e-9);
                prop_assert!((s.x[j] * g[j]).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn duplicate_and_zero_columns_do_no_harm() {
        let a = DMatrix::from_row_slice(
            3,
            4,
            &[
                1.0, 1.0, 0.0, 0.0, //
                0.0, 0.0, 0.0, 1.0, //
                1.0, 1.0, 0.0, 0.0,
            ],
        );
        let s = lawson_hanson(&Problem::new(&a, 0.0), &DVector::from_vec(vec![2.0, 3.0, 2.0]));
        assert_eq!(s.status, Status::Converged);
        assert!((s.x[0] + s.x[1] - 2.0).abs() < 1e-12);
        assert_eq!(s.x[2], 0.0);
        assert!((s.x[3] - 3.0).abs() < 1e-12);
        assert!(s.residual < 1e-12);
    }
}
