//! Accuracy of the touches on simulated frames: fewer scenes than `examples/touch_accuracy.rs`, with the same bounds.

use forward::Drive;
use studies::conformal::{ConformalMap, angles};
use studies::{Fault, Kind, Score, TestSheet, imager, quantile, reconstructor, rng, trial};

/// Scenes of one kind from the paper's drive.
fn paper(kind: Kind, snr_db: f64, scenes: usize, seed: u64) -> Score {
    let imager = imager(Drive::PAPER, 5.0).unwrap();
    let mut rng = rng(seed);
    let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.0, 0.0, &mut rng).unwrap();
    let mut r = sheet.reconstructor().unwrap();
    trial::score(&mut sheet, &mut r, kind, snr_db, scenes, &mut rng).unwrap()
}

/// Fewest successes of n with probability p each; fewer have a chance of about one in a thousand.
fn least(n: usize, p: f64) -> usize {
    let (n, q) = (n as f64, 1.0 - p);
    (n * p - 3.1 * (n * p * q).sqrt() - 0.5).floor().max(0.0) as usize
}

#[test]
fn one_touch_to_three_tenths_of_a_millimetre() {
    for kind in [Kind::Equal(1), Kind::Fingers(1)] {
        let s = paper(kind, 27.0, 60, 9001);
        assert!(s.counted >= least(60, 0.99), "{kind:?}: {} of 60", s.counted);
        assert!(
            s.error_mm(0.5) < 0.3 && s.error_mm(0.95) < 0.8,
            "{kind:?}: {} {}",
            s.error_mm(0.5),
            s.error_mm(0.95)
        );
    }
}

#[test]
fn four_touches_to_half_a_millimetre_and_their_uncertainty_is_honest() {
    let s = paper(Kind::Equal(4), 27.0, 40, 9002);
    assert!(s.counted >= least(40, 0.99), "{} of 40", s.counted);
    // 160 errors: the 95th percentile itself scatters by a fifth.
    assert!(
        s.error_mm(0.5) < 0.5 && s.error_mm(0.95) < 1.8,
        "{} {}",
        s.error_mm(0.5),
        s.error_mm(0.95)
    );
    // Of 320 coordinates, 95 % should lie within two standard uncertainties.
    assert!((0.90..=0.995).contains(&s.honest_part()), "{}", s.honest_part());
}

#[test]
fn two_tips_side_by_side_are_told_apart() {
    for (apart, db, p) in [
        (40.0, 27.0, 0.99),
        (35.0, 27.0, 0.97),
        (30.0, 27.0, 0.95),
        (27.0, 60.0, 0.95),
    ] {
        let s = paper(Kind::Pair(apart), db, 30, 9003);
        assert!(s.resolved >= least(30, p), "{apart} mm, {db} dB: {} of 30", s.resolved);
    }
}

#[test]
fn unequal_touches_are_all_found() {
    let s = paper(Kind::Unequal, 27.0, 50, 9004);
    assert!(s.counted >= least(50, 0.97), "{} of 50", s.counted);
    assert!(
        s.error_mm(0.5) < 0.8 && s.error_mm(0.95) < 3.5,
        "{} {}",
        s.error_mm(0.5),
        s.error_mm(0.95)
    );
}

#[test]
fn strong_touches_keep_their_rise() {
    for rise in [1.0, 3.0] {
        let s = paper(Kind::Strong(rise), 27.0, 20, 9005);
        assert_eq!(s.counted, 20, "{rise}");
        assert!(s.error_mm(0.5) < 0.7, "{rise}: {}", s.error_mm(0.5));
        let median = quantile(&s.totals, 0.5);
        assert!((median - 1.0).abs() < 0.1, "{rise}: {median}");
    }
}

#[test]
fn a_lost_electrode_and_a_stuck_channel_are_found_and_left_out() {
    for fault in [Fault::Electrode, Fault::Missing, Fault::Stuck] {
        let s = paper(Kind::Broken(fault), 27.0, 20, 9006);
        assert!(s.counted >= least(20, 0.95), "{fault:?}: {} of 20", s.counted);
        assert!(s.error_mm(0.5) < 1.5, "{fault:?}: {}", s.error_mm(0.5));
    }
}

#[test]
fn electrodes_and_contacts_that_are_off_are_found() {
    for (n, median, p95) in [(1, 0.3, 0.8), (4, 0.5, 1.5)] {
        let imager = imager(Drive::PAPER, 5.0).unwrap();
        let mut rng = rng(9007);
        let mut s = Score::default();
        for _ in 0..4 {
            let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.5, 0.3, &mut rng).unwrap();
            let mut r = sheet.reconstructor().unwrap();
            trial::run(&mut sheet, &mut r, Kind::Equal(n), 27.0, 10, &mut rng, &mut s).unwrap();
        }
        assert!(s.counted >= least(40, 0.99), "{n}: {} of 40", s.counted);
        // With four sheets only, the bounds are a third wider than those of many.
        assert!(
            s.error_mm(0.5) < 1.33 * median && s.error_mm(0.95) < 1.33 * p95,
            "{n}: {}",
            s.error_mm(0.5)
        );
        // The electrode uncertainty is part of the uncertainty of the touches, also with little noise.
        let mut quiet = Score::default();
        for _ in 0..4 {
            let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.5, 0.3, &mut rng).unwrap();
            let mut r = sheet.reconstructor().unwrap();
            trial::run(&mut sheet, &mut r, Kind::Equal(n), 60.0, 10, &mut rng, &mut quiet).unwrap();
        }
        for score in [s, quiet] {
            assert!(score.honest_part() > 0.88, "{n}: {}", score.honest_part());
        }
    }
}

/// The baseline does not show a conformal map of the disc. Nothing else of the electrodes stays unknown.
#[test]
fn electrodes_are_found_but_for_a_conformal_map() {
    for (drive, seed) in [(Drive::PAPER, 9009), (Drive::Current { amplitude_a: 1e-3 }, 9010)] {
        let imager = imager(drive, 5.0).unwrap();
        let mut rng = rng(seed);
        let sheet = TestSheet::new(&imager, drive, 0.5, 0.3, &mut rng).unwrap();
        let found = inverse::reference::electrode_fit::find(&imager, &sheet.baseline).unwrap();
        let nominal = angles(imager.model.sheet());
        let off: Vec<f64> = angles(sheet.as_built())
            .iter()
            .zip(&nominal)
            .zip(&found.moved_mm)
            .map(|((is, said), moved)| moved - 97.5 * (is - said))
            .collect();
        let (_, left) = ConformalMap::nearest(97.5, &off, &nominal).unwrap();
        let largest = |v: &[f64]| v.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        // The difference of the two meshes allows 0.01 mm.
        assert!(largest(&left) < 0.01, "{left:?}");
        assert!(largest(&off) > 0.05, "{off:?}");
    }
}

#[test]
fn noise_is_no_touch() {
    let imager = imager(Drive::PAPER, 5.0).unwrap();
    let mut rng = rng(9008);
    let sheet = TestSheet::new(&imager, Drive::PAPER, 0.0, 0.0, &mut rng).unwrap();
    let mut r = reconstructor(&imager, &sheet.baseline).unwrap();
    for sigma in [1e-6, 1e-4, 1e-2] {
        for _ in 0..300 {
            let frame = sheet.empty(sigma * sheet.baseline[0], &mut rng);
            let found = r.frame(&frame).unwrap();
            assert!(found.touches.is_empty(), "{sigma}: {:?}", found.touches);
        }
    }
}
