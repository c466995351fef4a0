//! Where double precision has to be watched: systems whose numbers lie far apart.

use crate::cholesky::{BLOCK, Factor, Symbolic};
use crate::error::ForwardError;
use crate::system::System;
use nalgebra::DMatrix;
use std::ops::AddAssign;

/// Span of the matrix's diagonal up to which a solution is trusted unchecked: it costs four of sixteen digits at most. Less
/// refines sheets that do not need it; more trusts solutions with larger errors.
pub(crate) const TRUSTED: f64 = 1e4;
/// Largest relative error left in a voltage after refinement; a larger one is an error. A thousandth of the default accuracy
/// of a model, so that rounding never counts.
const ALLOWED: f64 = 1e-6;
/// Most steps of iterative refinement, each of which costs a solve. Each multiplies the error by condition times rounding.
const STEPS: usize = 5;

/// Largest over smallest element of the diagonal; infinite when one is not positive.
pub(crate) fn span(symbolic: &Symbolic, values: &[f64]) -> f64 {
    let (mut low, mut high) = (f64::INFINITY, 0.0_f64);
    for ((column, row), v) in symbolic.pairs().zip(values) {
        if row == column {
            low = low.min(*v);
            high = high.max(*v);
        }
    }
    if low > 0.0 { high / low } else { f64::INFINITY }
}

/// `b - K x`, in place of b. All currents but those into ground flow between unknowns, so a row is its off-diagonal values
/// times differences of potential: no digits are lost however large the diagonal is.
fn residual(system: &System, values: &[f64], x: &[[f64; BLOCK]], b: &mut [[f64; BLOCK]]) {
    for ((column, row), v) in system.symbolic.pairs().zip(values) {
        if row != column {
            for k in 0..BLOCK {
                let current = v * (x[column][k] - x[row][k]);
                b[row][k] -= current;
                b[column][k] += current;
            }
        }
    }
    for (p, share) in system.grounded() {
        for k in 0..BLOCK {
            b[p][k] -= share * x[p][k];
        }
    }
}

/// Adds to `x` the solution for what `right` lacks: one step of iterative refinement. Leaves the step in `right`.
fn step(system: &System, factor: &Factor, values: &[f64], x: &mut [[f64; BLOCK]], right: &mut [[f64; BLOCK]]) {
    let symbolic = &system.symbolic;
    residual(system, values, x, right);
    factor.forward_substitute(symbolic, right, 0);
    factor.back_substitute(symbolic, right);
    for (x, s) in x.iter_mut().zip(right) {
        for k in 0..BLOCK {
            x[k] += s[k];
        }
    }
}

/// Solves for every drive pair of an electrode and the next, with iterative refinement; then hands over, for blocks of
/// electrodes from the last to the first, the solutions for 1 A into each and out of ground: `(first electrode, how many,
/// solutions, last step of the refinement)`. A pair's current does not pass the other contacts, so that a poor one of the
/// ground does not drown the differences.
pub(crate) fn columns(
    system: &System,
    factor: &Factor,
    values: &[f64],
    mut take: impl FnMut(usize, usize, &[[f64; BLOCK]], &[[f64; BLOCK]]),
) {
    let symbolic = &system.symbolic;
    let free = system.electrodes - 1;
    let n = symbolic.unknowns();
    let mut sum = vec![0.0; n];
    for first in (0..free).step_by(BLOCK).rev() {
        let count = BLOCK.min(free - first);
        let mut right = vec![[0.0; BLOCK]; n];
        for k in 0..count {
            right[symbolic.position(system.nodes + first + k)][k] = 1.0;
            if first + k + 1 < free {
                right[symbolic.position(system.nodes + first + k + 1)][k] = -1.0;
            }
        }
        let mut x = vec![[0.0; BLOCK]; n];
        let mut last = right.clone();
        for k in 0..=STEPS {
            if k > 0 {
                last.clone_from(&right);
            }
            step(system, factor, values, &mut x, &mut last);
        }
        for (x, sum) in x.iter_mut().zip(&mut sum) {
            for k in (0..count).rev() {
                *sum += x[k];
                x[k] = *sum;
            }
        }
        take(first, count, &x, &last);
    }
}

/// The electrodes' block of the inverse by iterative refinement.
///
/// # Errors
/// [`ForwardError::Precision`] when transfer impedances between neighbouring electrodes are still uncertain by more than
/// 1e-6 of themselves: by the last step of the refinement, by the asymmetry, or by the currents' sum.
pub(crate) fn refined(system: &System, factor: &Factor, values: &[f64]) -> Result<DMatrix<f64>, ForwardError> {
    let symbolic = &system.symbolic;
    let free = system.electrodes - 1;
    let mut out = DMatrix::zeros(free, free);
    // Of the drive pairs, not of the electrodes.
    let mut change = DMatrix::zeros(free, free);
    let mut leak: f64 = 0.0;
    columns(system, factor, values, |first, count, x, last| {
        for k in 0..count {
            for l in 0..free {
                let p = symbolic.position(system.nodes + l);
                out[(l, first + k)] = x[p][k];
                change[(l, first + k)] = last[p][k];
            }
            let ground = system.ground_current(|node| x[symbolic.position(node)][k]);
            leak = leak.max((ground - 1.0).abs());
        }
    });
    for k in (0..free.saturating_sub(1)).rev() {
        let next = change.column(k + 1).clone_owned();
        change.column_mut(k).add_assign(&next);
    }
    let asymmetry = &out - out.transpose();
    let relative = worst(&out, &change).max(worst(&out, &asymmetry)).max(leak);
    if relative.is_nan() || relative > ALLOWED {
        return Err(ForwardError::Precision { relative });
    }
    Ok(0.5 * (&out + out.transpose()))
}

/// Largest change of a transfer impedance between neighbouring pairs, relative to itself.
fn worst(matrix: &DMatrix<f64>, change: &DMatrix<f64>) -> f64 {
    let n = matrix.nrows() + 1;
    let at = |m: &DMatrix<f64>, i: usize, j: usize| if i + 1 == n || j + 1 == n { 0.0 } else { m[(i, j)] };
    let pair = |m: &DMatrix<f64>, i: usize, j: usize| {
        let (k, l) = ((i + 1) % n, (j + 1) % n);
        (at(m, i, j) - at(m, k, j)) - (at(m, i, l) - at(m, k, l))
    };
    let mut worst: f64 = 0.0;
    for i in 0..n {
        for j in 0..n {
            let relative = (pair(change, i, j) / pair(matrix, i, j)).abs();
            worst = if relative.is_nan() {
                f64::NAN
            } else {
                worst.max(relative)
            };
            if worst.is_nan() {
                return worst;
            }
        }
    }
    worst
}
