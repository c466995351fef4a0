//! The picture of a reduced frame: the solve by the method asked for, and its peaks.

use crate::pipeline::options::ReconstructorOptions;
use crate::pipeline::result::FrameResult;
use crate::pipeline::weighted::Weighted;
use crate::reference::imager::Imager;
use crate::solvers::{Method, Nnls, NnlsOptions, discrepancy_ridge, lawson_hanson, pseudo_inverse, tikhonov};
use crate::touches::peaks::TouchFinder;
use nalgebra::DVector;

/// Solves for pictures, one after another.
pub(crate) struct ImageSolver {
    finder: TouchFinder,
    cells: usize,
}

impl ImageSolver {
    pub(crate) fn new(imager: &Imager, options: &ReconstructorOptions) -> Self {
        Self {
            finder: TouchFinder::new(&imager.grid, options.touches),
            cells: imager.grid.len(),
        }
    }

    /// Solves by the method asked for, x in relative rise, and finds the peaks. `values` are the weighted frame, `sigma` the
    /// standard deviation of one of them. Returns the ridge where falls may be tried with it.
    pub(crate) fn solve(
        &mut self,
        options: &ReconstructorOptions,
        weighted: &mut Weighted,
        values: &[f64],
        sigma: f64,
        result: &mut FrameResult,
    ) -> Option<f64> {
        result.x.resize(self.cells, 0.0);
        if options.method == Method::Nnls {
            return Some(self.solve_nnls(options, weighted, values, sigma, result));
        }
        let problem = &weighted.problem;
        let b = DVector::from_column_slice(values);
        let solution = match options.method {
            Method::LawsonHanson => lawson_hanson(problem, &b),
            Method::PseudoInverse => pseudo_inverse(problem, &b),
            _ => {
                // What the model gets wrong cannot be explained by any ridge: then that of the expected rise.
                let ridge = discrepancy_ridge(problem, &b, sigma).max(sigma / options.expected_rise);
                let mut solution = tikhonov(problem, &b, ridge);
                weighted.scale(solution.x.as_mut_slice());
                solution
            }
        };
        result.x.copy_from_slice(solution.x.as_slice());
        (result.residual, result.gap, result.status) = (solution.residual, solution.gap, solution.status);
        None
    }

    fn solve_nnls(
        &mut self,
        options: &ReconstructorOptions,
        weighted: &mut Weighted,
        values: &[f64],
        sigma: f64,
        result: &mut FrameResult,
    ) -> f64 {
        let mut expected = options.expected_rise;
        let ridge = sigma / expected;
        let known = weighted.solving.as_ref().map_or(0.0, |(made_for, _)| ridge / made_for);
        // A ridge estimated from frame after frame scatters; a larger one loses less by what is left out, not more.
        if !(0.5..8.0).contains(&known) {
            let fraction = options.drop_below_ridge * ridge / weighted.problem.singular().max();
            weighted.solving = Some((ridge, weighted.problem.without(fraction)));
        }
        let problem = weighted.solving.as_ref().map_or(&weighted.problem, |(_, p)| p);
        let nnls = &mut weighted.nnls;
        nnls.set_ridge(ridge);
        let mut outcome = nnls.solve_into(problem, values, &mut result.x);
        // A picture far beyond what was expected was held down by the ridge: expect more and solve again.
        for _ in 0..options.most_rescalings {
            let rises = result.x.iter().zip(&weighted.prior).map(|(x, prior)| x * prior);
            let largest = rises.fold(0.0, f64::max);
            if largest <= options.largest_over_expected * expected {
                break;
            }
            expected = largest / options.largest_over_expected;
            nnls.set_ridge(sigma / expected);
            outcome = nnls.solve_into(problem, values, &mut result.x);
        }
        weighted.scale(&mut result.x);
        (result.residual, result.gap, result.status) = (outcome.residual, outcome.gap, outcome.status);
        sigma / expected
    }

    /// Finds the touches of the picture: its peaks.
    pub(crate) fn find(&mut self, result: &mut FrameResult) {
        self.finder.find(&result.x, &mut result.touches);
    }

    /// Lets the picture fall as well as rise: where no touches explain a frame, nothing says that it only rises (metal
    /// beside a finger, say). With a voltage drive a fall somewhere looks much like a rise everywhere else, so that a
    /// picture of rises alone can explain it well and be wrong.
    pub(crate) fn solve_with_falls(
        &mut self,
        options: &ReconstructorOptions,
        weighted: &mut Weighted,
        values: &[f64],
        ridge: f64,
        result: &mut FrameResult,
    ) {
        let problem = &weighted.problem;
        let both = weighted.with_falls.get_or_insert_with(|| problem.with_falls(1.0));
        let solution = Nnls::new(NnlsOptions {
            ridge,
            ..weighted.nnls.options()
        })
        .solve(both, &DVector::from_column_slice(values));
        let mut x = solution.x;
        weighted.scale(x.as_mut_slice());
        let (rises, falls) = x.as_slice().split_at(self.cells);
        self.finder.find(falls, &mut result.touches);
        let fall = result.touches.iter().map(|t| t.total_mm2).fold(0.0, f64::max);
        result.x.copy_from_slice(rises);
        result.residual = solution.residual;
        result.gap = solution.gap;
        result.status = solution.status;
        self.finder.find(rises, &mut result.touches);
        result.touches.retain(|t| t.total_mm2 >= options.least_over_fall * fall);
    }
}
