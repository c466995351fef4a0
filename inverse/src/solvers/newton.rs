//! Semismooth Newton steps for `rho^2 u + A max(0, A^T u) = b`, rho the ridge, with their state from one solve to the
//! next.
//!
//! The left side is increasing and piecewise linear in u. The equation says that the gradient of the convex dual
//! function `rho^2/2 |u|^2 + 1/2 |max(0, A^T u)|^2 - b.u` is zero. Each step solves the linear system of the present
//! piece and goes to the least value of that function along the line. The steps therefore end after finitely many.

use crate::linalg::aligned::Aligned;
use crate::linalg::columns::Columns;
use crate::linalg::kernels::crossings;
use crate::linalg::signs;
use crate::linalg::vector::dot_of_lanes;
use crate::solvers::factor::Factor;
use crate::solvers::solution::Run;

/// How a [`Newton`] searches along a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct NewtonOptions {
    /// A line search ends where the derivative is below this fraction of its value at the start; above 0, below 1.
    ///
    /// More takes fewer evaluations and more Newton steps; less makes the line search exact, which costs more than the
    /// steps that it saves. The steps and times are those of `skin bench savings`, columns "steps" and "median us"
    /// (docs/benchmarks.md); the tried values are not on record.
    pub(super) slope: f64,
}

impl Default for NewtonOptions {
    fn default() -> Self {
        Self { slope: 0.1 }
    }
}

/// Evaluations of the derivative in one line search: enough to halve an interval down to rounding.
const MOST_EVALUATIONS: usize = 60;
/// Units of the last place that rounding may cost.
const ROUNDINGS: f64 = 16.0;
/// Exact residuals without progress after which rounding is taken to be the limit.
const MOST_STALLS: usize = 3;

/// The state: a point u, `g = A^T u`, the residual of the equation, and the factor of the point's piece.
#[derive(Clone, Debug)]
pub(super) struct Newton {
    options: NewtonOptions,
    factor: Factor,
    u: Aligned,
    g: Aligned,
    /// `A max(0, g)`.
    ax: Aligned,
    /// Residual of the equation: its left side less its right side.
    residual: Aligned,
    direction: Aligned,
    g_next: Aligned,
    list: Vec<(usize, f64)>,
    /// The largest entry of g, or 0.
    largest: f64,
    /// Whether the point is that of an earlier solve.
    warm: bool,
}

/// The problem of a run.
#[derive(Clone, Copy, Debug)]
pub(super) struct Task<'a> {
    pub(super) columns: &'a Columns,
    /// Squared singular values of A, for the start of a cold run.
    pub(super) weights: &'a [f64],
    /// The right-hand side, of norm 1.
    pub(super) b: &'a [f64],
    /// The ridge squared.
    pub(super) ridge_squared: f64,
    /// The gap to reach.
    pub(super) tolerance: f64,
    /// Most Newton steps.
    pub(super) most_steps: usize,
}

impl Newton {
    /// A state that has seen no frame.
    pub(super) fn new(columns: &Columns) -> Self {
        let (rows, cells) = (columns.rows(), columns.cells());
        Self {
            options: NewtonOptions::default(),
            factor: Factor::new(columns),
            u: Aligned::zeros(rows),
            g: Aligned::zeros(cells),
            ax: Aligned::zeros(rows),
            residual: Aligned::zeros(rows),
            direction: Aligned::zeros(rows),
            g_next: Aligned::zeros(cells),
            list: Vec::with_capacity(cells),
            largest: 0.0,
            warm: false,
        }
    }

    /// Forgets the last solve, to the last bit.
    pub(super) fn reset(&mut self) {
        if std::mem::take(&mut self.warm) {
            self.factor.clear();
        }
    }

