//! From presses at known places to what locates others: choices by cross-validation, the covariance of the rest, honest
//! uncertainties.

use super::choice::{Choice, Setting};
use super::correction::{Correction, StoredCorrection};
use super::frame::Grain;
use super::locator::{Evidence, Locator, Presence};
use super::maps::{Maps, Presses, StoredMaps, columns, matrix};
use super::orbits::Orbits;
use super::rest::{Residuals, Rest};
use super::search::{PARTS, choose};
use super::stale::stale;
use super::validation::{
    FOLDS, Fold, STEPS, Validation, first_evidence, locators, quantile, second_evidence, validate,
};
use crate::stats::{chance_of_gain, median};
use forward::Measurement;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Fewest presses to learn from.
pub const FEWEST: usize = 5;
/// Fewest presses of which half tell what more would.
pub const FEWEST_FOR_MORE: usize = 4 * FEWEST;
/// Changes are alike where so small a part of them, as squares, differs from press to press. On a sheet it is half and more.
const ALIKE: f64 = 1e-4;
/// A measurement takes part from this share of presses on in which it has a value.
const MOSTLY: f64 = 0.9;
/// Measurements below this part of the median of all are dead.
const DEAD: f64 = 1e-4;
/// Odds from which evidence for a press is strong (Jeffreys 1961).
const STRONG: f64 = 10.0;
/// Odds from which there is a press at all: a hundred frames are at rest for each in which one lands, and what presses leave behind
/// looks like a weak one.
const SURE: f64 = 100.0 * STRONG;
/// Measurements of whose change this part is left are hardly explained.
const HARDLY: f64 = 0.8;
/// Places beyond, mm, are none of a skin.
const FARTHEST_MM: f64 = 1e5;
/// Changes beyond are none of a measurement, in any unit; their squares can still be added.
const LARGEST_CHANGE: f64 = 1e100;
/// Presses beyond this many times the median error, and beyond a quarter of the reach, are gross.
const GROSS: f64 = 6.0;
/// Parts of the reach: a press that is so far off may spoil the others, and nearer ones are all alike.
const FAR_OFF: f64 = 0.5;
const LEAST_OFF: f64 = 0.01;
/// Chance that the others are located better without it, where it does not spoil them, by Student's distribution.
const BY_CHANCE: f64 = 1e-3;
/// How many are tried, the farthest ones; and of how many presses. Fewer tell too little, and more than that one does not spoil.
const TRIED: usize = 3;
const SPOILT: std::ops::RangeInclusive<usize> = 8..=100;
/// Largest part that is left out so; one may be in any case.
const MOST_SPOILERS: f64 = 0.1;

/// A press at a known place.
#[derive(Clone, Debug, PartialEq)]
pub struct Press {
    /// Its place, mm.
    pub place_mm: [f64; 2],
    /// Change of every measurement, pressed less unpressed, in any unit; not a number where a value is missing.
    pub change: Vec<f64>,
}

/// Why nothing can be learned.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum LearnError {
    /// Too few presses.
    #[error("{0} presses are too few to learn from; give {FEWEST} or more")]
    TooFew(usize),
    /// A press without the right number of values, or without a place.
    #[error("press {press} has {values} values of {wanted}, or no place; give both for every press")]
    Malformed {
        /// Number of the press, from 1.
        press: usize,
        /// Its values.
        values: usize,
        /// How many there should be.
        wanted: usize,
    },
    /// A number that no skin has.
    #[error("press {0} has a place beyond {FARTHEST_MM:e} mm or a change beyond {LARGEST_CHANGE:e}; look at its lines")]
    OutOfRange(usize),
    /// All presses at one place.
    #[error("all presses are within {0:.1} mm; spread them over the sheet")]
    OnePlace(f64),
    /// Nothing changes, or nothing can be solved for.
    #[error("the presses change nothing that can be measured; are the columns before and after exchanged for copies?")]
    NoChange,
    /// Presses that do not differ tell no place.
    #[error(
        "every press changes the measurements alike, wherever it is, so that places cannot be told; look at which columns are the frames under a press"
    )]
    Alike,
    /// Stored numbers that do not belong together.
    #[error("its numbers do not fit one another; calibrate anew")]
    Stored,
}

