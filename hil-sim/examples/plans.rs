//! The plans' times and signal to noise ratios, on the default electronics and on both drawn boards: the tables of
//! docs/firmware.md.
//!
//! `cargo run -p skin-hil-sim --example plans`

use forward::{Model, ModelOptions, Sheet};
use hil_sim::{PERIOD_SAMPLES, Preset, Rubber, Scene, SimBoard, SimConfig, Touch, samples, seconds};
use protocol::{Decoder, FromBoard, MAX_FROM_BOARD_LEN, MAX_TO_BOARD_LEN, Plan, Sampling, ToBoard, encode};
use std::error::Error;
use std::sync::Arc;

/// What a run gave: values of every frame in codes, the samples from one frame to the next, and bytes a frame.
struct Recording {
    frames: Vec<Vec<f64>>,
    step: u64,
    bytes: usize,
}

fn record(
    preset: Preset,
    model: &Arc<Model>,
    plan: &Plan,
    touches: Vec<Touch>,
    count: usize,
) -> Result<Recording, Box<dyn Error>> {
    let config = SimConfig {
        electronics: preset.electronics(),
        plan: Some(plan.clone()),
        ..SimConfig::default()
    };
    let mut board = SimBoard::new(config, Rubber::on_model(Arc::clone(model), Scene::still(touches))?)?;
    board.receive(encode(&ToBoard::Start, &mut [0; MAX_TO_BOARD_LEN])?);
    let mut decoder = Decoder::<MAX_FROM_BOARD_LEN>::new();
    let (mut frames, mut times, mut bytes) = (Vec::new(), Vec::new(), 0);
    let end = samples(0.1) + u64::from(plan.quarters()) * PERIOD_SAMPLES / 4 * (count as u64 + 2);
    while frames.len() < count && board.now() < 2 * end {
        let mut piece = Vec::new();
        board.step(|b| piece.push(b));
        decoder.push(&piece, |m| {
            if let Ok(FromBoard::Frame(f)) = m {
                times.push(f.time);
                frames.push(f.values.iter().map(|v| v.codes()).collect());
                if let Ok(framed) = encode(&FromBoard::Frame(f), &mut [0; MAX_FROM_BOARD_LEN]) {
                    bytes = framed.len();
                }
            }
        });
    }
    // The shortest: where the link carries less than the scan makes, frames are left out.
    let step = times.windows(2).map(|w| w[1] - w[0]).min().unwrap_or(0);
    Ok(Recording { frames, step, bytes })
}

fn mean(frames: &[Vec<f64>]) -> Vec<f64> {
    let n = frames.len() as f64;
    let first = frames.first().map_or(0, Vec::len);
    (0..first)
        .map(|k| frames.iter().map(|f| f[k]).sum::<f64>() / n)
        .collect()
}

/// `20 log10(||change of the mean|| / rms over the frames of ||noise||)`: the paper's figure of merit.
fn signal_to_noise_db(rest: &[Vec<f64>], pressed: &[Vec<f64>]) -> f64 {
    let (a, b) = (mean(rest), mean(pressed));
    let signal2: f64 = a.iter().zip(&b).map(|(x, y)| (y - x).powi(2)).sum();
    let noise2: f64 = rest
        .iter()
        .flat_map(|f| f.iter().zip(&a).map(|(x, y)| (x - y).powi(2)))
        .sum::<f64>()
        / (rest.len() - 1) as f64;
    10.0 * (signal2 / noise2).log10()
}

fn main() -> Result<(), Box<dyn Error>> {
    let model = Arc::new(Model::new(&Sheet::paper(), &ModelOptions::default())?);
    let six = |plan: Plan| Plan {
        integrate_periods: 6,
        ..plan
    };
    let plans = [
        ("the paper's: 208 values one by one, 6 periods", Plan::paper()),
        ("208 values one by one, 1 + 1", Plan::sequential()),
        ("208 values one by one, 1/4 + 1", Plan::sequential_fast()),
        ("104 independent values, 1 + 1", Plan::independent()),
        ("16 drives, all pairs at once, 1 + 6", six(Plan::fast())),
        ("16 drives, all pairs at once, 1 + 1", Plan::fast()),
        ("with the drive pairs' own voltages, 1 + 1", Plan::with_drive_pairs(1)),
        ("16 drives, 1/4 + 1", Plan::fastest()),
        ("14 drives that suffice, 1/4 + 1", Plan::fourteen()),
        (
            "14 drives, no settling",
            Plan {
                settle_quarters: 0,
                ..Plan::fourteen()
            },
        ),
    ];
    for preset in [Preset::SixteenChannels, Preset::DrawnBoard, Preset::DrawnSixteen] {
        println!("\n{}\n", preset.name());
        println!("| plan | values | periods | ms | frames/s | bytes/frame | kB/s | signal to noise, dB |");
        println!("|---|---|---|---|---|---|---|---|");
        for (name, plan) in &plans {
            let wired = match preset {
                Preset::DrawnBoard => plan.sampling == Sampling::Sequential,
                // Its amplifiers are wired to neighbours, through gain 0.
                Preset::DrawnSixteen => plan.slots.iter().all(|slot| slot.sense_step == 1 && slot.gain == 0),
                _ => true,
            };
            if wired {
                row(preset, &model, name, plan)?;
            }
        }
    }
    Ok(())
}

fn row(preset: Preset, model: &Arc<Model>, name: &str, plan: &Plan) -> Result<(), Box<dyn Error>> {
    let count = 400;
    let rest = record(preset, model, plan, vec![], count)?;
    let pressed = record(preset, model, plan, vec![Touch::tip(0.0, 0.0, 25.0)], count)?;
    let step_s = seconds(rest.step);
    println!(
        "| {name} | {} | {} | {:.1} | {:.1} | {} | {:.1} | {:.1} |",
        plan.value_count(),
        rest.step as f64 / PERIOD_SAMPLES as f64,
        1e3 * step_s,
        1.0 / step_s,
        rest.bytes,
        rest.bytes as f64 / step_s / 1e3,
        signal_to_noise_db(&rest.frames, &pressed.frames)
    );
    Ok(())
}
