//! Readings of a force gauge beside a recording: CSV.

use super::columns::{self, Columns};
use super::malformed::FileError;
use super::positions::{FORCE, TIME};
use std::path::Path;

/// Reads a time (`t_s`, `time_s` or `t`, s, rising) and a force (`force_n` or `force`, N), named as in lists of positions; other columns
/// are passed over.
///
/// # Errors
/// [`FileError`] with the line and the column.
pub(crate) fn read(path: &Path) -> Result<Vec<[f64; 2]>, FileError> {
    columns::read(path, parse)
}

fn parse(file: &str, text: &str) -> Result<Vec<[f64; 2]>, FileError> {
    let table = Columns::parse(file, text)?;
    let column = |names: &[&str], what| table.find(names).ok_or_else(|| table.missing(names[0], what));
    let time = column(&TIME, "a column t_s, time_s or t")?;
    let force = column(&FORCE, "a column force_n or force")?;
    let mut readings: Vec<[f64; 2]> = Vec::new();
    for line in table.lines() {
        let reading = [
            line.value(time, TIME[0], "a time in seconds")?,
            line.value(force, FORCE[0], "a force in newtons")?,
        ];
        if readings.last().is_some_and(|last| last[0] >= reading[0]) {
            let expected = "a time after the one before";
            return Err(line.malformed(TIME[0], expected, &reading[0].to_string()));
        }
        readings.push(reading);
    }
    Ok(readings)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn readings_are_read_and_what_is_wrong_is_named() {
        let text = "# bench\nforce_n,time_s,note\n0,0.5,a\n2.5,1,b\n";
        assert_eq!(parse("g.csv", text).unwrap(), [[0.5, 0.0], [1.0, 2.5]]);
        assert_eq!(parse("g.csv", "t,force\n1,2\n").unwrap(), [[1.0, 2.0]]);
        for (text, words) in [
            ("time_s\n1\n", ["g.csv:1", "force_n"]),
            ("time_s,force_n\n1,x\n", ["g.csv:2", "force_n"]),
            ("time_s,force_n\n1,0\n1,0\n", ["g.csv:3", "after the one before"]),
        ] {
            let why = parse("g.csv", text).unwrap_err().to_string();
            assert!(words.iter().all(|w| why.contains(w)), "{why}");
        }
    }
}