/// What was found while learning.
#[derive(Clone, Debug, PartialEq)]
pub struct Findings {
    /// Presses that were learned from.
    pub presses: usize,
    /// Presses that nothing explains, by their numbers from 0; they are left out.
    pub gross: Vec<usize>,
    /// Presses that are not found by what the others taught, by their numbers from 0; they are learned from.
    pub missed: Vec<usize>,
    /// Measurements without a value or a change; they are left out.
    pub dead: Vec<usize>,
    /// Measurements that presses hardly explain, by their numbers.
    pub unexplained: Vec<usize>,
    /// Measurements that hold what the press before did, by their numbers.
    pub stale: Vec<usize>,
    /// Whether turned measurements share a map.
    pub shared: bool,
    /// Whether the electrodes' numbers go round clockwise; of no meaning where nothing is shared.
    pub clockwise: bool,
    /// What the sheet is turned around, mm.
    pub centre_mm: [f64; 2],
    /// Radius of the sheet as the presses tell it, mm.
    pub radius_mm: f64,
    /// Its grain; none where it conducts alike in all directions.
    pub grain: Option<Grain>,
    /// Part of what the press before did that is in the change of the next; 0 where it does not show.
    pub memory: f64,
    /// Part of the press before's way from the middle by which the middle of the sheet is displaced; 0 where it does not show.
    pub displaced: f64,
    /// Whether the places are corrected by a regression on the changes.
    pub corrected: bool,
    /// Part of the change that maps learned from other presses explain, 0 to 1.
    pub explained: f64,
    /// Distances of presses that were not learned from to where they are located, mm: median and 95th percentile. One that is
    /// missed counts as the reach of the presses.
    pub error_mm: [f64; 2],
    /// The same median with half of the presses; none where these are too few.
    pub half_error_mm: Option<f64>,
    /// By how much variances are larger than if all residuals were independent.
    pub tempering: f64,
}

impl Findings {
    /// The median error expected of so many presses more, mm: the power law through the errors of half and of all of them. None
    /// where it does not fall, or where half of them are too few.
    pub fn expected_mm(&self, more: usize) -> Option<f64> {
        let half = self.half_error_mm?;
        let power = (half / self.error_mm[0]).log2().min(0.5);
        let ratio = (self.presses + more) as f64 / self.presses as f64;
        (power > 0.0).then(|| self.error_mm[0] * ratio.powf(-power))
    }
}

/// Locates presses by what was learned from others.
pub struct Learned {
    locator: Locator,
    /// Where it surely helps.
    correction: Option<Correction>,
    evidence: Evidence,
    /// Numbers of the measurements that take part.
    used: Vec<usize>,
    /// Turn by which measurements share their maps, electrodes.
    turn: usize,
    rest: Rest,
}

/// [`Learned`] as numbers, for a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stored {
    /// Measurements that are this many electrodes apart share a map; the number of electrodes where none do.
    pub turn: usize,
    /// Numbers of the measurements that take part, from 0.
    pub used: Vec<usize>,
    /// What squares of residuals are divided by, since they are not independent.
    pub tempering: f64,
    /// Rise of the logarithm of the evidence from which a first press counts.
    pub first_evidence: f64,
    /// The same for every press more.
    pub more_evidence: f64,
    /// Covariance of what the maps leave over, in the unit of the changes squared.
    pub covariance: Vec<Vec<f64>>,
    /// Part of its variances that is proportional to the square of the press's strength.
    pub proportional: f64,
    /// Offsets that depend on the changes, where there are enough presses to tell.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub correction: Option<StoredCorrection>,
    /// The maps.
    pub maps: StoredMaps,
}

