//! Beyond the paper: two touches at smaller and smaller distances, and the position error over the sheet. The paper's
//! method and ours have the same frames. These come from the nonlinear model on a finer mesh, with the noise of the
//! paper's 27 dB.

use crate::paper::methods::Reader;
use crate::paper::touches::matched;
use crate::paper::{Options, PaperError};
use crate::scene::{Fault, Kind, Scene, rng};
use crate::score::{MISSED_MM, quantile};
use crate::test_sheet::{TestSheet, noise_v, noisy};
use forward::{DiscTouch, Drive};
use inverse::touches::touch::Touch;
use rand::Rng;
use rand::rngs::StdRng;
use serde::Serialize;

/// The sheet's radius and the tip's, mm.
pub const RIM_MM: f64 = 97.5;
const TIP_MM: f64 = 12.5;
/// Widths of the pairs' discs, mm: the paper's tip, and a fingertip; with their rises.
pub const WIDTHS_MM: [f64; 2] = [25.0, 14.0];
const RISES: [f64; 2] = [0.2, 0.25];
/// Distances between the middles of the two touches, mm, from the distance at which they meet.
const APART_MM: [f64; 12] = [14.0, 16.0, 18.0, 20.0, 22.5, 25.0, 27.5, 30.0, 35.0, 40.0, 50.0, 60.0];
/// A touch further off than this, or than half of the pair's distance, counts as not resolved, mm.
pub const RESOLVED_MM: f64 = 8.0;

/// Results of a method for pairs at one distance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct PairResult {
    /// Part of the frames in which two touches are found.
    pub two: f64,
    /// Part in which both are also near their places.
    pub both: f64,
}

/// Pairs of touches at one distance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Separation {
    /// Width of each, mm.
    pub width_mm: f64,
    /// Distance between the middles, mm.
    pub apart_mm: f64,
    /// Frames.
    pub frames: usize,
    /// The paper's method.
    pub theirs: PairResult,
    /// Ours.
    pub ours: PairResult,
}

/// Position error at one place.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Place {
    /// Place of the press, mm.
    pub at_mm: [f64; 2],
    /// Median distance of the nearest touch found by the paper's method, mm; none where most frames show none.
    pub theirs_mm: Option<f64>,
    /// By ours.
    pub ours_mm: Option<f64>,
}

/// The map of position errors.
#[derive(Clone, Debug, Serialize)]
pub struct Positions {
    /// Distance between neighbouring places, mm.
    pub spacing_mm: f64,
    /// Frames at every place.
    pub frames: usize,
    /// The places.
    pub places: Vec<Place>,
    /// Median and 95th percentile over all frames, mm, the paper's method.
    pub theirs_mm: [f64; 2],
    /// By ours.
    pub ours_mm: [f64; 2],
    /// Part of the frames with the right count, the paper's method and ours.
    pub counted: [f64; 2],
}

/// Both.
#[derive(Clone, Debug, Serialize)]
pub struct Reach {
    /// Noise of a value, V of the simulated front end.
    pub noise_v: f64,
    /// Two touches closer and closer.
    pub separations: Vec<Separation>,
    /// One touch all over the sheet.
    pub positions: Positions,
}

struct Both {
    sheet: TestSheet,
    theirs: Reader,
    ours: Reader,
    sigma: f64,
    rng: StdRng,
}

pub(super) fn run(options: Options, progress: &dyn Fn(&str)) -> Result<Reach, PaperError> {
    let mut rng = rng(options.seed);
    let mut sheet = TestSheet::new(&Reader::our_imager()?, Drive::PAPER, 0.0, 0.0, &mut rng)?;
    let (theirs, ours) = (Reader::theirs(&sheet.baseline)?, Reader::ours(&sheet.baseline)?);
    let pressed = sheet.frame(&clean(vec![tip([0.0, 0.0])]), &mut rng)?;
    let sigma = noise_v(&pressed, &sheet.baseline, crate::paper::noise::PAPER_DB);
    let mut both = Both {
        sheet,
        theirs,
        ours,
        sigma,
        rng,
    };
    progress("two touches closer and closer");
    let pairs = if options.quick { 4 } else { 60 };
    let mut separations = Vec::new();
    for (width_mm, rise) in WIDTHS_MM.into_iter().zip(RISES) {
        for apart_mm in APART_MM.into_iter().filter(|a| *a >= width_mm) {
            separations.push(both.separation(width_mm, rise, apart_mm, pairs)?);
        }
    }
    progress("position error over the sheet");
    let (spacing_mm, frames) = if options.quick { (28.0, 1) } else { (11.0, 5) };
    let positions = both.positions(spacing_mm, frames)?;
    Ok(Reach {
        noise_v: sigma,
        separations,
        positions,
    })
}

fn tip(centre_mm: [f64; 2]) -> DiscTouch {
    DiscTouch {
        centre_mm,
        radius_mm: TIP_MM,
        rise: 0.2,
    }
}

/// A scene without noise. The noise depends on the sheet and not on the touches, and is added later.
fn clean(touches: Vec<DiscTouch>) -> Scene {
    Scene {
        touches,
        smooth: false,
        snr_db: f64::INFINITY,
        fault: Fault::None,
    }
}

