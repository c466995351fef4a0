//! Where the electrodes are and how well they make contact, estimated from the unpressed sheet's own values.
//!
//! Nobody places electrodes to a tenth of a millimetre, and half a millimetre moves touches by as much as the noise does.
//! But the baseline shows it: each value's logarithm against the model is linear in small moves of the electrodes along
//! the rim and in their contacts. Everything unknown is given a prior and fitted at once (Gauss and Newton, each step a
//! linear Gaussian model): moves, contacts, the common gain, a smooth unevenness of the sheet, and an error of every
//! value. How large these are is chosen by the evidence of the baseline itself (MacKay 1992), so that a sheet that
//! is not like the model keeps its electrodes where they were said to be.

mod distortion;
mod linear;
mod odd_pairs;
mod uneven;

pub use distortion::Distortion;
pub use odd_pairs::{OddPair, PairError};

use crate::reference::imager::Imager;
use linear::{Linear, Scales};
use nalgebra::DVector;
use std::sync::Arc;
pub(crate) use uneven::UnevenSheet;

/// What the baseline says of the electrodes.
#[derive(Clone, Debug)]
pub struct ElectrodeFit {
    /// The imager with its electrodes where they were found, and what is still uncertain of them.
    pub imager: Arc<Imager>,
    /// How far every electrode was moved along the rim, mm.
    pub moved_mm: Vec<f64>,
    /// By what every contact impedance was multiplied.
    pub contact: Vec<f64>,
    /// Relative error of one value that the fit leaves, one standard deviation.
    pub error: f64,
    /// Standard deviation of the sheet's relative unevenness.
    pub unevenness: f64,
    /// Values that disagree with all others and take no part, with what was measured over what was expected.
    pub outliers: Vec<(usize, f64)>,
    /// Pairs with a gain or an offset of their own. The values of a gain are divided by it in the fit, those of an offset take no
    /// part.
    pub odd_pairs: Vec<OddPair>,
    /// Something of the board that changes all values. It is taken out of them in the fit.
    pub distortion: Option<Distortion>,
    /// What the fit leaves of the baseline: relative, root mean square over the values that take part.
    pub misfit: f64,
}

/// Why no electrodes were found.
#[derive(Clone, Debug, PartialEq)]
pub enum NoFit {
    /// Too few values that can be used.
    TooFew,
    /// The sheet that comes out makes no sense: electrodes that overlap, or numbers that are not finite.
    NoSheet,
    /// An electrode would be further from its place than hands put it.
    TooFar {
        /// The electrode, from 0.
        electrode: usize,
        /// By how much it would be moved, mm.
        moved_mm: f64,
        /// The most that is accepted, mm.
        most_mm: f64,
    },
}

/// What is expected of electrodes and sheet before the baseline is looked at. Lengths are for the paper's disc (97.5 mm) and
/// grow with the sheet.
///
/// The candidates span what is built by hand, a factor of three to five apart: the evidence is flat between neighbours.
/// `cargo run --release -p studies --example mismatch` and `--example uneven_sheet` measure what comes of them (docs/results.md,
/// "Misplaced electrodes" and "Uneven sheets"); the single values were chosen by hand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElectrodeFitOptions {
    /// Candidates for the relative error of a value, one standard deviation. The largest is for sheets that the model hardly
    /// describes: their electrodes stay where they were said to be.
    pub errors: [f64; 5],
    /// Candidates for the standard deviation of the sheet's relative unevenness.
    pub unevennesses: [f64; 3],
    /// Candidates for the standard deviation of an electrode's place along the rim, mm.
    pub places_mm: [f64; 3],
    /// Candidates for the standard deviation of the logarithm of a contact impedance.
    pub contacts: [f64; 2],
    /// Standard deviation of the logarithm of what all contacts have in common.
    pub common_contact: f64,
    /// Standard deviation of the logarithm of the common gain: nothing is known of it.
    pub gain: f64,
    /// Distance of the bumps that an unevenness is made of, over the sheet's reach. Less follows finer unevenness and takes
    /// longer.
    pub bumps: f64,
    /// Most steps of Gauss and Newton, one model each.
    pub most_rounds: usize,
    /// A step that moves no electrode by more than this is the last, mm.
    pub settled_mm: f64,
    /// Fewest values for every electrode. Fewer cannot tell a place from a contact.
    pub least_values: usize,
    /// Most standard deviations of the widest candidate for a place that an electrode is moved. What is further was not put there by
    /// hand: the baseline is wrong in another way, and the electrodes are left where they were said to be.
    pub most_moves: f64,
    /// A value this many standard deviations from what the others predict is left out. Of 208 with Gaussian errors one is in
    /// 100,000 baselines.
    pub outlier: f64,
    /// A value that is off by less than this part of itself is never left out, and no pair is named for less: what it does to the
    /// electrodes is small.
    pub least_outlier: f64,
    /// Most pairs with a gain or an offset of their own. More of them are a sheet that is not like the model.
    pub most_odd_pairs: usize,
    /// Largest part of the values that are left out as outliers. More of them are a sheet that is not like the model.
    pub most_outliers: f64,
}

