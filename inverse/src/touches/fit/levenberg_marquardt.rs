//! A given number of touches fitted to whitened data: Levenberg's and Marquardt's method on their parameters.

use crate::linalg::dense::{backward, cholesky, forward};
use crate::linalg::kernels::{LANES, padded};
use crate::touches::fit::disc::{Disc, Discs, MOST_TOUCHES};
use crate::touches::fit::interpolation::{add_scaled, normal};
use crate::touches::fit::prior::FitOptions;
use crate::touches::fit::responses::ResponseTable;
use pulp::Arch;

/// Parameters of a touch, in the order of the Jacobian's columns: x, y, radius, strength.
pub const PARAMETERS: usize = 4;
/// Added to the scaled diagonal of the normal equations, which is 1: it keeps a singular problem solvable and is far
/// below what changes a step.
const DIAGONAL_FLOOR: f64 = 1e-12;

/// When a fit ends, and how far one step goes.
///
/// No experiment is on record for a single field: the values were chosen by hand. The accuracy that they give together
/// is in docs/results.md (`touch_accuracy`), their cost in docs/benchmarks.md (`skin bench cost`, column `median`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevenbergMarquardtOptions {
    /// Least fall of chi-square that a step must promise, or bring, for the fit to go on. More ends fits earlier and
    /// less exactly. 1e-3 is a thirtieth of a standard deviation.
    pub least_gain: f64,
    /// Most steps of a fit from a rough start. Fewer cost less where touches are far from their start.
    pub most_steps: usize,
    /// Most steps of a fit from the touches of the frame before. More follow faster touches, and cost more in frames
    /// that show something else.
    pub few_steps: usize,
    /// Longest move of a touch in one step, as a fraction of its expected radius. More converges in fewer steps, and
    /// overshoots more often: the model is not linear in the place.
    pub longest_step: f64,
    /// Least strength after a step, as a fraction of that before: a strength keeps its sign.
    pub least_strength: f64,
    /// How the damping follows the steps.
    pub damping: Damping,
}

impl Default for LevenbergMarquardtOptions {
    fn default() -> Self {
        Self {
            least_gain: 1e-3,
            most_steps: 24,
            few_steps: 8,
            longest_step: 0.5,
            least_strength: 0.1,
            damping: Damping::default(),
        }
    }
}

/// Marquardt's damping: what is added to the diagonal of the normal equations, which is scaled to 1.
///
/// Much damping makes short steps down the gradient, little makes Gauss-Newton steps. Chosen by hand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Damping {
    /// Of the first step.
    pub first: f64,
    /// Factor after a step that lowers the objective, below 1.
    pub after_success: f64,
    /// Factor after a step that does not, above 1.
    pub after_failure: f64,
    /// Least damping.
    pub least: f64,
    /// Above this damping no step lowers the objective: the fit ends.
    pub most: f64,
}

impl Default for Damping {
    fn default() -> Self {
        Self {
            first: 1e-3,
            after_success: 0.2,
            after_failure: 8.0,
            least: 1e-7,
            most: 1e6,
        }
    }
}

/// Why a fit ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ended {
    /// After the most steps allowed.
    #[default]
    MostSteps,
    /// No step promises, or brings, a fall of chi-square that matters.
    Converged,
    /// There was no touch to fit.
    NoTouches,
    /// The objective, or what a step promises, is not finite.
    NotFinite,
    /// The normal equations cannot be factorised.
    Singular,
    /// No step lowers the objective, however much it is damped.
    NoDescent,
}

/// A fit of some touches.
#[derive(Clone, Debug, Default)]
pub struct Fit {
    /// The touches, strengths in units of the noise.
    pub discs: Discs,
    /// Sum of squares of the residual, in units of the noise's variance.
    pub square: f64,
    /// The same with the penalty of the priors: what is minimised.
    pub objective: f64,
    /// What it cost: evaluations of the response to one touch.
    pub work: usize,
    /// Why it ended.
    pub ended: Ended,
    /// Data minus model over the noise, with the zeros that follow.
    pub residual: Vec<f64>,
    /// Columns of the Jacobian, one after the other, of the residual's length.
    pub jacobian: Vec<f64>,
    /// Normal equations: lower triangle, column by column; and the right-hand side.
    normal: Vec<f64>,
    gradient: Vec<f64>,
}

