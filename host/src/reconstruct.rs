//! `skin reconstruct`: frames of a table to touches and pictures.

use crate::disc::{self, Disc};
use crate::files::calibration_file;
use crate::files::measurements::MeasurementTable;
use crate::{number, sheet};
use anyhow::{Context, Result, bail};
use clap::Args;
use inverse::batch::{Batch, BatchOptions};
use inverse::pipeline::FrameResult;
use inverse::quality::doubt::Doubt;
use inverse::reference::imager::Imager;
use inverse::reference::screening::Finding;
use inverse::solvers::{Method, Status};
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use view::picture::Stats;
use view::png;
use view::surface::Surface;

/// Arguments of `skin reconstruct`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Table of measurements (CSV: drive_a, drive_b, sense_a, sense_b, then a column, or _re and _im, for every frame).
    file: PathBuf,
    /// Frames of the unpressed sheet; several are averaged, and eight or more tell the noise.
    #[arg(long, required = true, value_delimiter = ',', value_name = "COLUMN[,COLUMN...]")]
    baseline: Vec<String>,
    #[command(flatten)]
    disc: Disc,
    /// Take the electrodes to be exactly where they are said to be, instead of finding them in the baseline.
    #[arg(long)]
    trust_electrodes: bool,
    /// The electrode of the sheet that every wire leads to, in the order of the table's numbers, as `skin check` says it.
    #[arg(long, value_delimiter = ',', value_name = "ELECTRODE,...")]
    wires: Vec<usize>,
    /// Side of the picture's cells, mm [default: 5 mm on a 195 mm disc, in proportion; 20 mm for lawson-hanson].
    #[arg(long, allow_negative_numbers = true, value_name = "MM", value_parser = disc::length())]
    cell_mm: Option<f64>,
    /// How the picture is computed.
    #[arg(long, value_parser = crate::method::parser(), default_value_t = Method::Nnls)]
    method: Method,
    /// Writes a picture of every frame, FRAME.png, into this folder.
    #[arg(long, value_name = "DIR")]
    png: Option<PathBuf>,
    /// Writes the cells of every frame, FRAME.csv with x_mm, y_mm and relative rise, into this folder.
    #[arg(long, value_name = "DIR")]
    cells: Option<PathBuf>,
    /// Forces in newtons with the creep of the rubber taken out, by what `skin calibrate` wrote; the frames are those of one
    /// recording in the order of the columns.
    #[arg(long, requires = "frame_s", value_name = "FILE")]
    calibration: Option<PathBuf>,
    /// The frames follow one another, so many s from one to the next: what is broken or changed on the sheet is then told over several of
    /// them.
    #[arg(long, value_name = "S", value_parser = number::positive("a time in seconds above 0"))]
    frame_s: Option<f64>,
    /// One JSON object a line.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct TouchLine {
    x_mm: f64,
    y_mm: f64,
    rise: f64,
    area_mm2: f64,
    total_mm2: f64,
    /// Standard uncertainties; null where the touch is a peak of the picture only.
    x_sd_mm: Option<f64>,
    y_sd_mm: Option<f64>,
    area_sd_mm2: Option<f64>,
    total_sd_mm2: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    force_n: Option<f64>,
}

#[derive(Serialize)]
struct FrameLine<'a> {
    frame: &'a str,
    touches: Vec<TouchLine>,
    residual: f64,
    gap: f64,
    solve_us: f64,
    /// "converged", "stopped" (see gap) or "bad input".
    status: &'static str,
    /// Whether there was a change above the noise.
    changed: bool,
    /// How many values took part.
    used: usize,
    /// What speaks against the touches.
    #[serde(skip_serializing_if = "Option::is_none")]
    doubt: Option<Doubt>,
    /// What is left out of all frames, since it is wrong in the baseline.
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    left_out: &'a [&'a Finding],
}

fn status(status: Status) -> &'static str {
    match status {
        Status::Converged => "converged",
        Status::Stopped => "stopped",
        Status::BadInput => "bad input",
    }
}