impl Default for ElectrodeFitOptions {
    fn default() -> Self {
        Self {
            errors: [3e-4, 1e-3, 3e-3, 1e-2, 3e-2],
            unevennesses: [0.0, 0.02, 0.1],
            places_mm: [0.1, 0.5, 2.0],
            contacts: [0.1, 0.5],
            common_contact: 1.0,
            gain: 10.0,
            bumps: 0.3,
            most_rounds: 4,
            settled_mm: 0.01,
            least_values: 4,
            most_moves: 3.0,
            outlier: 6.0,
            least_outlier: 0.03,
            most_odd_pairs: 2,
            most_outliers: 0.05,
        }
    }
}

/// Misfit from which a distortion is looked for. So it is where something stands out.
const OFF: f64 = 3e-3;
/// By how much less the fit has to leave without it; or half of what stands out, and no more.
const LESS: f64 = 3.0;
/// Most times that it is looked for.
const MOST_DISTORTED: usize = 6;
/// Reach of the paper's disc, mm.
const PAPER_REACH_MM: f64 = 97.5;

/// Finds the electrodes of an imager's sheet from a baseline (any unit; not a number where a value is missing). `None` when too few
/// values can be used or what comes out makes no sense; the electrodes are then best left where they are.
pub fn find(imager: &Imager, baseline: &[f64]) -> Option<ElectrodeFit> {
    find_with(imager, baseline, &ElectrodeFitOptions::default()).ok()
}

/// The same with other expectations.
///
/// # Errors
/// [`NoFit`] says why nothing was found.
pub fn find_with(imager: &Imager, baseline: &[f64], options: &ElectrodeFitOptions) -> Result<ElectrodeFit, NoFit> {
    let found = find_without(imager, baseline, options);
    let is_sound = |fit: &ElectrodeFit| fit.misfit <= OFF && fit.odd() == 0;
    if !imager.is_searched() || found.as_ref().is_ok_and(is_sound) {
        return found;
    }
    let is_better = |fit: &ElectrodeFit| match &found {
        Ok(before) => {
            let leaves_less = LESS * fit.misfit < before.misfit && fit.odd() <= before.odd();
            leaves_less || (fit.misfit <= before.misfit && 2 * fit.odd() <= before.odd())
        }
        Err(_) => fit.misfit < LESS * OFF && fit.odd() == 0,
    };
    let taken = |(distortion, without): (Distortion, Vec<f64>)| {
        let fit = find_without(imager, &without, options).ok().filter(is_better)?;
        Some(ElectrodeFit {
            distortion: Some(distortion),
            ..fit
        })
    };
    let drawn = undistorted(Arc::new(imager.clone()), imager, baseline, options).and_then(taken);
    let fit = drawn.or_else(|| {
        let (settled, ..) = settle(imager, baseline, options).ok()?;
        undistorted(settled.imager, imager, baseline, options).and_then(taken)
    });
    fit.map_or(found.clone(), Ok)
}

/// What distorts a baseline, and the baseline without it. The electrodes take a part of it up. So they are looked for in what is left, and it is
/// looked for about them, until it stays. `here`: with the electrodes where that begins.
fn undistorted(
    mut here: Arc<Imager>,
    imager: &Imager,
    baseline: &[f64],
    options: &ElectrodeFitOptions,
) -> Option<(Distortion, Vec<f64>)> {
    let mut linear = Linear::new(&here, baseline, options)?;
    let mut scales = linear.best(&linear.residual, reach(imager));
    let mut last = None;
    // The least misfit, with what comes of it.
    let mut best: Option<(f64, (Distortion, Vec<f64>))> = None;
    for _ in 0..MOST_DISTORTED {
        let Some((distortion, logarithms)) = distortion::most_probable(&here, &linear, scales, reach(imager)) else {
            break;
        };
        let without = baseline.iter().zip(&logarithms);
        // Values whose sign would be another stand out as they are.
        let without: Vec<f64> = without
            .map(|(v, of)| if of.is_finite() { v / of.exp() } else { *v })
            .collect();
        let Ok((fit, _, of_fit)) = settle(imager, &without, options) else {
            break;
        };
        if best.as_ref().is_none_or(|(misfit, ..)| fit.misfit < *misfit) {
            best = Some((fit.misfit, (distortion, without)));
        }
        if last.is_some_and(|last| distortion.is_near(last)) {
            break;
        }
        last = Some(distortion);
        let at: Vec<f64> = fit.contact.iter().map(|c| c.ln()).chain(fit.moved_mm).collect();
        linear = Linear::new(&fit.imager, baseline, options)?;
        linear.about = linear.slopes() * DVector::from_vec(at);
        (here, scales) = (fit.imager, of_fit);
    }
    best.map(|(_, found)| found)
}

