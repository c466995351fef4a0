//! `skin reconstruct --calibration FILE` with a calibration from presses.

use super::changes::{self, Frame};
use super::file::PressCalibration;
use crate::files::before;
use crate::files::measurements::MeasurementTable;
use crate::files::sheet_line::SheetLine;
use crate::json;
use crate::progress::Progress;
use crate::table_notices;
use ::forward::Measurement;
use anyhow::{Result, bail};
use inverse::learned::{Gain, Located, Order, Presence};
use serde::Serialize;
use std::io::Write;
use std::path::Path;

/// What the frames are compared with.
pub(crate) struct Comparison<'a> {
    /// Columns of the unpressed sheet, or ranges of them.
    pub baseline: &'a [String],
    /// A list that names for each frame the one before it.
    pub before: Option<&'a Path>,
    /// Whether the columns hold changes.
    pub difference: bool,
}

#[derive(Serialize)]
struct TouchLine {
    x_mm: f64,
    y_mm: f64,
    x_sd_mm: f64,
    y_sd_mm: f64,
    /// Over the usual strength of the presses that were learned from.
    strength: f64,
    strength_sd: f64,
    /// N, where the calibration knows forces.
    #[serde(skip_serializing_if = "Option::is_none")]
    force_n: Option<f64>,
}

#[derive(Serialize)]
struct FrameLine<'a> {
    frame: &'a str,
    touches: Vec<TouchLine>,
    /// Part of the change that the touches leave unexplained, 0 to 1.
    residual: f64,
    /// Mean square of what they leave, in variances of the presses that were learned from.
    misfit: f64,
    used: usize,
    values: usize,
    baseline: &'a str,
    calibration: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    doubt: Option<String>,
    /// Values that the others do not tell, and that took no part: rows from 0.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    rejected: Vec<usize>,
}

/// Where the measurements of a calibration are among those of a table or a board; `of` names that. What is missing is said.
///
/// # Errors
/// Too few of them are there.
pub(crate) fn order(calibration: &PressCalibration, of: &str, among: &[Measurement]) -> Result<Order> {
    let (order, missing) = found(calibration, of, among)?;
    if let Some(missing) = missing {
        eprintln!("warning: {missing}");
    }
    Ok(order)
}

/// The same, with what is missing or turned round in words.
///
/// # Errors
/// Too few of them are there.
pub(crate) fn found(
    calibration: &PressCalibration,
    of: &str,
    among: &[Measurement],
) -> Result<(Order, Option<String>)> {
    let file = &calibration.file;
    let order = Order::new(&calibration.measurements, among);
    let (missing, all) = (order.missing(), order.len());
    if missing * 2 > all {
        bail!(
            "{of}: it has {} of the {all} measurements that {file} was made with; calibrate with this pattern",
            all - missing
        );
    }
    let mut said = Vec::new();
    if missing > 0 {
        said.push(format!(
            "{missing} of the {all} measurements of {file} are not in it and are taken as missing"
        ));
    }
    let turned = order.turned_round();
    if turned > 0 {
        said.push(format!(
            "{turned} of the {all} measurements of {file} have their drive turned round in it, which real skins do not always measure alike"
        ));
    }
    let said = (!said.is_empty()).then(|| format!("{of}: {}", said.join("; ")));
    Ok((order, said))
}

