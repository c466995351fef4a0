//! What drifts since the baseline makes no touches, and takes nothing from those that are there.

use forward::{DiscTouch, Drive};
use studies::{Drift, TestSheet, imager, noise_v, noisy, rng};

const CURRENT: Drive = Drive::Current { amplitude_a: 1e-3 };

fn finger(x: f64, y: f64) -> DiscTouch {
    DiscTouch {
        centre_mm: [x, y],
        radius_mm: 12.5,
        rise: 0.2,
    }
}

/// Frames at 27 dB, each alone, on another mesh and by the nonlinear model: a gain a tenth off, a sheet 10 K warmer (0.5 %/K),
/// contacts 10 % off by a normal distribution, and all of them.
#[test]
fn drift_makes_no_touch_and_moves_none() {
    for (drive, seed) in [(Drive::PAPER, 101), (CURRENT, 102)] {
        let imager = imager(drive, 5.0).unwrap();
        let mut rng = rng(seed);
        let mut sheet = TestSheet::new(&imager, drive, 0.0, 0.0, &mut rng).unwrap();
        let mut reconstructor = sheet.reconstructor().unwrap();
        let gain = Drift {
            gain: 1.1,
            ..Drift::none(16)
        };
        let warm = Drift {
            resistance: 0.95,
            ..Drift::none(16)
        };
        let contacts = Drift::none(16).with_contacts(0.1, &mut rng);
        let all = Drift {
            gain: 0.9,
            resistance: 1.05,
            ..Drift::none(16).with_contacts(0.1, &mut rng)
        };
        for drift in [gain, warm, contacts, all] {
            let sigma = noise_v(
                &sheet.clean_frame(&[finger(48.0, 0.0)]).unwrap(),
                &sheet.baseline.clone(),
                27.0,
            );
            let empty = sheet.drifted_frame(&[], &drift).unwrap();
            let touch = finger(-30.0, 45.0);
            let touched = sheet.drifted_frame(&[touch], &drift).unwrap();
            let name = format!("{drive:?} {drift:?}");
            for _ in 0..10 {
                let frame = noisy(empty.clone(), sigma, &mut rng);
                let found = reconstructor.frame(&frame).unwrap();
                assert!(found.touches.is_empty(), "{name}: {:?}", found.touches);
                let frame = noisy(touched.clone(), sigma, &mut rng);
                let found = reconstructor.frame(&frame).unwrap();
                assert_eq!(found.touches.len(), 1, "{name}: {:?}", found.touches);
                let t = found.touches[0];
                let off = (t.x_mm + 30.0).hypot(t.y_mm - 45.0);
                assert!(off < 0.8, "{name}: {off} mm");
                let total = touch.rise * std::f64::consts::PI * touch.radius_mm.powi(2);
                assert!(
                    (t.total_mm2 / total - 1.0).abs() < 0.1,
                    "{name}: {}",
                    t.total_mm2 / total
                );
            }
        }
    }
}

/// A gain is found to a thousandth, and said; one that did not drift is not.
#[test]
fn a_common_gain_is_found_and_said() {
    let imager = imager(Drive::PAPER, 5.0).unwrap();
    let mut rng = rng(103);
    let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.0, 0.0, &mut rng).unwrap();
    let mut reconstructor = sheet.reconstructor().unwrap();
    for gain in [0.5, 0.9, 1.0, 1.03, 2.0] {
        for touches in [vec![], vec![finger(10.0, -60.0)]] {
            let drift = Drift {
                gain,
                ..Drift::none(16)
            };
            let clean = sheet.drifted_frame(&touches, &drift).unwrap();
            let sigma = noise_v(
                &sheet.clean_frame(&[finger(48.0, 0.0)]).unwrap(),
                &sheet.baseline.clone(),
                27.0,
            );
            let found = reconstructor.frame(&noisy(clean, sigma, &mut rng)).unwrap();
            assert!(
                (found.drift.gain / gain - 1.0).abs() < 2e-3,
                "{gain} {}: {}",
                touches.len(),
                found.drift.gain
            );
            assert_eq!(found.drift.notice().is_some(), gain != 1.0);
        }
    }
}
