//! How a skin is best described: symmetric or not, which way round, around what; by cross-validation.

use super::choice::{Choice, NO_MEMORY, Setting};
use super::locator::Evidence;
use super::maps::{Frame, Maps, Presses};
use super::orbits::Orbits;
use super::validation::{FIRST_TEMPERING, Validation, locators};
use forward::Measurement;

/// Parts where only a choice is to be made.
const QUICK_FOLDS: usize = 5;
/// Steps of the grid there, from the middle to the reach of the presses.
const QUICK_STEPS: f64 = 10.0;
/// Standard errors by which a symmetry has to be refuted.
const SURELY: f64 = 3.0;
/// Parts of the work, about equally long.
pub(super) const PARTS: usize = 9;

/// Logarithms of the squared distances at which presses are located by maps of the others, for each of them. One that is not
/// found counts as a guess: it is off by the reach.
fn losses(choice: &Choice, presses: &Presses) -> Option<Vec<f64>> {
    let (locators, ..) = locators(choice, presses, QUICK_FOLDS, QUICK_STEPS)?;
    let step = choice.frame.reach_mm / QUICK_STEPS;
    let found = Validation::of(&locators, presses, Evidence::of_one_press(FIRST_TEMPERING));
    let errors = found.errors_mm(choice.frame.reach_mm);
    Some(errors.iter().map(|e| (e * e + step * step).ln()).collect())
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
    let make = |centre_mm: [f64; 2], turn: usize, clockwise: bool| {
        let frame = Frame {
            centre_mm,
            reach_mm: reach(presses, centre_mm),
            clockwise,
        };
        let orbits = Orbits::new(measurements, setting.electrodes, turn);
        Some(Choice {
            prior: Maps::prior(presses, frame, &orbits)?,
            frame,
            turn,
            orbits,
        })
    };
    let mut choices = Vec::new();
    if setting.turn < setting.electrodes {
        choices.extend([false, true].map(|clockwise| make([0.0; 2], setting.turn, clockwise)));
        // The origin is where the sheet's middle should be. Few presses cannot tell another one.
        if middle[0].hypot(middle[1]) > 0.2 * reach(presses, middle) {
            choices.extend([false, true].map(|clockwise| make(middle, setting.turn, clockwise)));
        }
    }
    progress(2, PARTS);
    let symmetric = best(choices.into_iter().flatten().collect(), presses, 0.0);
    progress(3, PARTS);
    let alone = make(middle, setting.electrodes, false)?;
    let taken = match symmetric {
        // Of few presses maps without symmetry promise more than they keep.
        Some(symmetric) => best(vec![symmetric, alone], presses, SURELY)?,
        None => alone,
    };
    progress(5, PARTS);
    let mut forgetful = taken.clone();
    forgetful.prior.memory = NO_MEMORY;
    best(vec![taken, forgetful], presses, 1.0)
}
