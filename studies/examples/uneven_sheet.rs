//! Touches on sheets of uneven resistance with misplaced electrodes. The electrodes are taken as nominal, or fitted
//! to the baseline. Table: docs/results.md, Uneven sheets.
//!
//!     cargo run --release -p studies --example uneven_sheet [seed, default 77]

use forward::field::conductivity_of;
use forward::{Drive, Model, ModelOptions, Solver};
use inverse::reference::electrode_fit;
use rand::Rng;
use rand::rngs::StdRng;
use rand_distr::StandardNormal;
use std::sync::Arc;
use studies::{Kind, Score, imager, misplaced, noise_v, noisy, reconstructor, rng};

const SHEETS: usize = 6;
const TOUCHES: usize = 15;
/// Number of plane waves that make the unevenness, and their largest wave number, rad/mm: waves of 110 mm or longer.
const WAVES: usize = 6;
const WAVE_NUMBER: f64 = 0.04;

/// A smooth field of unit variance.
fn field(rng: &mut StdRng) -> impl Fn([f64; 2]) -> f64 + use<> {
    let waves: [[f64; 4]; WAVES] = std::array::from_fn(|_| {
        let mut number = || rng.random_range(-WAVE_NUMBER..WAVE_NUMBER);
        let (kx, ky) = (number(), number());
        [
            kx,
            ky,
            rng.random_range(0.0..std::f64::consts::TAU),
            rng.sample(StandardNormal),
        ]
    });
    move |p| {
        let wave = |[kx, ky, phase, height]: &[f64; 4]| height * (kx * p[0] + ky * p[1] + phase).sin();
        waves.iter().map(wave).sum::<f64>() / (0.5 * WAVES as f64).sqrt()
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let seed = std::env::args().nth(1).map_or(Ok(77), |s| s.parse())?;
    let imager = imager(Drive::PAPER, 5.0)?;
    println!("| unevenness, % | electrodes | count right, % | median mm | 95th percentile mm | within 2 sd, % |");
    println!("|---|---|---|---|---|---|");
    for uneven in [0.0, 0.02, 0.05, 0.1] {
        let mut rng = rng(seed);
        let mut scores = [Score::default(), Score::default()];
        for _ in 0..SHEETS {
            let sheet = misplaced(0.5, 0.3, &mut rng);
            let field = field(&mut rng);
            let options = ModelOptions {
                accuracy: 1e-4,
                ..ModelOptions::default()
            };
            let model = Arc::new(Model::new(&sheet, &options)?);
            let mut solver = Solver::new(Arc::clone(&model))?;
            let mut frame = |rise: &dyn Fn([f64; 2]) -> f64| {
                let matrix = solver.solve(&conductivity_of(model.mesh(), rise))?;
                Ok::<_, forward::ForwardError>(Drive::PAPER.frame_v(matrix, &imager.pattern))
            };
            let baseline = frame(&|p| uneven * field(p))?;
            let found = electrode_fit::find(&imager, &baseline).map(|found| found.imager);
            let mut both = [
                reconstructor(&imager, &baseline)?,
                reconstructor(found.as_ref().unwrap_or(&imager), &baseline)?,
            ];
            for _ in 0..TOUCHES {
                let scene = Kind::Fingers(1).scene(&mut rng, 27.0);
                let t = scene.touches[0];
                let finger = |p: [f64; 2]| {
                    let d2 = (p[0] - t.centre_mm[0]).powi(2) + (p[1] - t.centre_mm[1]).powi(2);
                    t.rise * (-0.5 * d2 / (0.5 * t.radius_mm).powi(2)).exp()
                };
                let clean = frame(&|p| (1.0 + uneven * field(p)) * (1.0 + finger(p)) - 1.0)?;
                let sigma = noise_v(&clean, &baseline, scene.snr_db);
                let measured = noisy(clean, sigma, &mut rng);
                for (r, score) in both.iter_mut().zip(&mut scores) {
                    score.add(&scene, &r.frame(&measured)?.touches);
                }
            }
        }
        for (name, s) in ["trusted", "looked for"].iter().zip(&scores) {
            println!(
                "| {:.0} | {name} | {:.0} | {:.2} | {:.2} | {:.0} |",
                100.0 * uneven,
                100.0 * s.counted_part(),
                s.error_mm(0.5),
                s.error_mm(0.95),
                100.0 * s.honest_part()
            );
        }
    }
    Ok(())
}
