//! Time of a frame from voltages to touches, for different events on the sheet.

use crate::error::StudyError;
use crate::scene::{Fault, Scene, rng};
use crate::score::quantile;
use crate::test_sheet::{TestSheet, imager, live_reconstructor, noise_v, noisy};
use forward::{DiscTouch, Drive};
use inverse::pipeline::Reconstructor;
use inverse::reference::noise::FrameNoise;
use rand::rngs::StdRng;
use serde::Serialize;
use std::time::{Duration, Instant};

/// What happens on the sheet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Happening {
    /// Nothing; the noise is known from a recording of the unpressed sheet.
    Idle,
    /// Nothing, and the noise has to be estimated from every frame.
    IdleUnknownNoise,
    /// Four fingers at rest, with fresh noise.
    Still,
    /// One finger that moves 1 mm a frame.
    One,
    /// Four fingers that move 1 mm a frame.
    Four,
    /// Five finger tips and a palm that move 1 mm a frame.
    Hand,
}

impl Happening {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::Idle,
        Self::IdleUnknownNoise,
        Self::Still,
        Self::One,
        Self::Four,
        Self::Hand,
    ];

    /// Its name, for tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::IdleUnknownNoise => "idle, noise unknown",
            Self::Still => "four still",
            Self::One => "one moving",
            Self::Four => "four moving",
            Self::Hand => "whole hand moving",
        }
    }

    /// Touches of the k-th frame.
    pub fn touches(self, frame: usize) -> Vec<DiscTouch> {
        // 1 mm on a circle of 48 mm.
        let turn = frame as f64 / 48.0;
        match self {
            Self::Idle | Self::IdleUnknownNoise => Vec::new(),
            Self::Still => fingers(4, 0.0),
            Self::One => fingers(1, turn),
            Self::Four => fingers(4, turn),
            Self::Hand => hand(turn),
        }
    }
}

fn disc(at: [f64; 2], radius_mm: f64, rise: f64) -> DiscTouch {
    DiscTouch {
        centre_mm: at,
        radius_mm,
        rise,
    }
}

fn fingers(count: usize, turn: f64) -> Vec<DiscTouch> {
    (0..count)
        .map(|k| {
            let angle = turn + k as f64 * std::f64::consts::FRAC_PI_2;
            let radius = 48.0 + 12.0 * (0.37 * turn + k as f64).sin();
            disc([radius * angle.cos(), radius * angle.sin()], 12.5, 0.2)
        })
        .collect()
}

/// A palm low on the sheet and five tips above it, all moving together.
fn hand(turn: f64) -> Vec<DiscTouch> {
    let (dx, dy) = (12.0 * (4.0 * turn).sin(), 12.0 * (4.0 * turn).cos());
    let mut touches = vec![disc([dx, dy - 38.0], 26.0, 0.12)];
    for (x, y) in [(-58.0, -8.0), (-32.0, 34.0), (-2.0, 48.0), (28.0, 38.0), (54.0, 8.0)] {
        touches.push(disc([x + dx, y + dy], 9.0, 0.25));
    }
    touches
}

/// Times of a happening.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Cost {
    /// What happens.
    pub happening: &'static str,
    /// Frames measured; fewer than asked for where they take long.
    pub frames: usize,
    /// Time of a frame over the frames of the sequence, us: median and 99th percentile.
    pub median_us: f64,
    /// See `median_us`.
    pub p99_us: f64,
    /// The picture's solve alone, median, us.
    pub solve_us: f64,
    /// Touches found, mean over the frames.
    pub touches: f64,
    /// Part of the frames with as many touches as there are.
    pub counted: f64,
}

/// Number of runs through the sequence. The time of a frame is its least, which leaves out other programs.
const RUNS: usize = 5;
/// After this time a happening gets no more runs, and at most [`FEW`] frames.
const MOST: Duration = Duration::from_secs(3);
const FEW: usize = 8;