pub(super) fn check(presses: &[Press], setting: &Setting<'_>) -> Result<(), LearnError> {
    if presses.len() < FEWEST {
        return Err(LearnError::TooFew(presses.len()));
    }
    let wanted = setting.measurements.len();
    for (k, press) in presses.iter().enumerate() {
        if press.change.len() != wanted || !press.place_mm.iter().all(|v| v.is_finite()) {
            return Err(LearnError::Malformed {
                press: k + 1,
                values: press.change.len(),
                wanted,
            });
        }
    }
    let beyond = |press: &Press| {
        let far = press.place_mm.iter().any(|v| v.abs() > FARTHEST_MM);
        far || press.change.iter().any(|v| v.abs() > LARGEST_CHANGE)
    };
    if let Some(k) = presses.iter().position(beyond) {
        return Err(LearnError::OutOfRange(k + 1));
    }
    let first = presses[0].place_mm;
    let far = presses
        .iter()
        .map(|p| (p.place_mm[0] - first[0]).hypot(p.place_mm[1] - first[1]))
        .fold(0.0, f64::max);
    if far < 1.0 {
        return Err(LearnError::OnePlace(far));
    }
    Ok(())
}

/// Measurements that have values which change.
pub(super) fn alive(presses: &[Press], count: usize) -> Vec<usize> {
    let typical = |c: usize| {
        let sizes: Vec<f64> = presses.iter().map(|p| p.change[c].abs()).collect();
        let there = sizes.iter().filter(|v| v.is_finite()).count() as f64;
        let mean = sizes.iter().filter(|v| v.is_finite()).sum::<f64>() / there.max(1.0);
        if there >= MOSTLY * presses.len() as f64 {
            mean
        } else {
            0.0
        }
    };
    let sizes: Vec<f64> = (0..count).map(typical).collect();
    let least = DEAD * median(sizes.iter().copied());
    (0..count).filter(|c| sizes[*c] > least).collect()
}

/// Whether all presses change the measurements by the same values.
fn alike(presses: &[Press], used: &[usize]) -> bool {
    let (mut whole, mut differs) = (0.0, 0.0);
    for c in used {
        let values: Vec<f64> = presses.iter().map(|p| p.change[*c]).filter(|v| v.is_finite()).collect();
        let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
        whole += values.iter().map(|v| v * v).sum::<f64>();
        differs += values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
    }
    differs < ALIKE * whole
}

/// Some presses, in order of time; the one before may be one that is not kept.
pub(super) fn gather(presses: &[Press], used: &[usize], kept: &[usize]) -> Presses {
    Presses {
        places_mm: kept.iter().map(|k| presses[*k].place_mm).collect(),
        before_mm: kept
            .iter()
            .map(|k| k.checked_sub(1).map(|b| presses[b].place_mm))
            .collect(),
        changes: DMatrix::from_fn(kept.len(), used.len(), |k, c| presses[kept[k]].change[used[c]]),
    }
}

/// Learns from presses in order of time. `progress` is told how many parts of the work are done, and of how many.
///
/// # Errors
/// [`LearnError`] says what is missing.
pub fn learn(
    presses: &[Press],
    setting: &Setting<'_>,
    progress: impl FnMut(usize, usize),
) -> Result<(Learned, Findings), LearnError> {
    learn_without(presses, setting, &[], progress)
}

