//! The sheet that a command works on.

use ::forward::file::parse_sheet;
use ::forward::{Geometry, Pattern, Sheet};
use anyhow::{Context, Result};
use inverse::reference::imager::Imager;
use std::path::Path;

/// The sheet of a TOML file with its measurements; without a file the paper's disc.
pub(crate) fn load(file: Option<&Path>) -> Result<(Sheet, Pattern)> {
    let Some(path) = file else {
        return Ok((Sheet::paper(), Pattern::adjacent(16)?));
    };
    let text = std::fs::read_to_string(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    parse_sheet(&text).with_context(|| format!("{}", path.display()))
}

/// Whether a sheet's file states a pattern, or leaves it at the neighbouring pairs.
pub(crate) fn states_pattern(path: &Path) -> Result<bool> {
    let text = std::fs::read_to_string(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    let table: toml::Table = text.parse().with_context(|| format!("{}", path.display()))?;
    Ok(table.contains_key("pattern"))
}

/// Where a sheet is, for messages.
pub(crate) fn extent(geometry: &Geometry) -> String {
    let ([left, bottom], [right, top]) = geometry.bounding_box();
    format!("the sheet lies within x {left:.1} to {right:.1} mm and y {bottom:.1} to {top:.1} mm")
}

/// Correlation with the model's even sheet below which a baseline looks wrongly wired.
const LEAST_CORRELATION: f64 = 0.95;

/// Warns of a baseline that is not what an even sheet gives, or has values that no frame can be compared with.
pub(crate) fn look_at_baseline(imager: &Imager, baseline: &[f64]) {
    let usable = imager
        .difference(baseline, baseline)
        .map_or(0, |d| d.used.iter().filter(|used| **used).count());
    if usable < baseline.len() {
        eprintln!(
            "warning: {} of {} values of the baseline are missing, clipped or next to nothing and are left out; look at the \
             electrodes and the gain",
            baseline.len() - usable,
            baseline.len()
        );
    }
    let correlation = imager.correlation(baseline);
    if usable > 0 && correlation < LEAST_CORRELATION {
        eprintln!(
            "warning: the baseline agrees with an even sheet by a correlation of only {correlation:.2}; look at the order of \
             the electrodes and at the sign of the values"
        );
    }
}

/// 39 cells across: 5 mm on the paper's disc.
pub(crate) fn cell_mm(sheet: &Sheet) -> Result<f64> {
    let (low, high) = Geometry::new(sheet)?.bounding_box();
    Ok((high[0] - low[0]).min(high[1] - low[1]) / 39.0)
}