/// Measures the times of frames with the noise at which four fingers have 27 dB.
///
/// # Errors
/// [`StudyError`] where the sheet cannot be modelled.
pub fn costs(drive: Drive, frames: usize, seed: u64) -> Result<Vec<Cost>, StudyError> {
    let mut rng = rng(seed);
    let imager = imager(drive, 5.0)?;
    let mut sheet = TestSheet::new(&imager, drive, 0.0, 0.0, &mut rng)?;
    let sigma = noise(&mut sheet, &mut rng)?;
    let mut costs = Vec::new();
    for happening in Happening::ALL {
        let sequence = sequence(&mut sheet, happening, frames, sigma, &mut rng)?;
        let mut best = vec![f64::INFINITY; frames];
        let mut cost = Cost {
            happening: happening.name(),
            frames: 0,
            median_us: 0.0,
            p99_us: 0.0,
            solve_us: 0.0,
            touches: 0.0,
            counted: 0.0,
        };
        let mut solves = vec![f64::INFINITY; frames];
        let begin = Instant::now();
        for run in 0..RUNS {
            if run > 0 && begin.elapsed() > MOST {
                break;
            }
            let noise = match happening {
                Happening::IdleUnknownNoise => FrameNoise::Unknown,
                _ => FrameNoise::of_frames(sigma),
            };
            let mut r = live_reconstructor(&imager, &sheet.baseline, noise)?;
            // The first frame prepares the problem and the tables of the fit.
            warm_up(&mut r, &mut sheet, sigma, &mut rng)?;
            for (k, frame) in sequence.iter().enumerate() {
                if k >= FEW && begin.elapsed() > MOST {
                    break;
                }
                let start = Instant::now();
                let found = r.frame(frame)?;
                best[k] = best[k].min(start.elapsed().as_secs_f64() * 1e6);
                solves[k] = solves[k].min(found.solve_us);
                if run == 0 {
                    cost.frames += 1;
                    cost.touches += found.touches.len() as f64;
                    cost.counted += f64::from(found.touches.len() == happening.touches(k).len());
                }
            }
        }
        best.truncate(cost.frames);
        solves.truncate(cost.frames);
        cost.touches /= cost.frames as f64;
        cost.counted /= cost.frames as f64;
        cost.median_us = quantile(&best, 0.5);
        cost.p99_us = quantile(&best, 0.99);
        cost.solve_us = quantile(&solves, 0.5);
        costs.push(cost);
    }
    Ok(costs)
}

/// Noise at which four fingers have 27 dB, V.
fn noise(sheet: &mut TestSheet, rng: &mut StdRng) -> Result<f64, StudyError> {
    let clean = sheet.frame(&scene(Happening::Four, 0, f64::INFINITY), rng)?;
    Ok(noise_v(&clean, &sheet.baseline, 27.0))
}

fn scene(happening: Happening, frame: usize, snr_db: f64) -> Scene {
    Scene {
        touches: happening.touches(frame),
        smooth: false,
        snr_db,
        fault: Fault::None,
    }
}

/// Frames of a happening with noise of a known size.
pub(super) fn sequence(
    sheet: &mut TestSheet,
    happening: Happening,
    frames: usize,
    sigma: f64,
    rng: &mut StdRng,
) -> Result<Vec<Vec<f64>>, StudyError> {
    let mut still: Option<Vec<f64>> = None;
    (0..frames)
        .map(|k| {
            let same = matches!(
                happening,
                Happening::Idle | Happening::IdleUnknownNoise | Happening::Still
            );
            let clean = match (&still, same) {
                (Some(frame), true) => frame.clone(),
                _ => sheet.frame(&scene(happening, k, f64::INFINITY), rng)?,
            };
            still = Some(clean.clone());
            Ok(noisy(clean, sigma, rng))
        })
        .collect()
}

fn warm_up(r: &mut Reconstructor, sheet: &mut TestSheet, sigma: f64, rng: &mut StdRng) -> Result<(), StudyError> {
    for happening in [Happening::Four, Happening::Idle] {
        let frame = sequence(sheet, happening, 1, sigma, rng)?;
        r.frame(&frame[0])?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_touches_overlaps_or_leaves_the_sheet() {
        for happening in Happening::ALL {
            for frame in 0..300 {
                let touches = happening.touches(frame);
                for (k, t) in touches.iter().enumerate() {
                    let [x, y] = t.centre_mm;
                    assert!(x.hypot(y) + t.radius_mm < 97.5, "{happening:?} {frame}: {t:?}");
                    for other in &touches[..k] {
                        let apart = (x - other.centre_mm[0]).hypot(y - other.centre_mm[1]);
                        assert!(apart > t.radius_mm + other.radius_mm, "{happening:?} {frame}");
                    }
                }
            }
        }
    }

    #[test]
    fn costs_are_told_for_all_that_happens() {
        let costs = costs(Drive::PAPER, 4, 5).unwrap();
        assert_eq!(costs.len(), Happening::ALL.len());
        assert!(
            costs[..2].iter().all(|c| c.touches == 0.0 && c.solve_us == 0.0),
            "{costs:?}"
        );
        assert!(costs[2..5].iter().all(|c| c.counted == 1.0), "{costs:?}");
    }
}
