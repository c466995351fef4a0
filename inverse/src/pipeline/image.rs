//! The picture of a reduced frame: the solve by the method asked for, and its peaks.

use crate::pipeline::options::ReconstructorOptions;
use crate::pipeline::result::FrameResult;
use crate::pipeline::weighted::Pictures;
use crate::reference::imager::Imager;
use crate::solvers::{Method, discrepancy_ridge, lawson_hanson, pseudo_inverse, tikhonov};
use crate::touches::peaks::TouchFinder;
use crate::touches::polarity::Polarity;
use crate::touches::touch::Touch;
use nalgebra::DVector;

/// Solves for pictures, one after another.
pub(crate) struct ImageSolver {
    finder: TouchFinder,
    /// Room for a picture, or values, of the other sign, and its peaks.
    turned: Vec<f64>,
    hollows: Vec<Touch>,
    cells: usize,
}

impl ImageSolver {
    pub(crate) fn new(imager: &Imager, options: &ReconstructorOptions) -> Self {
        Self {
            finder: TouchFinder::new(&imager.grid, options.touches),
            turned: Vec::new(),
            hollows: Vec::new(),
            cells: imager.grid.len(),
        }
    }

    /// Solves by the method asked for, x in relative rise, and finds the peaks. `values` are the weighted frame, `sigma` the
    /// standard deviation of one of them. Returns the ridge where falls may be tried with it.
    pub(crate) fn solve(
        &mut self,
        options: &ReconstructorOptions,
        pictures: &mut Pictures,
        values: &[f64],
        (sigma, polarity): (f64, Polarity),
        result: &mut FrameResult,
    ) -> Option<f64> {
        result.x.resize(self.cells, 0.0);
        if options.method == Method::Nnls {
            let ridge = match polarity {
                Polarity::Down => {
                    self.turned.clear();
                    self.turned.extend(values.iter().map(|v| -v));
                    let turned = std::mem::take(&mut self.turned);
                    let ridge = Self::solve_nnls(options, pictures, &turned, sigma, result);
                    self.turned = turned;
                    result.x.iter_mut().for_each(|x| *x = -*x);
                    ridge
                }
                _ => Self::solve_nnls(options, pictures, values, sigma, result),
            };
            self.find(polarity, result);
            return Some(ridge);
        }
        let problem = &pictures.problem;
        let b = DVector::from_column_slice(values);
        let solution = match options.method {
            Method::LawsonHanson => lawson_hanson(problem, &b),
            Method::PseudoInverse => pseudo_inverse(problem, &b),
            _ => {
                // What the model gets wrong cannot be explained by any ridge: then that of the expected rise.
                let ridge = discrepancy_ridge(problem, &b, sigma).max(sigma / options.expected_rise);
                let mut solution = tikhonov(problem, &b, ridge);
                pictures.scale(solution.x.as_mut_slice());
                solution
            }
        };
        result.x.copy_from_slice(solution.x.as_slice());
        (result.residual, result.gap, result.status) = (solution.residual, solution.gap, solution.status);
        self.find(polarity, result);
        None
    }

    fn solve_nnls(
        options: &ReconstructorOptions,
        pictures: &mut Pictures,
        values: &[f64],
        sigma: f64,
        result: &mut FrameResult,
    ) -> f64 {
        let mut expected = options.expected_rise;
        let ridge = sigma / expected;
        pictures.prepare(ridge, options.drop_below_ridge, !options.sequence);
        let problem = pictures.solving.as_ref().map_or(&pictures.problem, |(_, p)| p);
        let nnls = &mut pictures.nnls;
        nnls.set_ridge(ridge);
        let mut outcome = nnls.solve_into(problem, values, &mut result.x);
        // A picture far beyond what was expected was held down by the ridge: expect more and solve again.
        for _ in 0..options.most_rescalings {
            let rises = result.x.iter().zip(&pictures.prior).map(|(x, prior)| x * prior);
            let largest = rises.fold(0.0, f64::max);
            if largest <= options.largest_over_expected * expected {
                break;
            }
            expected = largest / options.largest_over_expected;
            nnls.set_ridge(sigma / expected);
            outcome = nnls.solve_into(problem, values, &mut result.x);
        }
        pictures.scale(&mut result.x);
        (result.residual, result.gap, result.status) = (outcome.residual, outcome.gap, outcome.status);
        sigma / expected
    }

    /// Finds the touches of the picture: its peaks, and its hollows where these are allowed.
    fn find(&mut self, polarity: Polarity, result: &mut FrameResult) {
        result.touches.clear();
        if polarity != Polarity::Down {
            self.finder.find(&result.x, &mut result.touches);
        }
        if polarity != Polarity::Up {
            self.turned.clear();
            self.turned.extend(result.x.iter().map(|x| -x));
            self.finder.find(&self.turned, &mut self.hollows);
            result.touches.extend(self.hollows.drain(..).map(|t| Touch {
                // The picture is linear, and says of metal that it falls by more than there is.
                rise: (-t.rise).max(-1.0),
                total_mm2: -t.total_mm2,
                ..t
            }));
        }
    }

    /// Lets the picture fall as well as rise: where no touches explain a frame, nothing says that it only rises (metal
    /// beside a finger, say). With a voltage drive a fall somewhere looks much like a rise everywhere else, so that a
    /// picture of rises alone can explain it well and be wrong. Peaks are touches as far as the polarity allows them.
    pub(crate) fn solve_with_falls(
        &mut self,
        options: &ReconstructorOptions,
        pictures: &Pictures,
        values: &[f64],
        (ridge, polarity): (f64, Polarity),
        result: &mut FrameResult,
    ) {
        // Without a sign to keep to it is ridge regression.
        let mut solution = tikhonov(&pictures.problem, &DVector::from_column_slice(values), ridge);
        pictures.scale(solution.x.as_mut_slice());
        result.x.clear();
        result.x.extend_from_slice(solution.x.as_slice());
        (result.residual, result.gap, result.status) = (solution.residual, solution.gap, solution.status);
        self.find(Polarity::Either, result);
        let largest = |sign: f64| result.touches.iter().map(|t| sign * t.total_mm2).fold(0.0, f64::max);
        let [rise, fall] = [1.0, -1.0].map(|sign| options.least_over_fall * largest(sign));
        let highest = result.touches.iter().map(|t| t.rise.abs()).fold(0.0, f64::max);
        result.touches.retain(|t| {
            let least = if t.rise > 0.0 { fall } else { rise };
            let stands = t.total_mm2.abs() >= least && t.rise.abs() >= options.touches.least_of_strongest * highest;
            polarity.allows(t.rise) && stands
        });
        result.touches.sort_by(|a, b| b.rise.abs().total_cmp(&a.rise.abs()));
    }
}