impl Both {
    /// Touches that both methods find in one noisy frame.
    fn look(&mut self, clean: &[f64]) -> Result<[Vec<Touch>; 2], PaperError> {
        let frame = noisy(clean.to_vec(), self.sigma, &mut self.rng);
        let theirs = self.theirs.read(&frame)?.touches.clone();
        let ours = self.ours.read(&frame)?.touches.clone();
        Ok([theirs, ours])
    }

    fn separation(&mut self, width_mm: f64, rise: f64, apart_mm: f64, frames: usize) -> Result<Separation, PaperError> {
        let (mut two, mut both) = ([0_usize; 2], [0_usize; 2]);
        for _ in 0..frames {
            let mut touches = Kind::Pair(apart_mm).scene(&mut self.rng, f64::INFINITY).touches;
            for t in &mut touches {
                (t.radius_mm, t.rise) = (0.5 * width_mm, rise);
            }
            let truth: Vec<[f64; 2]> = touches.iter().map(|t| t.centre_mm).collect();
            let voltages = self.sheet.frame(&clean(touches), &mut self.rng)?;
            let near = RESOLVED_MM.min(0.5 * apart_mm);
            for (k, found) in self.look(&voltages)?.iter().enumerate().filter(|(_, f)| f.len() == 2) {
                two[k] += 1;
                both[k] += usize::from(matched(&truth, found).iter().all(|e| e.is_some_and(|e| e <= near)));
            }
        }
        let result = |k: usize| PairResult {
            two: two[k] as f64 / frames as f64,
            both: both[k] as f64 / frames as f64,
        };
        Ok(Separation {
            width_mm,
            apart_mm,
            frames,
            theirs: result(0),
            ours: result(1),
        })
    }

    fn positions(&mut self, spacing_mm: f64, frames: usize) -> Result<Positions, PaperError> {
        let (mut places, mut all, mut counted) = (Vec::new(), [Vec::new(), Vec::new()], [0_usize; 2]);
        let honeycomb = honeycomb(spacing_mm, RIM_MM - TIP_MM);
        let total = (honeycomb.len() * frames) as f64;
        for at_mm in honeycomb {
            // The touch is moved a little, because a place on a mesh point could be better than others.
            let off: [f64; 2] = [0; 2].map(|_| self.rng.random_range(-0.5..0.5));
            let truth = [at_mm[0] + off[0], at_mm[1] + off[1]];
            let voltages = self.sheet.frame(&clean(vec![tip(truth)]), &mut self.rng)?;
            let mut errors = [Vec::new(), Vec::new()];
            for _ in 0..frames {
                for (k, found) in self.look(&voltages)?.iter().enumerate() {
                    // The error of a touch that is not found is the same as in all tables of the project.
                    let error = matched(&[truth], found)[0].unwrap_or(MISSED_MM);
                    errors[k].push(error);
                    counted[k] += usize::from(found.len() == 1);
                }
            }
            let median = |list: &[f64]| Some(quantile(list, 0.5)).filter(|m| *m < MISSED_MM);
            places.push(Place {
                at_mm,
                theirs_mm: median(&errors[0]),
                ours_mm: median(&errors[1]),
            });
            for (all, errors) in all.iter_mut().zip(errors) {
                all.extend(errors);
            }
        }
        let pair = |list: &[f64]| [quantile(list, 0.5), quantile(list, 0.95)];
        Ok(Positions {
            spacing_mm,
            frames,
            places,
            theirs_mm: pair(&all[0]),
            ours_mm: pair(&all[1]),
            counted: counted.map(|n| n as f64 / total),
        })
    }
}

/// Middles of hexagons that fill a disc, mm.
fn honeycomb(spacing_mm: f64, radius_mm: f64) -> Vec<[f64; 2]> {
    let rows = (radius_mm / (spacing_mm * 0.75_f64.sqrt())).ceil() as i32;
    let columns = (radius_mm / spacing_mm).ceil() as i32 + 1;
    let all = (-rows..=rows).flat_map(|row| {
        let shift = if row % 2 == 0 { 0.0 } else { 0.5 };
        (-columns..=columns).map(move |column| {
            [
                (f64::from(column) + shift) * spacing_mm,
                f64::from(row) * spacing_mm * 0.75_f64.sqrt(),
            ]
        })
    });
    all.filter(|p| p[0].hypot(p[1]) <= radius_mm).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hexagons_fill_the_disc() {
        let places = honeycomb(9.0, 85.0);
        // One hexagon is sqrt(3/4) spacing² large.
        let area = places.len() as f64 * 0.75_f64.sqrt() * 81.0;
        assert!(
            (area / (std::f64::consts::PI * 85.0 * 85.0) - 1.0).abs() < 0.05,
            "{area}"
        );
        let nearest = |p: &[f64; 2]| {
            let others = places.iter().filter(|q| *q != p);
            others
                .map(|q| (p[0] - q[0]).hypot(p[1] - q[1]))
                .fold(f64::INFINITY, f64::min)
        };
        assert!(places.iter().all(|p| (nearest(p) - 9.0).abs() < 1e-9));
    }
}
