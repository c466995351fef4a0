//! The fit of one frame: from the data to touches with their uncertainty.

use crate::touches::fit::disc::{Disc, Discs, MOST_TOUCHES};
use crate::touches::fit::interpolation;
use crate::touches::fit::levenberg_marquardt::PARAMETERS;
use crate::touches::fit::model_order::{Before, Scratch, Search};
use crate::touches::fit::prior::FitOptions;
use crate::touches::fit::responses::TouchTable;
use crate::touches::touch::Touch;
use arrayvec::ArrayVec;
use std::f64::consts::PI;

/// Relative error of the integrated rise that more measurements would not lessen: where the linear model is good enough for the
/// places of touches, it is off by as much for their strengths.
const TOTAL_ERROR: f64 = 0.01;

/// The outcome of a fit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Fitted {
    /// The touches with their standard uncertainties, strongest (by peak rise) first.
    pub touches: Vec<Touch>,
    /// The discs behind, in the same order.
    pub discs: Discs,
    /// Norm of the answer to every one of them over the noise.
    pub norms: ArrayVec<f64, MOST_TOUCHES>,
    /// All discs that were fitted, also those too weak for touches: where the next frame's fit begins.
    pub all: Discs,
    /// Whether they are those that the fit began with, followed.
    pub followed: bool,
    /// Whether the search for them came to its end.
    pub finished: bool,
    /// Whether what the linear model leaves out was that of these touches, as far as it matters.
    pub settled: bool,
    /// Misfit over what the noise explains: mean square of the whitened residual per degree of freedom.
    pub misfit: f64,
    /// Norm of the residual over the norm of the data.
    pub residual: f64,
    /// What is left of the data over their noise, of [`TouchTable::stride`] entries.
    pub left: Vec<f64>,
    /// Chi-square with the priors' penalty, and the number of parameters.
    pub cost: f64,
    /// How the data answer to the parameters of all discs that were fitted, a column each of [`TouchTable::stride`] entries.
    pub slopes: Vec<f64>,
}

/// What is to be fitted.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// The data in the space of the table (volts).
    pub values: &'a [f64],
    /// Standard deviation of one of them.
    pub sigma: f64,
    /// Fall of chi-square that makes a touch believed (see [`model_order::drop`]).
    pub drop: f64,
    /// Part of the data that the model may get wrong: no touch is added for less.
    pub error: f64,
    /// What the search may cost: see [`FitOptions::most_work`].
    pub most_work: usize,
}

/// Where a fit begins.
#[derive(Clone, Copy, Debug)]
pub struct Start<'a> {
    /// Touches to start with (those without a strength get one).
    pub seeds: &'a [Disc],
    /// The frame before, to be followed from.
    pub before: Option<Before<'a>>,
}

/// Fits touches to a frame.
///
/// `None` when lengths do not match or a number is not finite; `out` is then what it was.
pub fn fit(
    table: &TouchTable,
    options: &FitOptions,
    frame: Frame,
    start: Start,
    scratch: &mut Scratch,
    out: &mut Fitted,
) -> Option<()> {
    let mut whitened = std::mem::take(&mut scratch.whitened);
    whitened.clear();
    whitened.extend(frame.values.iter().map(|v| v / frame.sigma));
    let fits = whitened.len() == table.length();
    whitened.resize(table.stride(), 0.0);
    let outcome = if fits {
        fit_whitened(table, options, frame, &whitened, start, scratch, out)
    } else {
        None
    };
    scratch.whitened = whitened;
    outcome
}

fn fit_whitened(
    table: &TouchTable,
    options: &FitOptions,
    frame: Frame,
    whitened: &[f64],
    start: Start,
    scratch: &mut Scratch,
    out: &mut Fitted,
) -> Option<()> {
    let sigma = frame.sigma;
    let norm = whitened.iter().map(|v| v * v).sum::<f64>().sqrt();
    let drop = frame.drop + (frame.error * norm).powi(2);
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
    let search = Search::new(table, options, whitened, drop, scratch)?.within(frame.most_work);
    let found = search.run(&in_noise(start.seeds), before)?;
    let best = found.fit;
    let freedom = (table.length() as f64 - 3.0 * best.discs.len() as f64).max(1.0);
    let misfit = best.square / freedom;
    // Variance of one value over sigma²: the noise, or the misfit where that is larger, and the model's own error.
    let model = options.model_error.max(frame.error) * norm;
    let variance = misfit.max(1.0) + model * model / freedom;
    let covariance = scratch.work.covariance(table.arch(), &best);
    let n = table.stride();
    let norm_of = |k: usize, d: &Disc| {
        let answer = &best.jacobian[(PARAMETERS * k + 3) * n..][..n];
        d.strength * interpolation::dot(table.arch(), answer, answer).sqrt()
    };
    (out.followed, out.finished, out.settled) = (found.followed, found.finished, true);
    let mut found: ArrayVec<(Touch, Disc, f64), MOST_TOUCHES> = best
        .discs
        .iter()
        .enumerate()
        .map(|(k, d)| {
            let disc = Disc {
                strength: d.strength * sigma,
                ..*d
            };
            let rise = disc.rise();
            let sd = |variance_of: f64| (variance_of.max(0.0) * variance).sqrt();
            let of = |i: usize, j: usize| covariance.as_ref().map(|c| c.of(4 * k + i, 4 * k + j));
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
            let touch = Touch {
                id: None,
                x_mm: disc.at[0],
                y_mm: disc.at[1],
                rise,
                area_mm2: disc.area_mm2(),
                total_mm2: rise * disc.area_mm2(),
                x_sd_mm: of(0, 0).map(sd),
                y_sd_mm: of(1, 1).map(sd),
                area_sd_mm2: of(2, 2).map(|v| 2.0 * PI * disc.radius * sd(v)),
                total_sd_mm2: total_variance().map(|v| sd(v).hypot(TOTAL_ERROR * rise * disc.area_mm2())),
                force_n: None,
            };
            (touch, disc, norm_of(k, d))
        })
        .collect();
    out.all = found.iter().map(|f| f.1).collect();
    found.sort_unstable_by(|a, b| b.0.rise.total_cmp(&a.0.rise));
    let strongest = found.iter().map(|f| f.0.total_mm2).fold(0.0, f64::max);
    found.retain(|(t, ..)| t.total_mm2 >= options.least_of_strongest * strongest && t.rise >= options.least_rise);
    out.touches.clear();
    out.touches.extend(found.iter().map(|f| f.0));
    out.discs = found.iter().map(|f| f.1).collect();
    out.norms = found.iter().map(|f| f.2).collect();
    out.misfit = misfit;
    out.residual = best.square.sqrt() / norm.max(f64::MIN_POSITIVE);
    out.left.clear();
    out.left.extend_from_slice(&best.residual);
    out.cost = best.objective + (PARAMETERS * best.discs.len()) as f64;
    out.slopes.clear();
    out.slopes.extend_from_slice(&best.jacobian);
    scratch.work.put(best);
    Some(())
}
