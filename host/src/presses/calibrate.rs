//! `skin calibrate presses`: maps of a real skin from presses at known places.

use super::file::ModelKeys;
use super::{changes, file, model, truth};
use crate::files::measurements::MeasurementTable;
use crate::progress::Progress;
use ::forward::Sheet;
use anyhow::{Context, Result, bail};
use clap::Args;
use inverse::learned::{Findings, Press, Setting, learn, turn};
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Presses for which the gain of more is told.
const MORE: usize = 30;

/// Arguments of `skin calibrate presses`.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Table of measurements (CSV: drive_a, drive_b, sense_a, sense_b, then a column for every frame).
    table: PathBuf,
    /// Where the presses were: a CSV with the columns frame, before, x_mm and y_mm, a line a press in order of time.
    #[arg(long, value_name = "FILE")]
    truth: PathBuf,
    /// The columns hold changes, pressed less unpressed; the column before is empty.
    #[arg(long)]
    difference: bool,
    /// The sheet, a TOML file as for `skin forward`: it says by what turns it is mapped onto itself, and its model is tried beside what
    /// is learned [default: the paper's disc, which any turn from electrode to electrode maps onto itself].
    #[arg(long, value_name = "FILE")]
    sheet: Option<PathBuf>,
    /// Where to write the calibration.
    #[arg(long, default_value = "skin.cal", value_name = "FILE")]
    out: PathBuf,
    /// One JSON object on stdout.
    #[arg(long)]
    json: bool,
    /// Says nothing of how far a long table is.
    #[arg(long)]
    no_progress: bool,
}

#[derive(Serialize)]
struct Line<'a> {
    presses: usize,
    /// Frames of presses that nothing explains; they are left out.
    gross: Vec<&'a str>,
    /// Frames of presses in which nothing is found by what the others taught; they are learned from.
    missed: Vec<&'a str>,
    measurements: usize,
    /// Rows of the table without a value or a change, as drive_a, drive_b, sense_a, sense_b.
    dead: Vec<[usize; 4]>,
    /// Rows that presses hardly explain.
    unexplained: Vec<[usize; 4]>,
    symmetric: bool,
    clockwise: Option<bool>,
    centre_mm: [f64; 2],
    memory: bool,
    corrected: bool,
    explained: f64,
    error_median_mm: f64,
    error_95th_percentile_mm: f64,
    uncertainty_factor: f64,
    expected_mm: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    model: Option<ModelLine>,
    #[serde(skip_serializing_if = "Option::is_none")]
    model_not_tried: Option<String>,
}

/// The sheet's model on the same presses.
#[derive(Serialize)]
struct ModelLine {
    error_median_mm: f64,
    error_95th_percentile_mm: f64,
    /// Whether it is better than what was learned, and used.
    better: bool,
}

impl ModelLine {
    const fn of(keys: &ModelKeys) -> Self {
        Self {
            error_median_mm: keys.error_median_mm,
            error_95th_percentile_mm: keys.error_95th_percentile_mm,
            better: keys.better,
        }
    }
}

/// Runs the command.
///
/// # Errors
/// A table or a list of presses that makes no sense, too few presses, a file that cannot be written.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let table = MeasurementTable::read(&arguments.table, &mut Progress::new("reading", arguments.no_progress))?;
    for note in &table.notes {
        eprintln!("{}: {note}", table.file);
    }
    let known = truth::read(&arguments.truth)?;
    let list = arguments.truth.display().to_string();
    let presses = changes::presses(&table, &list, &known, arguments.difference)?;
    let sheet = arguments.sheet.as_deref().map(sheet_of).transpose()?;
    let setting = Setting {
        measurements: &table.measurements,
        electrodes: table.electrodes,
        turn: sheet.as_ref().map_or(Ok(1), turn)?,
    };
    let mut progress = Progress::new("learning", arguments.no_progress);
    let (learned, found) = learn(&presses, &setting, |done, whole| progress.at(done, whole))
        .with_context(|| format!("{}: no calibration can be made", table.file))?;
    drop(progress);
    let model = by_model(arguments, &table, &known, &found);
    let text = file::text(
        &learned,
        &found,
        model.as_ref().ok(),
        (&table.measurements, table.electrodes),
        arguments.difference,
    )?;
    file::write(&arguments.out, &text)?;
    let line = Line {
        model: model.as_ref().ok().map(ModelLine::of),
        model_not_tried: model.as_ref().err().map(|why| format!("{why:#}")),
        ..line(&found, &known, &table, &presses)
    };
    let mut out = std::io::stdout().lock();
    if arguments.json {
        serde_json::to_writer(&mut out, &line)?;
        writeln!(out)?;
    } else {
        write!(out, "{}", words(&line))?;
    }
    eprintln!(
        "{0}: written; skin run --calibration {0} and skin reconstruct TABLE --calibration {0} locate touches with it",
        arguments.out.display()
    );
    Ok(())
}

