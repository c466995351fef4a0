//! Touches on a sheet that drifted since its baseline. Table: docs/reliability.md, Drift.
//!
//! `cargo run --release -p studies --example drift -- [--scenes N] [--seed S] [--db D] [--only WORD]`
//!
//! Single frames with one touch of +20 %, and empty frames with the same noise. The noise is estimated from every frame.

use forward::{DiscTouch, Drive};
use rand::Rng;
use rand::rngs::StdRng;
use std::fmt::Display;
use studies::{Drift, Kind, MISSED_MM, Score, StudyError, TestSheet, imager, noise_v, noisy, rng, smooth_field};

/// What drifts.
trait Drifted {
    /// Frames with touches and without, V, without noise.
    fn frames(
        &self,
        sheet: &mut TestSheet,
        touches: &[DiscTouch],
        rng: &mut StdRng,
    ) -> Result<[Vec<f64>; 2], StudyError>;
}

impl<F: Fn(Drift, &mut StdRng) -> Drift> Drifted for F {
    fn frames(
        &self,
        sheet: &mut TestSheet,
        touches: &[DiscTouch],
        rng: &mut StdRng,
    ) -> Result<[Vec<f64>; 2], StudyError> {
        let drift = self(Drift::none(16), rng);
        Ok([sheet.drifted_frame(touches, &drift)?, sheet.drifted_frame(&[], &drift)?])
    }
}

/// The sheet's resistance, by a smooth field of this root mean square and correlation length, mm; infinite: a slope over the sheet.
struct Uneven(f64, f64);

impl Drifted for Uneven {
    fn frames(
        &self,
        sheet: &mut TestSheet,
        touches: &[DiscTouch],
        rng: &mut StdRng,
    ) -> Result<[Vec<f64>; 2], StudyError> {
        let Self(sd, length) = *self;
        let field: Box<dyn Fn([f64; 2]) -> f64> = if length.is_finite() {
            Box::new(smooth_field(sd, length, rng))
        } else {
            // The root mean square of x over a disc is half of its radius.
            let (sin, cos) = rng.random_range(0.0..std::f64::consts::TAU).sin_cos();
            Box::new(move |p| 2.0 * sd * (p[0] * cos + p[1] * sin) / 97.5)
        };
        Ok([sheet.uneven_frame(touches, &field)?, sheet.uneven_frame(&[], &field)?])
    }
}

fn row(
    name: impl Display,
    drive: Drive,
    db: f64,
    (scenes, seed): (usize, u64),
    drifted: impl Drifted,
) -> Result<(), StudyError> {
    let imager = imager(drive, 5.0)?;
    let mut rng = rng(seed);
    let mut sheet = TestSheet::new(&imager, drive, 0.0, 0.0, &mut rng)?;
    let mut reconstructor = sheet.reconstructor()?;
    let (mut score, mut phantoms, mut doubts) = (Score::default(), 0, [0, 0]);
    for _ in 0..scenes {
        let scene = Kind::Equal(1).scene(&mut rng, db);
        let sigma = noise_v(&sheet.clean_frame(&scene.touches)?, &sheet.baseline, db);
        let [touched, empty] = drifted.frames(&mut sheet, &scene.touches, &mut rng)?;
        let frame = noisy(touched, sigma, &mut rng);
        let found = reconstructor.frame(&frame)?;
        score.add(&scene, &found.touches);
        doubts[0] += usize::from(found.doubt.is_some());
        let frame = noisy(empty, sigma, &mut rng);
        let found = reconstructor.frame(&frame)?;
        phantoms += usize::from(!found.touches.is_empty());
        doubts[1] += usize::from(found.doubt.is_some());
    }
    let total = |part| {
        let off: Vec<f64> = score.totals.iter().map(|t| (t - 1.0).abs()).collect();
        studies::quantile(&off, part)
    };
    println!(
        "| {name} | {:.0} % | {:.3} / {:.3} | {:.3} / {:.3} | {phantoms} | {} | {} |",
        100.0 * score.counted_part(),
        score.error_mm(0.5).min(MISSED_MM),
        score.error_mm(0.95).min(MISSED_MM),
        total(0.5),
        total(0.95),
        doubts[0],
        doubts[1],
    );
    Ok(())
}

fn main() -> anyhow::Result<()> {
    let given: Vec<String> = std::env::args().collect();
    let after = |name: &str| given.iter().position(|a| a == name).and_then(|k| given.get(k + 1));
    let number = |name: &str, default: f64| after(name).and_then(|v| v.parse().ok()).unwrap_or(default);
    let (scenes, seed) = (number("--scenes", 40.0) as usize, number("--seed", 1.0) as u64);
    let db = number("--db", 27.0);
    let only = after("--only").cloned().unwrap_or_default();
    println!("seed {seed}, {scenes} frames with a touch and as many without, {db} dB");
    println!(
        "| drift | counted right | position mm, median / 95 % | total off, median / 95 % | empty frames with touches | doubted, touched | doubted, empty |\n\
         |---|---|---|---|---|---|---|"
    );
    for (drive_name, drive) in [
        ("voltage", Drive::PAPER),
        ("current", Drive::Current { amplitude_a: 1e-3 }),
    ] {
        let count = (scenes, seed);
        let named = |name: &str| format!("{drive_name}: {name}");
        let wanted = |name: &str| named(name).contains(&only);
        if wanted("none") {
            row(named("none"), drive, db, count, |d: Drift, _: &mut StdRng| d)?;
        }
        for gain in [0.9, 0.999, 1.0005, 1.1, 2.0] {
            let name = format!("gain {gain}");
            if wanted(&name) {
                row(named(&name), drive, db, count, |d: Drift, _: &mut StdRng| Drift {
                    gain,
                    ..d
                })?;
            }
        }
        for resistance in [0.95, 1.05] {
            let name = format!("resistance {resistance}");
            if wanted(&name) {
                row(named(&name), drive, db, count, |d: Drift, _: &mut StdRng| Drift {
                    resistance,
                    ..d
                })?;
            }
        }
        for sd in [0.01, 0.1, 0.3] {
            let name = format!("contacts {sd}");
            if wanted(&name) {
                row(named(&name), drive, db, count, |d: Drift, rng: &mut StdRng| {
                    d.with_contacts(sd, rng)
                })?;
            }
        }
        for sd in [0.002, 0.01] {
            let name = format!("channels {sd}");
            if wanted(&name) {
                row(named(&name), drive, db, count, |d: Drift, rng: &mut StdRng| {
                    d.with_channels(sd, rng)
                })?;
            }
        }
        for (sd, length) in [(0.015, f64::INFINITY), (0.01, 120.0), (0.01, 60.0), (0.03, 120.0)] {
            let name = if length.is_finite() {
                format!("uneven {sd} over {length} mm")
            } else {
                format!("bent {sd}")
            };
            if wanted(&name) {
                row(named(&name), drive, db, count, Uneven(sd, length))?;
            }
        }
        if wanted("all") {
            row(
                named("all: gain 1.1, resistance 0.95, contacts 0.1"),
                drive,
                db,
                count,
                |d: Drift, rng: &mut StdRng| {
                    let all = Drift {
                        gain: 1.1,
                        resistance: 0.95,
                        ..d
                    };
                    all.with_contacts(0.1, rng)
                },
            )?;
        }
    }
    Ok(())
}
