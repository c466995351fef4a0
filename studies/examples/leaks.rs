//! Leaks between two wires, at the noise of a finger at 27 dB: how soon they are named, and what is shown beside them.
//!
//! `cargo run --release -p studies --example leaks -- [--current]` (docs/reliability.md, Faults while it runs)
//!
//! `--current`: the sheet is driven by a current instead of a voltage.

use forward::{DiscTouch, Drive};
use studies::{LiveSheet, StudyError};

const FRAMES: usize = 400;
/// Frames for which a leak may be unknown: a tenth of a second.
const UNKNOWN: usize = 21;
/// Places that are off by no more are right, mm.
const RIGHT_MM: f64 = 1.5;
const PLACE_MM: [f64; 2] = [-20.0, 35.0];

fn finger(centre_mm: [f64; 2]) -> DiscTouch {
    DiscTouch {
        centre_mm,
        radius_mm: 12.5,
        rise: 0.2,
    }
}

/// What is shown of a leak after [`UNKNOWN`] frames.
#[derive(Default)]
struct Shown {
    named: usize,
    right: usize,
    silent: usize,
    doubted: usize,
}

fn look(drive: Drive, pair: [usize; 2], ohm: f64, touched: bool, seed: u64) -> Result<Shown, StudyError> {
    let mut live = LiveSheet::new(drive, seed, |sheet, _| sheet.clean_frame(&[finger([48.0, 0.0])]))?;
    let rest = live.sheet.baseline.clone();
    for _ in 0..4 {
        live.reconstruct(&rest)?;
    }
    let touches = [finger(PLACE_MM)];
    let touches = if touched { &touches[..] } else { &[] };
    let clean = live.sheet.leaky_frame(touches, pair, ohm)?;
    let mut shown = Shown::default();
    for frame in 0..FRAMES {
        let result = live.reconstruct(&clean)?;
        if frame < UNKNOWN {
            continue;
        }
        let off = |t: &inverse::touches::touch::Touch| (t.x_mm - PLACE_MM[0]).hypot(t.y_mm - PLACE_MM[1]);
        let right = result.touches.len() == touches.len() && result.touches.iter().all(|t| off(t) < RIGHT_MM);
        shown.named += usize::from(!result.faults.is_empty());
        match (result.doubt, right) {
            (Some(_), _) => shown.doubted += 1,
            (None, true) => shown.right += 1,
            (None, false) => shown.silent += 1,
        }
    }
    Ok(shown)
}

fn main() -> Result<(), StudyError> {
    let drive = match std::env::args().any(|arg| arg == "--current") {
        true => Drive::Current { amplitude_a: 1e-3 },
        false => Drive::PAPER,
    };
    println!("| between | kilohm | finger | named | right | wrong and silent | doubted |");
    println!("|---|---|---|---|---|---|---|");
    for pair in [[3, 4], [3, 5], [2, 5], [2, 9]] {
        for kilohm in [3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0] {
            for touched in [false, true] {
                let mut all = Shown::default();
                for seed in 87..89 {
                    let shown = look(drive, pair, 1e3 * kilohm, touched, seed)?;
                    all.named += shown.named;
                    all.right += shown.right;
                    all.silent += shown.silent;
                    all.doubted += shown.doubted;
                }
                let [a, b] = pair.map(|l| l + 1);
                println!(
                    "| {a} and {b} | {kilohm} | {} | {} | {} | {} | {} |",
                    if touched { "yes" } else { "no" },
                    all.named,
                    all.right,
                    all.silent,
                    all.doubted
                );
            }
        }
    }
    println!("\nof {} frames each, after the first {UNKNOWN}", 2 * (FRAMES - UNKNOWN));
    Ok(())
}