/// How well the sheet's model locates the presses, or why it was not tried.
fn by_model(
    arguments: &Arguments,
    table: &MeasurementTable,
    known: &[truth::KnownPress],
    found: &Findings,
) -> Result<ModelKeys> {
    if arguments.difference {
        bail!("changes alone do not tell what they are a part of");
    }
    let sheet = arguments.sheet.as_deref();
    model::tried(
        table,
        &arguments.truth,
        known,
        sheet,
        found.error_mm,
        arguments.no_progress,
    )
}

fn sheet_of(path: &Path) -> Result<Sheet> {
    Ok(crate::sheet::load(Some(path))?.0)
}

fn line<'a>(found: &Findings, known: &'a [truth::KnownPress], table: &MeasurementTable, presses: &[Press]) -> Line<'a> {
    let rows = |list: &[usize]| -> Vec<[usize; 4]> {
        let of = |k: &usize| {
            let m = table.measurements[*k];
            [m.drive.plus, m.drive.minus, m.sense.minus, m.sense.plus].map(|e| e + 1)
        };
        list.iter().map(of).collect()
    };
    let frames = |list: &[usize]| list.iter().map(|k| known[*k].frame.as_str()).collect();
    Line {
        presses: presses.len(),
        gross: frames(&found.gross),
        missed: frames(&found.missed),
        measurements: table.measurements.len(),
        dead: rows(&found.dead),
        unexplained: rows(&found.unexplained),
        symmetric: found.shared,
        clockwise: found.shared.then_some(found.clockwise),
        centre_mm: found.centre_mm,
        memory: found.memory,
        corrected: found.corrected,
        explained: found.explained,
        error_median_mm: found.error_mm[0],
        error_95th_percentile_mm: found.error_mm[1],
        uncertainty_factor: found.tempering.sqrt(),
        expected_mm: found.expected_mm(MORE),
        model: None,
        model_not_tried: None,
    }
}

/// Rows by their drive pairs: a whole drive in one word.
fn by_drive(rows: &[[usize; 4]]) -> String {
    let mut parts: Vec<String> = Vec::new();
    for chunk in rows.chunk_by(|a, b| a[..2] == b[..2]) {
        let senses: Vec<String> = chunk.iter().map(|r| format!("{}-{}", r[2], r[3])).collect();
        parts.push(format!(
            "drive {}-{}: sense {}",
            chunk[0][0],
            chunk[0][1],
            senses.join(", ")
        ));
    }
    parts.join("; ")
}

fn words(line: &Line<'_>) -> String {
    let mut text = format!("presses         {}", line.presses);
    if !line.gross.is_empty() {
        text += &format!(
            ", without {} that nothing explains: {}",
            line.gross.len(),
            line.gross.join(", ")
        );
    }
    if !line.missed.is_empty() {
        text += &format!(
            "\n                {} not found by what the others taught: {}",
            line.missed.len(),
            line.missed.join(", ")
        );
    }
    text += "\nelectrodes      ";
    text += &match line.clockwise {
        Some(clockwise) => format!(
            "numbered {}clockwise around {:.1}, {:.1} mm; turned measurements respond alike",
            if clockwise { "" } else { "counter-" },
            line.centre_mm[0],
            line.centre_mm[1]
        ),
        None => "turned measurements do not respond alike; every one has a map of its own".to_owned(),
    };
    text += &format!("\nmeasurements    {}", line.measurements);
    for (rows, what) in [
        (&line.dead, "without a value or a change, left out"),
        (&line.unexplained, "that presses hardly explain"),
    ] {
        if !rows.is_empty() {
            text += &format!("\n                {} {what}: {}", rows.len(), by_drive(rows));
        }
    }
    text += if line.memory {
        "\nmemory          the press before still shows, and is taken out"
    } else {
        "\nmemory          the press before does not show"
    };
    if line.corrected {
        text += "\ncorrection      a regression on the changes takes out what the maps leave";
    }
    text += &format!(
        "\nexplained       {:.0} % of the change, each press by what the others taught",
        100.0 * line.explained
    );
    text += &format!(
        "\nerror           {:.1} mm median, {:.1} mm 95th percentile, likewise",
        line.error_median_mm, line.error_95th_percentile_mm
    );
    text += &format!(
        "\nuncertainty     {:.1} times that of independent noise",
        line.uncertainty_factor
    );
    text += &match line.expected_mm {
        Some(mm) => format!("\nmore presses    {MORE} more: about {mm:.1} mm median expected"),
        None => "\nmore presses    nothing says that they would help".to_owned(),
    };
    if let Some(model) = &line.model {
        text += &format!(
            "\nsheet's model   {:.2} mm median, {:.2} mm 95th percentile, with nothing learned: {}",
            model.error_median_mm,
            model.error_95th_percentile_mm,
            if model.better { "better, and used" } else { "not used" }
        );
    }
    if let Some(why) = &line.model_not_tried {
        text += &format!("\nsheet's model   not tried: {why}");
    }
    text + "\n"
}
