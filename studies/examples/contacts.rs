//! Contacts that changed since the baseline, and electrodes that slipped: whether they are distinguished from touches.
//! Table: docs/results.md, Contacts that changed.
//!
//! `cargo run --release -p studies --example contacts -- [--scenes N] [--seed S] [--frames F]`
//!
//! Frames are those of a `LiveSheet`. The noise is that of a finger of +20 % half way to the rim at 27 dB. N scenes
//! of every kind (default 20) have no finger, one, or two 50 mm apart. They are judged by their Fth frame (default 30)
//! after rest. N further scenes have one to four touches, one of them at the rim, and no contact changes. All of their
//! 120 frames are judged.

use forward::{DiscTouch, Drive};
use rand::Rng;
use rand::rngs::StdRng;
use studies::{LiveSheet, TestSheet, Worse, quantile, slipped};
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::prelude::*;

const RIM_MM: f64 = 97.5;
/// Frames of a scene with a changed contact, unless told; the contact monitor accepts a contact after 16.
const FRAMES: u64 = 30;
const SOUND_FRAMES: u64 = 120;

fn finger(at: [f64; 2], rise: f64) -> DiscTouch {
    DiscTouch {
        centre_mm: at,
        radius_mm: 12.5,
        rise,
    }
}

/// Places 50 mm apart, 20 mm or more from the rim; the first may be at the rim.
fn places(rng: &mut StdRng, count: usize, at_rim: bool) -> Vec<[f64; 2]> {
    let mut out: Vec<[f64; 2]> = Vec::new();
    while out.len() < count {
        let angle = rng.random_range(0.0..std::f64::consts::TAU);
        let radius = if at_rim && out.is_empty() {
            RIM_MM - rng.random_range(6.0..20.0)
        } else {
            (RIM_MM - 20.0) * rng.random_range(0.0..1.0_f64).sqrt()
        };
        let p = [radius * f64::cos(angle), radius * f64::sin(angle)];
        if out.iter().all(|q| (p[0] - q[0]).hypot(p[1] - q[1]) > 50.0) {
            out.push(p);
        }
    }
    out
}

/// What changed since the baseline.
#[derive(Clone, Copy, Debug)]
enum Change {
    Contact(Worse),
    /// Along the rim, mm, one way or the other.
    Slip(f64),
}

/// Whether electrodes that changed so are named, and the touches beside them right: a line of the table.
fn changed(live: &mut LiveSheet, change: Change, scenes: u64, frames: u64) -> anyhow::Result<String> {
    let (mut named, mut right, mut errors, mut longest) = (0, 0, Vec::new(), 0.0_f64);
    for k in 0..scenes {
        let electrode = live.rng.random_range(0..16);
        let touches: Vec<DiscTouch> = places(&mut live.rng, k as usize % 3, false)
            .into_iter()
            .map(|p| finger(p, 0.2))
            .collect();
        let clean = match change {
            Change::Contact(worse) => live.sheet.worse_frame(&touches, &[(electrode, worse)])?,
            Change::Slip(mm) => {
                let sheet = slipped(electrode, if live.rng.random() { mm } else { -mm });
                TestSheet::of_sheet(&live.sheet.imager, live.sheet.drive, &sheet)?.clean_frame(&touches)?
            }
        };
        // A frame of the untouched sheet separates the scenes.
        let rest = live.empty();
        live.reconstructor.frame(&rest)?;
        for _ in 1..frames {
            let frame = live.frame(&clean);
            let start = std::time::Instant::now();
            live.reconstructor.frame(&frame)?;
            longest = longest.max(start.elapsed().as_secs_f64() * 1e3);
        }
        let frame = live.frame(&clean);
        let found = live.reconstructor.frame(&frame)?;
        if found.contacts != [electrode] || found.touches.len() != touches.len() {
            tracing::debug!(?electrode, ?change, ?touches, ?found.contacts, ?found.faults, ?found.doubt, ?found.touches, ?found.misfit, "wrong");
        }
        named += usize::from(found.contacts == [electrode]);
        right += usize::from(found.touches.len() == touches.len());
        for t in &touches {
            let off = |f: &inverse::touches::touch::Touch| (f.x_mm - t.centre_mm[0]).hypot(f.y_mm - t.centre_mm[1]);
            errors.push(found.touches.iter().map(off).fold(50.0, f64::min));
        }
    }
    Ok(format!(
        "{:.0} | {:.0} | {:.2} / {:.2} | {longest:.0} |",
        100.0 * named as f64 / scenes as f64,
        100.0 * right as f64 / scenes as f64,
        quantile(&errors, 0.5),
        quantile(&errors, 0.95),
    ))
}