/// Runs the command.
///
/// # Errors
/// A table or a sheet that makes no sense, a frame that is not there, a picture that cannot be written.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let calibration = arguments
        .calibration
        .as_deref()
        .map(calibration_file::read)
        .transpose()?;
    let table = MeasurementTable::read(&arguments.file)?;
    if table.infinite > 0 {
        eprintln!(
            "warning: {}: {} values are infinite and are left out, as missing ones are",
            arguments.file.display(),
            table.infinite
        );
    }
    let baselines = arguments
        .baseline
        .iter()
        .map(|name| table.frame(name.trim()))
        .collect::<Result<Vec<_>, _>>()?;
    if (0..table.columns.len()).all(|k| baselines.contains(&k)) {
        bail!(
            "{}: every frame is a baseline; leave one to be reconstructed",
            arguments.file.display()
        );
    }
    let pattern = sheet::rewired(arguments.disc.pattern(&table)?, &arguments.wires)?;
    let method = arguments.method;
    let cell_mm = arguments
        .cell_mm
        .unwrap_or_else(|| arguments.disc.scaled(method.cell_mm()));
    let imager = Arc::new(Imager::for_method(
        method,
        &arguments.disc.sheet(pattern.electrodes()),
        arguments.disc.drive(),
        pattern,
        cell_mm,
    )?);
    let unpressed: Vec<&[f64]> = baselines.iter().map(|k| table.columns[*k].values.as_slice()).collect();
    if !unpressed
        .iter()
        .flat_map(|f| f.iter())
        .any(|v| v.is_finite() && *v != 0.0)
    {
        bail!(
            "{}: the baseline {} holds no value; name a frame of the unpressed sheet",
            arguments.file.display(),
            arguments.baseline.join(",")
        );
    }
    let defaults = BatchOptions::of(method);
    let options = BatchOptions {
        find_electrodes: defaults.find_electrodes && !arguments.trust_electrodes,
        interval_s: arguments.frame_s,
        calibration,
        ..defaults
    };
    let mut batch = Batch::new(imager, &unpressed, options)?;
    sheet::say(batch.inspection());
    if let Some(found) = &batch.inspection().electrodes {
        let most = found.moved_mm.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        eprintln!("electrodes found in the baseline, up to {most:.1} mm from where they were said to be");
    }
    let mut results = Vec::new();
    for (k, column) in table.columns.iter().enumerate() {
        if baselines.contains(&k) {
            batch.pass_over(k);
            continue;
        }
        let result = batch.frame(k, &column.values)?;
        warn(&column.name, &result);
        results.push((column.name.as_str(), result));
    }
    // Everything is computed and every picture written before the first line is printed: no part passes for the whole.
    if let Some(folder) = &arguments.png {
        write_pictures(folder, batch.imager(), &results)?;
    }
    if let Some(folder) = &arguments.cells {
        write_cells(folder, batch.imager(), &results)?;
    }
    let left_out: Vec<&Finding> = batch.inspection().left_out().collect();
    print(&results, &left_out, arguments.json)
}

/// Says on stderr what speaks against a frame's result.
fn warn(frame: &str, result: &FrameResult) {
    if let Some(doubt) = result.doubt {
        eprintln!("warning: frame {frame}: {doubt}");
    }
    match result.status {
        Status::Converged => {}
        Status::Stopped => eprintln!(
            "warning: frame {frame}: the solver stopped at a relative gap of {:.1e}",
            result.gap
        ),
        Status::BadInput => {
            eprintln!("warning: frame {frame}: its values are too large to compute with; look at its unit");
        }
    }
}

fn write_cells(folder: &Path, imager: &Imager, results: &[(&str, FrameResult)]) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("{}: cannot make this folder", folder.display()))?;
    let names = file_names(results.iter().map(|(name, _)| *name), "csv");
    for ((_, result), file) in results.iter().zip(names) {
        let path = folder.join(file);
        std::fs::write(&path, cells(imager, &result.x))
            .with_context(|| format!("{}: cannot write the cells", path.display()))?;
    }
    Ok(())
}

/// A line for every cell: its centre and what the method says of it, negative where it says so.
fn cells(imager: &Imager, x: &[f64]) -> String {
    let mut text = "x_mm,y_mm,rise\n".to_owned();
    for (k, rise) in x.iter().enumerate() {
        let [x, y] = imager.grid.centre(k);
        text.push_str(&format!("{x},{y},{rise:.6e}\n"));
    }
    text
}