/// The same without some presses, by their numbers from 0, that something else says are at wrong places: they are gross.
///
/// # Errors
/// As for [`learn`].
pub fn learn_without(
    presses: &[Press],
    setting: &Setting<'_>,
    wrong: &[usize],
    mut progress: impl FnMut(usize, usize),
) -> Result<(Learned, Findings), LearnError> {
    check(presses, setting)?;
    let mut numbers: Vec<usize> = (0..presses.len()).filter(|k| !wrong.contains(k)).collect();
    let given = numbers.len();
    if given < FEWEST {
        return Err(LearnError::TooFew(given));
    }
    let used = alive(presses, setting.measurements.len());
    if used.is_empty() {
        return Err(LearnError::NoChange);
    }
    if alike(presses, &used) {
        return Err(LearnError::Alike);
    }
    let measurements: Vec<Measurement> = used.iter().map(|k| setting.measurements[*k]).collect();
    let all = gather(presses, &used, &numbers);
    let mut choice = choose(&all, setting, &measurements, &mut progress).ok_or(LearnError::NoChange)?;
    let mut kept = all;
    let mut checked = Checked::new(&choice, &kept).ok_or(LearnError::NoChange)?;
    let most = ((MOST_SPOILERS * given as f64) as usize).max(1);
    while given - numbers.len() < most
        && let Some(spoiler) = checked.spoiler(&choice, &kept)
    {
        numbers.remove(spoiler);
        kept = gather(presses, &used, &numbers);
        choice = choose(&kept, setting, &measurements, &mut |_, _| {}).ok_or(LearnError::NoChange)?;
        checked = Checked::new(&choice, &kept).ok_or(LearnError::NoChange)?;
    }
    progress(PARTS - 2, PARTS);
    let gross = gross(&checked.validation, choice.frame.reach_mm);
    if !gross.is_empty() {
        let rows = 0..numbers.len();
        numbers = rows.filter(|k| !gross.contains(k)).map(|k| numbers[k]).collect();
        kept = gather(presses, &used, &numbers);
        checked = Checked::new(&choice, &kept).ok_or(LearnError::NoChange)?;
    }
    let Checked {
        list,
        residuals,
        rest,
        mut validation,
        mut evidence,
    } = checked;
    evidence.first = first_evidence(&validation).min(SURE.ln());
    // What a second press gains in frames with one.
    evidence.thorough = true;
    validation = Validation::of(&list, &kept, evidence);
    evidence.thorough = false;
    let mut gains: Vec<f64> = validation
        .presences
        .iter()
        .filter_map(|p| p.gains.get(1).copied())
        .collect();
    gains.sort_by(f64::total_cmp);
    evidence.more = second_evidence(&gains).max(evidence.first.min(STRONG.ln()));
    validation = Validation::of(&list, &kept, evidence);
    progress(PARTS - 1, PARTS);
    let correction = Correction::learn(&kept, &mut validation);
    let reach_mm = choice.frame.reach_mm;
    let mut errors = validation.errors_mm(reach_mm);
    errors.sort_by(f64::total_cmp);
    let maps = choice.maps(&kept).ok_or(LearnError::NoChange)?;
    let findings = Findings {
        presses: kept.len(),
        missed: validation.missed().into_iter().map(|k| numbers[k]).collect(),
        gross: (0..presses.len()).filter(|k| !numbers.contains(k)).collect(),
        dead: (0..setting.measurements.len()).filter(|c| !used.contains(c)).collect(),
        unexplained: (0..used.len())
            .filter(|c| rest.covariance[(*c, *c)] > HARDLY * mean_square(&kept, *c))
            .map(|c| used[c])
            .collect(),
        stale: stale(&maps, &kept, &residuals).into_iter().map(|c| used[c]).collect(),
        shared: choice.orbits.count < measurements.len(),
        clockwise: choice.frame.clockwise,
        centre_mm: choice.frame.centre_mm,
        radius_mm: choice.frame.radius_mm,
        grain: choice.frame.grain(),
        memory: choice.prior.memory,
        displaced: choice.prior.displaced,
        corrected: correction.is_some(),
        explained: explained(&kept, &residuals, &maps.scale),
        error_mm: [quantile(&errors, 0.5), quantile(&errors, 0.95)],
        half_error_mm: half_error(&choice, &kept, evidence),
        tempering: evidence.tempering,
    };
    let locator = Locator::new(maps, &rest, STEPS).ok_or(LearnError::NoChange)?.hurried();
    Ok((
        Learned {
            locator,
            correction,
            evidence,
            used,
            turn: choice.turn,
            rest,
        },
        findings,
    ))
}

