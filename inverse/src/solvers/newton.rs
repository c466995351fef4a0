//! Semismooth Newton steps for `rho^2 u + A max(0, A^T u) = b`, with their state from one solve to the next.
//!
//! The left side is increasing and piecewise linear in u, and the equation says that the gradient of the convex function
//! `rho^2/2 |u|^2 + 1/2 |max(0, A^T u)|^2 - b.u` is zero. Each step solves the linear system of the present piece and
//! goes to the least value of that function along the line, so that it ends after finitely many.

use crate::linalg::aligned::Aligned;
use crate::linalg::columns::Columns;
use crate::linalg::kernels::crossings;
use crate::linalg::signs;
use crate::solvers::factor::{Factor, dot};

/// A line search ends where the derivative is below this fraction of what it was at the start.
const ENOUGH: f64 = 0.1;
/// Evaluations of the derivative in one line search.
const MOST_EVALUATIONS: usize = 60;
/// Units of the last place that rounding may cost.
const ROUNDINGS: f64 = 16.0;
/// Proofs without progress after which rounding is taken to be the limit.
const MOST_STALLS: usize = 3;

/// The state: a point u, `g = A^T u`, what the point leaves, and the factor of its piece.
#[derive(Clone, Debug)]
pub(super) struct Newton {
    factor: Factor,
    u: Aligned,
    g: Aligned,
    /// `A max(0, g)`.
    ax: Aligned,
    /// The left side of the equation less its right side.
    left: Aligned,
    direction: Aligned,
    g_next: Aligned,
    list: Vec<(usize, f64)>,
    /// The largest entry of g, or 0.
    largest: f64,
    warm: bool,
}

/// What a run is to solve.
#[derive(Clone, Copy, Debug)]
pub(super) struct Task<'a> {
    pub(super) columns: &'a Columns,
    /// Squared singular values of A, for the start of a cold run.
    pub(super) weights: &'a [f64],
    /// The right-hand side, of norm 1.
    pub(super) b: &'a [f64],
    /// The ridge squared.
    pub(super) square: f64,
    /// The gap to reach.
    pub(super) tolerance: f64,
    pub(super) most_steps: usize,
}

/// How a run ended.
#[derive(Clone, Copy, Debug)]
pub(super) struct Run {
    /// Steps taken.
    pub(super) steps: usize,
    /// Bound on the largest `|x - max(0, A^T (b - A x) / rho^2)|` over the largest x.
    pub(super) gap: f64,
    /// The gap that rounding alone can make.
    pub(super) rounding: f64,
}

impl Newton {
    /// No state yet.
    pub(super) fn new(columns: &Columns) -> Self {
        let (rows, cells) = (columns.rows(), columns.cells());
        Self {
            factor: Factor::new(columns),
            u: Aligned::zeros(rows),
            g: Aligned::zeros(cells),
            ax: Aligned::zeros(rows),
            left: Aligned::zeros(rows),
            direction: Aligned::zeros(rows),
            g_next: Aligned::zeros(cells),
            list: Vec::with_capacity(cells),
            largest: 0.0,
            warm: false,
        }
    }

    /// Forgets the last solve.
    pub(super) fn reset(&mut self) {
        self.warm = false;
    }

    /// Forgets the factor, not the point.
    pub(super) fn reset_factor(&mut self) {
        self.factor.forget();
    }

    /// The point.
    pub(super) fn u(&self) -> &[f64] {
        &self.u
    }

    /// `A^T u`: the solution is its positive part.
    pub(super) fn g(&self) -> &[f64] {
        &self.g
    }

    /// Norm of `b - A x` of the last solve.
    pub(super) fn residual_norm(&self, square: f64) -> f64 {
        let each = self.u.iter().zip(&self.left).map(|(u, left)| square * u - left);
        each.map(|r| r * r).sum::<f64>().sqrt()
    }

