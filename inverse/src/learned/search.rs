//! How a skin is best described: symmetric or not, which way round, around what; by the evidence of the presses.

use super::choice::{Choice, Setting};
use super::maps::{Frame, Maps, Presses};
use super::orbits::Orbits;
use forward::Measurement;

/// Parts of the work, about equally long.
pub(super) const PARTS: usize = 9;

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
        let (prior, evidence) = Maps::prior(presses, frame, &orbits)?;
        let choice = Choice {
            frame,
            prior,
            turn,
            orbits,
        };
        Some((evidence, choice))
    };
    let mut choices = vec![make(middle, setting.electrodes, false)];
    progress(1, PARTS);
    if setting.turn < setting.electrodes {
        choices.extend([false, true].map(|clockwise| make([0.0; 2], setting.turn, clockwise)));
        progress(3, PARTS);
        // The origin is where the sheet's middle should be. Few presses cannot tell another one.
        if middle[0].hypot(middle[1]) > 0.2 * reach(presses, middle) {
            choices.extend([false, true].map(|clockwise| make(middle, setting.turn, clockwise)));
        }
    }
    progress(5, PARTS);
    let best = choices.into_iter().flatten().max_by(|a, b| a.0.total_cmp(&b.0));
    best.map(|(_, choice)| choice)
}
