//! `skin reconstruct`: frames of a table to touches and pictures.

use crate::drive::DriveKind;
use crate::files::calibration_file;
use crate::files::measurements::MeasurementTable;
use crate::files::names::file_names;
use crate::files::order;
use crate::files::replace::replace;
use crate::files::sheet_line::SheetLine;
use crate::json;
use crate::presses::{self, file::PressCalibration};
use crate::progress::Progress;
use crate::recorded_frames::{self, Part};
use crate::table_baseline::{BaselineArguments, Frame};
use crate::table_batch::{How, TableBatch};
use crate::table_sheet::Geometry;
use crate::usage::Usage;
use crate::{number, sheet, table_file, table_notices};
use ::forward::{Sheet, order::ValueOrder};
use anyhow::{Context, Result, bail};
use clap::Args;
use inverse::batch::Batch;
use inverse::pipeline::FrameResult;
use inverse::quality::doubt::Doubt;
use inverse::reference::diagnosis::Fault;
use inverse::reference::drift::Drift;
use inverse::reference::imager::Imager;
use inverse::reference::screening::Finding;
use inverse::solvers::{Method, Status};
use inverse::touches::polarity::Polarity;
use inverse::touches::touch::Touch;
use serde::Serialize;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use view::picture::Stats;
use view::png;
use view::surface::Surface;

/// Arguments of `skin reconstruct`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Table of measurements (CSV: drive_a, drive_b, sense_a, sense_b, then a column, or _re and _im, for every frame), or with
    /// --order one frame a line (text, .npy, .npz, .mat).
    #[arg(required_unless_present = "from")]
    file: Option<PathBuf>,
    /// A recording in place of a table.
    ///
    /// With its sheet and its wires; its columns are named as skin export names them [default baseline: the frames that it was taken of].
    #[arg(long, value_name = "RECORDING", conflicts_with_all = ["file", "order", "wires"])]
    from: Option<PathBuf>,
    #[command(flatten)]
    part: Part,
    #[command(flatten)]
    baseline: BaselineArguments,
    /// The file has one frame a line, in the order of this program (docs/tables.md).
    #[arg(long, value_parser = order::parser(), value_name = "ORDER")]
    order: Option<ValueOrder>,
    /// Variables of a .npz or .mat file that hold frames; a field of a struct is STRUCT.FIELD [default: all that fit the order].
    #[arg(
        long,
        value_delimiter = ',',
        value_name = "NAME[,NAME...]",
        requires = "order",
        conflicts_with = "from",
        hide_short_help = true
    )]
    variable: Vec<String>,
    /// How the sheet was driven.
    #[arg(long, value_enum, default_value_t = DriveKind::Voltage, hide_short_help = true)]
    drive: DriveKind,
    #[command(flatten)]
    geometry: Geometry,
    /// Take the electrodes to be exactly where they are said to be, instead of finding them in the baseline.
    #[arg(long, hide_short_help = true)]
    trust_electrodes: bool,
    /// The electrode of the sheet that every wire leads to, in the order of the table's numbers, as `skin check` says it.
    #[arg(long, value_delimiter = ',', value_name = "ELECTRODE,...", hide_short_help = true)]
    wires: Vec<usize>,
    /// How the picture is computed.
    #[arg(long, value_parser = crate::method::parser(), default_value_t = Method::Nnls)]
    method: Method,
    /// Writes a picture of every frame, FRAME.png, into this folder.
    #[arg(long, value_name = "DIR")]
    png: Option<PathBuf>,
    /// Writes the cells of every frame, FRAME.csv with x_mm, y_mm and relative rise, into this folder.
    #[arg(long, value_name = "DIR", hide_short_help = true)]
    cells: Option<PathBuf>,
    /// Which way touches change the resistance of the sheet [default: the way that explains a frame].
    #[arg(long, value_name = "WAY", value_parser = crate::rise::parser(), hide_short_help = true)]
    rise: Option<Polarity>,
    /// What `skin calibrate` wrote: forces, or places by presses.
    ///
    /// With --frame-s forces in newtons with the creep of the rubber taken out, the frames being those of one recording in the order of the
    /// columns. What `skin calibrate presses` wrote locates presses by it, in place of the model.
    #[arg(long, value_name = "FILE")]
    calibration: Option<PathBuf>,
    /// The frames follow one another, so many s from one to the next: what is broken or changed on the sheet is then told over several of
    /// them.
    #[arg(long, value_name = "S", value_parser = number::positive("a time in seconds above 0"), hide_short_help = true)]
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
    /// Whether the rise is the most or the least that the model of discs has: it is at least so much.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    at_limit: bool,
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
    /// Of how many.
    values: usize,
    /// What the frame was compared with.
    baseline: &'a str,
    #[serde(flatten)]
    source: &'a Source,
    /// What speaks against the touches.
    #[serde(skip_serializing_if = "Option::is_none")]
    doubt: Option<Doubt>,
    /// What is broken.
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    faults: &'a [Fault],
    /// Values of this frame that have nothing to do with the others, and took no part: rows from 0.
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    rejected: &'a [usize],
    /// Part of the change that the touches take, where discs do not explain it.
    #[serde(skip_serializing_if = "Option::is_none")]
    explained: Option<f64>,
    /// What drifted since the baseline.
    #[serde(skip_serializing_if = "Drift::is_none")]
    drift: &'a Drift,
    /// What is left out of all frames, since it is wrong in the baseline.
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    left_out: &'a [&'a Finding],
}