fn main() -> anyhow::Result<()> {
    let levels = std::env::var("RUST_LOG").ok().and_then(|levels| levels.parse().ok());
    tracing_subscriber::registry()
        .with(tracing_subscriber::fmt::layer().with_writer(std::io::stderr))
        .with(levels.unwrap_or_else(|| Targets::new().with_default(LevelFilter::ERROR)))
        .init();
    let given: Vec<String> = std::env::args().collect();
    let after = |name: &str| given.iter().position(|a| a == name).and_then(|k| given.get(k + 1));
    let number = |name: &str, default: u64| after(name).and_then(|v| v.parse().ok()).unwrap_or(default);
    let (scenes, seed, frames) = (number("--scenes", 20), number("--seed", 1), number("--frames", FRAMES));
    println!("seed {seed}, {scenes} scenes of every kind");
    println!(
        "| drive, change | electrode named, % | count right, % | position, median / 95th percentile mm | longest frame ms |"
    );
    println!("|---|---|---|---|---|");
    for (name, drive) in [
        ("voltage", Drive::PAPER),
        ("current", Drive::Current { amplitude_a: 1e-3 }),
    ] {
        let mut live = LiveSheet::new(drive, seed, |sheet, _| {
            sheet.worse_frame(&[finger([48.0, 0.0], 0.2)], &[])
        })?;
        let faces = [20.0, 50.0, 100.0, 200.0, 500.0].map(Worse::Face);
        let wires = [20.0, 100.0, 500.0].map(Worse::Wire);
        for worse in faces.into_iter().chain(wires) {
            let found = changed(&mut live, Change::Contact(worse), scenes, frames)?;
            println!("| {name}, {worse:?} ohm | {found}");
        }
        let (mut alarms, mut right, mut errors) = (0, 0, Vec::new());
        for k in 0..scenes {
            let rise = [0.03, 0.1, 0.2, 0.4, 1.0][k as usize % 5];
            let touches: Vec<DiscTouch> = places(&mut live.rng, 1 + k as usize % 4, true)
                .into_iter()
                .map(|p| finger(p, rise))
                .collect();
            let clean = live.sheet.worse_frame(&touches, &[])?;
            let rest = live.empty();
            live.reconstructor.frame(&rest)?;
            for _ in 0..SOUND_FRAMES {
                let frame = live.frame(&clean);
                let found = live.reconstructor.frame(&frame)?;
                alarms += usize::from(!found.contacts.is_empty());
                right += usize::from(found.touches.len() == touches.len());
                for t in &touches {
                    let off =
                        |f: &inverse::touches::touch::Touch| (f.x_mm - t.centre_mm[0]).hypot(f.y_mm - t.centre_mm[1]);
                    errors.push(found.touches.iter().map(off).fold(50.0, f64::min));
                }
            }
        }
        println!(
            "| {name}, {} frames, a touch at the rim, no change | {alarms} alarms | {:.0} | {:.2} / {:.2} | |",
            SOUND_FRAMES * scenes,
            100.0 * right as f64 / (SOUND_FRAMES * scenes) as f64,
            quantile(&errors, 0.5),
            quantile(&errors, 0.95),
        );
        for mm in [0.05, 0.1, 0.3, 1.0] {
            let found = changed(&mut live, Change::Slip(mm), scenes, frames)?;
            println!("| {name}, slipped by {mm} mm | {found}");
        }
    }
    Ok(())
}
