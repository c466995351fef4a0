//! Every fault of docs/simulator.md, and some in single values: what is said of it and what becomes of the touches. Table:
//! docs/reliability.md, Faults while it runs.
//!
//! `cargo run --release -p studies --example faults -- [--only TEXT] [--when TEXT]`
//!
//! The emulated board runs in simulated time, on a sheet with a finer mesh than the reconstruction's. A finger of 15 N presses
//! for a while. The fault comes under the finger, while nothing touches, or before the baseline is taken. Times are the board's.

use studies::faults::{Bench, Outcome, When, cases};
use studies::quantile;
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::prelude::*;

fn main() -> anyhow::Result<()> {
    let levels = std::env::var("RUST_LOG").ok().and_then(|levels| levels.parse().ok());
    tracing_subscriber::registry()
        .with(tracing_subscriber::fmt::layer().with_writer(std::io::stderr))
        .with(levels.unwrap_or_else(|| Targets::new().with_default(LevelFilter::ERROR)))
        .init();
    let given: Vec<String> = std::env::args().collect();
    let after = |name: &str| given.iter().position(|a| a == name).and_then(|k| given.get(k + 1));
    let (only, when) = (after("--only"), after("--when"));
    let mut bench = Bench::new()?;
    let cases = cases();
    let sound = bench.run(&cases[0], When::AtRest)?;
    let total = quantile(&sound.totals, 0.5);
    println!("{}", Outcome::HEAD);
    for case in cases.iter().filter(|c| only.is_none_or(|text| c.name.contains(text))) {
        for when in When::ALL
            .into_iter()
            .filter(|w| when.is_none_or(|text| w.name().contains(text)))
        {
            let outcome = bench.run(case, when)?;
            println!("{}", outcome.row(case, when, total));
            for (after_s, text) in &outcome.said {
                tracing::info!("{after_s:.2} s: {text}");
            }
        }
    }
    Ok(())
}
