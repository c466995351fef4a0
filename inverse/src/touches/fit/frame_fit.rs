//! The fit of one frame: from the data to touches with their uncertainty.

use crate::touches::fit::disc::{Disc, Discs, MOST_TOUCHES};
use crate::touches::fit::interpolation;
use crate::touches::fit::levenberg_marquardt::PARAMETERS;
use crate::touches::fit::model_order::{Before, DiscModel, Scratch, Search};
use crate::touches::fit::prior::FitOptions;
use crate::touches::fit::responses::ResponseTable;
use crate::touches::polarity::Polarity;
use crate::touches::touch::Touch;
use arrayvec::ArrayVec;
use std::f64::consts::PI;

/// Relative error of the integrated rise that more measurements would not lessen. Where the linear model is good enough
/// for the places of touches, it is off by as much for their strengths: the totals of single touches in docs/results.md
/// (`touch_accuracy`, column "total") are 1.01.
const TOTAL_ERROR: f64 = 0.01;

/// The strongest touch over the weakest: +300 % and the least that shows.
const STRENGTHS: f64 = 1000.0;

/// The outcome of a fit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Fitted {
    /// The touches with their standard uncertainties, strongest (by peak rise) first.
    pub touches: Vec<Touch>,
    /// The discs behind, in the same order.
    pub discs: Discs,
    /// Norm of the response to every one of them over the noise.
    pub norms: ArrayVec<f64, MOST_TOUCHES>,
    /// Strength of every one of them over its standard deviation; infinite where that is not determined.
    pub significances: ArrayVec<f64, MOST_TOUCHES>,
    /// All discs that were fitted, also those too weak for touches. The next frame's fit begins at them.
    pub all: Discs,
    /// Which of those every touch is.
    pub places: ArrayVec<usize, MOST_TOUCHES>,
    /// Covariances of the parameters of all discs ([`PARAMETERS`] each, mm and strength over `sigma`), column by column;
    /// empty where the data do not determine them.
    pub covariance: Vec<f64>,
    /// Standard deviation of a value, V, and the variance of a whitened one that the covariances are for.
    pub sigma: f64,
    /// See [`Fitted::sigma`].
    pub variance: f64,
    /// Whether they are those of the frame before, followed.
    pub followed: bool,
    /// Whether the search for them came to its end, or there was none.
    pub finished: bool,
    /// Whether there was no search, since no touches would explain the frame.
    pub hopeless: bool,
    /// What the search cost, in evaluations of the response to one touch.
    pub work: usize,
    /// Whether the linearisation error taken off the data was that of these touches, as far as it matters.
    pub settled: bool,
    /// Mean square of the whitened residual per degree of freedom: 1 where noise explains it.
    pub misfit: f64,
    /// Norm of the residual over the norm of the data.
    pub relative_residual: f64,
    /// Data minus model over the noise, of [`stride`](crate::touches::fit::responses::ResponseTable::stride) entries.
    pub residual_whitened: Vec<f64>,
    /// Chi-square with the priors' penalty, and the number of parameters.
    pub cost: f64,
    /// What makes it minus twice the logarithm of the frame's probability with so many touches somewhere, but for a constant: by how much
    /// the priors are wider than what the frame leaves (Laplace's approximation; MacKay, Neural Computation 4, 1992).
    pub open: f64,
    /// Jacobian: derivatives of the whitened data by the parameters of all discs that were fitted
    /// ([`PARAMETERS`] each), a column of as many entries for each.
    pub slopes: Vec<f64>,
}

impl Fitted {
    /// Forgets all that it said of its frame, and keeps the room.
    pub(super) fn forget(&mut self) {
        let before = std::mem::take(self);
        (self.touches, self.covariance) = (before.touches, before.covariance);
        (self.residual_whitened, self.slopes) = (before.residual_whitened, before.slopes);
        self.touches.clear();
        self.covariance.clear();
        self.residual_whitened.clear();
        self.slopes.clear();
    }

    /// With room for so many touches in data of this stride: no frame is then to allocate.
    pub(super) fn with_room(stride: usize, most: usize) -> Self {
        let count = PARAMETERS * most;
        Self {
            touches: Vec::with_capacity(most),
            covariance: Vec::with_capacity(count * count),
            residual_whitened: Vec::with_capacity(stride),
            slopes: Vec::with_capacity(stride * count),
            ..Self::default()
        }
    }

