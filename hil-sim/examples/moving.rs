//! How much of a processor core the simulated skin takes while everything moves: the firmware in process at 115 frames/s,
//! the sheet solved anew for every frame.
//!
//!     cargo run --release -p skin-hil-sim --example moving [seconds simulated, default 10]

use forward::Sheet;
use hil_sim::{Key, Material, PERIOD_SAMPLES, Rubber, Scene, Shape, SheetModel, SimBoard, SimConfig, Touch, seconds};
use protocol::{MAX_TO_BOARD_LEN, Plan, ToBoard, encode};
use std::error::Error;
use std::time::Instant;

/// Seconds that this thread has been on a processor; where that is not known, that have passed.
fn processor_s(start: Instant) -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = text.and_then(|t| t.split_whitespace().next()?.parse::<f64>().ok());
    nanoseconds.map_or_else(|| start.elapsed().as_secs_f64(), |n| 1e-9 * n)
}

/// Moving touches of a kind on rubber that creeps.
fn moving(shape: Shape, radius_mm: f64, count: usize, duration_s: f64) -> Scene {
    let touch = |n: usize| {
        let keys = (0..=(4.0 * duration_s) as u32 + 1).map(|k| {
            let angle = 0.8 * f64::from(k) + n as f64 * std::f64::consts::TAU / count as f64;
            Key {
                angle_deg: 40.0 * f64::from(k),
                ..Key::new(0.25 * f64::from(k), 50.0 * angle.cos(), 50.0 * angle.sin(), 15.0)
            }
        });
        Touch::new(shape, radius_mm, keys.collect())
    };
    Scene {
        material: Material::viscoelastic(),
        ..Scene::still((0..count).map(touch).collect())
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let duration_s = std::env::args().nth(1).map_or(Ok(10.0), |s| s.parse())?;
    let frame = 32 * PERIOD_SAMPLES;
    let scenes = [
        ("nothing", Scene::empty()),
        ("four fingers", moving(Shape::Finger, 6.75, 4, duration_s)),
        ("a tip", moving(Shape::Disc, 12.5, 1, duration_s)),
        ("four tips", moving(Shape::Disc, 12.5, 4, duration_s)),
        ("a palm", moving(Shape::Palm, 40.0, 1, duration_s)),
    ];
    println!("| what moves | sheet alone, ms a frame | all, ms a frame | frames/s on one core |");
    println!("|---|---|---|---|");
    let start = Instant::now();
    for (name, scene) in scenes {
        let mut rubber = Rubber::new(&Sheet::paper(), scene.clone())?;
        let looks = (duration_s / seconds(frame)) as u64;
        let before = processor_s(start);
        for k in 0..looks {
            rubber.electrode_matrix(seconds(k * frame))?;
        }
        let sheet = processor_s(start) - before;

        let config = SimConfig {
            plan: Some(Plan::fast()),
            look_samples: Some(frame),
            ..SimConfig::default()
        };
        let mut board = SimBoard::new(config, Rubber::new(&Sheet::paper(), scene)?)?;
        board.receive(encode(&ToBoard::Start, &mut [0; MAX_TO_BOARD_LEN])?);
        let before = processor_s(start);
        board.run(duration_s);
        let all = processor_s(start) - before;
        let frames = f64::from(board.counters().frames);
        println!(
            "| {name} | {:.2} | {:.2} | {:.0} |",
            1e3 * sheet / looks as f64,
            1e3 * all / frames,
            frames / all
        );
    }
    Ok(())
}
