//! Touches fitted to the measurements: where the picture's peaks begin, a handful of parameters ends.
//!
//! A touch is a disc of raised resistivity with four parameters: x and y of its centre (mm), its radius R (mm) and its
//! strength S (mm²), the rise integrated over it as the linear model sees it. In a uniform sheet the answer to a disc of any
//! contrast is that of the linear model with the rise c replaced by 2 c / (2 + c), for every order of the field's
//! multipoles; only what touches do to one another and the rim's image of a touch are left out, below 1 % for +20 %. So S
//! is fitted, and the true rise is c = 2 s / (2 - s) with s = S / (pi R²).
//!
//! [`responses`] holds the answer to a disc of unit strength over the sheet and interpolates it with its derivatives,
//! [`levenberg_marquardt`] fits a given number of touches, [`model_order`] chooses the number, [`nonlinear`] tells what the linear model leaves
//! out, [`linearisation_error`] carries that from frame to frame, [`fitter`] does it all frame after frame, and this module turns the outcome into touches with their uncertainty.

pub mod electrode_uncertainty;
pub mod fitter;
mod interpolation;
pub mod levenberg_marquardt;
pub mod linearisation_error;
pub mod model_order;
pub mod nonlinear;
pub mod responses;

use crate::touches::fit::levenberg_marquardt::PARAMETERS;
use crate::touches::fit::model_order::{Before, Scratch, Search};
use crate::touches::fit::responses::TouchTable;
use crate::touches::touch::Touch;
use arrayvec::ArrayVec;
use std::f64::consts::PI;

/// What is known of touches before the measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitOptions {
    /// Radius that a touch is expected to have, mm: the paper's 25 mm tip.
    pub radius_mm: f64,
    /// Standard deviation of a touch's radius, mm.
    pub radius_sd_mm: f64,
    /// Radius of a wide touch, mm: a palm. It is a second possibility beside the expected radius.
    pub wide_mm: f64,
    /// Standard deviation of a wide touch's radius, mm.
    pub wide_sd_mm: f64,
    /// How many wide touches there are for one of the expected radius.
    pub wide_odds: f64,
    /// Probability that noise adds a touch to a frame.
    pub false_touch: f64,
    /// Weakest touch, as a fraction of the strongest one's integrated rise.
    pub least_of_strongest: f64,
    /// Weakest touch, relative rise at its peak.
    pub least_rise: f64,
    /// Relative error of the linear disc model, as a standard deviation of one value: it widens the stated uncertainty.
    pub model_error: f64,
    /// Most touches in a frame.
    pub most_touches: usize,
    /// What the search in one frame of many may cost, in evaluations of the answer to a touch (3 to 5 us each): more is left to the
    /// next frame. Four touches take 50 to 300, a hand that lands 1,500. There is no limit where the noise has to be told from the
    /// frame: it may be the only one.
    pub most_work: usize,
}

impl FitOptions {
    /// Defaults for a sheet that reaches this far from its middle (mm): radii in proportion to the paper's 195 mm disc.
    pub fn for_extent(extent_mm: f64) -> Self {
        let scale = extent_mm / 97.5;
        Self {
            radius_mm: 12.5 * scale,
            radius_sd_mm: 2.5 * scale,
            wide_mm: 26.0 * scale,
            wide_sd_mm: 6.0 * scale,
            wide_odds: 0.01,
            false_touch: 1e-3,
            least_of_strongest: 0.02,
            least_rise: 0.005,
            model_error: 0.006,
            most_touches: 12,
            most_work: 600,
        }
    }

    /// A touch of the expected size to start from.
    pub fn seed(&self, at: [f64; 2]) -> Disc {
        Disc {
            at,
            radius: self.radius_mm,
            strength: 0.0,
        }
    }
}

/// What is known of a radius before the measurement, at one radius: minus twice the logarithm of its probability against that of the
/// expected radius, half its derivative (per mm), and half its second derivative without what would make it negative (per mm²).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RadiusPrior {
    pub(crate) penalty: f64,
    pub(crate) slope: f64,
    pub(crate) curvature: f64,
}

