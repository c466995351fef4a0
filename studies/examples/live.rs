//! The whole chain in every frame of long scenes: false results, missed touches, and the slowest frames. Table:
//! docs/results.md, Scenes that last.
//!
//! `cargo run --release -p studies --example live -- [--seconds S] [--seed N] [--plan NAME] [--scene NAME]...`
//!
//! The simulated board with its firmware sends the frames of a scene. A scene is `demo` or one of the library; the
//! default is all without a fault. Scenes repeat for S seconds of the board's time (default 60). The plan is that of
//! `skin run` unless one is given. Frames are reconstructed as by `skin run`, with a baseline of the first 0.7 s. No
//! contact changes.
//!
//! A touch counts as present when its force is a tenth of the scene's greatest force or more. Two kinds of frames are
//! not judged: those with a weaker touch, and those of a creeping sheet with dents of earlier touches.

use anyhow::{Context, Result};
use forward::Sheet;
use hil_sim::SceneFile;
use link::plans::PlanChoice;
use std::path::Path;
use studies::chain;
use studies::quantile;
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::prelude::*;

const SCENES: [&str; 9] = [
    "demo",
    "one-touch",
    "two-touches",
    "three-touches",
    "four-touches",
    "hand",
    "slow-press",
    "fast-tap",
    "creep",
];

fn main() -> Result<()> {
    let levels = std::env::var("RUST_LOG").ok().and_then(|levels| levels.parse().ok());
    tracing_subscriber::registry()
        .with(tracing_subscriber::fmt::layer().with_writer(std::io::stderr))
        .with(levels.unwrap_or_else(|| Targets::new().with_default(LevelFilter::ERROR)))
        .init();
    let given: Vec<String> = std::env::args().collect();
    let after = |name: &str| {
        let at = |(k, _)| given.get(k + 1).cloned();
        given
            .iter()
            .enumerate()
            .filter(|(_, a)| *a == name)
            .filter_map(at)
            .collect::<Vec<String>>()
    };
    let seconds: f64 = after("--seconds").first().map_or(Ok(60.0), |s| s.parse())?;
    let seed: u64 = after("--seed").first().map_or(Ok(1), |s| s.parse())?;
    let plan = match after("--plan").first() {
        Some(name) => Some(PlanChoice::all().find(|p| p.name() == name).context("no such plan")?),
        None => None,
    };
    let mut scenes = after("--scene");
    if scenes.is_empty() {
        scenes = SCENES.map(str::to_owned).to_vec();
    }
    println!("seed {seed}, {seconds} s of every scene");
    println!(
        "| scene | frames | contacts named | said to be no touches: times, frames | count right, % | position, median / 95th / 99.9th percentile mm | rise, 1st / 50th / 99th percentile | highest number | frame us, median / 99th / longest |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for name in scenes {
        let mut file = match name.as_str() {
            "demo" => SceneFile::demo(Sheet::paper()),
            _ => SceneFile::load(Path::new(&name))?,
        };
        file.config.electronics.seed = seed;
        let seen = chain::watch(file, seconds, plan)?;
        let judged = if seen.judged == 0 {
            "- | - | -".to_owned()
        } else {
            let [half, most, nearly_all] = [0.5, 0.95, 0.999].map(|q| quantile(&seen.off_mm, q));
            let right = 100.0 * seen.right as f64 / seen.judged as f64;
            let rise = [0.01, 0.5, 0.99].map(|q| quantile(&seen.rises, q));
            format!(
                "{right:.2} | {half:.2} / {most:.2} / {nearly_all:.2} | {:.2} / {:.2} / {:.2}",
                rise[0], rise[1], rise[2]
            )
        };
        let [half, most, longest] = [0.5, 0.99, 1.0].map(|q| quantile(&seen.us, q));
        println!(
            "| {name} | {} | {} | {}, {} | {judged} | {} | {half:.0} / {most:.0} / {longest:.0} |",
            seen.frames,
            seen.contacts.len(),
            seen.no_touches[0],
            seen.no_touches[1],
            seen.highest,
        );
        if !seen.contacts.is_empty() {
            eprintln!("{name}: {:?}", seen.contacts);
        }
    }
    Ok(())
}
