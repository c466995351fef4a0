//! Checks of the whole way of a frame.

use crate::cost::{self, Happening};
use crate::error::StudyError;
use crate::scene::rng;
use crate::stress::{Check, Effort, Verdict};
use crate::test_sheet::{TestSheet, imager, noise_v, noisy};
use forward::Drive;
use inverse::pipeline::{Reconstructor, ReconstructorOptions};
use inverse::reference::Reference;
use inverse::reference::noise::FrameNoise;
use inverse::solvers::{Method, Nnls, NnlsOptions, Problem, Status};
use nalgebra::DVector;
use rand::Rng;

/// Frames of arbitrary values.
pub(super) fn rubbish(effort: Effort) -> Result<Verdict, StudyError> {
    let mut check = Check::new(
        "any frame gives a picture that is finite (by nnls not negative, or no touches explain it, which is said) and touches on the sheet",
    );
    let mut rng = rng(effort.seed + 40);
    let imager = imager(Drive::PAPER, 10.0)?;
    let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.0, 0.0, &mut rng)?;
    let touched = cost::sequence(&mut sheet, Happening::Four, 1, 1e-5, &mut rng)?.swap_remove(0);
    let numbers = [
        f64::NAN,
        f64::INFINITY,
        f64::NEG_INFINITY,
        0.0,
        -0.0,
        5e-324,
        -1e-310,
        f64::MAX,
        f64::MIN,
        1e12,
        -1e-12,
    ];
    for method in Method::ALL {
        let options = ReconstructorOptions::for_imager(&imager, method);
        let against = |baseline: Vec<f64>| -> Result<Reconstructor, StudyError> {
            let reference = Reference::new(imager.clone(), baseline, FrameNoise::Unknown)?;
            Ok(Reconstructor::new(reference, options))
        };
        let mut sound = against(sheet.baseline.clone())?;
        for case in 0..effort.problems / 10 + numbers.len() {
            let mut frame = touched.clone();
            let mut baseline = sheet.baseline.clone();
            // One number everywhere first, then any of them in a part of the frame or the baseline.
            if let Some(number) = numbers.get(case) {
                frame.fill(*number);
            } else {
                let part = rng.random_range(0.0..1.0_f64).powi(2);
                let spoilt = if case % 2 == 0 {
                    frame.iter_mut()
                } else {
                    baseline.iter_mut()
                };
                for v in spoilt {
                    if rng.random_range(0.0..1.0) < part {
                        *v = numbers[rng.random_range(0..numbers.len())];
                    }
                }
            }
            let mut other = None;
            let r = match baseline == sheet.baseline {
                true => &mut sound,
                false => other.insert(against(baseline)?),
            };
            let found = r.frame(&frame)?;
            let finite = found.x.iter().all(|x| x.is_finite()) && found.residual.is_finite();
            check.holds(finite, || format!("{method}, case {case}: picture"));
            // Where no touches explain a frame its picture may fall as well, and it is doubted.
            let may_fall = method != Method::Nnls || (found.misfit.is_none() && found.doubt.is_some());
            let positive = may_fall || found.x.iter().all(|x| *x >= 0.0);
            check.holds(positive, || format!("{method}, case {case}: negative"));
            let on = found
                .touches
                .iter()
                .all(|t| t.x_mm.hypot(t.y_mm) < 150.0 && t.rise.is_finite());
            check.holds(on, || format!("{method}, case {case}: {:?}", found.touches));
        }
        let found = sound.frame(&touched)?;
        check.holds(method != Method::Nnls || found.touches.len() == 4, || {
            format!("{method}: {} touches of 4 after the rubbish", found.touches.len())
        });
    }
    Ok(check.verdict())
}

/// Four fingers move over the sheet for long, with warm and with cold starts. First at 27 dB with the usual ridge,
/// then with few cells whose sign changes from frame to frame.
pub(super) fn warm_is_cold(effort: Effort) -> Result<Verdict, StudyError> {
    let mut check = Check::new("on the sheet a long warm run equals cold solves");
    let mut rng = rng(effort.seed + 41);
    let imager = imager(Drive::PAPER, 5.0)?;
    let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.0, 0.0, &mut rng)?;
    let length = effort.sheet.min(100);
    let clean = cost::sequence(&mut sheet, Happening::Four, length, 0.0, &mut rng)?;
    let problem = Problem::new(&imager.sensitivity, 0.0);
    for (ridge, decibels) in [(0.003, 27.0), (0.01, 27.0), (0.01, 60.0), (0.1, 40.0)] {
        let sigma = noise_v(&clean[0], &sheet.baseline, decibels);
        let options = NnlsOptions {
            ridge: ridge * problem.singular()[0],
            tolerance: 1e-9,
            most_steps: 60,
        };
        let mut warm = Nnls::new(options);
        for frame in 0..effort.sheet {
            // There and back again, with fresh noise.
            let k = frame % (2 * length);
            let k = if k < length { k } else { 2 * length - 1 - k };
            let v = noisy(clean[k].clone(), sigma, &mut rng);
            let b = DVector::from_iterator(v.len(), v.iter().zip(&sheet.baseline).map(|(a, b)| a - b));
            let s = warm.solve(&problem, &b);
            check.holds(s.status == Status::Converged, || {
                format!(
                    "ridge {ridge}, {decibels} dB, frame {frame}: {:?} {:e}",
                    s.status, s.gap
                )
            });
            if frame % 20 == 0 || frame + 1 == effort.sheet {
                let cold = Nnls::new(options).solve(&problem, &b);
                check.most((&s.x - &cold.x).amax() / cold.x.amax(), 1e-7, || {
                    format!("ridge {ridge}, {decibels} dB, frame {frame}")
                });
            }
        }
    }
    Ok(check.verdict())
}