impl FitOptions {
    /// A mixture of two normal distributions, tips and palms. Near the expected radius the second does not matter.
    pub(crate) fn radius_prior(&self, radius_mm: f64) -> RadiusPrior {
        let tip = (radius_mm - self.radius_mm) / self.radius_sd_mm;
        let wide = (radius_mm - self.wide_mm) / self.wide_sd_mm;
        let odds = self.wide_odds * self.radius_sd_mm / self.wide_sd_mm;
        // Minus the logarithms of both parts; the smaller one is taken out of the sum, which may underflow.
        let (tip_log, wide_log) = (0.5 * tip * tip, 0.5 * wide * wide - odds.ln());
        let least = tip_log.min(wide_log);
        let parts = [(least - tip_log).exp(), (least - wide_log).exp()];
        let sum = parts[0] + parts[1];
        let [tips, wides] = parts.map(|p| p / sum);
        RadiusPrior {
            penalty: 2.0 * (least - sum.ln()),
            slope: tips * tip / self.radius_sd_mm + wides * wide / self.wide_sd_mm,
            curvature: tips * self.radius_sd_mm.powi(-2) + wides * self.wide_sd_mm.powi(-2),
        }
    }
}

/// A touch as it is fitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disc {
    /// Centre, mm.
    pub at: [f64; 2],
    /// Radius, mm.
    pub radius: f64,
    /// Strength as the linear model sees it: rise times area, mm².
    pub strength: f64,
}

/// Largest `s = S / (pi R²)` that is believed: the rise goes to infinity as s goes to 2.
const LARGEST_CONTRAST: f64 = 1.7;

impl Disc {
    /// Area, mm².
    pub fn area_mm2(&self) -> f64 {
        PI * self.radius * self.radius
    }

    /// The rise that the linear model sees, `s = S / (pi R²)`, as far as it is believed.
    pub fn contrast(&self) -> f64 {
        (self.strength / self.area_mm2()).min(LARGEST_CONTRAST)
    }

    /// The same strength on as large a disc as makes its contrast believable.
    pub fn believable(&self) -> Self {
        let least = (self.strength.max(0.0) / (PI * LARGEST_CONTRAST)).sqrt();
        Self {
            radius: self.radius.max(least),
            ..*self
        }
    }

    /// Relative rise of the resistivity inside: `2 s / (2 - s)`.
    pub fn rise(&self) -> f64 {
        let s = self.contrast();
        2.0 * s / (2.0 - s)
    }

    /// Derivatives of the integrated rise, `2 S / (2 - s)`, by the radius (mm²/mm) and by the strength.
    fn total_slopes(&self) -> [f64; 2] {
        let s = self.contrast();
        let below = (2.0 - s) * (2.0 - s);
        [-4.0 * s * self.strength / self.radius / below, 4.0 / below]
    }
}

/// Relative error of the integrated rise that more measurements would not lessen: where the linear model is good enough for the
/// places of touches, it is off by as much for their strengths.
const TOTAL_ERROR: f64 = 0.01;

/// Most touches that can be fitted together.
pub const MOST_TOUCHES: usize = 24;

/// Touches as they are fitted together.
pub type Discs = ArrayVec<Disc, MOST_TOUCHES>;

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_prior_is_that_of_a_tip_near_its_radius_and_of_a_palm_near_its_own() {
        let options = FitOptions::for_extent(97.5);
        for radius in [8.0, 12.5, 15.0] {
            let tip = (radius - options.radius_mm) / options.radius_sd_mm;
            assert!(
                (options.radius_prior(radius).penalty - tip * tip).abs() < 0.01,
                "{radius}"
            );
        }
        let palm = options.radius_prior(options.wide_mm);
        let odds = options.wide_odds * options.radius_sd_mm / options.wide_sd_mm;
        assert!((palm.penalty + 2.0 * odds.ln()).abs() < 1e-3 && palm.slope.abs() < 1e-3);
    }

    #[test]
    fn the_prior_is_as_steep_as_it_says() {
        let options = FitOptions::for_extent(97.5);
        for k in 1..80 {
            let radius = 0.5 * f64::from(k);
            let [up, down] = [1e-5, -1e-5].map(|d| options.radius_prior(radius + d).penalty);
            let prior = options.radius_prior(radius);
            assert!((0.5 * (up - down) / 2e-5 - prior.slope).abs() < 1e-5, "{radius}");
            assert!(prior.curvature > 0.0);
        }
    }
}