/// What all frames of a table have in common.
#[derive(Serialize)]
struct Source {
    /// The sheet they were reconstructed on.
    sheet: String,
    /// The pattern of the rows.
    pattern: String,
    /// Measurements of the pattern that the table does not have, as drive_a, drive_b, sense_a, sense_b.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    missing: Vec<[usize; 4]>,
    /// What was assumed, left out or found strange in the table and in its baseline.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    notes: Vec<String>,
    /// A calibration from presses whose sheet this is.
    #[serde(skip_serializing_if = "Option::is_none")]
    calibration: Option<String>,
    /// Part of earlier dents that has gone between the frame before and the frame, 0 to 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    creep_recovered: Option<f64>,
    /// Depth of the mean of these dents over that of the mean press, 0 to 0.5, where no frame shows the sheet without them.
    #[serde(skip_serializing_if = "Option::is_none")]
    creep_dented: Option<f64>,
}

/// A frame's name, what it was compared with, and what came of it.
struct Done<'a> {
    frame: &'a str,
    baseline: String,
    result: FrameResult,
}

fn status(status: Status) -> &'static str {
    match status {
        Status::Converged => "converged",
        Status::Stopped => "stopped",
        Status::BadInput => "bad input",
    }
}

/// Frames, and what a recording knows of them.
struct Input {
    table: MeasurementTable,
    sheet: Option<Sheet>,
    baseline: Option<String>,
}

/// Reads the table or the recording, and says what was assumed.
fn read(arguments: &Arguments) -> Result<Input> {
    if let Some(path) = &arguments.from {
        let recorded = recorded_frames::table(path, &arguments.part)?;
        if recorded.baseline.is_none() && arguments.baseline.says_nothing() {
            bail!(
                "{}: the frames of its baseline are not in the part that is read; name some with --baseline",
                path.display()
            );
        }
        return Ok(Input {
            table: recorded.table,
            sheet: Some(recorded.sheet),
            baseline: recorded.baseline,
        });
    }
    if arguments.part.is_asked() {
        let why = "--from-s, --to-s and --every are for a recording, which --from names";
        return Err(Usage(why.to_owned()).into());
    }
    let path = arguments.file.as_deref().unwrap_or_else(|| Path::new(""));
    let table = table_file::read(path, arguments.order, &arguments.variable)?;
    Ok(Input {
        table,
        sheet: None,
        baseline: None,
    })
}

/// What was given that only a reconstruction by the sheet's model uses.
fn of_the_model(arguments: &Arguments) -> Vec<&'static str> {
    let mut list = arguments.geometry.given();
    list.extend(
        [
            (arguments.png.is_some(), "--png"),
            (arguments.cells.is_some(), "--cells"),
            (arguments.drive != DriveKind::Voltage, "--drive"),
            (arguments.trust_electrodes, "--trust-electrodes"),
            (!arguments.wires.is_empty(), "--wires"),
            (arguments.method != Method::Nnls, "--method"),
            (arguments.rise.is_some(), "--rise"),
            (arguments.frame_s.is_some(), "--frame-s"),
            (arguments.baseline.has_unit(), "--unit-v"),
        ]
        .iter()
        .filter_map(|(given, name)| given.then_some(*name)),
    );
    list
}

/// Locates presses by what others taught.
fn by_presses(
    arguments: &Arguments,
    table: &MeasurementTable,
    calibration: &PressCalibration,
    baseline: Option<&str>,
) -> Result<()> {
    let of_the_model = of_the_model(arguments);
    if !of_the_model.is_empty() {
        let why = "a calibration from presses takes the place of the sheet's model, and gives places only; leave out";
        return Err(Usage(format!("{why} {}", of_the_model.join(", "))).into());
    }
    let compared = arguments.baseline.or(baseline);
    presses::locate::run(table, calibration, &compared.comparison(), arguments.json)
}

