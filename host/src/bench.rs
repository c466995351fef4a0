//! `skin bench`: what the reconstruction costs and how good it is, on this machine.

use crate::drive::DriveKind;
use crate::progress::Progress;
use crate::{json, latency, presses, progress};
use anyhow::{Result, anyhow, bail};
use clap::{Args, Subcommand, ValueEnum};
use inverse::solvers::Method;
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};
use studies::compare::{self, Entry};
use studies::cost::{self, Cost};
use studies::merit::{self, Ring};
use studies::savings::{self, Savings};
use studies::stress::{self, Effort};
use view::chart::{Chart, Mark};

/// What `skin bench` can measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Part {
    /// Run time against position error: all methods, cell sizes and ranks.
    Methods,
    /// Time of a frame by what happens on the sheet.
    Cost,
    /// GREIT figures of merit of the picture over the radius.
    Greit,
    /// What each shortcut of the solver is worth.
    Savings,
    /// From a contact on the simulated skin to its JSON line and to the page, in real time.
    Latency,
}

/// What needs data of its own.
#[derive(Debug, Subcommand)]
enum What {
    /// Error on held-out presses of real skins against the number of presses that are known, for a folder of tables.
    Skins(presses::bench::Arguments),
}

/// Arguments of `skin bench`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    what: Option<What>,
    /// What to measure [default: all].
    #[arg(value_enum, value_name = "PART")]
    parts: Vec<Part>,
    /// Frames that every method is given.
    #[arg(long, default_value_t = 24, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    scenes: u32,
    /// The same seed gives the same frames.
    #[arg(long, default_value_t = 1, value_name = "S")]
    seed: u64,
    /// How the sheet is driven.
    #[arg(long, value_enum, default_value_t = DriveKind::Voltage)]
    drive: DriveKind,
    /// One JSON object a line.
    #[arg(long)]
    json: bool,
    /// Draws run time against error into this file.
    #[arg(long, value_name = "FILE")]
    png: Option<PathBuf>,
    /// Draws the pictures of one frame by every method into this file, and measures nothing.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["png", "parts", "stress"])]
    fig7: Option<PathBuf>,
    /// Tries what must hold on any data instead of measuring: one verdict a line; exit code 1 when one fails.
    #[arg(long, conflicts_with_all = ["png", "parts"])]
    stress: bool,
    /// Warm frames of the longest run of --stress.
    #[arg(long, default_value_t = Effort::LONG.wandering, value_name = "N", requires = "stress", value_parser = clap::value_parser!(u64).range(1..))]
    frames: u64,
}

/// Frames of a sequence for the tables of costs and savings.
const FRAMES: usize = 48;
/// Touches at every radius.
const TOUCHES: usize = 12;

/// Runs the command.
///
/// # Errors
/// A sheet that cannot be modelled, a picture that cannot be written, a law that does not hold.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    if let Some(What::Skins(skins)) = &arguments.what {
        return presses::bench::run(skins);
    }
    if arguments.stress {
        return stress(arguments);
    }
    let drive = arguments.drive.drive();
    if let Some(path) = &arguments.fig7 {
        // Its message names the cause already.
        return studies::fig7::write(drive, arguments.seed, path).map_err(|e| anyhow!("{e}"));
    }
    let wanted = |p: Part| arguments.parts.is_empty() || arguments.parts.contains(&p);
    let frames = arguments.scenes as usize;
    let mut out = Out {
        json: arguments.json,
        first: true,
    };
    if wanted(Part::Methods) || arguments.png.is_some() {
        let progress = Progress::new("methods");
        let entries = compare::compare(drive, frames, arguments.seed, |what, done, whole| {
            progress.call(what);
            progress.at(done, whole);
        })?;
        drop(progress);
        if let Some(path) = &arguments.png {
            draw(&entries, path)?;
        }
        if wanted(Part::Methods) {
            methods(&mut out, &entries)?;
        }
    }
    if wanted(Part::Cost) {
        let progress = Progress::new("cost of a frame");
        let measured = cost::costs(drive, FRAMES, arguments.seed, |what| progress.call(what))?;
        drop(progress);
        costs(&mut out, &measured)?;
    }
    if wanted(Part::Greit) {
        for method in Method::ALL {
            let touches = TOUCHES.max(frames / 2);
            let rings = progress::meanwhile("figures of merit", || {
                merit::profile(drive, method, touches, arguments.seed)
            })?;
            greit(&mut out, method, &rings)?;
        }
    }
    if wanted(Part::Savings) {
        let saved = progress::meanwhile("savings", || savings::savings(drive, FRAMES, arguments.seed))?;
        shortcuts(&mut out, &saved)?;
    }
    if wanted(Part::Latency) {
        latency(&mut out, arguments.seed)?;
    }
    Ok(())
}