/// The same of a baseline that nothing distorts.
fn find_without(imager: &Imager, baseline: &[f64], options: &ElectrodeFitOptions) -> Result<ElectrodeFit, NoFit> {
    let mut kept = baseline.to_vec();
    let mut outliers: Vec<(usize, f64)> = Vec::new();
    let mut odd_pairs: Vec<OddPair> = Vec::new();
    let most = (options.most_outliers * baseline.len() as f64) as usize;
    // Of many values a sheet takes seconds: it is made without what stands out already where the electrodes are drawn.
    let mut drawn = !imager.is_searched();
    loop {
        let (fit, linear, scales) = if drawn {
            let linear = Linear::new(imager, &kept, options).ok_or(NoFit::TooFew)?;
            let scales = linear.best(&linear.residual, reach(imager));
            (None, linear, scales)
        } else {
            let (fit, linear, scales) = settle(imager, &kept, options)?;
            (Some(fit), linear, scales)
        };
        let (more, odd) = linear.stand_out(scales, &kept, &imager.pattern);
        if let Some(odd) = odd.filter(|_| odd_pairs.len() < options.most_odd_pairs) {
            for (kept, m) in kept.iter_mut().zip(imager.pattern.measurements()) {
                if odd.carries(m) {
                    *kept /= match odd.error {
                        PairError::Gain(gain) => gain,
                        PairError::Offset(_) => f64::NAN,
                    };
                }
            }
            odd_pairs.push(odd);
            continue;
        }
        if more.is_empty() || outliers.len() + more.len() > most {
            let Some(mut fit) = fit else {
                drawn = false;
                continue;
            };
            (fit.outliers, fit.odd_pairs) = (outliers, odd_pairs);
            let most_mm = options.most_moves * options.places_mm.iter().fold(0.0_f64, |m, p| m.max(*p)) * reach(imager);
            let far = fit.moved_mm.iter().copied().enumerate();
            return match far.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs())) {
                Some((electrode, moved_mm)) if moved_mm.abs() > most_mm => Err(NoFit::TooFar {
                    electrode,
                    moved_mm,
                    most_mm,
                }),
                _ => Ok(fit),
            };
        }
        for (k, _) in &more {
            kept[*k] = f64::NAN;
        }
        outliers.extend(more);
    }
}

impl ElectrodeFit {
    /// How many values and pairs stand out.
    fn odd(&self) -> usize {
        self.outliers.len() + self.odd_pairs.len()
    }
}

/// The sheet's size, over the paper's.
fn reach(imager: &Imager) -> f64 {
    imager.reach_mm() / PAPER_REACH_MM
}

/// Steps of Gauss and Newton until the electrodes stay; with the linear model about where they are.
fn settle(
    imager: &Imager,
    baseline: &[f64],
    options: &ElectrodeFitOptions,
) -> Result<(ElectrodeFit, Linear, Scales), NoFit> {
    let sheet = imager.model.sheet();
    let geometry = imager.model.geometry();
    let n = sheet.electrodes.len();
    let reach = reach(imager);
    let mut at = DVector::zeros(2 * n);
    let mut here = imager.clone();
    let mut linear = Linear::new(&here, baseline, options).ok_or(NoFit::TooFew)?;
    let mut scales = None;
    let mut round = 0;
    // Of many values a round takes seconds, and one is enough: electrodes off by 0.5 mm.
    let most_rounds = if imager.is_searched() { options.most_rounds } else { 1 };
    loop {
        round += 1;
        // Beyond the linear part: what the values would be if all were linear about the prior's mean.
        let y = &linear.residual + linear.slopes() * &at;
        let s = *scales.get_or_insert_with(|| linear.best(&y, reach));
        let (mean, covariance) = linear.solve(&y, s).ok_or(NoFit::NoSheet)?;
        let step = (&mean - &at).rows(n, n).amax();
        at = mean;
        let found = geometry.displaced(sheet, at.as_slice()).ok_or(NoFit::NoSheet)?;
        here = Imager::new(&found, imager.drive, imager.pattern.clone(), imager.grid.cell_mm())
            .map_err(|_| NoFit::NoSheet)?;
        here.electrode_covariance = Some(covariance);
        let last = round >= most_rounds || step <= options.settled_mm * reach;
        // About where the electrodes are now: for the next step, or for what the last one leaves.
        linear = Linear::new(&here, baseline, options).ok_or(NoFit::TooFew)?;
        if last {
            if let Some(told) = &imager.told {
                here = told.seen_by(here);
            }
            linear.about = linear.slopes() * &at;
            let fit = ElectrodeFit {
                misfit: linear.misfit(),
                imager: Arc::new(here),
                moved_mm: at.rows(n, n).iter().copied().collect(),
                contact: at.rows(0, n).map(f64::exp).iter().copied().collect(),
                error: s.error,
                unevenness: s.unevenness,
                outliers: Vec::new(),
                odd_pairs: Vec::new(),
                distortion: None,
            };
            return Ok((fit, linear, s));
        }
    }
}