fn write_pictures(folder: &Path, imager: &Imager, results: &[(&str, FrameResult)]) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("{}: cannot make this folder", folder.display()))?;
    let names = file_names(results.iter().map(|(name, _)| *name), "png");
    for (k, ((name, result), file)) in results.iter().zip(names).enumerate() {
        let stats = Stats {
            solve_us: result.changed.then_some(result.solve_us as f32),
            residual: result.changed.then_some(result.residual as f32),
            source: (*name).to_owned(),
            ..Stats::default()
        };
        let picture = Surface::of(imager)?.picture(result, k as u64, 0.0, stats);
        let path = folder.join(file);
        png::write_png(&picture, &path).with_context(|| format!("{}: cannot write the picture", path.display()))?;
    }
    Ok(())
}

/// A file for every frame: its name with whatever may trouble a file system replaced, numbered where two become the same.
fn file_names<'a>(frames: impl Iterator<Item = &'a str>, kind: &str) -> Vec<String> {
    let mut files: Vec<String> = Vec::new();
    for frame in frames {
        let safe: String = frame
            .chars()
            .map(|c| {
                if c.is_alphanumeric() || "-_.".contains(c) {
                    c
                } else {
                    '_'
                }
            })
            .collect();
        let taken = |file: &str| files.iter().any(|f| f.to_lowercase() == file.to_lowercase());
        let mut file = format!("{safe}.{kind}");
        let mut number = 2;
        while taken(&file) {
            file = format!("{safe}-{number}.{kind}");
            number += 1;
        }
        files.push(file);
    }
    files
}

/// To a tenth: more digits of a time are noise.
fn tenths(value: f64) -> f64 {
    (10.0 * value).round() / 10.0
}

fn print(results: &[(&str, FrameResult)], left_out: &[&Finding], json: bool) -> Result<()> {
    let mut out = std::io::stdout().lock();
    for (frame, result) in results {
        if json {
            let line = FrameLine {
                frame,
                touches: result
                    .touches
                    .iter()
                    .map(|t| TouchLine {
                        x_mm: t.x_mm,
                        y_mm: t.y_mm,
                        rise: t.rise,
                        area_mm2: t.area_mm2,
                        total_mm2: t.total_mm2,
                        x_sd_mm: t.x_sd_mm,
                        y_sd_mm: t.y_sd_mm,
                        area_sd_mm2: t.area_sd_mm2,
                        total_sd_mm2: t.total_sd_mm2,
                        force_n: t.force_n,
                    })
                    .collect(),
                residual: result.residual,
                gap: result.gap,
                solve_us: tenths(result.solve_us),
                status: status(result.status),
                changed: result.changed,
                used: result.used,
                doubt: result.doubt,
                left_out,
            };
            serde_json::to_writer(&mut out, &line)?;
            writeln!(out)?;
            continue;
        }
        if result.used == 0 {
            writeln!(out, "{frame}: no value that can be used")?;
            continue;
        }
        if !result.changed {
            writeln!(out, "{frame}: no change above the noise")?;
            continue;
        }
        let count = match result.touches.len() {
            0 => "no touch".to_owned(),
            1 => "1 touch".to_owned(),
            n => format!("{n} touches"),
        };
        writeln!(
            out,
            "{frame}: {count} (unexplained {:.1} %, gap {:.0e}, solve {:.0} us)",
            100.0 * result.residual,
            result.gap,
            result.solve_us
        )?;
        for t in &result.touches {
            writeln!(
                out,
                "    x {:7.1} mm  y {:7.1} mm  rise {:6.1} %  area {:6.0} mm2{}",
                t.x_mm,
                t.y_mm,
                100.0 * t.rise,
                t.area_mm2,
                t.force_n.map_or(String::new(), |f| format!("  force {f:6.2} N"))
            )?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::forward::{Drive, Pattern, Sheet};

    #[test]
    fn no_two_frames_share_a_file() {
        let files = file_names(["a b", "a_b", "A/b", "a_b-2", "../x"].into_iter(), "png");
        assert_eq!(files, ["a_b.png", "a_b-2.png", "A_b-3.png", "a_b-2-2.png", ".._x.png"]);
    }

    #[test]
    fn every_cell_has_its_line() {
        let imager = Imager::new(&Sheet::paper(), Drive::PAPER, Pattern::adjacent(16).unwrap(), 20.0).unwrap();
        let x: Vec<f64> = (0..imager.grid.len()).map(|k| 0.001 * k as f64 - 0.01).collect();
        let text = cells(&imager, &x);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 1 + imager.grid.len());
        let [cx, cy] = imager.grid.centre(7);
        assert_eq!(
            (lines[0], lines[8]),
            ("x_mm,y_mm,rise", format!("{cx},{cy},-3.000000e-3").as_str())
        );
    }
}