/// Where tables go: for a reader, or a line of JSON for every row.
struct Out {
    json: bool,
    first: bool,
}

#[derive(Serialize)]
struct Row<'a, T: Serialize> {
    table: &'a str,
    #[serde(flatten)]
    row: T,
}

impl Out {
    /// A table: its name, the heads of its columns, its rows.
    fn table<T: Serialize>(
        &mut self,
        name: &str,
        title: &str,
        heads: &[&str],
        rows: &[T],
        cells: impl Fn(&T) -> Vec<String>,
    ) -> Result<()> {
        let mut out = crate::say::stdout();
        if self.json {
            for row in rows {
                out.write_all(&json::line(&Row { table: name, row })?)?;
            }
            return Ok(());
        }
        if !std::mem::replace(&mut self.first, false) {
            writeln!(out)?;
        }
        writeln!(out, "{title}\n")?;
        let rows: Vec<Vec<String>> = rows.iter().map(cells).collect();
        let widths: Vec<usize> = (0..heads.len())
            .map(|k| {
                let each = rows.iter().filter_map(|r| r.get(k)).map(|c| c.chars().count());
                each.max().unwrap_or(0).max(heads[k].chars().count())
            })
            .collect();
        let line = |cells: &[String]| {
            let each = cells.iter().zip(&widths).enumerate();
            let padded: Vec<String> = each
                .map(|(k, (c, w))| if k == 0 { format!("{c:<w$}") } else { format!("{c:>w$}") })
                .collect();
            format!("| {} |", padded.join(" | "))
        };
        writeln!(
            out,
            "{}",
            line(&heads.iter().map(|h| (*h).to_owned()).collect::<Vec<_>>())
        )?;
        let rules: Vec<String> = widths.iter().map(|w| "-".repeat(*w)).collect();
        writeln!(out, "{}", line(&rules))?;
        for row in &rows {
            writeln!(out, "{}", line(row))?;
        }
        Ok(())
    }
}

/// The page or the JSON has a touch this long after its contact, ms.
const WANTED_MS: f64 = 30.0;

fn latency(out: &mut Out, seed: u64) -> Result<()> {
    let measured = latency::measure(seed)?;
    let title = format!(
        "From a contact to JSON and page: {} contacts of 15 N in 15 ms on the simulated skin, {:.1} frames/s",
        measured.contacts, measured.frames_per_s
    );
    let heads = ["part", "median ms", "p95 ms", "most ms"];
    out.table("latency", &title, &heads, &measured.rows, |row| {
        let digits = |ms: f64| format!("{ms:.2}");
        vec![
            row.part.to_owned(),
            digits(row.median_ms),
            digits(row.p95_ms),
            digits(row.most_ms),
        ]
    })?;
    for row in measured
        .rows
        .iter()
        .filter(|row| row.is_whole && row.p95_ms > WANTED_MS)
    {
        eprintln!(
            "{}: {:.1} ms (p95) is more than {WANTED_MS} ms; what is not the board's is this machine's, also when it is busy",
            row.part, row.p95_ms
        );
    }
    Ok(())
}

fn methods(out: &mut Out, entries: &[Entry]) -> Result<()> {
    let heads = [
        "method",
        "cell mm",
        "cells",
        "rank",
        "frames",
        "frame us",
        "solve us",
        "count right %",
        "median mm",
        "p95 mm",
        "front",
    ];
    let title = "Run time against position error: 1 to 4 touches at 27 dB. A touch not found counts 50 mm.";
    out.table("methods", title, &heads, entries, |e| {
        vec![
            e.method.clone(),
            format!("{}", e.cell_mm),
            format!("{}", e.cells),
            format!("{}", e.rank),
            format!("{}", e.frames),
            format!("{:.0}", e.frame_us),
            format!("{:.0}", e.solve_us),
            format!("{:.0}", 100.0 * e.counted),
            format!("{:.2}", e.median_mm),
            format!("{:.2}", e.p95_mm),
            if e.on_front { "yes" } else { "" }.to_owned(),
        ]
    })
}

fn costs(out: &mut Out, costs: &[Cost]) -> Result<()> {
    let heads = [
        "on the sheet",
        "frames",
        "median us",
        "p99 us",
        "worst us",
        "solve us",
        "touches",
        "count right %",
    ];
    let title = "Time of a frame, from voltages to touches, at 27 dB";
    out.table("cost", title, &heads, costs, |c| {
        vec![
            c.happening.clone(),
            format!("{}", c.frames),
            format!("{:.1}", c.median_us),
            format!("{:.1}", c.p99_us),
            format!("{:.1}", c.worst_us),
            format!("{:.1}", c.solve_us),
            format!("{:.1}", c.touches),
            c.counted.map_or(String::new(), |part| format!("{:.0}", 100.0 * part)),
        ]
    })
}

