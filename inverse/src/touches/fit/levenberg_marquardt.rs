//! A given number of touches fitted to whitened data: Levenberg's and Marquardt's method on their parameters.

use crate::linalg::dense::{backward, cholesky, forward};
use crate::linalg::kernels::{LANES, padded};
use crate::touches::fit::interpolation::{add_scaled, normal};
use crate::touches::fit::responses::TouchTable;
use crate::touches::fit::{Disc, Discs, FitOptions, MOST_TOUCHES};
use pulp::Arch;

/// Parameters of a touch, in the order of the Jacobian's columns: x, y, radius, strength.
pub const PARAMETERS: usize = 4;
/// A step that promises less than this of chi-square ends the fit: a thirtieth of a standard deviation.
const LEAST_GAIN: f64 = 1e-3;
/// Most steps of a fit from a rough start.
pub const MOST_STEPS: usize = 24;
/// Most steps of a fit from the touches of the frame before.
pub const FEW_STEPS: usize = 8;
/// A touch moves at most this part of its expected radius in one step.
const LONGEST_STEP: f64 = 0.5;
/// A whisker of damping keeps a singular problem solvable.
const WHISKER: f64 = 1e-12;

/// A fit of some touches.
#[derive(Clone, Debug, Default)]
pub struct Fit {
    /// The touches, strengths in units of the noise.
    pub discs: Discs,
    /// Sum of squares of the residual, in units of the noise's variance.
    pub square: f64,
    /// The same with the penalty of the priors: what is minimised.
    pub objective: f64,
    /// What it cost: evaluations of the model, one for every touch.
    pub work: usize,
    /// What is left of the data, with the zeros that follow.
    pub residual: Vec<f64>,
    /// Columns of the Jacobian, one after the other, of the residual's length.
    pub jacobian: Vec<f64>,
    /// Normal equations: lower triangle, column by column; and the right-hand side.
    normal: Vec<f64>,
    gradient: Vec<f64>,
}

/// Fits that are not in use, and what a fit needs besides: nothing is allocated once they are as large as they get.
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
            column[j] += damping + WHISKER;
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

impl Fit {
    /// The touches' model against the data: residual, Jacobian, normal equations.
    fn evaluate(&mut self, table: &TouchTable, options: &FitOptions, data: &[f64], discs: &[Disc]) {
        let n = table.stride();
        let arch = table.arch();
        let count = PARAMETERS * discs.len();
        self.discs.clear();
        self.discs.extend(discs.iter().copied());
        self.residual.clear();
        self.residual.extend_from_slice(data);
        self.jacobian.resize(count * n, 0.0);
        self.normal.resize(count * count, 0.0);
        self.gradient.resize(count, 0.0);
        let mut penalty = 0.0;
        self.square = data.iter().map(|v| v * v).sum();
        for (d, block) in discs.iter().zip(self.jacobian.chunks_exact_mut(PARAMETERS * n)) {
            let (x, rest) = block.split_at_mut(n);
            let (y, rest) = rest.split_at_mut(n);
            let (radius, strength) = rest.split_at_mut(n);
            table.at(d.at, d.radius, [&mut *strength, &mut *x, &mut *y, &mut *radius]);
            self.square = add_scaled(arch, strength, -d.strength, &mut self.residual);
            for column in [x, y, radius] {
                column.iter_mut().for_each(|v| *v *= d.strength);
            }
            penalty += options.radius_prior(d.radius).penalty;
        }
        self.objective = self.square + penalty;
        normal(
            arch,
            &self.jacobian,
            &self.residual,
            &mut self.normal,
            &mut self.gradient,
        );
        for (k, d) in discs.iter().enumerate() {
            let at = PARAMETERS * k + 2;
            let prior = options.radius_prior(d.radius);
            self.normal[at * count + at] += prior.curvature;
            self.gradient[at] -= prior.slope;
        }
    }
}

/// Fits touches from a start to data of [`TouchTable::stride`] entries, in at most so many steps. `None` when a number is not
/// finite.
pub fn fit(
    table: &TouchTable,
    options: &FitOptions,
    data: &[f64],
    start: &[Disc],
    most_steps: usize,
    work: &mut Workspace,
) -> Option<Fit> {
    let arch = table.arch();
    let most = options.most_touches.min(MOST_TOUCHES);
    let mut best = work.take(data.len(), most);
    best.evaluate(table, options, data, start);
    let mut next = work.take(data.len(), most);
    let [smallest, largest] = table.radii_mm();
    let mut damping = 1e-3;
    let mut evaluations = 1;
    for _ in 0..most_steps {
        if best.discs.is_empty() || !best.objective.is_finite() || !work.factor.set(arch, &best, damping) {
            break;
        }
        work.factor.solve(arch, &best.gradient);
        let step = &work.factor.step;
        let promise: f64 = step.iter().zip(&best.gradient).map(|(s, g)| s * g).sum();
        if !promise.is_finite() || promise < LEAST_GAIN {
            break;
        }
        let mut discs = best.discs.clone();
        for (d, s) in discs.iter_mut().zip(step.chunks_exact(PARAMETERS)) {
            let length = s[0].hypot(s[1]);
            let shorten = (LONGEST_STEP * options.radius_mm / length.max(f64::MIN_POSITIVE)).min(1.0);
            let moved = [d.at[0] + shorten * s[0], d.at[1] + shorten * s[1]];
            *d = Disc {
                at: if table.holds(moved) { moved } else { d.at },
                radius: (d.radius + s[2]).clamp(smallest, largest),
                // A strength stays positive: it may fall to a tenth in one step.
                strength: (d.strength + s[3]).max(0.1 * d.strength),
            };
        }
        next.evaluate(table, options, data, &discs);
        evaluations += 1;
        if next.objective < best.objective {
            let gain = best.objective - next.objective;
            std::mem::swap(&mut best, &mut next);
            damping = (0.2 * damping).max(1e-7);
            if gain < LEAST_GAIN {
                break;
            }
        } else {
            damping *= 8.0;
            if damping > 1e6 {
                break;
            }
        }
    }
    work.put(next);
    best.work = evaluations * start.len();
    if best.objective.is_finite() {
        return Some(best);
    }
    work.put(best);
    None
}
