//! Errors of the touches compared with the Cramer-Rao bound, in the scenes of `touch_accuracy`. Table:
//! docs/results.md, The bound.
//!
//! `cargo run --release -p studies --example bounds -- [--scenes N] [--seed S] [--only WORD]`
//!
//! The derivatives of the nonlinear model are central differences on the mesh that makes the frames. Parameters are
//! x, y, radius and rise of every touch. With the noise of the scene they give the least covariance of any unbiased
//! fit of one frame. The bound with the prior is that of a fit with a prior of the radius; its mean is the radius of
//! these touches. Errors are drawn from both covariances and listed like those of the reconstruction.

use forward::{DiscTouch, Drive};
use inverse::touches::fit::FitOptions;
use nalgebra::{DMatrix, DVector};
use rand::Rng;
use rand::rngs::StdRng;
use rand_distr::StandardNormal;
use studies::StudyError;
use studies::{Kind, Score, TestSheet, imager, noise_v, quantile, rng};

/// Steps of the differences: x and y, radius (mm), and the rise (relative).
const STEPS: [f64; 4] = [0.5, 0.5, 0.5, 0.05];
/// Errors drawn for every scene.
const DRAWS: usize = 200;

/// Position errors (mm) and relative errors of the integrated rise.
#[derive(Default)]
struct Errors {
    places: Vec<f64>,
    totals: Vec<f64>,
}

fn moved(touches: &[DiscTouch], parameter: usize, steps: f64) -> Vec<DiscTouch> {
    let mut out = touches.to_vec();
    let t = &mut out[parameter / 4];
    let step = steps * STEPS[parameter % 4];
    match parameter % 4 {
        0 => t.centre_mm[0] += step,
        1 => t.centre_mm[1] += step,
        2 => t.radius_mm += step,
        _ => t.rise *= 1.0 + step,
    }
    out
}

/// Information of a frame about x, y, radius (mm) and the logarithm of the rise of every touch.
fn information(sheet: &mut TestSheet, touches: &[DiscTouch], sigma: f64) -> Result<DMatrix<f64>, StudyError> {
    let mut columns = Vec::new();
    for parameter in 0..4 * touches.len() {
        let up = sheet.clean_frame(&moved(touches, parameter, 1.0))?;
        let down = sheet.clean_frame(&moved(touches, parameter, -1.0))?;
        let slope = up
            .iter()
            .zip(&down)
            .map(|(u, d)| (u - d) / (2.0 * STEPS[parameter % 4] * sigma));
        columns.push(DVector::from_iterator(up.len(), slope));
    }
    let jacobian = DMatrix::from_columns(&columns);
    Ok(jacobian.tr_mul(&jacobian))
}

/// Draws errors of a fit with this information and a prior of the radius with this inverse variance, 1/mm².
fn draw(
    information: &DMatrix<f64>,
    prior: f64,
    touches: &[DiscTouch],
    rng: &mut StdRng,
    out: &mut Errors,
) -> Option<()> {
    let count = information.nrows();
    let with_prior = DMatrix::from_fn(count, count, |i, j| {
        information[(i, j)] + if i == j && i % 4 == 2 { prior } else { 0.0 }
    });
    // Covariance where the true radius is the mean of the prior.
    let inverse = with_prior.try_inverse()?;
    let covariance = &inverse * information * inverse.transpose();
    let factor = (0.5 * (&covariance + covariance.transpose())).cholesky()?;
    for _ in 0..DRAWS {
        let error = factor.l() * DVector::from_fn(count, |_, _| rng.sample::<f64, _>(StandardNormal));
        for (k, t) in touches.iter().enumerate() {
            let [x, y, radius, rise] = [0, 1, 2, 3].map(|p| error[4 * k + p]);
            out.places.push(x.hypot(y));
            out.totals.push((2.0 * radius / t.radius_mm + rise).abs());
        }
    }
    Some(())
}

fn main() -> anyhow::Result<()> {
    let given: Vec<String> = std::env::args().collect();
    let after = |name: &str| given.iter().position(|a| a == name).and_then(|k| given.get(k + 1));
    let number = |name: &str, default: u64| after(name).and_then(|v| v.parse().ok()).unwrap_or(default);
    let (scenes, seed) = (number("--scenes", 30), number("--seed", 1));
    let only = after("--only").cloned().unwrap_or_default();
    println!("seed {seed}, {scenes} scenes of every kind");
    println!(
        "| scenes | position mm, fit: median / 95 % | bound with the prior | bound | total 95 % off, fit | bound with the prior | bound |\n\
         |---|---|---|---|---|---|---|"
    );
    for (drive_name, drive) in [
        ("voltage", Drive::PAPER),
        ("current", Drive::Current { amplitude_a: 1e-3 }),
    ] {
        let imager = imager(drive, 5.0)?;
        let options = FitOptions::for_extent(imager.reach_mm());
        let prior = options.radius_sd_mm.powi(-2);
        let kinds = [
            ("equal 1", Kind::Equal(1), 27.0),
            ("equal 4", Kind::Equal(4), 27.0),
            ("pair 30 mm", Kind::Pair(30.0), 27.0),
            ("strong +100 %, 27 dB", Kind::Strong(1.0), 27.0),
            ("strong +300 %, 27 dB", Kind::Strong(3.0), 27.0),
            ("strong +100 %, 38.3 dB", Kind::Strong(1.0), 38.3),
            ("strong +300 %, 43.4 dB", Kind::Strong(3.0), 43.4),
        ];
        for (k, (name, kind, db)) in kinds.into_iter().enumerate() {
            let name = format!("{drive_name} {name}");
            if !name.contains(&only) {
                continue;
            }
            let mut rng = rng(1000 * seed + k as u64);
            let mut sheet = TestSheet::new(&imager, drive, 0.0, 0.0, &mut rng)?;
            let mut reconstructor = sheet.reconstructor()?;
            let (mut score, mut with_prior, mut without) = (Score::default(), Errors::default(), Errors::default());
            for _ in 0..scenes {
                let scene = kind.scene(&mut rng, db);
                let frame = sheet.frame(&scene, &mut rng)?;
                let found = reconstructor.frame(&frame)?;
                score.add(&scene, &found.touches);
                let clean = sheet.clean_frame(&scene.touches)?;
                let sigma = noise_v(&clean, &sheet.baseline, db);
                let information = information(&mut sheet, &scene.touches, sigma)?;
                for (prior, out) in [(prior, &mut with_prior), (0.0, &mut without)] {
                    draw(&information, prior, &scene.touches, &mut rng, out);
                }
            }
            let off: Vec<f64> = score.totals.iter().map(|t| (t - 1.0).abs()).collect();
            let both = |e: &Errors| format!("{:.2} / {:.2}", quantile(&e.places, 0.5), quantile(&e.places, 0.95));
            println!(
                "| {name} | {:.2} / {:.2} | {} | {} | {:.3} | {:.3} | {:.3} |",
                score.error_mm(0.5),
                score.error_mm(0.95),
                both(&with_prior),
                both(&without),
                quantile(&off, 0.95),
                quantile(&with_prior.totals, 0.95),
                quantile(&without.totals, 0.95),
            );
        }
    }
    Ok(())
}