/// Fits that are not in use, and room for the factor. Nothing is allocated once they are as large as they get.
#[derive(Clone, Debug, Default)]
pub struct Workspace {
    spare: Vec<Fit>,
    factor: Factor,
}

impl Workspace {
    fn take(&mut self, stride: usize, most: usize) -> Fit {
        let mut fit = self.spare.pop().unwrap_or_default();
        // Room for as many touches as there can be: a fit that grew later would be the one frame that takes longer.
        let count = PARAMETERS * most;
        for (numbers, room) in [
            (&mut fit.residual, stride),
            (&mut fit.jacobian, stride * count),
            (&mut fit.normal, count * count),
            (&mut fit.gradient, count),
        ] {
            numbers.reserve(room.saturating_sub(numbers.len()));
        }
        fit
    }

    /// Takes a fit back.
    pub fn put(&mut self, fit: Fit) {
        self.spare.push(fit);
    }

    /// Covariances of the parameters of a fit for noise of unit variance; `None` where the data do not determine them.
    pub fn covariance(&mut self, arch: Arch, fit: &Fit) -> Option<Covariance<'_>> {
        self.factor.covariance(arch, fit)
    }
}

/// Covariances of a fit's parameters, counted touch by touch in the order of [`PARAMETERS`].
#[derive(Clone, Copy, Debug)]
pub struct Covariance<'a> {
    /// Columns of the inverse of the factor.
    columns: &'a [f64],
    rows: usize,
    scale: &'a [f64],
}

impl Covariance<'_> {
    /// Logarithm of the determinant of the covariance of all parameters.
    pub fn log_determinant(&self) -> f64 {
        let diagonal = self
            .scale
            .iter()
            .enumerate()
            .map(|(k, s)| self.columns[k * self.rows + k] * s);
        diagonal.map(|d| 2.0 * d.ln()).sum()
    }

    /// Of the parameters i and j.
    pub fn of(&self, i: usize, j: usize) -> f64 {
        // The inverse of L L^T holds the products of the columns of L^-1.
        let column = |k: usize| &self.columns[k * self.rows..(k + 1) * self.rows];
        let product: f64 = column(i).iter().zip(column(j)).map(|(a, b)| a * b).sum();
        product * self.scale[i] * self.scale[j]
    }
}

/// Cholesky factor of a fit's normal equations with the diagonal scaled to 1 and damped.
#[derive(Clone, Debug, Default)]
struct Factor {
    l: Vec<f64>,
    inverse: Vec<f64>,
    scale: Vec<f64>,
    step: Vec<f64>,
    columns: Vec<f64>,
}

impl Factor {
    fn set(&mut self, arch: Arch, fit: &Fit, damping: f64) -> bool {
        let count = fit.gradient.len();
        let rows = padded(count, LANES);
        self.scale.clear();
        self.scale.extend((0..count).map(|k| {
            let d = fit.normal[k * count + k];
            if d > 0.0 { 1.0 / d.sqrt() } else { 1.0 }
        }));
        self.l.clear();
        self.l.resize(rows * rows, 0.0);
        self.inverse.clear();
        self.inverse.resize(rows, 0.0);
        for (j, column) in self.l.chunks_exact_mut(rows.max(1)).enumerate() {
            if j >= count {
                column[j] = 1.0;
                continue;
            }
            let below = column[j..count].iter_mut().zip(&self.scale[j..]);
            for ((out, scale), v) in below.zip(&fit.normal[j * count + j..(j + 1) * count]) {
                *out = v * scale * self.scale[j];
            }
            column[j] += damping + DIAGONAL_FLOOR;
        }
        cholesky(arch, &mut self.l, &mut self.inverse)
    }

    /// Solves for a right-hand side; the step is left in `step`.
    fn solve(&mut self, arch: Arch, right: &[f64]) {
        self.step.clear();
        self.step.extend(right.iter().zip(&self.scale).map(|(r, s)| r * s));
        self.step.resize(self.inverse.len(), 0.0);
        forward(arch, &self.l, &self.inverse, &mut self.step);
        backward(arch, &self.l, &self.inverse, &mut self.step);
        self.step.truncate(right.len());
        for (step, scale) in self.step.iter_mut().zip(&self.scale) {
            *step *= scale;
        }
    }