#[derive(Serialize)]
struct MethodRing {
    method: &'static str,
    #[serde(flatten)]
    ring: Ring,
}

fn greit(out: &mut Out, method: Method, rings: &[Ring]) -> Result<()> {
    let heads = ["r / R", "amplitude", "AR", "PE mm", "distance mm", "RES", "SD", "RNG"];
    let title = format!(
        "GREIT figures of merit of the picture by {method}, cells of {} mm",
        method.cell_mm()
    );
    let method = method.name();
    let rows: Vec<MethodRing> = rings.iter().map(|ring| MethodRing { method, ring: *ring }).collect();
    out.table("greit", &title, &heads, &rows, |r| {
        let r = &r.ring;
        vec![
            format!("{:.1}", r.radius),
            format!("{:.3}", r.amplitude),
            format!("{:.3}", r.response),
            format!("{:.2}", r.position_mm),
            format!("{:.2}", r.distance_mm),
            format!("{:.3}", r.resolution),
            format!("{:.3}", r.deformation),
            format!("{:.3}", r.ringing),
        ]
    })
}

fn shortcuts(out: &mut Out, s: &Savings) -> Result<()> {
    let heads = ["solve", "rank", "median us", "p99 us", "steps", "error of x"];
    let title = "What each shortcut is worth: four touches that move 1 mm a frame at 27 dB";
    out.table("savings", title, &heads, &s.rows, |r| {
        vec![
            r.name.clone(),
            format!("{}", r.rank),
            format!("{:.1}", r.median_us),
            format!("{:.1}", r.p99_us),
            r.steps.map_or(String::new(), |s| format!("{s:.1}")),
            format!("{:.1e}", r.error),
        ]
    })?;
    let title = format!(
        "Screening: cells known to be zero before the solution is. One product with all cells takes {:.1} us.",
        s.product_us
    );
    let heads = ["steps from the frame before", "known %", "zero in the solution %"];
    out.table("screening", &title, &heads, &s.screening, |r| {
        vec![
            format!("{}", r.steps),
            format!("{:.1}", 100.0 * r.known),
            format!("{:.1}", 100.0 * r.zero),
        ]
    })
}

/// Run time against error, the front joined by a line.
fn draw(entries: &[Entry], path: &Path) -> Result<()> {
    let mut series: Vec<String> = Vec::new();
    let mut marks = Vec::new();
    for e in entries {
        let k = series.iter().position(|s| *s == e.method).unwrap_or_else(|| {
            series.push(e.method.clone());
            series.len() - 1
        });
        let most = entries
            .iter()
            .filter(|o| o.method == e.method && o.cell_mm == e.cell_mm);
        let full = most.map(|o| o.rank).max().unwrap_or(e.rank);
        let rank = if e.rank < full {
            format!(", rank {}", e.rank)
        } else {
            String::new()
        };
        marks.push(Mark {
            at: [e.frame_us, e.median_mm],
            series: k,
            label: format!("{} mm{rank}", e.cell_mm),
        });
    }
    let mut front: Vec<[f64; 2]> = entries
        .iter()
        .filter(|e| e.on_front)
        .map(|e| [e.frame_us, e.median_mm])
        .collect();
    front.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let chart = Chart {
        title: "Run time against error: 1 to 4 touches at 27 dB".to_owned(),
        axes: [
            "time of a frame, from voltages to touches, us (median)".to_owned(),
            "position error, mm (median)".to_owned(),
        ],
        series,
        marks,
        front,
    };
    let canvas = chart.draw(1400, 900)?;
    canvas.write_png(path).map_err(|e| anyhow!("{e}"))
}

fn stress(arguments: &Arguments) -> Result<()> {
    let effort = Effort {
        wandering: arguments.frames,
        seed: arguments.seed,
        ..Effort::LONG
    };
    let verdicts = stress::run(effort, |v| {
        let mut out = crate::say::stdout();
        // A reader who has gone away is no reason to stop.
        let _ = if arguments.json {
            json::line(v).map_or(Ok(()), |line| out.write_all(&line))
        } else {
            let word = if v.passed { "pass" } else { "FAIL" };
            writeln!(out, "{word}  {} ({})", v.law, v.detail)
        };
    })?;
    let failed = verdicts.iter().filter(|v| !v.passed).count();
    if failed > 0 {
        bail!("{failed} of {} laws do not hold", verdicts.len());
    }
    Ok(())
}