/// Locates the presses of a table's frames, in order: what a press leaves behind is taken from the next one.
///
/// # Errors
/// Another pattern than the calibration's, a frame that is not there.
pub(crate) fn run(
    table: &MeasurementTable,
    calibration: &PressCalibration,
    comparison: &Comparison<'_>,
    json: bool,
) -> Result<()> {
    let file = &calibration.file;
    if let (Some(named), Some(sheet)) = (&table.sheet, &calibration.sheet)
        && let Some(difference) = named.differs(&SheetLine::of(sheet)?)
    {
        bail!(
            "{}: its header names another sheet than that of {file}: {difference}; calibrate on this sheet, or correct the header",
            table.file
        );
    }
    let gain = calibration.gain.as_deref();
    let order = order(calibration, &table.file, &table.measurements)?;
    if calibration.difference != comparison.difference {
        eprintln!(
            "notice: {file} was made from {}, and these columns are {}: both have to be in the same unit",
            kind(calibration.difference),
            kind(comparison.difference)
        );
    }
    eprintln!(
        "calibration: {file}, of {} presses, {:.1} mm median error; each frame is compared with the press before it",
        calibration.presses, calibration.error_mm
    );
    let frames = frames(table, comparison)?;
    let progress = Progress::new("locating");
    let mut before_mm = None;
    for (k, frame) in frames.iter().enumerate() {
        let change = order.ordered(&frame.change);
        let presence = calibration.learned.locate(&change, before_mm);
        if let Some(press) = presence.presses.first() {
            before_mm = Some(press.place_mm);
        }
        let rejected = order.among(&presence.wild);
        if let Some(text) = table_notices::rejected(&rejected, &table.measurements) {
            eprintln!("notice: frame {}: {text}", frame.name);
        }
        let used = change.iter().filter(|v| v.is_finite()).count() - rejected.len();
        let doubt = doubt(&presence, used);
        if let Some(doubt) = &doubt {
            eprintln!("warning: frame {}: {doubt}", frame.name);
        }
        if json {
            let line = FrameLine {
                frame: &frame.name,
                touches: presence.presses.iter().map(|press| touch(press, gain)).collect(),
                residual: 1.0 - presence.explained,
                misfit: presence.misfit,
                used,
                values: table.measurements.len(),
                baseline: &frame.baseline,
                calibration: file,
                doubt,
                rejected,
            };
            crate::say::stdout().write_all(&json::line(&line)?)?;
        } else {
            write!(crate::say::stdout(), "{}", words(frame, &presence, gain))?;
        }
        progress.at(k + 1, frames.len());
    }
    Ok(())
}

const fn kind(difference: bool) -> &'static str {
    if difference {
        "columns of changes"
    } else {
        "frames with one before each"
    }
}

fn frames(table: &MeasurementTable, comparison: &Comparison<'_>) -> Result<Vec<Frame>> {
    if comparison.difference {
        return Ok(changes::all(table));
    }
    let names = table.names();
    let mut common = Vec::new();
    for name in comparison.baseline {
        common.extend(names.range(name.trim())?);
    }
    match comparison.before {
        Some(path) => {
            let list = before::read(path)?;
            changes::listed(table, &path.display().to_string(), &list, &common)
        }
        None => Ok(changes::against(table, &common)),
    }
}

fn doubt(presence: &Presence, used: usize) -> Option<String> {
    if used == 0 {
        return Some("no value that can be used".to_owned());
    }
    presence.doubt().map(|doubt| doubt.to_string())
}

fn touch(press: &Located, gain: Option<&Gain>) -> TouchLine {
    TouchLine {
        x_mm: hundredths(press.place_mm[0]),
        y_mm: hundredths(press.place_mm[1]),
        x_sd_mm: hundredths(press.covariance_mm2[0][0].sqrt()),
        y_sd_mm: hundredths(press.covariance_mm2[1][1].sqrt()),
        strength: press.strength,
        strength_sd: press.strength_sd,
        force_n: gain.map(|gain| hundredths(gain.newtons(press.place_mm, press.strength))),
    }
}

fn hundredths(value: f64) -> f64 {
    (100.0 * value).round() / 100.0
}

fn words(frame: &Frame, presence: &Presence, gain: Option<&Gain>) -> String {
    let count = match presence.presses.len() {
        0 => "no touch".to_owned(),
        1 => "1 touch".to_owned(),
        n => format!("{n} touches"),
    };
    let mut text = format!(
        "{}: {count} (unexplained {:.1} %)\n",
        frame.name,
        100.0 * (1.0 - presence.explained)
    );
    for press in &presence.presses {
        let t = touch(press, gain);
        let force = t.force_n.map_or(String::new(), |force| format!("  force {force:.1} N"));
        text += &format!(
            "    x {:7.1} ± {:.1} mm  y {:7.1} ± {:.1} mm  strength {:5.2}{force}\n",
            t.x_mm, t.x_sd_mm, t.y_mm, t.y_sd_mm, t.strength
        );
    }
    text
}
