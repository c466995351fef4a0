//! The sheet that a command works on.

use crate::say::say;
use ::forward::file::parse_sheet;
use ::forward::{Geometry, Pattern, Sheet};
use anyhow::{Context, Result, bail};
use inverse::reference::inspection::Inspection;
use inverse::reference::wiring::rewire;
use std::path::Path;

/// The sheet of a TOML file with its measurements; without a file the paper's disc.
pub(crate) fn load(file: Option<&Path>) -> Result<(Sheet, Pattern)> {
    let Some(path) = file else {
        return Ok((Sheet::paper(), Pattern::adjacent(16)?));
    };
    let text = ::forward::whole::text(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    parse_sheet(&text).with_context(|| format!("{}", path.display()))
}

/// Whether a sheet's file states a pattern, or leaves it at the neighbouring pairs.
pub(crate) fn states_pattern(path: &Path) -> Result<bool> {
    let text = ::forward::whole::text(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    let table: toml::Table = text.parse().with_context(|| format!("{}", path.display()))?;
    Ok(table.contains_key("pattern"))
}

/// Where a sheet is, for messages.
pub(crate) fn extent(geometry: &Geometry) -> String {
    let ([left, bottom], [right, top]) = geometry.bounding_box();
    format!("the sheet lies within x {left:.1} to {right:.1} mm and y {bottom:.1} to {top:.1} mm")
}

/// Says on stderr what a baseline was found to be worth: what is left out, and whether it is that of the sheet. The same without the word
/// that marks a warning.
pub(crate) fn say(inspection: &Inspection) -> Vec<String> {
    let [expected, others] = inspection.unusable();
    let all = inspection.baseline.values_v.len();
    let mut notes = Vec::new();
    if expected > 0 {
        notes.push(format!(
            "{expected} of {all} values are next to zero on this sheet, or beyond what the board can measure, as its model has them, and \
             are left out"
        ));
    }
    notes.extend(inspection.notes());
    let mut warnings = Vec::new();
    if others > 0 {
        warnings.push(format!(
            "{others} of {all} values of the baseline are missing, clipped or next to nothing and are left out; look at the electrodes \
             and the gain"
        ));
    }
    warnings.extend(inspection.warnings());
    for line in &warnings {
        say!("warning: {line}");
    }
    for line in &notes {
        say!("{line}");
    }
    warnings.extend(notes);
    warnings
}

/// The measurements of wires that lead to these electrodes (from 1; none given: each wire to its own).
///
/// # Errors
/// A list that does not name every electrode once.
pub(crate) fn rewired(pattern: Pattern, wires: &[usize]) -> Result<Pattern> {
    if wires.is_empty() {
        return Ok(pattern);
    }
    let n = pattern.electrodes();
    let mut sorted = wires.to_vec();
    sorted.sort_unstable();
    if !sorted.iter().copied().eq(1..=n) {
        bail!(
            "--wires names {} electrodes, but it has to name each of the {n} once; skin check says the order",
            wires.len()
        );
    }
    let order: Vec<usize> = wires.iter().map(|l| l - 1).collect();
    Ok(rewire(&pattern, &order)?)
}
