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
    no_progress: bool,
) -> Result<ModelKeys> {
    let chosen =
        Geometry::of(sheet_file).choose_with(table, Method::Nnls, sheet.filter(|_| sheet_file.is_none()).cloned())?;
    let way = (&chosen.sheet, chosen.pattern, chosen.cell_mm);
    let ready = TableBatch::new(
        table,
        way,
        &BaselineArguments::of_presses(list),
        &How::plain(no_progress),
    )?;
    let mut batch = ready.batch()?;
    let places: HashMap<&str, [f64; 2]> = known.iter().map(|p| (p.frame.as_str(), p.place_mm)).collect();
    let span = |axis: usize| {
        let along = || known.iter().map(|p| p.place_mm[axis]);
        along().fold(f64::MIN, f64::max) - along().fold(f64::MAX, f64::min)
    };
    let missed_mm = 0.5 * span(0).hypot(span(1));
    let frames = &ready.prepared.frames;
    let some = frames.iter().step_by(frames.len().div_ceil(MOST));
    let mut progress = Progress::new("trying the sheet's model", no_progress);
    let mut errors = Vec::new();
    for frame in some {
        let Some(place) = places.get(table.columns[frame.place].name.as_str()) else {
            continue;
        };
        let result = batch.frame(frame.place, &frame.values)?;
        let strongest = (result.touches.iter()).max_by(|a, b| a.total_mm2.abs().total_cmp(&b.total_mm2.abs()));
        let off = |touch: &Touch| (touch.x_mm - place[0]).hypot(touch.y_mm - place[1]);
        errors.push(strongest.map_or(missed_mm, off));
        progress.at(errors.len(), frames.len().min(MOST));
    }
    errors.sort_by(f64::total_cmp);
    let at = |part: f64| errors.get((part * (errors.len().saturating_sub(1)) as f64).round() as usize);
    let (Some(&median), Some(&high)) = (at(0.5), at(0.95)) else {
        bail!("the list names no frame of the table");
    };
    Ok(ModelKeys {
        error_median_mm: median,
        error_95th_percentile_mm: high,
        better: median < learned_mm[0] && high < learned_mm[1],
        sheet: sheet_text(&chosen.sheet)?,
    })
}
