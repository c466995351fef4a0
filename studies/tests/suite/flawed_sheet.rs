//! A calibration with a few presses is never worse than the model without: on a sheet with misplaced electrodes it is better, on one that
//! the model describes it is the same.

use forward::Drive;
use studies::flawed_sheet::{Flaws, compare};
use studies::imager;

/// Squares of distances that count as none, mm²: a press is located to a tenth of a millimetre.
const FLOOR_MM2: f64 = 0.01;

fn loss(errors_mm: &[f64]) -> f64 {
    let sum: f64 = errors_mm.iter().map(|e| (e * e + FLOOR_MM2).ln()).sum();
    sum / errors_mm.len() as f64
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
