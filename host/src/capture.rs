//! `skin sim` as fast as it goes: frames as a table, or bytes.

use crate::files::replace::replace;
use crate::files::sheet_line::SheetLine;
use crate::progress::Progress;
use ::forward::Pattern;
use anyhow::{Context, Result, anyhow};
use hil_sim::{Pace, Rubber, SceneFile, SimBoard, SimPort};
use link::Session;
use link::plans::adjacent_plan;
use protocol::{MAX_TO_BOARD_LEN, ToBoard, encode};
use serde::Serialize;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::time::Duration;

/// A time in whole milliseconds, for [`Progress::at`].
fn milliseconds(s: f64) -> usize {
    (1e3 * s).max(0.0) as usize
}

/// Writes a file, as a whole or not at all.
fn write(path: &Path, fill: impl FnOnce(&mut BufWriter<&mut File>) -> io::Result<()>) -> Result<()> {
    let written = replace(path, |file| {
        let mut out = BufWriter::new(file);
        fill(&mut out)?;
        out.flush()
    });
    written.with_context(|| format!("{}: cannot be written", path.display()))
}

/// Writes what the board sends after it was told to start.
///
/// # Errors
/// The file cannot be written.
pub(crate) fn bytes(mut board: SimBoard<Rubber>, duration_s: f64, path: &Path) -> Result<()> {
    let start = encode(&ToBoard::Start, &mut [0; MAX_TO_BOARD_LEN])
        .map_err(|e| anyhow!("the command to start: {e:?}"))?
        .to_vec();
    board.receive(&start);
    let mut bytes = Vec::new();
    let progress = Progress::new("simulating");
    write(path, |out| {
        while board.now_s() < duration_s {
            bytes.clear();
            board.step(|byte| bytes.push(byte));
            out.write_all(&bytes)?;
            progress.at(milliseconds(board.now_s()), milliseconds(duration_s));
        }
        Ok(())
    })
}

/// What there really is.
#[derive(Serialize)]
struct Truth {
    time_s: f64,
    touches: Vec<TrueTouch>,
}

#[derive(Serialize)]
struct TrueTouch {
    id: usize,
    x_mm: f64,
    y_mm: f64,
    force_n: f64,
    /// Relative rise in resistivity at the centre: now, of all that was.
    rise: f64,
}

/// Prints a frame every so many seconds as a table for `skin reconstruct`; what there really is goes into the file `truth`.
///
/// # Errors
/// The board does not answer, or a file cannot be written.
pub(crate) fn table(file: &SceneFile, board: SimBoard<Rubber>, every_s: f64, truth: Option<&Path>) -> Result<()> {
    let plan = file.config.plan.clone();
    let port = SimPort::new(board, Pace::Unpaced).context("the simulated skin does not start")?;
    let session = Session::start(Box::new(port), |hello| plan.map_or_else(|| adjacent_plan(hello), Ok))?;
    let pattern = Pattern::from_pairs(session.electrodes(), session.measurements())?;
    let mut frames = Vec::new();
    let mut next_s = 0.0;
    let progress = Progress::new("simulating");
    loop {
        let frame = session
            .frame(Duration::from_secs(3))?
            .ok_or_else(|| anyhow!("the simulated board sends no frame any more"))?;
        progress.at(milliseconds(frame.time_s), milliseconds(file.duration_s));
        if frame.time_s > file.duration_s {
            break;
        }
        if frame.time_s >= next_s {
            next_s = frame.time_s + every_s;
            frames.push(frame);
        }
    }
    drop(progress);
    if let Some(path) = truth {
        write(path, |out| {
            for frame in &frames {
                let now = file.scene.truth(frame.time_s).into_iter().map(|t| {
                    let mut probe = file.scene.probe(t.x_mm, t.y_mm);
                    probe.advance(frame.time_s);
                    TrueTouch {
                        id: t.id,
                        x_mm: t.x_mm,
                        y_mm: t.y_mm,
                        force_n: t.force_n,
                        rise: probe.rise(),
                    }
                });
                let truth = Truth {
                    time_s: frame.time_s,
                    touches: now.collect(),
                };
                serde_json::to_writer(&mut *out, &truth)?;
                writeln!(out)?;
            }
            Ok(())
        })?;
    }
    let mut out = BufWriter::new(crate::say::stdout());
    writeln!(
        out,
        "# simulated: {}, seed {}",
        file.title, file.config.electronics.seed
    )?;
    writeln!(out, "# sheet: {}", SheetLine::of(&file.sheet)?)?;
    writeln!(out, "# rows: {}", pattern.len())?;
    writeln!(
        out,
        "# quantity: amplitude, V; the current enters at drive_a, the value is U(sense_b) - U(sense_a); columns are times, s"
    )?;
    write!(out, "drive_a,drive_b,sense_a,sense_b")?;
    for frame in &frames {
        write!(out, ",t{:.3}", frame.time_s)?;
    }
    writeln!(out)?;
    for (k, m) in pattern.measurements().iter().enumerate() {
        let [da, db, sa, sb] = [m.drive.plus, m.drive.minus, m.sense.minus, m.sense.plus].map(|e| e + 1);
        write!(out, "{da},{db},{sa},{sb}")?;
        for frame in &frames {
            let value = frame.values_v.get(k).copied().unwrap_or(f64::NAN);
            write!(out, ",{value:.6e}")?;
        }
        writeln!(out)?;
    }
    out.flush()?;
    Ok(())
}
