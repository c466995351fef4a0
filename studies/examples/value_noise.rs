//! What the noise of each value is worth: frames whose values are not all as noisy, weighted by one noise for all of them and by what the
//! baseline tells of each (`Reference::of`).
//!
//! `cargo run --release -p studies --example value_noise` (docs/reliability.md, Faults in the baseline)

use forward::{DiscTouch, Drive};
use inverse::pipeline::{Reconstructor, ReconstructorOptions};
use inverse::reference::Reference;
use inverse::reference::baseline::Baseline;
use inverse::reference::inspection::{InspectionOptions, inspect};
use inverse::reference::noise::FrameNoise;
use inverse::solvers::Method;
use rand::Rng;
use rand::rngs::StdRng;
use rand_distr::StandardNormal;
use std::sync::Arc;
use studies::{StudyError, TestSheet, imager, noise_v, noisy, rng};

const SEEDS: std::ops::Range<u64> = 1..4;
/// Frames at rest, and under the finger, of each seed.
const FRAMES: usize = 160;
const FINGER: DiscTouch = DiscTouch {
    centre_mm: [31.0, -18.0],
    radius_mm: 12.5,
    rise: 0.2,
};

#[derive(Clone, Copy)]
enum Noise {
    /// The same of all values.
    Even,
    /// This part of each value, beside the even one.
    Proportional(f64),
    /// One amplifier has so many times the even one.
    Amplifier(f64),
    /// The gain of every sense channel is another in each frame, by this part.
    Channels(f64),
}

impl Noise {
    fn add(self, frame: &mut [f64], sigma: f64, sense: &[usize], rng: &mut StdRng) {
        let mut normal = || rng.sample::<f64, _>(StandardNormal);
        match self {
            Self::Even => {}
            Self::Proportional(part) => frame.iter_mut().for_each(|v| *v *= 1.0 + part * normal()),
            Self::Amplifier(times) => {
                let loud = frame.iter_mut().zip(sense).filter(|(_, l)| **l == 7);
                loud.for_each(|(v, _)| *v += times * sigma * normal());
            }
            Self::Channels(part) => {
                let gains: Vec<f64> = (0..16).map(|_| 1.0 + part * normal()).collect();
                frame.iter_mut().zip(sense).for_each(|(v, l)| *v *= gains[*l]);
            }
        }
    }
}

/// Frames at rest that show touches without a doubt, frames under the finger that are right, and the finger's median error, mm.
fn row(noise: Noise, baseline_frames: usize, of_each: bool) -> Result<(usize, usize, f64), StudyError> {
    let (mut silent, mut right, mut off) = (0, 0, Vec::new());
    for seed in SEEDS {
        let mut rng = rng(seed);
        let imager = imager(Drive::PAPER, 5.0)?;
        let sense: Vec<usize> = imager.pattern.measurements().iter().map(|m| m.sense.plus).collect();
        let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.3, 0.2, &mut rng)?;
        let touched = sheet.clean_frame(&[FINGER])?;
        let sigma = noise_v(&touched, &sheet.baseline, 27.0);
        let mut measured = |clean: &[f64]| {
            let mut frame = noisy(clean.to_vec(), sigma, &mut rng);
            noise.add(&mut frame, sigma, &sense, &mut rng);
            frame
        };
        let frames: Vec<Vec<f64>> = (0..baseline_frames).map(|_| measured(&sheet.baseline)).collect();
        let list: Vec<&[f64]> = frames.iter().map(Vec::as_slice).collect();
        let baseline = Baseline::of_frames(imager.pattern.len(), &list);
        let found = inspect(&imager, baseline, true, &InspectionOptions::default());
        let options = ReconstructorOptions::for_imager(&found.imager, Method::Nnls).of_sequence();
        let reference = if of_each {
            Reference::of(Arc::clone(&found.imager), &found.baseline)?
        } else {
            let known = FrameNoise::Known {
                sigma: found.baseline.noise_v,
                baseline_frames: Some(found.baseline.frames),
            };
            Reference::new(Arc::clone(&found.imager), found.baseline.values_v.clone(), known)?
        };
        let mut reconstructor = Reconstructor::new(reference, options);
        for frame in 0..2 * FRAMES {
            let down = frame >= FRAMES;
            let values = measured(if down { &touched } else { &sheet.baseline });
            let result = reconstructor.frame(&values)?;
            let said = result.doubt.is_some() || !result.faults.is_empty();
            if !down {
                silent += usize::from(!result.touches.is_empty() && !said);
            } else if let [one] = result.touches[..] {
                let [x, y] = FINGER.centre_mm;
                let error = (one.x_mm - x).hypot(one.y_mm - y);
                right += usize::from(error < 5.0);
                off.push(error);
            }
        }
    }
    off.sort_by(f64::total_cmp);
    Ok((silent, right, off.get(off.len() / 2).copied().unwrap_or(f64::NAN)))
}

fn main() -> Result<(), StudyError> {
    let kinds = [
        ("the same of all values, 27 dB", Noise::Even),
        ("0.1 % of each value", Noise::Proportional(0.001)),
        ("0.2 % of each value", Noise::Proportional(0.002)),
        ("0.5 % of each value", Noise::Proportional(0.005)),
        ("1 % of each value", Noise::Proportional(0.01)),
        ("one amplifier ten times as noisy", Noise::Amplifier(10.0)),
        ("gains of channels, 0.2 % in each frame", Noise::Channels(0.002)),
    ];
    let all = FRAMES * SEEDS.count();
    println!(
        "| noise | baseline frames | silent touches at rest, of {all}: one noise / own | finger right, of {all} | median mm |"
    );
    println!("|---|---|---|---|---|");
    for (name, noise) in kinds {
        for baseline_frames in [8, 24, 80] {
            let [one, own] = [row(noise, baseline_frames, false)?, row(noise, baseline_frames, true)?];
            println!(
                "| {name} | {baseline_frames} | {} / {} | {} / {} | {:.2} / {:.2} |",
                one.0, own.0, one.1, own.1, one.2, own.2
            );
        }
    }
    Ok(())
}
