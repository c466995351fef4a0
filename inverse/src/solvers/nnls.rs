//! Non-negative least squares with a ridge, solved where it is small: in the space of the measurements.
//!
//! `min over x >= 0 of 1/2 |A x - b|^2 + ridge^2/2 |x|^2`. At the optimum `x = max(0, A^T u)` with `ridge^2 u = b - A
//! x`. The unknown is u, as long as the rank: it solves `ridge^2 u + A max(0, A^T u) = b`. A few Newton steps from the
//! u of the frame before are enough.

use crate::linalg::aligned::Aligned;
use crate::linalg::columns::Columns;
use crate::linalg::vector::norm;
use crate::solvers::active_set::ActiveSet;
use crate::solvers::newton::{Newton, Task};
use crate::solvers::stacked::Stacked;
use crate::solvers::{Outcome, Problem, Solution, Status};
use nalgebra::DVector;
use std::sync::Arc;

/// Least squared ridge, over the largest squared singular value. A smaller one is lost in rounding beside it.
const LEAST_RIDGE_SQUARED: f64 = 1e-16;
/// Relative error of x by rounding above which the ridge becomes further rows (docs/solver.md, "Without a ridge").
const MOST_ROUNDING: f64 = 1e-6;

/// Ridge and accuracy of a solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NnlsOptions {
    /// The ridge, in units of A's singular values; 0 or more. Below 1e-8 of the largest singular value the ridge is
    /// taken as 0: plain non-negative least squares.
    pub ridge: f64,
    /// Largest gap (see [`Nnls::solve`]) of a solve that has converged, relative to x.
    pub tolerance: f64,
    /// Most Newton steps. The problem without a ridge takes as many steps as it needs.
    pub most_steps: usize,
}

/// The solver with its state from frame to frame.
///
/// The workspace is allocated at the first solve of a problem, and another at the first without a ridge or with one too
/// small for Newton steps. After these [`Nnls::solve_into`] allocates nothing.
#[derive(Clone, Debug)]
pub struct Nnls {
    options: NnlsOptions,
    rounding: bool,
    workspace: Option<Workspace>,
}

#[derive(Clone, Debug)]
struct Workspace {
    /// The problem that the state belongs to.
    columns: Arc<Columns>,
    newton: Newton,
    /// For no ridge; made when first needed.
    active_set: Option<Box<ActiveSet>>,
    /// For a ridge that is too small for Newton steps; made when first needed.
    stacked: Option<Box<Stacked>>,
    /// Squared singular values over that of the largest.
    weights: Vec<f64>,
    /// The right-hand side, padded, over its largest entry.
    full: Aligned,
    /// The reduced one, of norm 1.
    unit: Aligned,
    rank: usize,
    /// Factor that turns Newton's point into the dual solution of the last right-hand side.
    dual_scale: Option<f64>,
}

impl Workspace {
    fn new(problem: &Problem) -> Self {
        let columns = problem.columns().clone();
        let largest = problem.singular()[0];
        let mut weights: Vec<f64> = problem.singular().iter().map(|s| (s / largest).powi(2)).collect();
        weights.resize(columns.rows(), 0.0);
        Self {
            newton: Newton::new(&columns),
            active_set: None,
            stacked: None,
            weights,
            full: Aligned::zeros(problem.basis_columns().rows()),
            unit: Aligned::zeros(columns.rows()),
            rank: problem.rank(),
            dual_scale: None,
            columns,
        }
    }
}

impl Nnls {
    /// A solver that has seen no frame.
    pub fn new(options: NnlsOptions) -> Self {
        Self {
            options,
            rounding: false,
            workspace: None,
        }
    }

    /// One with the same options that has seen no frame.
    pub(crate) fn anew(&self) -> Self {
        Self {
            workspace: None,
            ..*self
        }
    }

    /// Whether a ridge that is small beside the residual leaves the solution as exact as rounding lets it be. Else the ridge becomes
    /// further rows, which takes as long as thousands of steps.
    pub fn with_rounding(self, rounding: bool) -> Self {
        Self { rounding, ..self }
    }

    /// Ridge and accuracy of the next solve.
    pub fn options(&self) -> NnlsOptions {
        self.options
    }

    /// Changes the ridge. The next solve starts from the last frame all the same.
    pub fn set_ridge(&mut self, ridge: f64) {
        self.options.ridge = ridge;
    }

    /// Changes the limit of Newton steps.
    pub fn set_most_steps(&mut self, most_steps: usize) {
        self.options.most_steps = most_steps;
    }

    /// Forgets the last frame: the next solve starts cold.
    pub fn reset(&mut self) {
        if let Some(workspace) = &mut self.workspace {
            workspace.newton.reset();
            if let Some(active_set) = &mut workspace.active_set {
                active_set.reset();
            }
            if let Some(stacked) = &mut workspace.stacked {
                stacked.reset();
            }
        }
    }

