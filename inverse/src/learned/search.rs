//! How a skin is best described: symmetric or not, which way round, around what; chosen by cross-validation.

use super::choice::{Choice, Setting};
use super::locator::Evidence;
use super::maps::{Frame, Presses, Prior};
use super::orbits::Orbits;
use super::validation::{FIRST_TEMPERING, Validation, locators};
use forward::Measurement;
use nalgebra::{Matrix2, Vector2};

/// Parts where only a choice is to be made.
const QUICK_FOLDS: usize = 5;
/// Steps of the grid there, from the middle to the reach of the presses.
const QUICK_STEPS: f64 = 10.0;
/// Parts of the work, about equally long.
pub(super) const PARTS: usize = 9;

pub(super) const PRIOR: Prior = Prior {
    shared: 0.5,
    own: 0.06,
    memory: 0.0,
};
/// Parts of what the press before did that are tried as left.
const MEMORIES: [f64; 6] = [0.07, 0.14, 0.2, 0.3, 0.4, 0.5];
/// Standard errors by which presses have to be drawn to the one before, and be located better by a memory.
const LIKELY: f64 = 1.0;
/// Standard errors by which a symmetry has to be refuted.
const SURELY: f64 = 3.0;
/// Presses located within this part of the reach tell what draws them.
const NEARLY: f64 = 0.4;

/// All presses located by maps of the others, with one way to describe the skin.
fn located(choice: &Choice, presses: &Presses) -> Option<Validation> {
    let (locators, ..) = locators(choice, presses, QUICK_FOLDS, QUICK_STEPS)?;
    Some(Validation::of(
        &locators,
        presses,
        Evidence::of_one_press(FIRST_TEMPERING),
    ))
}

/// Logarithms of the squared distances at which presses are located by maps of the others, for each of them. One that is not
/// found counts as a guess: it is off by the reach.
fn losses(choice: &Choice, presses: &Presses) -> Option<Vec<f64>> {
    let step = choice.frame.reach_mm / QUICK_STEPS;
    let errors = located(choice, presses)?.errors_mm(choice.frame.reach_mm);
    Some(errors.iter().map(|e| (e * e + step * step).ln()).collect())
}

/// By what part of the way to the one before presses are located towards it, over its standard error: by least squares, beside what
/// draws them to the middle. `None` where too few are found near their places.
fn pull(choice: &Choice, presses: &Presses) -> Option<f64> {
    let found = located(choice, presses)?;
    let (mut square, mut product) = (Matrix2::zeros(), Vector2::zeros());
    let mut list = Vec::new();
    for ((place, before), offset) in presses.places_mm.iter().zip(&presses.before_mm).zip(&found.offsets) {
        let near = offset[0].hypot(offset[1]) < NEARLY * choice.frame.reach_mm;
        let Some(before) = before.filter(|_| near) else {
            continue;
        };
        for axis in 0..2 {
            let ways = Vector2::new(before[axis] - place[axis], place[axis] - choice.frame.centre_mm[axis]);
            square += ways * ways.transpose();
            product += ways * offset[axis];
            list.push((ways, offset[axis]));
        }
    }
    let inverse = square.try_inverse()?;
    let parts = inverse * product;
    let left: f64 = list
        .iter()
        .map(|(ways, offset)| (offset - ways.dot(&parts)).powi(2))
        .sum();
    let free = list.len().checked_sub(2)? as f64;
    let pull = parts.x / (left / free * inverse[(0, 0)]).sqrt();
    pull.is_finite().then_some(pull)
}

