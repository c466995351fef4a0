//! Frames in which no touches are looked for, and those in which they are, however much the linear model is wrong by.

use forward::{DiscTouch, Drive};
use inverse::pipeline::{Reconstructor, ReconstructorOptions};
use inverse::quality::doubt::Doubt;
use inverse::reference::Reference;
use inverse::reference::noise::FrameNoise;
use inverse::solvers::Method;
use inverse::touches::polarity::Polarity;
use rand::Rng;
use rand::rngs::StdRng;
use rand_distr::StandardNormal;
use studies::{TestSheet, imager, noise_v, noisy, rng};

/// Frames of the paper's sheet, each by itself, with the noise known.
fn table(sheet: &TestSheet, sigma: f64) -> Reconstructor {
    let imager = sheet.fitted_imager();
    let options = ReconstructorOptions {
        polarity: Some(Polarity::Either),
        ..ReconstructorOptions::for_imager(&imager, Method::Nnls)
    };
    let noise = FrameNoise::of_frames(sigma);
    Reconstructor::new(Reference::new(imager, sheet.baseline.clone(), noise).unwrap(), options)
}

/// Every value off by this part of it.
fn random(baseline: &[f64], part: f64, rng: &mut StdRng) -> Vec<f64> {
    let off = |b: &f64| b * (1.0 + part * rng.sample::<f64, _>(StandardNormal));
    baseline.iter().map(off).collect()
}

/// Touches of any strength, in the middle and at the rim, one to four, at any noise: discs explain every frame of them.
#[test]
fn touches_are_looked_for_in_every_frame_of_touches() {
    let mut rng = rng(871);
    let imager = imager(Drive::PAPER, 5.0).unwrap();
    let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.0, 0.0, &mut rng).unwrap();
    let corners = [[10.0, 5.0], [-55.0, 30.0], [20.0, -62.0], [60.0, 52.0]];
    for (rise, count) in [0.2, 1.0, 3.0, 10.0, -0.5, -0.9].into_iter().zip([4, 3, 4, 2, 3, 1]) {
        let touches: Vec<DiscTouch> = (corners.iter().take(count))
            .map(|at| DiscTouch {
                centre_mm: at.map(|v| v + rng.random_range(-8.0..8.0)),
                radius_mm: 12.5,
                rise,
            })
            .collect();
        let clean = sheet.clean_frame(&touches).unwrap();
        for snr_db in [27.0, 60.0] {
            let sigma = noise_v(&clean, &sheet.baseline, snr_db);
            let mut reconstructor = table(&sheet, sigma);
            let result = reconstructor.frame(&noisy(clean.clone(), sigma, &mut rng)).unwrap();
            let (found, misfit) = (result.touches.len(), result.misfit);
            let case = format!("{count} touches of {rise} at {snr_db} dB: {found}, {misfit:?}");
            assert!(misfit.is_some() && result.doubt.is_none(), "{case}");
            assert_eq!(found, count, "{case}");
        }
    }
}

/// Frames of a table that have nothing to do with the sheet cost no evaluation of a touch, and are doubted.
#[test]
fn frames_of_nothing_are_given_up_and_doubted() {
    let mut rng = rng(872);
    let imager = imager(Drive::PAPER, 5.0).unwrap();
    let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.0, 0.0, &mut rng).unwrap();
    let finger = DiscTouch {
        centre_mm: [30.0, 20.0],
        radius_mm: 12.5,
        rise: 0.2,
    };
    let clean = sheet.clean_frame(&[finger]).unwrap();
    let sigma = noise_v(&clean, &sheet.baseline, 27.0);
    let mut reconstructor = table(&sheet, sigma);
    for part in [0.01, 0.3, 10.0] {
        for k in 0..12 {
            let result = reconstructor.frame(&random(&clean, part, &mut rng)).unwrap();
            assert!(matches!(
                result.doubt,
                Some(Doubt::NotTouches | Doubt::NotThisSheet | Doubt::FewValues { .. })
            ));
            let work = reconstructor.work();
            assert_eq!(work.evaluations, 0, "{part}, frame {k}: {work:?}");
        }
    }
}
