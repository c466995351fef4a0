//! One to four touches (the paper's Fig. 8), and three touches by the generalised inverse (Fig. 7). Frames are
//! measured in the paper's way through the whole chain.

use crate::paper::map::Map;
use crate::paper::methods::Reader;
use crate::paper::rig::{Press, Recording, Rig, Tip};
use crate::paper::{Options, PaperError};
use crate::score::quantile;
use inverse::pipeline::FrameResult;
use inverse::reference::imager::Imager;
use inverse::solvers::Method;
use inverse::touches::touch::Touch;
use protocol::Plan;
use serde::Serialize;
use std::sync::Arc;
use std::time::Instant;

/// Places of the touches (mm), like those of fingers of two hands.
const PLACES: [&[[f64; 2]]; 4] = [
    &[[25.0, 18.0]],
    &[[-38.0, 12.0], [34.0, -24.0]],
    &[[-40.0, -22.0], [6.0, 48.0], [42.0, -18.0]],
    &[[-48.0, 10.0], [-6.0, 52.0], [48.0, 16.0], [4.0, -46.0]],
];
/// Force of each finger, N, and its radius at half the pressure, mm.
const FINGER_N: f64 = 10.0;
const FINGER_MM: f64 = 6.75;

/// Result of a method for a frame.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// Touches that it found.
    pub found: usize,
    /// Distance of every true touch to the nearest one found, mm; none where nothing was found.
    pub errors_mm: Vec<Option<f64>>,
    /// Least and greatest value of the picture, relative rise.
    pub range: [f64; 2],
    /// Time from voltages to touches, ms (the median of several runs).
    pub frame_ms: f64,
    /// Places found, mm.
    pub places_mm: Vec<[f64; 2]>,
    /// The picture.
    #[serde(skip)]
    pub map: Map,
}

/// A frame of one to four touches.
#[derive(Clone, Debug, Serialize)]
pub struct Scene {
    /// Places of the presses, mm.
    pub truth_mm: Vec<[f64; 2]>,
    /// By the paper's method.
    pub theirs: Outcome,
    /// By ours.
    pub ours: Outcome,
}

/// One method on the frame of three touches.
#[derive(Clone, Debug, Serialize)]
pub struct Panel {
    /// Its name.
    pub name: &'static str,
    /// Its result.
    pub outcome: Outcome,
}

/// Figs. 7 and 8.
#[derive(Clone, Debug, Serialize)]
pub struct Touches {
    /// One, two, three and four touches.
    pub scenes: Vec<Scene>,
    /// The frame of three touches by every method.
    pub panels: Vec<Panel>,
    /// The sheet's outline, mm.
    #[serde(skip)]
    pub outline_mm: Vec<[f64; 2]>,
}

pub(super) fn run(rig: &dyn Rig, options: Options) -> Result<Touches, PaperError> {
    let plan = Plan::paper();
    let frame_s = f64::from(plan.quarters()) / 4.0 * 16.0 * 1425.0 / 84e6;
    let rest = [0.2, 0.2 + frame_s * if options.quick { 6.5 } else { 20.5 }];
    // Each scene is held for a little more than two frames. One frame is then measured completely within the scene.
    let held = |scene: usize| {
        let start = rest[1] + (0.2 + 2.1 * frame_s + 0.2) * scene as f64 + 0.2;
        [start, start + 2.1 * frame_s]
    };
    let presses: Vec<Press> = PLACES
        .iter()
        .enumerate()
        .flat_map(|(k, places)| {
            let [from, to] = held(k);
            places.iter().map(move |[x, y]| Press {
                tip: Tip::Finger,
                radius_mm: FINGER_MM,
                path: vec![
                    [from - 0.1, *x, *y, 0.0],
                    [from, *x, *y, FINGER_N],
                    [to, *x, *y, FINGER_N],
                    [to + 0.1, *x, *y, 0.0],
                ],
            })
        })
        .collect();
    let skin = rig.mount(&presses, false, options.seed)?;
    let r = Recording::make(skin, &plan, held(PLACES.len() - 1)[1])?;
    let (baseline, _) = r.mean(rest[0], rest[1]);
    let frames: Vec<&[f64]> = (0..PLACES.len())
        .filter_map(|k| r.within(held(k)[0], held(k)[1]).next().map(|f| f.values_v.as_slice()))
        .collect();
    if frames.len() < PLACES.len() {
        return Err(PaperError::Silent);
    }
    let (mut theirs, mut ours) = (Reader::theirs(&baseline)?, Reader::ours(&baseline)?);
    let mut scenes = Vec::new();
    for (frame, places) in frames.iter().zip(PLACES) {
        scenes.push(Scene {
            truth_mm: places.to_vec(),
            theirs: by(&mut theirs, frame, places)?,
            ours: by(&mut ours, frame, places)?,
        });
    }
    let mut panels = Vec::new();
    for (name, method, cell_mm) in [
        ("generalised inverse, 20 mm", Method::PseudoInverse, 20.0),
        ("generalised inverse, 5 mm", Method::PseudoInverse, 5.0),
        ("Lawson-Hanson, 20 mm (the paper)", Method::LawsonHanson, 20.0),
        ("Tikhonov, 5 mm", Method::Tikhonov, 5.0),
        ("ours: ridge and x ≥ 0, 5 mm, fitted", Method::Nnls, 5.0),
    ] {
        let mut reader = Reader::new(method, cell_mm, &baseline)?;
        let outcome = by(&mut reader, frames[2], PLACES[2])?;
        panels.push(Panel { name, outcome });
    }
    Ok(Touches {
        scenes,
        panels,
        outline_mm: ours.imager.outline_mm.clone(),
    })
}