/// Runs the command.
///
/// # Errors
/// A table or a sheet that makes no sense, a frame that is not there, a picture that cannot be written.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let calibration = arguments.calibration.as_deref();
    let is_of_presses = calibration.map_or(Ok(false), presses::file::is)?;
    let of_presses = calibration.filter(|_| is_of_presses);
    let rubber = calibration.filter(|_| !is_of_presses);
    // First, so that a damaged file is told and not taken for one of the rubber's creep.
    let calibration = rubber.map(calibration_file::read).transpose()?;
    if rubber.is_some() && arguments.frame_s.is_none() {
        let why = "--calibration of the rubber's creep needs --frame-s: the time from a frame to the next";
        return Err(Usage(why.to_owned()).into());
    }
    let Input { table, sheet, baseline } = read(arguments)?;
    let of_presses = of_presses.map(presses::file::read).transpose()?;
    // The sheet of a model that locates the calibration's presses better than what they taught.
    let (mut calibrated, mut told) = (None, None);
    if let Some(presses) = of_presses {
        let Some(model) = &presses.better else {
            return by_presses(arguments, &table, &presses, baseline.as_deref());
        };
        eprintln!("calibration: {}", presses::live::model_text(&presses.file, model));
        calibrated = Some((presses.file.clone(), model.sheet.clone()));
        told.clone_from(&model.told);
    }
    let method = arguments.method;
    let known = sheet.or_else(|| calibrated.as_ref().map(|(_, sheet)| sheet.clone()));
    let chosen = arguments.geometry.choose_with(&table, method, known)?;
    if let Some((file, calibrated)) = &calibrated
        && let Some(difference) = SheetLine::of(calibrated)?.differs(&chosen.line)
    {
        bail!("{file}: it was made on another sheet than the one used: {difference}; calibrate on this sheet");
    }
    if let Some(missing) = chosen.table_pattern.missing_text(&table.measurements) {
        eprintln!("warning: {}: {missing}", table.file);
    }
    let mut notes = table.notes.clone();
    notes.extend(table_notices::of_drive(&table, arguments.drive));
    if !arguments.baseline.comparison().difference {
        notes.extend(table_notices::of_rounding(&table));
    }
    let mut source = Source {
        creep_recovered: None,
        creep_dented: None,
        sheet: chosen.line.to_string(),
        pattern: chosen.table_pattern.name.clone(),
        missing: chosen
            .table_pattern
            .missing
            .iter()
            .map(|m| [m.drive.plus, m.drive.minus, m.sense.minus, m.sense.plus].map(|e| e + 1))
            .collect(),
        notes,
        calibration: calibrated.map(|(file, _)| file),
    };
    let pattern = sheet::rewired(chosen.pattern, &arguments.wires)?;
    let how = How {
        drive: arguments.drive.drive(),
        method,
        polarity: arguments.rise,
        trust_electrodes: arguments.trust_electrodes,
        frame_s: arguments.frame_s,
        calibration,
        told,
    };
    let compared = arguments.baseline.or(baseline.as_deref());
    let mut ready = TableBatch::new(&table, (&chosen.sheet, pattern, chosen.cell_mm), &compared, &how)?;
    eprintln!(
        "sheet: {}; pattern: {}; baseline: {}",
        source.sheet, source.pattern, ready.prepared.name
    );
    if let Some(left_out) = &ready.prepared.left_out {
        eprintln!("warning: {left_out}");
    }
    let mut batch = ready.batch()?;
    let looked_at = ready.prepared.tells_noise && !arguments.trust_electrodes;
    if chosen.assumed && looked_at && !batch.inspection().conclusive {
        bail!(
            "{}: its baseline is not that of the paper's disc ({}), which is assumed where nothing says which sheet was measured. \
             Describe the sheet with --sheet FILE. If it is that disc, look at the order of the values (--order) and of the wires \
             (skin check), or say --diameter-mm 195",
            table.file,
            source.sheet
        );
    }
    source.notes.append(&mut ready.prepared.notes);
    source.notes.extend(sheet::say(batch.inspection()));
    if let Some(found) = &batch.inspection().electrodes {
        let most = found.moved_mm.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        eprintln!("electrodes found in the baseline, up to {most:.1} mm from where they were said to be");
    }
    if let Some(recovery) = ready.prepared.recover(&batch)? {
        source.creep_recovered = Some(recovery.part);
        source.creep_dented = Some(recovery.dented).filter(|_| !ready.prepared.undented);
    }
    let results = reconstruct(arguments, &table, ready.prepared.frames, &mut batch)?;
    table_notices::of_all(results.iter().map(|done| &done.result), method);
    // Everything is computed and every picture written before the first line is printed: no part passes for the whole.
    if let Some(folder) = &arguments.png {
        write_pictures(folder, batch.imager(), &results)?;
    }
    if let Some(folder) = &arguments.cells {
        write_cells(folder, batch.imager(), &results)?;
    }
    let left_out: Vec<&Finding> = batch.inspection().left_out().collect();
    print(&results, &source, table.measurements.len(), &left_out, arguments.json)
}

