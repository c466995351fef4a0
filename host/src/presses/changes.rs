//! Changes of the measurements, pressed less unpressed, from the columns of a table.

use super::truth::KnownPress;
use crate::files::before::Before;
use crate::files::measurements::MeasurementTable;
use anyhow::{Result, anyhow, bail};
use inverse::learned::Press;

/// The change from one column to another, or a column that is one already.
fn change(table: &MeasurementTable, pressed: usize, before: Option<usize>) -> Vec<f64> {
    let values = &table.columns[pressed].values;
    match before {
        None => values.clone(),
        Some(before) => {
            let unpressed = &table.columns[before].values;
            values.iter().zip(unpressed).map(|(v, u)| v - u).collect()
        }
    }
}

/// The presses of a table with their changes. With `difference` the columns are changes already.
///
/// # Errors
/// A frame that the table does not have, or a press without a frame before it where there should be one.
pub(super) fn presses(
    table: &MeasurementTable,
    file: &str,
    known: &[KnownPress],
    difference: bool,
) -> Result<Vec<Press>> {
    let names = table.names();
    let find = |press: &KnownPress, name: &str| {
        names
            .get(name)
            .ok_or_else(|| anyhow!("{file}:{}: {}", press.line, names.unknown(name)))
    };
    known
        .iter()
        .map(|press| {
            let pressed = find(press, &press.frame)?;
            let before = match (&press.before, difference) {
                (None, true) => None,
                (Some(name), false) => Some(find(press, name)?),
                (None, false) => bail!(
                    "{file}:{}: column before: press {} has no frame before it; name one, or give --difference where the columns \
                     hold changes",
                    press.line,
                    press.frame
                ),
                (Some(_), true) => bail!(
                    "{file}:{}: column before: press {} has a frame before it, but --difference says that the columns hold changes; \
                     leave out one of them",
                    press.line,
                    press.frame
                ),
            };
            Ok(Press {
                place_mm: press.place_mm,
                change: change(table, pressed, before),
            })
        })
        .collect()
}

/// A frame to locate presses in.
pub(super) struct Frame {
    /// Its name.
    pub(super) name: String,
    /// What it is compared with, in words.
    pub(super) baseline: String,
    /// Change of every row of the table.
    pub(super) change: Vec<f64>,
}

/// Every column as a change already.
pub(super) fn all(table: &MeasurementTable) -> Vec<Frame> {
    (0..table.columns.len())
        .map(|k| Frame {
            name: table.columns[k].name.clone(),
            baseline: "none: the columns are changes".to_owned(),
            change: change(table, k, None),
        })
        .collect()
}

/// The frames that a list names, each against the one before it; or against a common one where the list names none.
///
/// # Errors
/// A frame that the table does not have, or one that nothing is there to compare with.
pub(super) fn listed(table: &MeasurementTable, file: &str, list: &[Before], common: &[usize]) -> Result<Vec<Frame>> {
    let names = table.names();
    let find = |entry: &Before, name: &str| {
        names
            .get(name)
            .ok_or_else(|| anyhow!("{file}:{}: {}", entry.line, names.unknown(name)))
    };
    let (mean, mean_name) = mean(table, common);
    list.iter()
        .map(|entry| {
            let pressed = find(entry, &entry.frame)?;
            let (change, baseline) = match &entry.before {
                Some(name) => (change(table, pressed, Some(find(entry, name)?)), name.clone()),
                None if common.is_empty() => bail!(
                    "{file}:{}: column before: frame {} has no frame before it; name one, or give --baseline or --difference",
                    entry.line,
                    entry.frame
                ),
                None => (less(&table.columns[pressed].values, &mean), mean_name.clone()),
            };
            Ok(Frame {
                name: entry.frame.clone(),
                baseline,
                change,
            })
        })
        .collect()
}

/// All columns but those of the unpressed sheet, against the mean of these.
pub(super) fn against(table: &MeasurementTable, common: &[usize]) -> Vec<Frame> {
    let (mean, name) = mean(table, common);
    (0..table.columns.len())
        .filter(|k| !common.contains(k))
        .map(|k| Frame {
            name: table.columns[k].name.clone(),
            baseline: name.clone(),
            change: less(&table.columns[k].values, &mean),
        })
        .collect()
}

fn less(values: &[f64], from: &[f64]) -> Vec<f64> {
    values.iter().zip(from).map(|(v, u)| v - u).collect()
}

fn mean(table: &MeasurementTable, columns: &[usize]) -> (Vec<f64>, String) {
    let mut mean = vec![0.0; table.measurements.len()];
    for k in columns {
        for (m, v) in mean.iter_mut().zip(&table.columns[*k].values) {
            *m += v / columns.len() as f64;
        }
    }
    let names: Vec<&str> = columns
        .iter()
        .take(8)
        .map(|k| table.columns[*k].name.as_str())
        .collect();
    let more = columns.len().saturating_sub(8);
    let name = names.join(",")
        + &if more > 0 {
            format!(" and {more} more")
        } else {
            String::new()
        };
    (mean, name)
}