    /// Forgets the factor of the last frame but not its solution: the next solve forms the factor anew. The benchmarks
    /// measure with it what a kept factor is worth.
    pub fn reset_factor(&mut self) {
        if let Some(workspace) = &mut self.workspace {
            workspace.newton.reset_factor();
        }
    }

    /// The last solve's estimate of the reduced residual `b - A x`, which is the solution of the dual problem. `None`
    /// without a solve or without a ridge.
    pub fn dual(&self) -> Option<DVector<f64>> {
        let workspace = self.workspace.as_ref()?;
        let scale = workspace.dual_scale.filter(|s| s.is_finite())?;
        let u = &workspace.newton.u()[..workspace.rank];
        Some(DVector::from_iterator(u.len(), u.iter().map(|u| u * scale)))
    }

    /// Solves for one right-hand side, starting from the last frame's solution.
    ///
    /// The solution's `gap` is a bound on the largest entry of `|x - max(0, A^T (b - A x)) / ridge^2|` over the largest
    /// of x. Without a ridge the gap is the largest `|min(x_j |a_j|, g_j / |a_j|)|` over `|b|`, with the gradient
    /// `g = A^T (A x - b)`.
    ///
    /// Where the ridge is small beside the residual, rounding spoils the Newton steps. The ridge then becomes further
    /// rows of A, and the gap is that without a ridge. Such a solve takes longer.
    ///
    /// A solve has converged when the gap is at most the tolerance, or the gap that rounding makes where that is more.
    pub fn solve(&mut self, problem: &Problem, b: &DVector<f64>) -> Solution {
        let mut x = DVector::zeros(problem.cells());
        let outcome = self.solve_into(problem, b.as_slice(), x.as_mut_slice());
        Solution {
            x,
            residual: outcome.residual,
            gap: outcome.gap,
            iterations: outcome.iterations,
            status: outcome.status,
        }
    }

    /// [`Nnls::solve`] into the caller's x, one entry for each cell; `b` has one for each row of the whole matrix.
    ///
    /// Numbers that are not finite, lengths that do not fit and a negative ridge end as [`Status::BadInput`] with x =
    /// 0.
    pub fn solve_into(&mut self, problem: &Problem, b: &[f64], x: &mut [f64]) -> Outcome {
        x.fill(0.0);
        let ridge = self.options.ridge;
        if b.len() != problem.rows()
            || x.len() != problem.cells()
            || !problem.is_finite()
            || !b.iter().all(|v| v.is_finite())
            || !(ridge >= 0.0)
        {
            self.reset();
            return Outcome::nothing(Status::BadInput, 0.0);
        }
        let largest = b.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        if largest < f64::MIN_POSITIVE {
            return Outcome::nothing(Status::Converged, 0.0);
        }
        if problem.rank() == 0 {
            return Outcome::nothing(Status::Converged, 1.0);
        }
        let workspace = match &mut self.workspace {
            Some(w) if Arc::ptr_eq(&w.columns, problem.columns()) => w,
            other => other.insert(Workspace::new(problem)),
        };
        workspace.solve(problem, (&self.options, self.rounding), b, largest, x)
    }
}