fn mean_square(presses: &Presses, c: usize) -> f64 {
    let column = presses.changes.column(c);
    let sizes: Vec<f64> = column.iter().map(|v| v.abs()).collect();
    let limit = 4.0 * median(sizes.iter().copied()).max(f64::MIN_POSITIVE);
    column
        .iter()
        .filter(|v| v.is_finite())
        .map(|v| v.clamp(-limit, limit).powi(2))
        .sum::<f64>()
        / column.len() as f64
}

/// Part of the change that the maps explain, with gross values drawn in.
fn explained(presses: &Presses, residuals: &Residuals, scale: &[f64]) -> f64 {
    let (mut whole, mut left) = (0.0, 0.0);
    for (c, scale) in scale.iter().enumerate() {
        for k in 0..presses.len() {
            let (v, r) = (presses.changes[(k, c)] / scale, residuals.values[(k, c)] / scale);
            if v.is_finite() {
                whole += v.clamp(-6.0, 6.0).powi(2);
                left += r.clamp(-6.0, 6.0).powi(2);
            }
        }
    }
    1.0 - (left / whole.max(f64::MIN_POSITIVE)).min(1.0)
}

/// Presses, each located by what the others taught.
struct Checked {
    list: Vec<Fold<Locator>>,
    residuals: Residuals,
    rest: Rest,
    validation: Validation,
    evidence: Evidence,
}

impl Checked {
    fn new(choice: &Choice, presses: &Presses) -> Option<Self> {
        let (list, residuals, turning) = locators(choice, presses, FOLDS, STEPS)?;
        let (validation, evidence) = validate(&list, presses);
        Some(Self {
            rest: residuals.rest(&choice.orbits, turning),
            list,
            residuals,
            validation,
            evidence,
        })
    }

    /// Of few presses one at a wrong place spoils the maps for the others, so that many are off. It is one that the others put far from its
    /// place, and without which they are located better, surely.
    fn spoiler(&self, choice: &Choice, presses: &Presses) -> Option<usize> {
        let reach_mm = choice.frame.reach_mm;
        let errors = self.validation.errors_mm(reach_mm);
        let mut far: Vec<usize> = (0..errors.len()).filter(|k| errors[*k] > FAR_OFF * reach_mm).collect();
        if !SPOILT.contains(&presses.len()) {
            return None;
        }
        far.sort_by(|a, b| errors[*b].total_cmp(&errors[*a]));
        let tried = far.into_iter().take(TRIED).filter_map(|k| {
            let others: Vec<usize> = (0..errors.len()).filter(|o| *o != k).collect();
            let without = Self::new(choice, &presses.select(&others))?
                .validation
                .errors_mm(reach_mm);
            let gains: Vec<f64> = (others.iter().zip(&without))
                .map(|(o, now)| (errors[*o].max(LEAST_OFF * reach_mm) / now.max(LEAST_OFF * reach_mm)).ln())
                .collect();
            let (chance, mean) = chance_of_gain(&gains)?;
            (chance < BY_CHANCE / TRIED as f64).then_some((k, mean))
        });
        tried.max_by(|a, b| a.1.total_cmp(&b.1)).map(|t| t.0)
    }
}

/// Presses that are put so far from their places, mm, that these are wrong, by what puts most near theirs; none where nothing is found.
pub fn far_off(errors_mm: &[Option<f64>], reach_mm: f64) -> Vec<usize> {
    let limit = (GROSS * median(errors_mm.iter().map(|e| e.unwrap_or(reach_mm)))).max(0.25 * reach_mm);
    let off = |k: &usize| errors_mm[*k].is_some_and(|e| e > limit);
    (0..errors_mm.len()).filter(off).collect()
}

fn gross(validation: &Validation, reach_mm: f64) -> Vec<usize> {
    let errors = validation
        .offsets
        .iter()
        .map(|o| Some(o[0].hypot(o[1])).filter(|e| e.is_finite()));
    let list = far_off(&errors.collect::<Vec<_>>(), reach_mm);
    let few = validation.offsets.len() / 10;
    // Where many are off, it is the maps that are not good enough.
    if list.len() <= few { list } else { Vec::new() }
}