    /// The touches whose strength is at least so many of its standard deviations.
    pub fn standing_out(&self, least_significance: f64) -> impl Iterator<Item = &Touch> {
        let strengths = self.touches.iter().zip(&self.significances);
        strengths
            .filter(move |(_, s)| **s >= least_significance)
            .map(|(t, _)| t)
    }
}

/// What is to be fitted.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// The data in the space of the table, V.
    pub values: &'a [f64],
    /// Standard deviation of one of them, V.
    pub sigma: f64,
    /// Fall of chi-square that an additional touch must bring
    /// ([`chi_square_threshold`](crate::touches::fit::model_order::chi_square_threshold)).
    pub chi_square_threshold: f64,
    /// Part of the data that the model may get wrong, 0 to 1: no touch is added for less.
    pub error: f64,
    /// Which way touches change the resistivity.
    pub polarity: Polarity,
    /// What the search may cost: see [`most_work`](crate::touches::fit::prior::FitOptions::most_work).
    pub most_work: usize,
}

/// Touches to start with, asked for only where they are needed. Those without a strength get one. None where no touches would explain the
/// frame: then none are looked for.
pub type Seeds<'a> = &'a mut dyn FnMut() -> Option<Discs>;

/// Where a fit begins.
pub struct Start<'a> {
    /// Touches to start with where there is no frame before, or it is not followed.
    pub seeds: Seeds<'a>,
    /// The frame before, to be followed from.
    pub before: Option<Before<'a>>,
}

/// Fits touches to a frame.
///
/// `None` when lengths do not match or a number is not finite; `out` is then what it was.
pub fn fit(model: DiscModel, frame: Frame, start: Start, scratch: &mut Scratch, out: &mut Fitted) -> Option<()> {
    let mut whitened = std::mem::take(&mut scratch.whitened);
    whitened.clear();
    whitened.extend(frame.values.iter().map(|v| v / frame.sigma));
    let fits = whitened.len() == model.table.length();
    whitened.resize(model.table.stride(), 0.0);
    let outcome = if fits {
        fit_whitened(model, frame, &whitened, start, scratch, out)
    } else {
        None
    };
    scratch.whitened = whitened;
    outcome
}

fn fit_whitened(
    model: DiscModel,
    frame: Frame,
    whitened: &[f64],
    start: Start,
    scratch: &mut Scratch,
    out: &mut Fitted,
) -> Option<()> {
    let DiscModel { table, prior, .. } = model;
    let sigma = frame.sigma;
    let norm = whitened.iter().map(|v| v * v).sum::<f64>().sqrt();
    let chi_square_threshold = frame.chi_square_threshold + (frame.error * norm).powi(2);
    let in_noise = |discs: &[Disc]| -> Discs {
        let of = |d: &Disc| Disc {
            strength: d.strength / sigma,
            ..*d
        };
        discs.iter().take(MOST_TOUCHES).map(of).collect()
    };
    let discs_before = start.before.map_or_else(Discs::new, |b| in_noise(b.discs));
    let before = start.before.map(|b| Before {
        discs: &discs_before,
        ..b
    });
    let search = Search::new(model, whitened, chi_square_threshold, scratch)?
        .within(frame.most_work)
        .of(frame.polarity);
    let seeds = start.seeds;
    let found = search.run(&mut || seeds().map(|discs| in_noise(&discs)), before)?;
    let best = found.fit;
    let freedom = (table.length() as f64 - 3.0 * best.discs.len() as f64).max(1.0);
    let misfit = best.square / freedom;
    // Variance of one value over sigma²: the noise, or the misfit where that is larger, and the model's own error.
    let model_error = prior.model_error.max(frame.error) * norm;
    let variance = misfit.max(1.0) + model_error * model_error / freedom;
    let covariance = scratch.work.covariance(table.arch(), &best);
    let count = PARAMETERS * best.discs.len();
    let parameters = match &covariance {
        Some(covariance) => {
            occam(table, prior, &best.discs) - count as f64 * variance.ln() - covariance.log_determinant()
        }
        None => count as f64,
    };
    out.covariance.clear();
    if let Some(covariance) = covariance {
        let all = (0..count * count).map(|k| variance * covariance.of(k % count, k / count));
        out.covariance.extend(all);
    }
    let n = table.stride();
    let norm_of = |k: usize, d: &Disc| {
        let response = &best.jacobian[(PARAMETERS * k + 3) * n..][..n];
        d.strength.abs() * interpolation::dot(table.arch(), response, response).sqrt()
    };
    (out.followed, out.finished, out.settled) = (found.followed, found.finished, true);
    out.hopeless = found.hopeless;
    out.work = found.work;
    (out.sigma, out.variance) = (sigma, variance);
    let mut found: ArrayVec<(Touch, Disc, f64, usize), MOST_TOUCHES> = best
        .discs
        .iter()
        .enumerate()
        .map(|(k, d)| {
            let disc = Disc {
                strength: d.strength * sigma,
                ..*d
            };
            let of = |i: usize, j: usize| out.covariance.get((4 * k + j) * count + 4 * k + i).copied();
            (touch_of(&disc, sigma, of), disc, norm_of(k, d), k)
        })
        .collect();
    out.all = found.iter().map(|f| f.1).collect();
    found.sort_unstable_by(|a, b| b.0.rise.abs().total_cmp(&a.0.rise.abs()));
    let strongest = found.iter().map(|f| f.0.total_mm2.abs()).fold(0.0, f64::max);
    let least = prior.least_of_strongest * strongest;
    found.retain(|(t, ..)| t.total_mm2.abs() >= least && t.rise.abs() >= prior.least_rise);
    out.touches.clear();
    out.touches.extend(found.iter().map(|f| f.0));
    out.discs = found.iter().map(|f| f.1).collect();
    out.norms = found.iter().map(|f| f.2).collect();
    out.significances = found
        .iter()
        .map(|(_, disc, _, k)| {
            let variance = out.covariance.get((4 * k + 3) * (count + 1)).copied();
            significance(disc, sigma, variance)
        })
        .collect();
    out.places = found.iter().map(|f| f.3).collect();
    out.misfit = misfit;
    out.relative_residual = best.square.sqrt() / norm.max(f64::MIN_POSITIVE);
    out.residual_whitened.clear();
    out.residual_whitened.extend_from_slice(&best.residual);
    out.cost = best.objective + count as f64;
    out.open = parameters - count as f64;
    out.slopes.clear();
    out.slopes.extend_from_slice(&best.jacobian);
    scratch.work.put(best);
    Some(())
}

