//! How well the sheet's model locates presses at known places: alone, and with what they tell of its sheet.

use super::file::{ModelKeys, ToldKeys};
use super::truth::KnownPress;
use crate::files::measurements::MeasurementTable;
use crate::progress::{self, Progress};
use crate::table_baseline::BaselineArguments;
use crate::table_batch::{How, TableBatch};
use crate::table_sheet::Geometry;
use ::forward::Sheet;
use ::forward::file::sheet_text;
use anyhow::{Context, Result, bail};
use inverse::learned::{Learned, Press, SeenPress, Shift, far_off, model_is_better, shifted_by_places, told};
use inverse::reference::ToldSheet;
use inverse::reference::inspection::Inspection;
use inverse::solvers::Method;
use inverse::touches::touch::Touch;
use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

/// Most presses that are tried: they tell a median well enough, and on a sheet that is not the model's each takes its time.
const MOST: usize = 60;

/// Distances below this part of the extent of the presses are alike.
const ALIKE: f64 = 0.01;

/// Where a sheet's model, which knows nothing of the list, puts presses.
pub(super) struct ByModel {
    found: Found,
    /// Numbers of the presses in the list.
    presses: Vec<usize>,
    /// Half the extent of the presses, mm.
    missed_mm: f64,
}

impl ByModel {
    /// Where it puts each press of a list; none of those that were not tried, or in which it finds nothing.
    fn places_mm(&self, count: usize) -> Vec<Option<[f64; 2]>> {
        let mut places = vec![None; count];
        for (found, k) in self.found.presses.iter().zip(&self.presses) {
            places[*k] = found.strongest.as_ref().map(|touch| [touch.x_mm, touch.y_mm]);
        }
        places
    }

    /// Presses that it puts far from their places, though most near theirs.
    pub(super) fn wrong(&self, known: &[KnownPress]) -> Vec<usize> {
        let places = self.places_mm(known.len());
        let off = |k: &usize| places[*k].map(|found| apart(found, known[*k].place_mm));
        let errors: Vec<Option<f64>> = self.presses.iter().map(off).collect();
        let far = far_off(&errors, self.missed_mm);
        far.into_iter().map(|k| self.presses[k]).collect()
    }

    /// Those of these presses that maps of the others put nearer to where the model does than to their places: a model that is wrong of a
    /// part of the sheet puts right presses there far off, too.
    pub(super) fn confirmed(
        &self,
        wrong: &[usize],
        known: &[KnownPress],
        presses: &[Press],
        maps: &Learned,
    ) -> Vec<usize> {
        let places = self.places_mm(known.len());
        let is_wrong = |k: &usize| {
            let before_mm = k.checked_sub(1).map(|before| known[before].place_mm);
            let presence = maps.locate(&presses[*k].change, before_mm);
            let by_maps = presence.presses.first().map(|press| press.place_mm);
            let both = by_maps.zip(places[*k]);
            both.is_some_and(|(maps, model)| apart(maps, model) < apart(maps, known[*k].place_mm))
        };
        wrong.iter().copied().filter(is_wrong).collect()
    }

    /// Whether it puts presses at the places of other lines.
    pub(super) fn shifted(&self, known: &[KnownPress]) -> Option<Shift> {
        let listed: Vec<[f64; 2]> = known.iter().map(|press| press.place_mm).collect();
        shifted_by_places(&self.places_mm(known.len()), &listed, ALIKE * self.missed_mm)
    }
}