    /// Forgets the factor, not the point.
    pub(super) fn reset_factor(&mut self) {
        self.factor.clear_sum();
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
    pub(super) fn residual_norm(&self, ridge_squared: f64) -> f64 {
        let each = self
            .u
            .iter()
            .zip(&self.residual)
            .map(|(u, residual)| ridge_squared * u - residual);
        each.map(|r| r * r).sum::<f64>().sqrt()
    }

    /// Runs to a gap of at most the tolerance.
    pub(super) fn run(&mut self, task: Task) -> Run {
        loop {
            let was_warm = self.warm;
            let run = self.run_from_here(task);
            if (dot_of_lanes(&self.u, &self.u) + dot_of_lanes(&self.residual, &self.residual)).is_finite() {
                return run;
            }
            // A state that an earlier frame spoilt costs neither this frame nor a later one.
            self.reset();
            if !was_warm {
                return run;
            }
        }
    }

    /// [`Newton::run`] from the present state.
    fn run_from_here(&mut self, task: Task) -> Run {
        let Task {
            columns,
            weights,
            b,
            ridge_squared,
            tolerance,
            most_steps,
        } = task;
        if !self.warm {
            // Before anything is known, half of the cells are taken to be positive.
            for (u, (b, w)) in self.u.iter_mut().zip(b.iter().zip(weights)) {
                *u = b / (ridge_squared + 0.5 * w);
            }
        }
        if !self.warm {
            columns.dots(&self.u, &mut self.g);
            self.factor.set(&self.g);
            self.product(columns);
        }
        self.warm = true;
        self.compute_residual(b, ridge_squared);
        let (mut steps, mut stalls, mut best) = (0, 0, f64::INFINITY);
        let mut fresh = true;
        loop {
            let bound = self.bound(columns, ridge_squared);
            if fresh || bound <= tolerance {
                if !fresh {
                    self.product(columns);
                    self.compute_residual(b, ridge_squared);
                }
                let mut gap = self.bound(columns, ridge_squared);
                if gap > tolerance && steps > 0 {
                    gap = self.gap(columns, ridge_squared);
                }
                stalls = if gap < 0.5 * best { 0 } else { stalls + 1 };
                best = best.min(gap);
                if stalls > 0 {
                    self.factor.invalidate();
                }
                if gap <= tolerance || stalls >= MOST_STALLS || steps >= most_steps {
                    return Run {
                        steps,
                        gap,
                        rounding: self.rounding(columns, ridge_squared),
                    };
                }
            }
            if steps >= most_steps || !self.step(columns, ridge_squared) {
                self.product(columns);
                self.compute_residual(b, ridge_squared);
                let gap = self.gap(columns, ridge_squared);
                return Run {
                    steps,
                    gap,
                    rounding: self.rounding(columns, ridge_squared),
                };
            }
            fresh = false;
            steps += 1;
        }
    }

    /// Computes `A max(0, g)` afresh.
    fn product(&mut self, columns: &Columns) {
        signs::positive(&self.g, &mut self.list);
        self.largest = self.list.iter().fold(0.0, |m, (_, g)| m.max(*g));
        self.ax.fill(0.0);
        columns.add(&self.list, &mut self.ax);
    }

    /// Computes the residual of the equation afresh, from `A max(0, g)`.
    fn compute_residual(&mut self, b: &[f64], ridge_squared: f64) {
        for (residual, ((u, ax), b)) in self.residual.iter_mut().zip(self.u.iter().zip(&self.ax).zip(b)) {
            *residual = ridge_squared * u + ax - b;
        }
    }

    /// Bound on the relative gap. `b - A x = rho^2 u - residual`, and no column turns the residual into more than the
    /// column's norm times the residual's.
    fn bound(&self, columns: &Columns, ridge_squared: f64) -> f64 {
        let residual = dot_of_lanes(&self.residual, &self.residual).sqrt();
        relative(columns.largest_norm() * residual / ridge_squared, self.largest)
    }

    /// The relative gap itself; costs one product.
    fn gap(&mut self, columns: &Columns, ridge_squared: f64) -> f64 {
        columns.dots(&self.residual, &mut self.g_next);
        let (mut off, mut largest) = (0.0_f64, 0.0_f64);
        for (g, h) in self.g.iter().zip(&self.g_next) {
            let (x, again) = (g.max(0.0), (g - h / ridge_squared).max(0.0));
            off = off.max((x - again).abs());
            largest = largest.max(x).max(again);
        }
        relative(off, largest)
    }

    /// The relative gap that rounding alone can make, for a right-hand side of norm 1.
    ///
    /// The terms of the equation are rounded, and so is g. The error of g reaches the equation through one more
    /// product.
    fn rounding(&self, columns: &Columns, ridge_squared: f64) -> f64 {
        let largest = columns.largest_norm();
        let terms = 1.0 + largest * dot_of_lanes(&self.u, &self.u).sqrt();
        relative(ROUNDINGS * f64::EPSILON * largest * terms / ridge_squared, self.largest)
    }

    /// One Newton step; false when the point cannot move.
    fn step(&mut self, columns: &Columns, ridge_squared: f64) -> bool {
        if !self.factor.prepare(columns, ridge_squared) && !self.factor.prepare(columns, ridge_squared) {
            return false;
        }
        for (d, residual) in self.direction.iter_mut().zip(&self.residual) {
            *d = -residual;
        }
        self.factor.solve(columns, &mut self.direction);
        // The product is that with the end of the whole step, not with the direction. When the step is taken whole, g
        // then carries over no old rounding error.
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
        // Along the line the residual falls in proportion, but for the columns that change sign.
        for residual in &mut self.residual {
            *residual *= 1.0 - t;
        }
        self.largest = signs::advance(columns.arch(), &mut self.g, &self.g_next, t, &mut self.list);
        for (j, _) in &self.list {
            self.factor.toggle(*j);
        }
        columns.add(&self.list, &mut self.residual);
        true
    }

    /// The root of the derivative along the direction, in whole steps; `g_next` holds the change of g over the whole
    /// step.
    ///
    /// Without columns that change sign the derivative falls in proportion to the rest of the step. The share of those
    /// columns is summed apart, so that nothing cancels near the solution.
    fn line_search(&self, columns: &Columns) -> f64 {
        let start = dot_of_lanes(&self.direction, &self.residual);
        if !(start < 0.0) {
            return f64::NAN;
        }
        let (mut low, mut high, mut t) = (0.0, f64::INFINITY, 1.0);
        for _ in 0..MOST_EVALUATIONS {
            let (value, slope) = crossings(columns.arch(), &self.g, &self.g_next, t);
            let (value, slope) = (value + (1.0 - t) * start, slope - start);
            if value.abs() <= self.options.slope * start.abs() {
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

/// `off / largest`; 0 where nothing is off, infinite where something is off of nothing.
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
            ridge_squared: 1e-3,
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
