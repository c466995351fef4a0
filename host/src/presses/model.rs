//! How well the sheet's model locates presses at known places, without anything learned.

use super::file::ModelKeys;
use super::truth::KnownPress;
use crate::files::measurements::MeasurementTable;
use crate::progress::Progress;
use crate::table_baseline::BaselineArguments;
use crate::table_batch::{How, TableBatch};
use crate::table_sheet::Geometry;
use ::forward::Sheet;
use ::forward::file::sheet_text;
use anyhow::{Result, bail};
use inverse::solvers::Method;
use inverse::touches::touch::Touch;
use std::collections::HashMap;
use std::path::Path;

/// Most presses that are tried: they tell a median well enough, and on a sheet that is not the model's each takes its time.
const MOST: usize = 60;

/// The model of a sheet (the paper's disc where no file says another), tried on presses spread over a list. A press in which it finds
/// nothing counts as half the extent of the presses. The strongest touch counts where it finds several. `learned_mm` is what it is
/// compared with: median and 95th percentile.
///
/// # Errors
/// Why there is no model of the table.
pub(super) fn tried(
    table: &MeasurementTable,
    list: &Path,
    known: &[KnownPress],
    sheet: Option<&Sheet>,
    sheet_file: Option<&Path>,
    learned_mm: [f64; 2],
) -> Result<ModelKeys> {
    let places: HashMap<&str, [f64; 2]> = known.iter().map(|p| (p.frame.as_str(), p.place_mm)).collect();
    let span = |axis: usize| {
        let along = || known.iter().map(|p| p.place_mm[axis]);
        along().fold(f64::MIN, f64::max) - along().fold(f64::MAX, f64::min)
    };
    let missed_mm = 0.5 * span(0).hypot(span(1));
    let some: Vec<&str> = (known.iter().step_by(known.len().div_ceil(MOST)))
        .map(|p| p.frame.as_str())
        .collect();
    let (sheet, found) = of_frames(table, (list, false), &some, (sheet, sheet_file))?;
    let mut errors: Vec<f64> = (found.iter().zip(&some))
        .map(|(found, name)| {
            let place = places[name];
            let off = |touch: &Touch| (touch.x_mm - place[0]).hypot(touch.y_mm - place[1]);
            found.strongest.as_ref().map_or(missed_mm, off)
        })
        .collect();
    errors.sort_by(f64::total_cmp);
    let at = |part: f64| errors.get((part * (errors.len().saturating_sub(1)) as f64).round() as usize);
    let (Some(&median), Some(&high)) = (at(0.5), at(0.95)) else {
        bail!("the list names no frame of the table");
    };
    Ok(ModelKeys {
        error_median_mm: median,
        error_95th_percentile_mm: high,
        better: median < learned_mm[0] && high < learned_mm[1],
        sheet: sheet_text(&sheet)?,
    })
}

/// What a model finds in the frame of a press.
pub(super) struct AtPress {
    /// Its strongest touch.
    pub strongest: Option<Touch>,
    /// How many it finds.
    pub touches: usize,
    /// Part of the change that they explain, 0 to 1.
    pub explained: f64,
}

/// What the model of a sheet (the paper's disc where no file says another) finds in some frames of a table, in their order. `list` names
/// the frames before them, unless the columns hold changes.
///
/// # Errors
/// Why there is no model of the table.
pub(super) fn of_frames(
    table: &MeasurementTable,
    (list, difference): (&Path, bool),
    names: &[&str],
    (sheet, sheet_file): (Option<&Sheet>, Option<&Path>),
) -> Result<(Sheet, Vec<AtPress>)> {
    let given = sheet.filter(|_| sheet_file.is_none()).cloned();
    let chosen = Geometry::of(sheet_file).choose_with(table, Method::Nnls, given)?;
    let way = (&chosen.sheet, chosen.pattern, chosen.cell_mm);
    let baseline = BaselineArguments::of_presses(list, difference);
    let ready = TableBatch::new(table, way, &baseline, &How::plain())?;
    let mut batch = ready.batch()?;
    let frames: HashMap<&str, _> = (ready.prepared.frames.iter())
        .map(|f| (table.columns[f.place].name.as_str(), f))
        .collect();
    let progress = Progress::new("trying the sheet's model");
    let mut found = Vec::new();
    for name in names {
        let Some(frame) = frames.get(name) else {
            bail!("the table has no frame {name}");
        };
        let result = batch.frame(frame.place, &frame.values)?;
        let strongest = (result.touches.iter()).max_by(|a, b| a.total_mm2.abs().total_cmp(&b.total_mm2.abs()));
        found.push(AtPress {
            strongest: strongest.cloned(),
            touches: result.touches.len(),
            explained: match result.explained {
                Some(part) => part,
                None if result.touches.is_empty() => 0.0,
                None => 1.0 - result.residual,
            },
        });
        progress.at(found.len(), names.len());
    }
    Ok((chosen.sheet, found))
}
