//! How well presses are located by what others taught: cross-validation.

use super::choice::Choice;
use super::locator::{Evidence, Locator, Presence};
use super::maps::{Maps, Presses};
use super::rest::Residuals;
use statrs::distribution::{ContinuousCDF, StudentsT};

/// Parts into which presses are cut for cross-validation; fewer presses are left out one by one.
pub(super) const FOLDS: usize = 10;
/// Steps of the grid on which a press is located, from the middle to the reach of the presses.
pub(super) const STEPS: f64 = 20.0;
/// Later presses are off by this many times what those are that lie between known ones in time: skins age. Chosen on three skins.
const AGEING: f64 = 1.15;
/// Two standard deviations hold this part of the coordinates.
const WITHIN_TWO: f64 = 0.9545;
/// Tempering before anything is known of it.
pub(super) const FIRST_TEMPERING: f64 = 3.0;
/// Chance of a second press in a frame with one.
const FALSE_SECOND: f64 = 0.01;

/// What the presses of some rows have no part in.
pub(super) struct Fold<T> {
    pub(super) rows: Vec<usize>,
    pub(super) of_others: T,
}

/// Rows of every fold and those of all others. A fold is a stretch of time: what drifts from press to press must not
/// be known from the neighbours.
pub(super) fn folds(count: usize, most: usize) -> Vec<(Vec<usize>, Vec<usize>)> {
    let folds = if count < 2 * most { count } else { most };
    (0..folds)
        .map(|f| (0..count).partition(|k| k * folds / count == f))
        .collect()
}

/// Maps of every fold with what they leave over of its presses.
pub(super) fn cross_validate(choice: &Choice, presses: &Presses, most: usize) -> Option<(Vec<Fold<Maps>>, Residuals)> {
    let mut all = Residuals::none(presses.len(), presses.changes.ncols());
    let mut list = Vec::new();
    for (out, rest) in folds(presses.len(), most) {
        let maps = choice.maps(&presses.select(&rest))?;
        let residuals = Residuals::of(&maps, &presses.select(&out));
        all.put(&out, &residuals);
        list.push(Fold {
            rows: out,
            of_others: maps,
        });
    }
    Some((list, all))
}

/// Locators of every fold, and the residuals for a covariance of all with the part of it that turns. A fold's covariance comes from
/// residuals by maps that its own presses have no part in either: maps that have learned the noise of a press leave it in the
/// residuals of others, whose covariance then expects it.
pub(super) fn locators(
    choice: &Choice,
    presses: &Presses,
    most: usize,
    steps: f64,
) -> Option<(Vec<Fold<Locator>>, Residuals, f64)> {
    let (maps, residuals) = cross_validate(choice, presses, most)?;
    // Where only a choice is to be made, none does.
    let turning = if most == FOLDS {
        residuals.turning(&choice.orbits)
    } else {
        0.0
    };
    let rows: Vec<&[usize]> = maps.iter().map(|f| f.rows.as_slice()).collect();
    let mut of_others: Vec<Vec<Residuals>> = rows.iter().map(|_| Vec::new()).collect();
    for a in 0..rows.len() {
        for b in 0..a {
            let kept: Vec<usize> = (0..presses.len())
                .filter(|k| !rows[a].contains(k) && !rows[b].contains(k))
                .collect();
            let without_both = choice.maps(&presses.select(&kept))?;
            of_others[a].push(Residuals::of(&without_both, &presses.select(rows[b])));
            of_others[b].push(Residuals::of(&without_both, &presses.select(rows[a])));
        }
    }
    let list = (maps.into_iter().zip(of_others))
        .map(|(fold, others)| {
            let rest = Residuals::joined(&others).rest(&choice.orbits, turning);
            Some(Fold {
                rows: fold.rows,
                of_others: Locator::new(fold.of_others, &rest, steps)?,
            })
        })
        .collect::<Option<Vec<_>>>()?;
    Some((list, residuals, turning))
}

/// What the located presses are compared with.
pub(super) struct Validation {
    pub(super) presences: Vec<Presence>,
    /// Offsets of the strongest press, mm, with their standard deviations.
    pub(super) offsets: Vec<[f64; 2]>,
    deviations: Vec<[f64; 2]>,
}