impl Workspace {
    fn solve(
        &mut self,
        problem: &Problem,
        (options, rounding): (&NnlsOptions, bool),
        b: &[f64],
        largest: f64,
        x: &mut [f64],
    ) -> Outcome {
        for (full, b) in self.full.iter_mut().zip(b) {
            *full = b / largest;
        }
        problem.basis_columns().dots(&self.full, &mut self.unit);
        self.unit[problem.rank()..].fill(0.0);
        let (whole, norm) = (norm(&self.full), norm(&self.unit));
        // Work on b of norm 1 and A of norm 1, so that data in any unit take the same steps.
        if norm < 1e-14 * whole {
            return Outcome::nothing(Status::Converged, 1.0);
        }
        for unit in self.unit.iter_mut() {
            *unit /= norm;
        }
        let sigma = problem.singular()[0];
        let ridge_squared = (options.ridge / sigma).powi(2);
        if !ridge_squared.is_finite() {
            return Outcome::nothing(Status::Converged, 1.0);
        }
        let scale = norm * largest / sigma;
        self.dual_scale = (ridge_squared > LEAST_RIDGE_SQUARED).then_some(ridge_squared * norm * largest);
        let (run, residual) = if ridge_squared > LEAST_RIDGE_SQUARED {
            let run = self.newton.run(Task {
                columns: &self.columns,
                weights: &self.weights,
                b: &self.unit,
                ridge_squared,
                tolerance: options.tolerance,
                most_steps: options.most_steps,
            });
            for (x, g) in x.iter_mut().zip(self.newton.g()) {
                *x = (g.max(0.0) * scale).min(f64::MAX);
            }
            if run.gap > options.tolerance && run.rounding > MOST_ROUNDING && !rounding {
                let stacked = match &mut self.stacked {
                    Some(s) if s.ridge_squared() == ridge_squared => s,
                    other => other.insert(Box::new(Stacked::new(problem, ridge_squared))),
                };
                self.dual_scale = None;
                stacked.run(&self.unit, options.tolerance, scale, x)
            } else {
                (run, self.newton.residual_norm(ridge_squared))
            }
        } else {
            let active_set = self
                .active_set
                .get_or_insert_with(|| Box::new(ActiveSet::new(&self.columns)));
            let run = active_set.run(&self.columns, &self.unit, options.tolerance);
            active_set.write(scale, x);
            (run, active_set.residual_norm())
        };
        let explained = norm / whole;
        let rest = (1.0 - explained * explained).max(0.0).sqrt();
        Outcome {
            residual: (residual * explained).hypot(rest).min(1.0),
            gap: run.gap,
            iterations: run.steps,
            status: if run.gap <= options.tolerance.max(run.rounding) {
                Status::Converged
            } else {
                Status::Stopped
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::lawson_hanson;
    use super::*;
    use nalgebra::DMatrix;
    use proptest::prelude::*;

    fn matrix(rows: usize, cells: usize) -> impl Strategy<Value = (DMatrix<f64>, DVector<f64>)> {
        (
            proptest::collection::vec(-1.0..1.0_f64, rows * cells),
            proptest::collection::vec(-1.0..1.0_f64, rows),
        )
            .prop_map(move |(a, b)| (DMatrix::from_vec(rows, cells, a), DVector::from_vec(b)))
    }

    fn options(ridge: f64) -> NnlsOptions {
        NnlsOptions {
            ridge,
            tolerance: 1e-12,
            most_steps: 100,
        }
    }

    proptest! {
        #[test]
        fn equals_lawson_hanson_on_the_stacked_problem((a, b) in matrix(8, 20), ridge in 0.05..2.0_f64) {
            let problem = Problem::new(&a, 0.0);
            let ours = Nnls::new(options(ridge)).solve(&problem, &b);
            prop_assert_eq!(ours.status, Status::Converged);
            prop_assert!(ours.x.iter().all(|x| *x >= 0.0));
            // The ridge as further rows: 1/2 |[A; ridge I] x - [b; 0]|^2.
            let mut stacked = DMatrix::zeros(28, 20);
            stacked.rows_mut(0, 8).copy_from(&a);
            for k in 0..20 {
                stacked[(8 + k, k)] = ridge;
            }
            let mut rhs = DVector::zeros(28);
            rhs.rows_mut(0, 8).copy_from(&b);
            let theirs = lawson_hanson(&Problem::new(&stacked, 0.0), &rhs);
            prop_assert!((&ours.x - &theirs.x).amax() < 1e-9 * (1.0 + theirs.x.amax()));
        }

        #[test]
        fn warm_equals_cold((a, b) in matrix(10, 40), (_, c) in matrix(10, 1)) {
            let problem = Problem::new(&a, 0.0);
            let mut warm = Nnls::new(options(0.1));
            warm.solve(&problem, &b);
            let next = &b * 0.9 + &c * 0.1;
            let w = warm.solve(&problem, &next);
            let cold = Nnls::new(options(0.1)).solve(&problem, &next);
            prop_assert!((&w.x - &cold.x).amax() < 1e-10 * (1.0 + cold.x.amax()));
        }

        #[test]
        fn scales_with_the_data((a, b) in matrix(6, 12), power in -12..12_i32) {
            let problem = Problem::new(&a, 0.0);
            let factor = 10.0_f64.powi(power);
            let one = Nnls::new(options(0.2)).solve(&problem, &b);
            let many = Nnls::new(options(0.2)).solve(&problem, &(&b * factor));
            prop_assert!((&many.x / factor - &one.x).amax() < 1e-10 * (1.0 + one.x.amax()));
        }
    }

    #[test]
    fn nothing_in_nothing_out_and_rubbish_is_said() {
        let problem = Problem::new(&DMatrix::from_row_slice(2, 3, &[1.0, 2.0, 3.0, 0.5, 0.1, 0.2]), 0.0);
        let mut solver = Nnls::new(options(0.1));
        let zero = solver.solve(&problem, &DVector::zeros(2));
        assert_eq!((zero.status, zero.x.amax()), (Status::Converged, 0.0));
        let bad = solver.solve(&problem, &DVector::from_vec(vec![f64::NAN, 1.0]));
        assert_eq!((bad.status, bad.x.amax()), (Status::BadInput, 0.0));
    }
}