    fn covariance(&mut self, arch: Arch, fit: &Fit) -> Option<Covariance<'_>> {
        if !self.set(arch, fit, 0.0) {
            return None;
        }
        let rows = self.inverse.len();
        self.columns.clear();
        self.columns.resize(fit.gradient.len() * rows, 0.0);
        for (k, column) in self.columns.chunks_exact_mut(rows.max(1)).enumerate() {
            column[k] = 1.0;
            forward(arch, &self.l, &self.inverse, column);
        }
        Some(Covariance {
            columns: &self.columns,
            rows,
            scale: &self.scale,
        })
    }
}

/// What is fitted, and how.
#[derive(Clone, Copy)]
struct Task<'a> {
    table: &'a ResponseTable,
    prior: &'a FitOptions,
    options: &'a LevenbergMarquardtOptions,
    data: &'a [f64],
}

impl Task<'_> {
    /// The touches' model against the data: residual, Jacobian, normal equations.
    fn evaluate(&self, fit: &mut Fit, discs: &[Disc]) {
        let Self { table, prior, data, .. } = *self;
        let n = table.stride();
        let arch = table.arch();
        let count = PARAMETERS * discs.len();
        fit.discs.clear();
        fit.discs.extend(discs.iter().copied());
        fit.residual.clear();
        fit.residual.extend_from_slice(data);
        fit.jacobian.resize(count * n, 0.0);
        fit.normal.resize(count * count, 0.0);
        fit.gradient.resize(count, 0.0);
        let mut penalty = 0.0;
        fit.square = data.iter().map(|v| v * v).sum();
        for (d, block) in discs.iter().zip(fit.jacobian.chunks_exact_mut(PARAMETERS * n)) {
            let (x, rest) = block.split_at_mut(n);
            let (y, rest) = rest.split_at_mut(n);
            let (radius, strength) = rest.split_at_mut(n);
            table.at(d.at, d.radius, [&mut *strength, &mut *x, &mut *y, &mut *radius]);
            fit.square = add_scaled(arch, strength, -d.strength, &mut fit.residual);
            for column in [x, y, radius] {
                column.iter_mut().for_each(|v| *v *= d.strength);
            }
            penalty += prior.radius_prior(d.radius).penalty;
        }
        fit.objective = fit.square + penalty;
        normal(arch, &fit.jacobian, &fit.residual, &mut fit.normal, &mut fit.gradient);
        for (k, d) in discs.iter().enumerate() {
            let at = PARAMETERS * k + 2;
            let prior = prior.radius_prior(d.radius);
            fit.normal[at * count + at] += prior.curvature;
            fit.gradient[at] -= prior.slope;
        }
    }

    /// The touches after a step, as far as they may go in one.
    fn after(&self, step: &[f64], discs: &Discs) -> Discs {
        let [smallest, largest] = self.table.radii_mm();
        let longest = self.options.longest_step * self.prior.radius_mm;
        let mut discs = discs.clone();
        for (d, s) in discs.iter_mut().zip(step.chunks_exact(PARAMETERS)) {
            let length = s[0].hypot(s[1]);
            let shorten = (longest / length.max(f64::MIN_POSITIVE)).min(1.0);
            let moved = [d.at[0] + shorten * s[0], d.at[1] + shorten * s[1]];
            let (strength, least) = (d.strength + s[3], self.options.least_strength * d.strength);
            *d = Disc {
                at: if self.table.holds(moved) { moved } else { d.at },
                radius: (d.radius + s[2]).clamp(smallest, largest),
                strength: if strength.abs() < least.abs() || strength * least < 0.0 {
                    least
                } else {
                    strength
                },
            };
        }
        discs
    }

    /// Lowers the objective of `best`, which is evaluated, in at most so many steps; `next` is room for a trial.
    /// Returns why that ended, and how many trials there were.
    fn descend(&self, best: &mut Fit, next: &mut Fit, factor: &mut Factor, most_steps: usize) -> (Ended, usize) {
        let (arch, options) = (self.table.arch(), self.options);
        let mut damping = options.damping.first;
        if best.discs.is_empty() {
            return (Ended::NoTouches, 0);
        }
        for trials in 0..most_steps {
            if !best.objective.is_finite() {
                return (Ended::NotFinite, trials);
            }
            if !factor.set(arch, best, damping) {
                return (Ended::Singular, trials);
            }
            factor.solve(arch, &best.gradient);
            let promise: f64 = factor.step.iter().zip(&best.gradient).map(|(s, g)| s * g).sum();
            if !promise.is_finite() {
                return (Ended::NotFinite, trials);
            }
            if promise < options.least_gain {
                return (Ended::Converged, trials);
            }
            self.evaluate(next, &self.after(&factor.step, &best.discs));
            if next.objective < best.objective {
                let gain = best.objective - next.objective;
                std::mem::swap(best, next);
                damping = (options.damping.after_success * damping).max(options.damping.least);
                if gain < options.least_gain {
                    return (Ended::Converged, trials + 1);
                }
            } else {
                damping *= options.damping.after_failure;
                if damping > options.damping.most {
                    return (Ended::NoDescent, trials + 1);
                }
            }
        }
        (Ended::MostSteps, most_steps)
    }
}