fn apart(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// The model of a sheet (the paper's disc where no file says another), tried on presses spread over a list. The strongest touch counts
/// where it finds several.
///
/// # Errors
/// Why there is no model of the table.
pub(super) fn located(
    table: &MeasurementTable,
    list: &Path,
    known: &[KnownPress],
    (sheet, sheet_file): (Option<&Sheet>, Option<&Path>),
) -> Result<ByModel> {
    let span = |axis: usize| {
        let along = || known.iter().map(|p| p.place_mm[axis]);
        along().fold(f64::MIN, f64::max) - along().fold(f64::MAX, f64::min)
    };
    let missed_mm = 0.5 * span(0).hypot(span(1));
    let presses: Vec<usize> = (0..known.len()).step_by(known.len().div_ceil(MOST).max(1)).collect();
    let some: Vec<&str> = presses.iter().map(|k| known[*k].frame.as_str()).collect();
    // What is uncertain of the sheet is told by the presses.
    let found = of_frames(
        table,
        (list, false),
        &some,
        (sheet, sheet_file),
        (Some(ToldSheet::trusted()), true),
    )?;
    Ok(ByModel {
        found,
        presses,
        missed_mm,
    })
}

/// How well it locates the presses but those of a list, which are at wrong places. One in which it finds nothing counts as half the extent
/// of the presses. What the presses tell of the sheet is taken where each is located better by what the others tell. `learned_mm` is what it
/// is compared with: median and 95th percentile.
///
/// # Errors
/// No press is left.
pub(super) fn tried(
    by_model: &ByModel,
    known: &[KnownPress],
    gross: &[usize],
    learned_mm: [f64; 2],
) -> Result<ModelKeys> {
    let ByModel {
        found,
        presses,
        missed_mm,
    } = by_model;
    let missed_mm = *missed_mm;
    let kept = || {
        let pairs = found.presses.iter().zip(presses);
        pairs
            .filter(|(_, k)| !gross.contains(*k))
            .map(|(found, k)| (found, known[*k].place_mm))
    };
    let errors = kept().map(|(found, place)| {
        let off = |touch: &Touch| apart([touch.x_mm, touch.y_mm], place);
        found.strongest.as_ref().map_or(missed_mm, off)
    });
    let untold = errors_at(errors.collect())?;
    let seen: Vec<SeenPress> = kept()
        .filter_map(|(found, place)| seen(found.strongest.as_ref()?, place))
        .collect();
    let told = progress::meanwhile("fitting the sheet to the presses", || told(&found.inspection, &seen));
    let told = told.filter(|told| told.stands);
    let errors = match &told {
        Some(told) => {
            let missed = kept().count().saturating_sub(seen.len());
            let errors = told.errors_mm.iter().copied();
            errors_at(errors.chain(std::iter::repeat_n(missed_mm, missed)).collect())?
        }
        None => untold,
    };
    Ok(ModelKeys {
        error_median_mm: errors[0],
        error_95th_percentile_mm: errors[1],
        better: model_is_better(errors, learned_mm),
        sheet: sheet_text(&found.sheet)?,
        told: told.map(|told| ToldKeys {
            untold_median_mm: untold[0],
            untold_95th_percentile_mm: untold[1],
            moved_mm: told.moved_mm,
            of_sheet: told.sheet,
        }),
    })
}

fn seen(touch: &Touch, place_mm: [f64; 2]) -> Option<SeenPress> {
    Some(SeenPress {
        place_mm,
        found_mm: [touch.x_mm, touch.y_mm],
        sd_mm: [touch.x_sd_mm?, touch.y_sd_mm?],
    })
}

/// Median and 95th percentile.
fn errors_at(mut errors: Vec<f64>) -> Result<[f64; 2]> {
    errors.sort_by(f64::total_cmp);
    let at = |part: f64| errors.get((part * (errors.len().saturating_sub(1)) as f64).round() as usize);
    let (Some(&median), Some(&high)) = (at(0.5), at(0.95)) else {
        bail!("the list names no frame of the table");
    };
    Ok([median, high])
}

/// What a model finds in some frames.
pub(super) struct Found {
    /// Its sheet.
    pub sheet: Sheet,
    /// What the baseline was worth to it.
    pub inspection: Inspection,
    /// In the order of the frames.
    pub presses: Vec<AtPress>,
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
/// the frames before them, unless the columns hold changes. `told`: what is known of the sheet; `recovers`: whether dents of earlier presses
/// are taken off.
///
/// # Errors
/// Why there is no model of the table.
pub(super) fn of_frames(
    table: &MeasurementTable,
    (list, difference): (&Path, bool),
    names: &[&str],
    (sheet, sheet_file): (Option<&Sheet>, Option<&Path>),
    (told, recovers): (Option<ToldSheet>, bool),
) -> Result<Found> {
    let given = sheet.filter(|_| sheet_file.is_none()).cloned();
    let chosen = Geometry::of(sheet_file).choose_with(table, Method::Nnls, given)?;
    let way = (&chosen.sheet, chosen.pattern, chosen.cell_mm);
    let baseline = BaselineArguments::of_presses(list, difference);
    let how = How {
        told: told.map(Arc::new),
        ..How::plain()
    };
    let mut ready = TableBatch::new(table, way, &baseline, &how)?;
    let mut batch = ready.batch()?;
    if recovers {
        ready.prepared.recover(&batch)?;
    }
    let named: HashMap<&str, _> = (ready.prepared.frames.iter())
        .map(|f| (table.columns[f.place].name.as_str(), (f.place, f.values.as_ref())))
        .collect();
    let of_name = |name: &&str| {
        let frame = named.get(name).copied();
        frame.with_context(|| format!("the table has no frame {name}"))
    };
    let frames: Vec<_> = names.iter().map(of_name).collect::<Result<_>>()?;
    let progress = Progress::new("trying the sheet's model");
    let mut found = Vec::with_capacity(frames.len());
    batch.frames(&frames, |_, result| {
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
    })?;
    Ok(Found {
        sheet: chosen.sheet,
        inspection: batch.inspection().clone(),
        presses: found,
    })
}
