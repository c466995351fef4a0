//! Faults that are there already when the baseline is taken: what is named, and what becomes of the touches. Table:
//! docs/reliability.md, Faults in the baseline.
//!
//! `cargo run -p studies --example reliability -- [--trials N] [--seed S]`
//!
//! Every trial (default 10 for each row) has a sheet of its own with electrodes off by 0.5 mm (standard deviation) and contacts
//! by up to 30 %, and six frames of one or two touches at 45 dB. Sheets without a fault, ten times as many, count false alarms.
//! What is named wrongly is on stderr.

use anyhow::Result;
use forward::Drive;
use inverse::reference::screening::FindingKind;
use rand::Rng;
use studies::reliability::{BaselineFault, same_values, trial};
use studies::{Score, imager, quantile, rng};

const FRAMES: usize = 6;

fn main() -> Result<()> {
    let given: Vec<String> = std::env::args().collect();
    let after = |name: &str| given.iter().position(|a| a == name).and_then(|k| given.get(k + 1));
    let trials: u64 = after("--trials").map_or(Ok(10), |s| s.parse())?;
    let seed: u64 = after("--seed").map_or(Ok(1), |s| s.parse())?;
    let imager = imager(Drive::PAPER, 5.0)?;
    let (n, values) = (imager.pattern.electrodes(), imager.pattern.len());
    let mut draw = rng(seed);
    println!("seed {seed}, {trials} sheets a row, {FRAMES} frames of each");
    println!("| fault in the baseline | named | count right | touch, median / 95th percentile mm |");
    println!("|---|---|---|---|");
    for row in [
        "none",
        "one dead electrode",
        "two dead electrodes",
        "three dead electrodes",
        "two wires of neighbours exchanged",
        "two distant wires exchanged",
        "one value x10",
        "one value x1.5",
        "one value x-1",
        "all signs turned",
        "sign of one drive pair turned",
        "sign of one sense pair turned",
    ] {
        let mut score = Score::default();
        let mut named = 0;
        for k in 0..trials {
            let any = draw.random_range(0..n);
            let value = draw.random_range(0..values);
            let fault = match row {
                "one dead electrode" => BaselineFault::Dead(vec![k as usize % n]),
                "two dead electrodes" => BaselineFault::dead(2, n, &mut draw),
                "three dead electrodes" => BaselineFault::dead(3, n, &mut draw),
                "two wires of neighbours exchanged" => BaselineFault::Exchanged(any, (any + 1) % n),
                "two distant wires exchanged" => BaselineFault::Exchanged(any, (any + draw.random_range(2..n - 1)) % n),
                "one value x10" => BaselineFault::Value(value, 10.0),
                "one value x1.5" => BaselineFault::Value(value, 1.5),
                "one value x-1" => BaselineFault::Value(value, -1.0),
                "all signs turned" => BaselineFault::AllSigns,
                "sign of one drive pair turned" => BaselineFault::DriveSign(any),
                "sign of one sense pair turned" => BaselineFault::SenseSign(any),
                _ => BaselineFault::None,
            };
            let (found, touches) = trial(&imager, &fault, 0.5, FRAMES, 1000 * seed + k)?;
            let of = |kind| {
                let electrodes = found.findings.iter().filter(move |f| f.kind == kind);
                let mut list: Vec<usize> = electrodes.flat_map(|f| f.electrodes.clone()).collect();
                list.sort_unstable();
                list
            };
            let only = |kind: FindingKind, count: usize| found.findings.len() == count && of(kind).len() >= count;
            let right = match &fault {
                BaselineFault::None => found.findings.is_empty() && found.wiring.is_none(),
                BaselineFault::Dead(dead) => {
                    let named: Vec<usize> = of(FindingKind::Electrode).iter().map(|l| l - 1).collect();
                    found.findings.len() == named.len() && same_values(&imager.pattern, &named, dead)
                }
                BaselineFault::Value(k, _) => found.findings.len() == 1 && found.findings[0].value == Some(*k),
                BaselineFault::AllSigns => found.findings.len() == 1 && found.findings[0].kind == FindingKind::AllSigns,
                BaselineFault::DriveSign(_) => only(FindingKind::DriveSign, 1),
                BaselineFault::SenseSign(_) => only(FindingKind::SenseSign, 1),
                BaselineFault::Exchanged(a, b) => found.wiring.as_ref().is_some_and(|check| {
                    let mut moved = check.moved();
                    moved.sort_unstable();
                    moved == [*a.min(b), *a.max(b)]
                }),
            };
            named += u64::from(right);
            if !right {
                let said: Vec<String> = found.findings.iter().map(ToString::to_string).collect();
                eprintln!("{row}: {fault:?}: {}", said.join("; "));
            }
            score.scenes += touches.scenes;
            score.counted += touches.counted;
            score.errors_mm.extend(touches.errors_mm);
        }
        let [half, most] = [0.5, 0.95].map(|q| quantile(&score.errors_mm, q));
        println!(
            "| {row} | {named} of {trials} | {} of {} | {half:.2} / {most:.2} |",
            score.counted, score.scenes
        );
    }
    for off_mm in [0.5, 1.0] {
        let sheets = 10 * trials;
        let mut alarms = 0;
        for k in 0..sheets {
            let (found, _) = trial(&imager, &BaselineFault::None, off_mm, 0, 5000 * seed + k)?;
            alarms += usize::from(!found.findings.is_empty() || found.wiring.is_some() || !found.conclusive);
        }
        println!("without a fault, electrodes off by {off_mm} mm: {alarms} of {sheets} sheets named");
    }
    Ok(())
}
