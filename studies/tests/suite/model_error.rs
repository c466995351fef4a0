//! Sheets that no model describes: every value has a gain of its own, so that no disc explains a press.

use forward::{DiscTouch, Drive, Pattern, Sheet};
use inverse::pipeline::{Reconstructor, ReconstructorOptions};
use inverse::quality::doubt::Doubt;
use inverse::reference::Reference;
use inverse::reference::imager::Imager;
use inverse::reference::noise::FrameNoise;
use inverse::solvers::Method;
use nalgebra::DVector;
use rand::Rng;
use rand_distr::StandardNormal;
use std::sync::Arc;
use studies::{TestSheet, imager, live_reconstructor, noise_v, noisy, quantile, rng};

/// Presses, and standard deviation of a value's own gain, whose mean is 1: three tenths of the change's square are the model's.
const PRESSES: usize = 100;
const GAIN_SD: f64 = 1.5;

/// What came of single presses on sheets whose values have gains of their own: errors (mm) and those of a coordinate over their
/// standard deviation, of frames with one touch; frames with more; frames without a touch; touches that are doubted.
struct Outcome {
    errors: Vec<f64>,
    whitened: Vec<f64>,
    more: usize,
    none: usize,
    doubted: usize,
}

fn presses(pattern: &Pattern, drifts: bool) -> Outcome {
    let imager = Arc::new(Imager::new(&Sheet::paper(), Drive::PAPER, pattern.clone(), 5.0).unwrap());
    let mut rng = rng(23);
    let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.0, 0.0, &mut rng).unwrap();
    let baseline = sheet.baseline.clone();
    let options = ReconstructorOptions {
        drifts,
        ..ReconstructorOptions::for_imager(&imager, Method::Nnls)
    };
    let reference = Reference::new(Arc::clone(&imager), baseline.clone(), FrameNoise::Unknown).unwrap();
    let mut reconstructor = Reconstructor::new(reference, options);
    let mut outcome = Outcome {
        errors: Vec::new(),
        whitened: Vec::new(),
        more: 0,
        none: 0,
        doubted: 0,
    };
    for _ in 0..PRESSES {
        let (angle, r) = (
            rng.random_range(0.0..std::f64::consts::TAU),
            75.0 * rng.random::<f64>().sqrt(),
        );
        let at = [r * angle.cos(), r * angle.sin()];
        let touch = DiscTouch {
            centre_mm: at,
            radius_mm: 12.5,
            rise: 0.2,
        };
        let clean = sheet.clean_frame(&[touch]).unwrap();
        let frame: Vec<f64> = clean
            .iter()
            .zip(&baseline)
            .map(|(v, b)| b + (v - b) * (1.0 + GAIN_SD * rng.sample::<f64, _>(StandardNormal)))
            .collect();
        let found = reconstructor.frame(&frame).unwrap();
        let doubted = found.doubt == Some(Doubt::NotTouches) && !found.touches.is_empty();
        outcome.doubted += usize::from(doubted);
        match found.touches.as_slice() {
            [] => outcome.none += 1,
            [touch] => {
                let off = [touch.x_mm - at[0], touch.y_mm - at[1]];
                outcome.errors.push(off[0].hypot(off[1]));
                outcome.whitened.push(off[0] / touch.x_sd_mm.unwrap());
                outcome.whitened.push(off[1] / touch.y_sd_mm.unwrap());
            }
            _ => outcome.more += 1,
        }
    }
    outcome
}

/// The pairs of the adjacent pattern contradict one another by as much as a press changes, so that reciprocity takes all of it for
/// noise; in the other pattern there is none.
#[test]
fn a_press_that_no_disc_explains_is_one_touch_with_an_honest_uncertainty() {
    for pattern in [Pattern::adjacent(16), Pattern::rotating(16, 8, 1)] {
        for drifts in [false, true] {
            let outcome = presses(&pattern.clone().unwrap(), drifts);
            let within = outcome.whitened.iter().filter(|v| v.abs() < 2.0).count() as f64;
            let within = within / outcome.whitened.len() as f64;
            let median = quantile(&outcome.errors, 0.5);
            println!(
                "drifts {drifts}: {} of {PRESSES} with one touch, {} more, {} none, {} doubted; {median:.1} / {:.1} mm; {:.3} \
                 within two standard deviations",
                outcome.errors.len(),
                outcome.more,
                outcome.none,
                outcome.doubted,
                quantile(&outcome.errors, 0.95),
                within
            );
            assert!(outcome.errors.len() >= PRESSES / 2 && outcome.more <= 5);
            assert!(outcome.doubted >= PRESSES / 2);
            assert!(median < 8.0 && within >= 0.88, "{median} mm, {within}");
        }
    }
}

/// A touch whose place the values do not tell is not listed, and that is said.
#[test]
fn a_touch_without_a_place_is_no_silence() {
    let mut uncertain = Imager::clone(&imager(Drive::PAPER, 5.0).unwrap());
    let electrodes = uncertain.pattern.electrodes();
    // Electrodes along the rim may be turned, or drawn together and apart, by 8 mm.
    let mode = |of: fn(f64) -> f64| {
        let turn = |l: usize| std::f64::consts::TAU * l as f64 / electrodes as f64;
        let mode = DVector::from_fn(2 * electrodes, |k, _| {
            k.checked_sub(electrodes).map_or(0.0, |l| 8.0 * of(turn(l)))
        });
        &mode * mode.transpose()
    };
    uncertain.electrode_covariance = Some(mode(|_| 1.0) + mode(f64::sin) + mode(|turn| (2.0 * turn).cos()));
    let mut rng = rng(311);
    let uncertain = Arc::new(uncertain);
    let mut sheet = TestSheet::new(&uncertain, Drive::PAPER, 0.0, 0.0, &mut rng).unwrap();
    let finger = |centre_mm| DiscTouch {
        centre_mm,
        radius_mm: 12.5,
        rise: 0.2,
    };
    let rim = sheet.clean_frame(&[finger([0.0, 90.0])]).unwrap();
    let middle = sheet.clean_frame(&[finger([0.0, 20.0])]).unwrap();
    let sigma = noise_v(&rim, &sheet.baseline, 40.0);
    let noise = FrameNoise::of_frames(sigma);
    let mut reconstructor = live_reconstructor(&uncertain, &sheet.baseline, noise).unwrap();
    for (clean, doubt, touches) in [(&rim, Some(Doubt::Unplaced), 0), (&middle, None, 1)] {
        for _ in 0..8 {
            let result = reconstructor.frame(&noisy(clean.clone(), sigma, &mut rng)).unwrap();
            assert_eq!(
                (result.doubt, result.touches.len()),
                (doubt, touches),
                "{:?}",
                result.touches
            );
        }
        reconstructor.frame(&sheet.empty(sigma, &mut rng)).unwrap();
    }
}
