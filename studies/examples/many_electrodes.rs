//! One frame of a disc with many electrodes, by the steps of `skin reconstruct`: what time and memory it takes. Table:
//! docs/reliability.md, Not promised of files.
//!
//!     cargo build --release -p studies --example many_electrodes
//!     /usr/bin/time -v target/release/examples/many_electrodes KIND [electrodes, default 64] [baseline frames, default 1]
//!
//! KIND is `touch` (+20 %, 27 dB), `moved` (the same with electrodes off by 0.5 mm), `proportional` (the same with noise in proportion to every value), `wild` (every value of the frame off by
//! 30 %) or `baseline` (every value of the baseline off by 30 %). Of 8 baseline frames or more the noise is known.

use forward::{DiscTouch, Drive, Geometry, Model, ModelOptions, Pattern, Sheet, Solver};
use inverse::batch::{Batch, BatchOptions};
use inverse::reference::imager::Imager;
use inverse::solvers::Method;
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use rand_distr::StandardNormal;

const DIAMETER_MM: f64 = 195.0;
/// Width of all electrodes together: 4 mm each of 64.
const ELECTRODES_MM: f64 = 256.0;
const OFF_MM: f64 = 0.5;
const WILD: f64 = 0.3;
const NOISE_DB: f64 = 27.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let kind = arguments.next().unwrap_or_default();
    let electrodes = arguments.next().map_or(Ok(64), |n| n.parse::<usize>())?;
    let unpressed = arguments.next().map_or(Ok(1), |n| n.parse::<usize>())?;
    let (drive, pattern) = (Drive::PAPER, Pattern::adjacent(electrodes)?);
    let sheet = Sheet::disc(DIAMETER_MM, electrodes, ELECTRODES_MM / electrodes as f64, 1.0, 1000.0);
    let pressed = DiscTouch {
        centre_mm: [30.0, -20.0],
        radius_mm: 12.5,
        rise: 0.2,
    };
    let mut rng = StdRng::seed_from_u64(1);
    let mut normal = || rng.sample::<f64, _>(StandardNormal);
    let mut real = sheet.clone();
    if kind == "moved" {
        let off = (0..2 * electrodes).map(|k| if k < electrodes { 0.0 } else { OFF_MM * normal() });
        let off: Vec<f64> = off.collect();
        real = Geometry::new(&sheet)?
            .displaced(&sheet, &off)
            .ok_or("electrodes overlap")?;
    }
    let mut rubber = Solver::new(Model::new(&real, &ModelOptions::for_touches(&[pressed]))?.into())?;
    let mut baseline = drive.frame_v(rubber.electrode_matrix(), &pattern);
    let mut frame = drive.frame_v(rubber.solve_touches(&[pressed])?, &pattern);
    drop(rubber);
    let rms =
        |values: &mut dyn Iterator<Item = f64>| (values.map(|v| v * v).sum::<f64>() / pattern.len() as f64).sqrt();
    let noise = 10f64.powf(-NOISE_DB / 20.0);
    let changes = frame.iter().zip(&baseline);
    let (volts, parts) = (
        noise * rms(&mut changes.clone().map(|(f, b)| f - b)),
        noise * rms(&mut changes.map(|(f, b)| f / b - 1.0)),
    );
    match kind.as_str() {
        "touch" | "moved" => frame.iter_mut().for_each(|v| *v += volts * normal()),
        "proportional" => frame.iter_mut().for_each(|v| *v *= 1.0 + parts * normal()),
        "wild" => frame.iter_mut().for_each(|v| *v *= 1.0 + WILD * normal()),
        "baseline" => baseline.iter_mut().for_each(|v| *v *= 1.0 + WILD * normal()),
        _ => return Err("say touch, moved, proportional, wild or baseline".into()),
    }
    let imager = Imager::new(&sheet, drive, pattern, Method::Nnls.cell_mm())?;
    println!("{} values, {} cells", imager.pattern.len(), imager.grid.len());
    let mut noisy = || -> Vec<f64> { baseline.iter().map(|v| v + volts * normal()).collect() };
    let baselines: Vec<Vec<f64>> = match unpressed {
        1 => vec![baseline.clone()],
        many => (0..many).map(|_| noisy()).collect(),
    };
    let baselines: Vec<&[f64]> = baselines.iter().map(Vec::as_slice).collect();
    let mut batch = Batch::new(imager.into(), &baselines, BatchOptions::of(Method::Nnls))?;
    let result = batch.frame(1, &frame)?;
    let places: Vec<[f64; 2]> = result.touches.iter().map(|t| [t.x_mm, t.y_mm]).collect();
    println!(
        "touches at {places:?} mm, doubt {:?}, faults {:?}",
        result.doubt, result.faults
    );
    Ok(())
}