fn half_error(choice: &Choice, presses: &Presses, evidence: Evidence) -> Option<f64> {
    if presses.len() < FEWEST_FOR_MORE {
        return None;
    }
    let half = presses.select(&(0..presses.len()).step_by(2).collect::<Vec<_>>());
    let (list, ..) = locators(choice, &half, FOLDS, STEPS)?;
    let mut validation = Validation::of(&list, &half, evidence);
    Correction::learn(&half, &mut validation);
    Some(median(validation.errors_mm(choice.frame.reach_mm).into_iter()))
}

impl Learned {
    /// The presses of a frame: its changes in the order and the unit of those that were learned from, and the place of the press
    /// before where it is known.
    pub fn locate(&self, change: &[f64], before_mm: Option<[f64; 2]>) -> Presence {
        let value = |k: &usize| change.get(*k).copied().unwrap_or(f64::NAN);
        let used: Vec<f64> = self.used.iter().map(value).collect();
        let mut presence = self.locator.locate(&used, before_mm, self.evidence);
        presence.wild.iter_mut().for_each(|k| *k = self.used[*k]);
        presence.wild.sort_unstable();
        if let Some(correction) = &self.correction {
            correction.correct(&used, &mut presence);
        }
        presence
    }

    /// Distance below which two presses cannot be told from one between them, mm.
    pub fn resolution_mm(&self) -> f64 {
        self.locator.maps().near_mm()
    }

    /// The numbers that make it.
    pub fn stored(&self) -> Stored {
        Stored {
            turn: self.turn,
            used: self.used.clone(),
            tempering: self.evidence.tempering,
            first_evidence: self.evidence.first,
            more_evidence: self.evidence.more,
            covariance: columns(&self.rest.covariance),
            proportional: self.rest.proportional,
            correction: self.correction.as_ref().map(Correction::stored),
            maps: self.locator.maps().stored(),
        }
    }

    /// What such numbers make, with the measurements that they are of.
    ///
    /// # Errors
    /// [`LearnError::Stored`] where they do not fit one another.
    pub fn restore(stored: &Stored, measurements: &[Measurement], electrodes: usize) -> Result<Self, LearnError> {
        let build = || {
            let sound = stored.used.is_sorted_by(|a, b| a < b)
                && (1..=electrodes).contains(&stored.turn)
                && (1e-6..=1e6).contains(&stored.tempering)
                && (0.0..=1.0).contains(&stored.proportional)
                && !stored.first_evidence.is_nan()
                && !stored.more_evidence.is_nan();
            sound.then_some(())?;
            let used: Vec<Measurement> = stored
                .used
                .iter()
                .map(|k| measurements.get(*k).copied())
                .collect::<Option<_>>()?;
            let orbits = Orbits::new(&used, electrodes, stored.turn);
            let rest = Rest {
                covariance: matrix(&stored.covariance, used.len(), used.len())?,
                proportional: stored.proportional,
            };
            let maps = Maps::restore(&stored.maps, electrodes, orbits)?;
            // What is left of a value, over what presses do to it: within what squares of it can be computed with.
            let parts = rest
                .covariance
                .diagonal()
                .component_div(&DVector::from_column_slice(&stored.maps.scale).map(|s| s * s));
            parts.iter().all(|part| (1e-30..=1e30).contains(part)).then_some(())?;
            Some(Self {
                locator: Locator::new(maps, &rest, STEPS)?.hurried(),
                correction: match &stored.correction {
                    Some(correction) => Some(Correction::restore(correction, stored.used.len())?),
                    None => None,
                },
                evidence: Evidence {
                    tempering: stored.tempering,
                    first: stored.first_evidence,
                    more: stored.more_evidence,
                    thorough: false,
                },
                used: stored.used.clone(),
                turn: stored.turn,
                rest,
            })
        };
        build().ok_or(LearnError::Stored)
    }
}