/// Minus twice the logarithm of the priors' density at these discs (strengths over the noise), each with the expected radius, times
/// the volume of a unit of all parameters: any place on the sheet is as probable, and any size of the strength.
fn occam(table: &ResponseTable, prior: &FitOptions, discs: &[Disc]) -> f64 {
    let area = table.area_mm2();
    let one = |disc: &Disc| {
        let of_strength = disc.strength.abs() * STRENGTHS.ln();
        let of_radius = (2.0 * PI).sqrt() * prior.radius_sd_mm;
        2.0 * (area * of_radius * of_strength).ln() - PARAMETERS as f64 * (2.0 * PI).ln()
    };
    discs.iter().map(one).sum()
}

/// Strength of a disc over its standard deviation; `variance` is over `sigma²`.
pub(super) fn significance(disc: &Disc, sigma: f64, variance: Option<f64>) -> f64 {
    variance.map_or(f64::INFINITY, |v| disc.strength.abs() / (sigma * v.max(0.0).sqrt()))
}

/// The touch that a disc is. `of` gives the covariances of its parameters, the strength's over `sigma`.
pub(super) fn touch_of(disc: &Disc, sigma: f64, of: impl Fn(usize, usize) -> Option<f64>) -> Touch {
    let rise = disc.rise();
    let sd = |variance: f64| variance.max(0.0).sqrt();
    let [by_radius, by_strength] = disc.total_slopes();
    let by_strength = by_strength * sigma;
    let total_variance = || {
        let (radius, strength, both) = (of(2, 2)?, of(3, 3)?, of(2, 3)?);
        Some(
            by_radius * by_radius * radius
                + by_strength * by_strength * strength
                + 2.0 * by_radius * by_strength * both,
        )
    };
    Touch {
        id: None,
        x_mm: disc.at[0],
        y_mm: disc.at[1],
        rise,
        at_limit: disc.is_at_limit(),
        area_mm2: disc.area_mm2(),
        total_mm2: rise * disc.area_mm2(),
        x_sd_mm: of(0, 0).map(sd),
        y_sd_mm: of(1, 1).map(sd),
        area_sd_mm2: of(2, 2).map(|v| 2.0 * PI * disc.radius * sd(v)),
        total_sd_mm2: total_variance().map(|v| sd(v).hypot(TOTAL_ERROR * rise * disc.area_mm2())),
        force_n: None,
        uncalibrated: false,
        frames: 0,
    }
}