/// Distance of every true place to the touch matched with it, nearest pairs first; `None` without a match.
pub(super) fn matched(truth: &[[f64; 2]], found: &[Touch]) -> Vec<Option<f64>> {
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for (k, t) in truth.iter().enumerate() {
        for (j, f) in found.iter().enumerate() {
            pairs.push(((f.x_mm - t[0]).hypot(f.y_mm - t[1]), k, j));
        }
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut out, mut taken) = (vec![None; truth.len()], vec![false; found.len()]);
    for (d, k, j) in pairs {
        if out[k].is_none() && !taken[j] {
            out[k] = Some(d);
            taken[j] = true;
        }
    }
    out
}

const RUNS: usize = 9;

/// What `read` makes of a frame, time and time again.
pub(super) fn outcome(
    imager: &Imager,
    truth: &[[f64; 2]],
    mut read: impl FnMut() -> Result<FrameResult, PaperError>,
) -> Result<Outcome, PaperError> {
    let mut times = Vec::new();
    for _ in 0..RUNS {
        let start = Instant::now();
        read()?;
        times.push(1e3 * start.elapsed().as_secs_f64());
    }
    let result = read()?;
    let range = result.x.iter().fold([0.0_f64; 2], |r, x| [r[0].min(*x), r[1].max(*x)]);
    let places_mm: Vec<[f64; 2]> = result.touches.iter().map(|t| [t.x_mm, t.y_mm]).collect();
    Ok(Outcome {
        found: result.touches.len(),
        errors_mm: matched(truth, &result.touches),
        range,
        frame_ms: quantile(&times, 0.5),
        map: Map::of_cells(imager, &result.x)?
            .with_truth(truth)
            .with_found(&places_mm),
        places_mm,
    })
}

/// The same by a method.
fn by(reader: &mut Reader, frame: &[f64], truth: &[[f64; 2]]) -> Result<Outcome, PaperError> {
    let imager = Arc::clone(&reader.imager);
    outcome(&imager, truth, || Ok(reader.read(frame)?.clone()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_touch_is_matched_once() {
        let touch = |x_mm, y_mm| Touch {
            x_mm,
            y_mm,
            ..Touch::default()
        };
        let found = [touch(1.0, 0.0), touch(10.0, 0.0)];
        assert_eq!(matched(&[[0.0, 0.0], [2.5, 0.0]], &found), [Some(1.0), Some(7.5)]);
        assert_eq!(matched(&[[0.0, 0.0]], &[]), [None]);
    }

    #[test]
    fn the_places_keep_their_distance() {
        for places in PLACES {
            for (k, a) in places.iter().enumerate() {
                assert!(a[0].hypot(a[1]) < 77.5);
                assert!(places[..k].iter().all(|b| (a[0] - b[0]).hypot(a[1] - b[1]) >= 45.0));
            }
        }
    }
}