    /// Runs to a gap of at most the tolerance.
    pub(super) fn run(&mut self, task: Task) -> Run {
        loop {
            let was_warm = self.warm;
            let run = self.run_from_here(task);
            if (dot(&self.u, &self.u) + dot(&self.left, &self.left)).is_finite() {
                return run;
            }
            // No frame is lost, and none after it, to what an earlier one left.
            self.reset();
            self.factor.forget();
            if !was_warm {
                return run;
            }
        }
    }

    fn run_from_here(&mut self, task: Task) -> Run {
        let Task {
            columns,
            weights,
            b,
            square,
            tolerance,
            most_steps,
        } = task;
        if !self.warm {
            // Half of the cells pushing is the best guess before anything is known.
            for (u, (b, w)) in self.u.iter_mut().zip(b.iter().zip(weights)) {
                *u = b / (square + 0.5 * w);
            }
        }
        if !self.warm {
            columns.dots(&self.u, &mut self.g);
            self.factor.set(&self.g);
            self.product(columns);
        }
        self.warm = true;
        self.residual(b, square);
        let (mut steps, mut stalls, mut best) = (0, 0, f64::INFINITY);
        let mut fresh = true;
        loop {
            let bound = self.bound(columns, square);
            if fresh || bound <= tolerance {
                if !fresh {
                    self.product(columns);
                    self.residual(b, square);
                }
                let mut gap = self.bound(columns, square);
                if gap > tolerance && steps > 0 {
                    gap = self.gap(columns, square);
                }
                stalls = if gap < 0.5 * best { 0 } else { stalls + 1 };
                best = best.min(gap);
                if stalls > 0 {
                    self.factor.distrust();
                }
                if gap <= tolerance || stalls >= MOST_STALLS || steps >= most_steps {
                    return Run {
                        steps,
                        gap,
                        rounding: self.rounding(columns, square),
                    };
                }
            }
            if steps >= most_steps || !self.step(columns, square) {
                self.product(columns);
                self.residual(b, square);
                let gap = self.gap(columns, square);
                return Run {
                    steps,
                    gap,
                    rounding: self.rounding(columns, square),
                };
            }
            fresh = false;
            steps += 1;
        }
    }

    /// `A max(0, g)` afresh.
    fn product(&mut self, columns: &Columns) {
        signs::positive(&self.g, &mut self.list);
        self.largest = self.list.iter().fold(0.0, |m, (_, g)| m.max(*g));
        self.ax.fill(0.0);
        columns.add(&self.list, &mut self.ax);
    }

    fn residual(&mut self, b: &[f64], square: f64) {
        for (left, ((u, ax), b)) in self.left.iter_mut().zip(self.u.iter().zip(&self.ax).zip(b)) {
            *left = square * u + ax - b;
        }
    }

    /// Bound on the relative gap: `b - A x = rho^2 u - left`, and no column turns `left` into more than its norm's share.
    fn bound(&self, columns: &Columns, square: f64) -> f64 {
        let left = dot(&self.left, &self.left).sqrt();
        relative(columns.largest_norm() * left / square, self.largest)
    }

    /// The gap itself; costs one product.
    fn gap(&mut self, columns: &Columns, square: f64) -> f64 {
        columns.dots(&self.left, &mut self.g_next);
        let (mut off, mut largest) = (0.0_f64, 0.0_f64);
        for (g, h) in self.g.iter().zip(&self.g_next) {
            let (x, again) = (g.max(0.0), (g - h / square).max(0.0));
            off = off.max((x - again).abs());
            largest = largest.max(x).max(again);
        }
        relative(off, largest)
    }

    /// The gap that comes of rounding alone, for a right-hand side of norm 1: the equation's terms are rounded, and so is
    /// g, whose error reaches the equation through one more product.
    fn rounding(&self, columns: &Columns, square: f64) -> f64 {
        let largest = columns.largest_norm();
        let terms = 1.0 + largest * dot(&self.u, &self.u).sqrt();
        relative(ROUNDINGS * f64::EPSILON * largest * terms / square, self.largest)
    }

