//! A calibration with a few presses is never worse than the model without: on a sheet with misplaced electrodes it is better, on one that
//! the model describes it is the same.

use forward::{DiscTouch, Drive};
use inverse::batch::{Batch, BatchOptions, OwnFrame};
use inverse::reference::baseline::Baseline;
use inverse::solvers::Method;
use std::sync::Arc;
use studies::flawed_sheet::{Flaws, compare};
use studies::{TestSheet, imager, noise_v, noisy, rng};

/// Squares of distances that count as none, mm²: a press is located to a tenth of a millimetre.
const FLOOR_MM2: f64 = 0.01;
/// Rises of a press, and of the dent that it leaves.
const PRESS: f64 = 0.2;
const DENT: f64 = 0.08;

fn loss(errors_mm: &[f64]) -> f64 {
    let sum: f64 = errors_mm.iter().map(|e| (e * e + FLOOR_MM2).ln()).sum();
    sum / errors_mm.len() as f64
}

/// Of a dent that the press before left a part has gone in the next frame: touches that explain the frames tell that part, and that none
/// has gone. Where nobody has seen the sheet without dents, they also tell how deep the mean of all dents is.
#[test]
fn the_part_of_a_dent_that_has_gone_is_found() {
    let imager = imager(Drive::PAPER, 5.0).unwrap();
    let mut random = rng(3);
    let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.0, 0.0, &mut random).unwrap();
    let rest = sheet.baseline.clone();
    let press = |k: usize, rise: f64| {
        let (angle, radius) = (2.4 * k as f64, 20.0 + 6.0 * (k % 9) as f64);
        DiscTouch {
            centre_mm: [radius * angle.cos(), radius * angle.sin()],
            radius_mm: 12.5,
            rise,
        }
    };
    for (gone, is_seen) in [(0.0, true), (0.3, true), (0.3, false), (0.7, true)] {
        let pairs: Vec<[Vec<f64>; 2]> = (1..25)
            .map(|k| {
                let before = sheet.clean_frame(&[press(k - 1, DENT)]).unwrap();
                let both = [press(k - 1, DENT * (1.0 - gone)), press(k, PRESS)];
                let pressed = sheet.clean_frame(&both).unwrap();
                let sigma = noise_v(&pressed, &rest, 27.0);
                [
                    noisy(before, 0.3 * sigma, &mut random),
                    noisy(pressed, sigma, &mut random),
                ]
            })
            .collect();
        fn own([before, values]: &[Vec<f64>; 2]) -> OwnFrame<'_> {
            OwnFrame { before, values }
        }
        let own: Vec<OwnFrame<'_>> = pairs.iter().map(own).collect();
        let options = BatchOptions {
            drifts: false,
            noise_frames: usize::MAX,
            ..BatchOptions::of(Method::Nnls)
        };
        let unpressed: Vec<&[f64]> = own.iter().map(|frame| frame.before).collect();
        let unpressed = if is_seen { vec![rest.as_slice()] } else { unpressed };
        let mean = Baseline::of_frames(rest.len(), &unpressed).values_v;
        let batch = Batch::new(Arc::clone(&imager), &unpressed, options).unwrap();
        let found = batch.recovered(&mean, is_seen, &own).unwrap();
        let (part, dented) = found.map_or((0.0, 0.0), |found| (found.part, found.dented));
        assert!((part - gone).abs() < 0.1, "{gone}: {part}");
        let depth = if is_seen { 0.0 } else { DENT / PRESS };
        assert!((dented - depth).abs() < 0.08, "{gone}: {dented} of {depth}");
    }
}

#[test]
fn a_calibration_is_never_worse_than_the_model_without() {
    let imager = imager(Drive::PAPER, 5.0).unwrap();
    let misplaced = Flaws {
        off_mm: 0.5,
        contact: 0.3,
        ..Flaws::default()
    };
    for (flaws, better) in [(misplaced, true), (Flaws::default(), false)] {
        let found = compare(&imager, flaws, (16, 16), (7, 0)).unwrap();
        assert!(found.model_taken, "{flaws:?}");
        assert!(!better || found.told_taken, "{flaws:?}");
        let [alone, calibrated] = [&found.alone, &found.calibrated].map(|l| loss(&l.errors_mm));
        // What presses tell of a sheet that is right has the uncertainty of their noise.
        let most = if better { alone } else { alone + 0.2 };
        assert!(calibrated < most, "{flaws:?}: {calibrated} {alone}");
        assert!(
            found.calibrated.at()[0] < 0.25,
            "{flaws:?}: {:?}",
            found.calibrated.at()
        );
        assert!(
            found.calibrated.honest_part() > 0.8,
            "{flaws:?}: {}",
            found.calibrated.honest_part()
        );
    }
}
