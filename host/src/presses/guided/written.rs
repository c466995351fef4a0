//! The files of a guided calibration: the table of frames, the list of presses, the list of marks.

use super::Gathered;
use crate::files::columns::{self, Columns, Line};
use crate::files::malformed::FileError;
use crate::files::sheet_line::SheetLine;
use crate::presses::marks::write as write_text;
use anyhow::Result;
use std::fmt::Write as _;
use std::path::Path;

/// The frames of all presses as a table, and the list of them.
///
/// # Errors
/// They cannot be written.
pub(super) fn write(gathered: &Gathered, table: &Path, list: &Path) -> Result<()> {
    // Writing to a text cannot fail.
    let mut out = "# presses, taken by skin calibrate presses: before (u) and under (p) each\n".to_owned();
    let _ = writeln!(out, "# sheet: {}", SheetLine::of(&gathered.sheet)?);
    let _ = writeln!(out, "# rows: {}", gathered.pattern.len());
    out += "# quantity: amplitude, V; the current enters at drive_a, the value is U(sense_b) - U(sense_a)\n";
    out += "drive_a,drive_b,sense_a,sense_b";
    for k in 0..gathered.presses.len() {
        let _ = write!(out, ",u{k},p{k}");
    }
    out.push('\n');
    for (row, m) in gathered.pattern.measurements().iter().enumerate() {
        let [da, db, sa, sb] = [m.drive.plus, m.drive.minus, m.sense.minus, m.sense.plus].map(|e| e + 1);
        let _ = write!(out, "{da},{db},{sa},{sb}");
        for kept in &gathered.presses {
            for values in [&kept.press.before, &kept.press.pressed] {
                let _ = write!(out, ",{:.8e}", values.get(row).copied().unwrap_or(f64::NAN));
            }
        }
        out.push('\n');
    }
    write_text(table, &out)?;
    let mut out = "frame,before,x_mm,y_mm,force_n,t_s\n".to_owned();
    for (k, kept) in gathered.presses.iter().enumerate() {
        if let Some([x, y]) = kept.place_mm {
            let force = kept.force_n.map_or(String::new(), |f| format!("{f:.3}"));
            let _ = writeln!(out, "p{k},u{k},{x:.3},{y:.3},{force},{:.3}", kept.press.taken_s);
        }
    }
    write_text(list, &out)
}

/// Marks to press in this order, each with its line: a CSV with `x_mm` and `y_mm`.
///
/// # Errors
/// [`FileError`] with line and column.
pub(super) fn marks(path: &Path) -> Result<Vec<(u64, [f64; 2])>, FileError> {
    columns::read(path, |file, text| {
        let columns = Columns::parse(file, text)?;
        let (x, y) = (columns.column("x_mm")?, columns.column("y_mm")?);
        let place = |line: Line, column, name| line.value(column, name, "a place in millimetres");
        let both = |line: Line| {
            let place_mm = [place(line, x, "x_mm")?, place(line, y, "y_mm")?];
            Ok((line.number(), place_mm))
        };
        columns.lines().map(both).collect()
    })
}
