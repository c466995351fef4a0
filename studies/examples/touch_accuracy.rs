//! Accuracy of the touches. Tables: docs/results.md, Touches.
//!
//! `cargo run --release -p studies --example touch_accuracy -- [--scenes N] [--seed S] [--only WORD]`
//!
//! Frames come from the nonlinear model on a finer mesh than the imager's. The noise is white, with the stated ratio
//! of signal to noise, and is estimated from the frame. Every kind has N scenes (default 100). WORD selects the kinds
//! whose name contains it.

use forward::Drive;
use studies::{Fault, Kind, Score, TestSheet, imager, quantile, rng, trial};

struct Arguments {
    scenes: usize,
    seed: u64,
    only: String,
}

fn arguments() -> Arguments {
    let given: Vec<String> = std::env::args().collect();
    let after = |name: &str| given.iter().position(|a| a == name).and_then(|k| given.get(k + 1));
    let number = |name: &str, default: u64| after(name).and_then(|v| v.parse().ok()).unwrap_or(default);
    Arguments {
        scenes: number("--scenes", 100) as usize,
        seed: number("--seed", 1),
        only: after("--only").cloned().unwrap_or_default(),
    }
}

fn print(name: &str, s: &Score) {
    println!(
        "| {name:<28} | {:5.1} | {:5.1} | {:4.2} | {:5.2} | {:5.1} | {:4.2} / {:4.2} | {:5.1} | {:4.0} / {:4.0} | {} |",
        100.0 * s.counted_part(),
        100.0 * s.resolved_part(),
        s.error_mm(0.5),
        s.error_mm(0.95),
        100.0 * s.honest_part(),
        quantile(&s.totals, 0.5),
        quantile(&s.totals.iter().map(|t| (t - 1.0).abs()).collect::<Vec<_>>(), 0.95),
        100.0 * s.honest_total_part(),
        quantile(&s.times_us, 0.5),
        quantile(&s.times_us, 0.95),
        s.unfitted,
    );
}

fn main() -> anyhow::Result<()> {
    let a = arguments();
    println!("seed {}, {} scenes of every kind", a.seed, a.scenes);
    println!(
        "| scenes                       | count right % | and within 8 mm % | median mm | p95 mm | within 2 sd % \
         | total, median / p95 off | total within 2 sd % | frame us, median / p95 | not fitted |\n|---|---|---|---|---|---|---|---|---|---|"
    );
    for (drive_name, drive) in [
        ("voltage", Drive::PAPER),
        ("current", Drive::Current { amplitude_a: 1e-3 }),
    ] {
        let imager = imager(drive, 5.0)?;
        let mut kinds: Vec<(String, Kind, f64)> = Vec::new();
        for n in 1..=4 {
            kinds.push((format!("equal {n}"), Kind::Equal(n), 27.0));
        }
        for n in [1, 4] {
            kinds.push((format!("fingers {n}"), Kind::Fingers(n), 27.0));
        }
        for (apart, db) in [(40.0, 27.0), (35.0, 27.0), (30.0, 27.0), (27.0, 60.0)] {
            kinds.push((format!("pair {apart} mm, {db} dB"), Kind::Pair(apart), db));
        }
        kinds.push(("unequal".into(), Kind::Unequal, 27.0));
        kinds.push(("unequal, 60 dB".into(), Kind::Unequal, 60.0));
        for rise in [1.0, 3.0] {
            let name = format!("strong +{:.0} %", 100.0 * rise);
            kinds.push((name, Kind::Strong(rise), 27.0));
        }
        for fault in [Fault::Electrode, Fault::Missing, Fault::Stuck] {
            kinds.push((format!("fault {fault:?}"), Kind::Broken(fault), 27.0));
        }
        // The same board: its noise does not grow with the touch. The response of a disc of rise c is 2 c / (2 + c).
        for rise in [1.0, 3.0] {
            let response = |c: f64| 2.0 * c / (2.0 + c);
            let db = 27.0 + 20.0 * (response(rise) / response(0.2)).log10();
            let name = format!("strong +{:.0} %, {db:.1} dB (as +20 % at 27)", 100.0 * rise);
            kinds.push((name, Kind::Strong(rise), db));
        }
        for (k, (name, kind, db)) in kinds.iter().enumerate() {
            let name = format!("{drive_name} {name}");
            if !name.contains(&a.only) {
                continue;
            }
            let mut rng = rng(1000 * a.seed + k as u64);
            let mut sheet = TestSheet::new(&imager, drive, 0.0, 0.0, &mut rng)?;
            let mut r = sheet.reconstructor()?;
            let mut score = Score::default();
            trial::run(&mut sheet, &mut r, *kind, *db, a.scenes, &mut rng, &mut score)?;
            print(&name, &score);
        }
        for (n, db) in [(1, 27.0), (4, 27.0), (1, 60.0), (4, 60.0)] {
            let name = format!("{drive_name} mismatch {n}, {db} dB");
            if !name.contains(&a.only) {
                continue;
            }
            let mut rng = rng(1000 * a.seed + 500 + n as u64);
            let mut score = Score::default();
            for _ in 0..8 {
                let mut sheet = TestSheet::new(&imager, drive, 0.5, 0.3, &mut rng)?;
                let mut r = sheet.reconstructor()?;
                trial::run(
                    &mut sheet,
                    &mut r,
                    Kind::Equal(n),
                    db,
                    a.scenes.div_ceil(8),
                    &mut rng,
                    &mut score,
                )?;
            }
            print(&name, &score);
        }
        let name = format!("{drive_name} empty");
        if name.contains(&a.only) {
            let mut rng = rng(1000 * a.seed + 900);
            let sheet = TestSheet::new(&imager, drive, 0.0, 0.0, &mut rng)?;
            let mut r = sheet.reconstructor()?;
            let frames = 10 * a.scenes;
            let (mut touched, mut passed) = (0, 0);
            for _ in 0..frames {
                let frame = sheet.empty(1e-4 * sheet.baseline[0], &mut rng);
                // The lengths match: both are the imager's.
                if let Ok(found) = r.frame(&frame) {
                    touched += found.touches.len();
                    passed += usize::from(found.changed);
                }
            }
            println!("| {name:<28} | {frames} frames: {touched} touches, {passed} past the gate |");
        }
    }
    Ok(())
}
