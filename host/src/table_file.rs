//! Frames of a file: a table of measurements, or one frame a line in another program's order.

use crate::files::measurements::MeasurementTable;
use crate::files::{arrays, ordered};
use crate::progress::Progress;
use crate::rails;
use ::forward::order::ValueOrder;
use anyhow::Result;
use std::path::Path;

/// The frames of a file: a table, or where an order is given one frame a line. What was assumed is said on stderr, and noted in the
/// table.
///
/// # Errors
/// A file that cannot be read, or holds no frames of that order.
pub(crate) fn read(path: &Path, order: Option<ValueOrder>, wanted: &[String]) -> Result<MeasurementTable> {
    let mut read = match order {
        Some(order) => {
            let (kind, arrays) = arrays::read(path)?;
            ordered::table(order, &path.display().to_string(), kind, &arrays, wanted)?
        }
        None => MeasurementTable::read(path, Progress::new("reading").told())?,
    };
    for note in &read.notes {
        eprintln!("{}: {note}", read.file);
    }
    if read.infinite > 0 {
        let note = format!(
            "{} values are infinite and are left out, as missing ones are",
            read.infinite
        );
        eprintln!("warning: {}: {note}", read.file);
        read.notes.push(note);
    }
    if let Some(note) = rails::leave_out(&mut read) {
        eprintln!("warning: {}: {note}", read.file);
        read.notes.push(note);
    }
    Ok(read)
}
