//! The live page with four synthetic fingers on a disc, without a board and without a reconstruction.
//!
//! `cargo run -p view --example view_demo -- [--seconds N] [--port P] [--png FILE] [--still]`

use std::f64::consts::TAU;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use clap::Parser;
use inverse::touches::touch::Touch;
use view::picture::{DEFAULT_CELL_MM, Grid, Picture, Stats, circle_mm};
use view::png;
use view::web::{Command, DEFAULT_PORT, LiveOptions, LiveView};

const RADIUS_MM: f64 = 97.5;
const FRAMES_PER_S: f64 = 33.0;

/// Shows four moving fingers on the live page.
#[derive(Parser)]
struct Arguments {
    /// End after so many seconds; without it, with Ctrl-C.
    #[arg(long)]
    seconds: Option<f64>,
    /// Port of the page; 0 takes any free one.
    #[arg(long, default_value_t = DEFAULT_PORT)]
    port: u16,
    /// Write one picture to this file and end.
    #[arg(long)]
    png: Option<PathBuf>,
    /// Begin with the fingers on the sheet, close together.
    #[arg(long)]
    still: bool,
    /// Electrodes on the rim.
    #[arg(long, default_value_t = 16)]
    electrodes: usize,
}

fn main() -> anyhow::Result<()> {
    let arguments = Arguments::parse();
    let outline = Arc::new(circle_mm(RADIUS_MM, 240));
    let grid = Arc::new(Grid::cover(&outline, DEFAULT_CELL_MM)?);
    let electrodes = Arc::new(circle_mm(RADIUS_MM, arguments.electrodes));
    let picture = |sequence: u64, time_s: f64, since_tare: f64| {
        let taring = since_tare < 1.5 && !arguments.still;
        let touches = if taring {
            Vec::new()
        } else {
            fingers(if arguments.still { 6.3 } else { since_tare })
        };
        Picture {
            sequence,
            time_s,
            values: field(&grid, &touches, sequence),
            grid: Arc::clone(&grid),
            outline_mm: Arc::clone(&outline),
            electrodes_mm: Arc::clone(&electrodes),
            stats: Stats {
                frames_per_s: FRAMES_PER_S as f32,
                solve_us: (!touches.is_empty()).then_some(380.0 + 40.0 * (time_s.sin() as f32)),
                residual: (!touches.is_empty()).then_some(0.031),
                lost_frames: (time_s / 20.0) as u64,
                skipped_frames: 0,
                source: "synthetic fingers".into(),
                baseline: None,
                faulty: Vec::new(),
                status: taring.then(|| "taking the baseline, do not touch".to_owned()),
                away: None,
                preparing: taring,
                uncalibrated: false,
                smoothed: false,
            },
            touches,
        }
    };
    if let Some(path) = &arguments.png {
        return Ok(png::write_png(&picture(231, 7.0, 6.3), path)?);
    }
    let view = LiveView::start(LiveOptions {
        listen: ([127, 0, 0, 1], arguments.port).into(),
        ..LiveOptions::default()
    })?;
    println!("{}", view.url());
    let (start, mut tared) = (Instant::now(), 0.0);
    for sequence in 0.. {
        let time_s = start.elapsed().as_secs_f64();
        if arguments.seconds.is_some_and(|end| time_s > end) {
            break;
        }
        while let Some(command) = view.command() {
            tared = if command == Command::Tare { time_s } else { 0.0 };
        }
        view.publish(picture(sequence, time_s, time_s - tared))?;
        let next = Duration::from_secs_f64((sequence + 1) as f64 / FRAMES_PER_S);
        std::thread::sleep(next.saturating_sub(start.elapsed()));
    }
    Ok(())
}

/// The fingers at a time: they come one after the other, wander, and go; then the sheet is free for a while.
fn fingers(t: f64) -> Vec<Touch> {
    let t = t % 18.0;
    let finger = |k: usize| {
        let (arrives, leaves) = (2.0 + 0.8 * k as f64, 14.0 + 0.4 * k as f64);
        let pressed = ((t - arrives) / 0.3).clamp(0.0, 1.0) * ((leaves - t) / 0.4).clamp(0.0, 1.0);
        let angle = TAU * (0.02 * t + k as f64 / 9.0 - 0.05);
        let far = 48.0 + 18.0 * (0.7 * t + 1.7 * k as f64).sin();
        let rise = pressed * (0.13 + 0.05 * k as f64 + 0.04 * (1.9 * t + k as f64).sin());
        Touch {
            id: Some(k as u32 + 1),
            x_mm: far * angle.cos(),
            y_mm: far * angle.sin(),
            rise,
            area_mm2: 250.0 + 500.0 * rise,
            ..Touch::default()
        }
    };
    (0..4).map(finger).filter(|f| f.rise > 0.02).collect()
}

/// The rise per cell: a soft bump per finger over a little noise that changes from frame to frame.
fn field(grid: &Grid, touches: &[Touch], sequence: u64) -> Vec<f32> {
    let noise = |cell: usize| {
        let mixed = (cell as u64 + 7919 * sequence).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
        0.004 * (mixed % 1000) as f64 / 1000.0
    };
    let bump = |c: [f64; 2], touch: &Touch| {
        let square = (c[0] - touch.x_mm).powi(2) + (c[1] - touch.y_mm).powi(2);
        touch.rise * (-square / touch.area_mm2 * 1.6).exp()
    };
    let cells = grid.centres_mm().enumerate();
    cells
        .map(|(k, c)| (noise(k) + touches.iter().map(|t| bump(c, t)).sum::<f64>()) as f32)
        .collect()
}