/// All frames in order; those between them are frames in which nothing pressed.
fn reconstruct<'a>(
    arguments: &Arguments,
    table: &'a MeasurementTable,
    frames: Vec<Frame<'_>>,
    batch: &mut Batch,
) -> Result<Vec<Done<'a>>> {
    let progress = Progress::new("reconstructing");
    let pictures = arguments.png.is_some() || arguments.cells.is_some();
    let values: Vec<_> = frames.iter().map(|f| (f.place, f.values.as_ref())).collect();
    let mut results = Vec::with_capacity(frames.len());
    batch.frames(&values, |number, mut result| {
        let name = table.columns[values[number].0].name.as_str();
        table_notices::of_frame(name, &result, &table.measurements);
        if !pictures {
            // Of ten minutes of frames the cells alone take most of a gigabyte.
            result.x = Vec::new();
        }
        results.push((name, result));
        progress.at(results.len(), values.len());
    })?;
    let done = results.into_iter().zip(&frames).map(|((frame, result), of)| Done {
        frame,
        baseline: of.baseline.clone(),
        result,
    });
    Ok(done.collect())
}

fn write_cells(folder: &Path, imager: &Imager, results: &[Done<'_>]) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("{}: cannot make this folder", folder.display()))?;
    let names = file_names(results.iter().map(|done| done.frame), "csv");
    for (done, file) in results.iter().zip(names) {
        let path = folder.join(file);
        let text = cells(imager, &done.result.x);
        replace(&path, |new| new.write_all(text.as_bytes()))
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

fn write_pictures(folder: &Path, imager: &Imager, results: &[Done<'_>]) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("{}: cannot make this folder", folder.display()))?;
    let names = file_names(results.iter().map(|done| done.frame), "png");
    for (k, (done, file)) in results.iter().zip(names).enumerate() {
        let result = &done.result;
        let stats = Stats {
            solve_us: result.changed.then_some(result.solve_us as f32),
            residual: result.changed.then_some(result.residual as f32),
            source: done.frame.to_owned(),
            ..Stats::default()
        };
        let picture = Surface::of(imager)?.picture(result, k as u64, 0.0, stats);
        let path = folder.join(file);
        png::write_png(&picture, &path).with_context(|| format!("{}: cannot write the picture", path.display()))?;
    }
    Ok(())
}

/// To a tenth: more digits of a time are noise.
fn print(results: &[Done<'_>], source: &Source, values: usize, left_out: &[&Finding], json: bool) -> Result<()> {
    let mut out = BufWriter::new(crate::say::stdout());
    for Done {
        frame,
        baseline,
        result,
    } in results
    {
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
                        at_limit: t.at_limit,
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
                solve_us: result.solve_us,
                status: status(result.status),
                changed: result.changed,
                used: result.used,
                values,
                baseline,
                source,
                doubt: result.doubt,
                faults: &result.faults,
                rejected: &result.rejected,
                explained: result.explained,
                drift: &result.drift,
                left_out,
            };
            out.write_all(&json::line(&line)?)?;
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
                "    x {:7.1} mm  y {:7.1} mm  rise {}{:6.1} %  area {:6.0} mm2{}",
                t.x_mm,
                t.y_mm,
                at_least(t),
                100.0 * t.rise,
                t.area_mm2,
                t.force_n.map_or(String::new(), |f| format!("  force {f:6.2} N"))
            )?;
        }
    }
    out.flush()?;
    Ok(())
}

/// What stands before a rise at the model's limit: it is at least so much.
fn at_least(touch: &Touch) -> &'static str {
    match (touch.at_limit, touch.rise < 0.0) {
        (false, _) => "",
        (true, false) => "at least ",
        (true, true) => "at most ",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::forward::{Drive, Pattern, Sheet};

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