/// Fits touches from a start to data of [`ResponseTable::stride`] entries, in at most so many steps. `None` when the
/// objective is not finite.
pub fn fit(
    table: &ResponseTable,
    prior: &FitOptions,
    options: &LevenbergMarquardtOptions,
    data: &[f64],
    start: &[Disc],
    most_steps: usize,
    work: &mut Workspace,
) -> Option<Fit> {
    let task = Task {
        table,
        prior,
        options,
        data,
    };
    let most = prior.most_touches.min(MOST_TOUCHES);
    let mut best = work.take(data.len(), most);
    task.evaluate(&mut best, start);
    let mut next = work.take(data.len(), most);
    let (ended, trials) = task.descend(&mut best, &mut next, &mut work.factor, most_steps);
    work.put(next);
    best.ended = ended;
    best.work = (1 + trials) * start.len();
    if best.objective.is_finite() {
        return Some(best);
    }
    work.put(best);
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::{Drive, Model, ModelOptions, Pattern, Sheet};
    use std::sync::Arc;

    /// Every way out that data can bring about.
    #[test]
    fn a_fit_says_why_it_ended() {
        let model = Arc::new(Model::new(&Sheet::paper(), &ModelOptions::default()).unwrap());
        let table = ResponseTable::new(&model, Drive::PAPER, &Pattern::adjacent(16).unwrap(), 12.5).unwrap();
        let prior = FitOptions::for_extent(97.5);
        let options = LevenbergMarquardtOptions::default();
        let truth = Disc {
            at: [10.0, -20.0],
            radius: 12.5,
            strength: 80.0,
        };
        let [mut value, mut x, mut y, mut radius]: [Vec<f64>; 4] = std::array::from_fn(|_| vec![0.0; table.stride()]);
        table.at(truth.at, truth.radius, [&mut value, &mut x, &mut y, &mut radius]);
        // A noise of a ten thousandth of the response.
        let sigma = 1e-4 * value.iter().map(|v| v * v).sum::<f64>().sqrt();
        let data: Vec<f64> = value.iter().map(|v| truth.strength * v / sigma).collect();
        let start = Disc {
            at: [16.0, -16.0],
            strength: 50.0 / sigma,
            ..truth
        };
        let mut work = Workspace::default();
        let mut fit_to = |data: &[f64], start: &[Disc], most_steps| {
            fit(&table, &prior, &options, data, start, most_steps, &mut work)
        };
        let found = fit_to(&data, &[start], options.most_steps).unwrap();
        assert_eq!(found.ended, Ended::Converged);
        assert!((found.discs[0].at[0] - 10.0).hypot(found.discs[0].at[1] + 20.0) < 1e-3);
        assert_eq!(fit_to(&data, &[start], 1).unwrap().ended, Ended::MostSteps);
        assert_eq!(fit_to(&data, &[], options.most_steps).unwrap().ended, Ended::NoTouches);
        let nan = vec![f64::NAN; data.len()];
        assert!(fit_to(&nan, &[start], options.most_steps).is_none());
    }
}