    /// One Newton step; false when it cannot move.
    fn step(&mut self, columns: &Columns, square: f64) -> bool {
        if !self.factor.prepare(columns, square) && !self.factor.prepare(columns, square) {
            return false;
        }
        for (d, left) in self.direction.iter_mut().zip(&self.left) {
            *d = -left;
        }
        self.factor.solve(columns, &mut self.direction);
        // The product at the end of the whole step, not that with the direction: g never carries over an old rounding error
        // when the step is taken whole.
        for (u, d) in self.u.iter_mut().zip(&self.direction) {
            *u += d;
        }
        columns.dots(&self.u, &mut self.g_next);
        signs::subtract(columns.arch(), &mut self.g_next, &self.g);
        let t = self.line_search(columns);
        if !(t > 0.0 && t.is_finite()) {
            for (u, d) in self.u.iter_mut().zip(&self.direction) {
                *u -= d;
            }
            return false;
        }
        for (u, d) in self.u.iter_mut().zip(&self.direction) {
            *u += (t - 1.0) * d;
        }
        // Along the line the left side falls in proportion, but for the columns that changed sides.
        for left in &mut self.left {
            *left *= 1.0 - t;
        }
        self.largest = signs::advance(columns.arch(), &mut self.g, &self.g_next, t, &mut self.list);
        for (j, _) in &self.list {
            self.factor.toggle(*j);
        }
        columns.add(&self.list, &mut self.left);
        true
    }

    /// The root of the derivative along the direction; `g_next` holds the change of g over the whole step.
    ///
    /// Without columns that change sides the derivative falls in proportion to what is left of the step; what they add is
    /// summed apart, so that nothing cancels near the solution.
    fn line_search(&self, columns: &Columns) -> f64 {
        let start = dot(&self.direction, &self.left);
        if !(start < 0.0) {
            return f64::NAN;
        }
        let (mut low, mut high, mut t) = (0.0, f64::INFINITY, 1.0);
        for _ in 0..MOST_EVALUATIONS {
            let (value, slope) = crossings(columns.arch(), &self.g, &self.g_next, t);
            let (value, slope) = (value + (1.0 - t) * start, slope - start);
            if value.abs() <= ENOUGH * start.abs() {
                return t;
            }
            if value > 0.0 {
                high = t;
            } else {
                low = t;
            }
            let mut next = t - value / slope;
            if !(next > low && next < high) {
                next = if high.is_finite() { 0.5 * (low + high) } else { 2.0 * t };
            }
            t = next;
        }
        t
    }
}

fn relative(off: f64, largest: f64) -> f64 {
    if off == 0.0 {
        0.0
    } else if largest > 0.0 {
        off / largest
    } else {
        f64::INFINITY
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

    #[test]
    fn what_an_earlier_frame_spoilt_costs_no_frame() {
        let a = DMatrix::from_fn(8, 24, |i, j| f64::from((i * 7 + j * 5) as u32 % 11) / 40.0 - 0.1);
        let columns = Columns::new(&a, 1.0);
        let (weights, b) = ([1.0; 8], [0.4, -0.1, 0.3, 0.2, 0.5, -0.3, 0.4, 0.1]);
        let mut newton = Newton::new(&columns);
        let task = Task {
            columns: &columns,
            weights: &weights,
            b: &b,
            square: 1e-3,
            tolerance: 1e-10,
            most_steps: 50,
        };
        let first = newton.run(task);
        let expected = newton.g.to_vec();
        assert!(first.gap <= 1e-10);
        newton.u[3] = f64::NAN;
        newton.factor.spoil();
        let second = newton.run(task);
        assert!(second.gap <= 1e-10);
        for (g, e) in newton.g.iter().zip(&expected) {
            assert!((g - e).abs() < 1e-9);
        }
    }
}