/// The best of some ways; an earlier one unless a later one is better by more than so many standard errors of the difference.
fn best(choices: Vec<Choice>, presses: &Presses, errors: f64) -> Option<Choice> {
    let mut taken: Option<(Vec<f64>, Choice)> = None;
    for choice in choices {
        let Some(losses) = losses(&choice, presses) else {
            continue;
        };
        let better = taken.as_ref().is_none_or(|(of_taken, _)| {
            let count = losses.len() as f64;
            let differences = || losses.iter().zip(of_taken).map(|(a, b)| a - b);
            let mean = differences().sum::<f64>() / count;
            let variance = differences().map(|d| (d - mean).powi(2)).sum::<f64>() / (count * (count - 1.0));
            mean < -errors * variance.sqrt()
        });
        if better {
            taken = Some((losses, choice));
        }
    }
    taken.map(|(_, choice)| choice)
}

fn reach(presses: &Presses, centre: [f64; 2]) -> f64 {
    let farthest = presses
        .places_mm
        .iter()
        .map(|p| (p[0] - centre[0]).hypot(p[1] - centre[1]))
        .fold(0.0, f64::max);
    // Of K places in a disc the farthest is expected at 2 K / (2 K + 1) of its radius.
    farthest * (1.05 + 0.5 / presses.len() as f64)
}

/// How the sheet is best described: symmetric or not, which way round, around what.
pub(super) fn choose(
    presses: &Presses,
    setting: &Setting<'_>,
    measurements: &[Measurement],
    progress: &mut impl FnMut(usize, usize),
) -> Option<Choice> {
    let along = |axis: usize| presses.places_mm.iter().map(move |p| p[axis]);
    let middle = [0, 1].map(|axis| {
        let (low, high) = along(axis).fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
        0.5 * (low + high)
    });
    let make = |centre_mm: [f64; 2], turn: usize, clockwise: bool, prior: Prior| Choice {
        frame: Frame {
            centre_mm,
            reach_mm: reach(presses, centre_mm),
            electrodes: setting.electrodes,
            clockwise,
        },
        prior,
        turn,
        orbits: Orbits::new(measurements, setting.electrodes, turn),
    };
    let mut choices = Vec::new();
    if setting.turn < setting.electrodes {
        for clockwise in [false, true] {
            choices.push(make([0.0; 2], setting.turn, clockwise, PRIOR));
        }
        // The origin is where the sheet's middle should be. Few presses cannot tell another one.
        let shifted = middle[0].hypot(middle[1]) > 0.2 * reach(presses, middle);
        if shifted {
            for clockwise in [false, true] {
                choices.push(make(middle, setting.turn, clockwise, PRIOR));
            }
        }
    }
    let symmetric = best(choices, presses, 0.0);
    progress(2, PARTS);
    let with = |choice: &Choice, change: &dyn Fn(&mut Prior)| {
        let mut choice = choice.clone();
        change(&mut choice.prior);
        choice
    };
    let alone = make(middle, setting.electrodes, false, Prior { own: 0.5, ..PRIOR });
    let taken = match symmetric {
        Some(symmetric) => {
            let freer = [(0.25, 0.25), (0.1, 0.5)]
                .map(|(shared, own)| with(&symmetric, &|p| (p.shared, p.own) = (shared, own)));
            let mut choices = vec![symmetric];
            choices.extend(freer);
            // Of few presses maps without symmetry promise more than they keep.
            best(vec![best(choices, presses, 1.0)?, alone], presses, SURELY)?
        }
        None => alone,
    };
    progress(5, PARTS);
    remember(taken, presses)
}

/// What part of what the press before did is left, by cross-validation. Without it presses are located towards the one before, or away
/// from it where the frame before has more of it than the press. As much more is taken as they are located better by it.
fn remember(mut taken: Choice, presses: &Presses) -> Option<Choice> {
    let Some(pull) = pull(&taken, presses).filter(|pull| pull.abs() > LIKELY) else {
        return Some(taken);
    };
    for part in MEMORIES {
        let mut more = taken.clone();
        more.prior.memory = pull.signum() * part;
        let errors = if taken.prior.memory == 0.0 { LIKELY } else { 0.0 };
        taken = best(vec![taken, more], presses, errors)?;
        if taken.prior.memory.abs() < part {
            break;
        }
    }
    Some(taken)
}