impl Validation {
    pub(super) fn of(locators: &[Fold<Locator>], presses: &Presses, evidence: Evidence) -> Self {
        let mut presences = vec![Presence::default(); presses.len()];
        let (mut offsets, mut deviations) = (vec![[f64::NAN; 2]; presses.len()], vec![[f64::NAN; 2]; presses.len()]);
        for fold in locators {
            for k in &fold.rows {
                let change: Vec<f64> = presses.changes.row(*k).iter().copied().collect();
                let presence = fold.of_others.locate(&change, presses.before_mm[*k], evidence);
                if let Some(press) = presence.presses.first() {
                    let place = presses.places_mm[*k];
                    offsets[*k] = [0, 1].map(|a| press.place_mm[a] - place[a]);
                    deviations[*k] = [0, 1].map(|a| press.covariance_mm2[a][a].sqrt());
                }
                presences[*k] = presence;
            }
        }
        Self {
            presences,
            offsets,
            deviations,
        }
    }

    /// Distances, mm, in the order of the presses; `missed_mm` for those that are not found.
    pub(super) fn errors_mm(&self, missed_mm: f64) -> Vec<f64> {
        let distance = |o: &[f64; 2]| o[0].hypot(o[1]);
        let or_missed = |d: f64| if d.is_finite() { d } else { missed_mm };
        self.offsets.iter().map(distance).map(or_missed).collect()
    }

    /// Presses in whose frames nothing is found.
    pub(super) fn missed(&self) -> Vec<usize> {
        (0..self.presences.len())
            .filter(|k| self.presences[*k].presses.is_empty())
            .collect()
    }

    /// By how much standard deviations have to grow so that two of them hold what they should: of the coordinates' offsets
    /// over them the quantile, and beside it the median, which few presses tell better. What few presses tell is uncertain itself:
    /// Student's distribution has so many degrees of freedom.
    pub(super) fn growth(&self) -> f64 {
        let mut over: Vec<f64> = (self.offsets.iter().zip(&self.deviations))
            .flat_map(|(o, d)| [0, 1].map(|a| (o[a] / d[a]).abs()))
            .filter(|v| v.is_finite())
            .collect();
        over.sort_by(f64::total_cmp);
        let at = |part: f64| quantile(&over, part);
        let student = StudentsT::new(0.0, 1.0, (0.5 * over.len() as f64).max(1.0));
        let wider = student.map_or(1.0, |s| s.inverse_cdf(0.5 + 0.5 * WITHIN_TWO) / 2.0);
        AGEING * 0.5 * wider * (at(WITHIN_TWO) / 2.0 + at(0.6827))
    }
}

/// Of sorted values.
pub(super) fn quantile(sorted: &[f64], part: f64) -> f64 {
    if sorted.is_empty() {
        return f64::NAN;
    }
    let at = part * (sorted.len() - 1) as f64;
    let (low, high) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    low + (high - low) * at.fract()
}

/// Locates all presses by the maps of the others, with the tempering that makes their uncertainties right.
pub(super) fn validate(locators: &[Fold<Locator>], presses: &Presses) -> (Validation, Evidence) {
    let mut evidence = Evidence::of_one_press(FIRST_TEMPERING);
    let mut validation = Validation::of(locators, presses, evidence);
    for _ in 0..3 {
        let growth = validation.growth();
        if growth.is_finite() {
            evidence.tempering = (evidence.tempering * growth * growth).clamp(0.5, 300.0);
        }
        validation = Validation::of(locators, presses, evidence);
    }
    (validation, evidence)
}

/// The gain that all but one frame in a hundred with a press exceed, by an exponential tail; none below that of an even chance. Maps
/// that explain little gain little where there is a press.
pub(super) fn first_evidence(validation: &Validation) -> f64 {
    let mut gains: Vec<f64> = (validation.presences.iter())
        .filter_map(|p| p.gains.first().copied())
        .collect();
    gains.sort_by(f64::total_cmp);
    if gains.is_empty() {
        return 0.0;
    }
    let (low, middle) = (quantile(&gains, 0.1), quantile(&gains, 0.5));
    (middle - (middle - low) / 5.0_f64.ln() * (0.5 / FALSE_SECOND).ln()).max(0.0)
}

/// The gain that one frame in a hundred with a single press exceeds: an exponential tail through what frames show.
pub(super) fn second_evidence(sorted: &[f64]) -> f64 {
    if sorted.is_empty() {
        return 0.0;
    }
    let (middle, high) = (quantile(sorted, 0.5), quantile(sorted, 0.9));
    // Between them an exponential tail falls by a factor of five.
    // What few frames tell of the tail is uncertain by a standard error of it.
    let uncertain = 1.0 + 1.0 / (sorted.len() as f64).sqrt();
    let scale = uncertain * ((high - middle) / 5.0_f64.ln()).max(0.0);
    let tail = middle + scale * (0.5 / FALSE_SECOND).ln();
    tail.max(quantile(sorted, 1.0 - FALSE_SECOND))
}
