//! Leaks between two wires, at the noise of a finger at 27 dB: how soon they are named, and what is shown beside them.
//!
//! `cargo run --release -p studies --example leaks -- [--current] [--rows]` (docs/reliability.md, Faults while it runs)
//!
//! `--current`: the sheet is driven by a current instead of a voltage. `--rows`: each frame stands for itself, as a row of a table does.

use forward::{DiscTouch, Drive};
use inverse::pipeline::FrameResult;
use inverse::touches::touch::Touch;
use studies::{LiveSheet, StudyError};

const FRAMES: usize = 400;
const ROWS: usize = 10;
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

/// What is shown of a leak: in frames that follow one another after the first [`UNKNOWN`].
#[derive(Default)]
struct Shown {
    named: usize,
    right: usize,
    silent: usize,
    doubted: usize,
}

impl Shown {
    /// Takes what a frame of these touches shows.
    fn take(&mut self, result: &FrameResult, touches: &[DiscTouch]) {
        let off = |t: &Touch| (t.x_mm - PLACE_MM[0]).hypot(t.y_mm - PLACE_MM[1]);
        let right = result.touches.len() == touches.len() && result.touches.iter().all(|t| off(t) < RIGHT_MM);
        self.named += usize::from(!result.faults.is_empty());
        match (result.doubt, right) {
            (Some(_), _) => self.doubted += 1,
            (None, true) => self.right += 1,
            (None, false) => self.silent += 1,
        }
    }

    /// Of a sheet on which a leak comes and stays, or of rows that each have it.
    fn look(
        &mut self,
        mut live: LiveSheet,
        (pair, ohm): ([usize; 2], f64),
        touches: &[DiscTouch],
        rows: bool,
    ) -> Result<(), StudyError> {
        let clean = live.sheet.leaky_frame(touches, pair, ohm)?;
        if rows {
            let mut table = live.sheet.reconstructor()?;
            for _ in 0..ROWS {
                self.take(table.frame(&live.frame(&clean))?, touches);
            }
            return Ok(());
        }
        let rest = live.sheet.baseline.clone();
        for _ in 0..4 {
            live.reconstruct(&rest)?;
        }
        for frame in 0..FRAMES {
            let result = live.reconstruct(&clean)?;
            if frame >= UNKNOWN {
                self.take(result, touches);
            }
        }
        Ok(())
    }
}

fn main() -> Result<(), StudyError> {
    let is_given = |option: &str| std::env::args().any(|arg| arg == option);
    let drive = match is_given("--current") {
        true => Drive::Current { amplitude_a: 1e-3 },
        false => Drive::PAPER,
    };
    let rows = is_given("--rows");
    println!("| between | kilohm | finger | named | right | wrong and silent | doubted |");
    println!("|---|---|---|---|---|---|---|");
    for pair in [[3, 4], [3, 5], [2, 5], [2, 9]] {
        for kilohm in [3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0] {
            for touched in [false, true] {
                let touches = [finger(PLACE_MM)];
                let touches = if touched { &touches[..] } else { &[] };
                let mut shown = Shown::default();
                for seed in 87..89 {
                    let live = LiveSheet::new(drive, seed, |sheet, _| sheet.clean_frame(&[finger([48.0, 0.0])]))?;
                    shown.look(live, (pair, 1e3 * kilohm), touches, rows)?;
                }
                let [a, b] = pair.map(|l| l + 1);
                println!(
                    "| {a} and {b} | {kilohm} | {} | {} | {} | {} | {} |",
                    if touched { "yes" } else { "no" },
                    shown.named,
                    shown.right,
                    shown.silent,
                    shown.doubted
                );
            }
        }
    }
    let each = if rows { ROWS } else { FRAMES - UNKNOWN };
    println!("\nof {} frames each", 2 * each);
    Ok(())
}
