//! Measurement tables: one row for every measurement, one column (or a `_re`, `_im` pair) for every frame.
//!
//! The format of tests/data: comma-separated, `#` lines are comments, the header names `drive_a, drive_b, sense_a,
//! sense_b` (electrodes from 1) and then the frames. The current enters at `drive_a`; a value is the potential of
//! `sense_b` less that of `sense_a`, which makes a homogeneous disc positive. Empty fields, `NaN` and
//! infinite values are measurements left out.

use crate::files::malformed::FileError;
use ::forward::{Measurement, Pair};
use csv::StringRecord;
use std::collections::HashMap;
use std::io::Read;
use std::path::Path;
use thiserror::Error;

/// What is wrong with a table.
#[derive(Debug, Error)]
#[non_exhaustive]
pub(crate) enum TableError {
    /// The file cannot be read, or a line does not have the form of a table.
    #[error(transparent)]
    File(#[from] FileError),
    /// A frame that the table does not have.
    #[error("{file}: there is no frame named {name}; it has {available}")]
    NoSuchFrame {
        /// The file.
        file: String,
        /// The name asked for.
        name: String,
        /// The names there are.
        available: String,
    },
}

/// One frame of a table.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Column {
    /// The column's name, without `_re`.
    pub name: String,
    /// Values in the order of the rows; not a number where a measurement was left out. Of a complex frame the magnitude.
    pub values: Vec<f64>,
}

/// A table of measurements.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct MeasurementTable {
    /// Where it came from, for messages.
    pub file: String,
    /// What every row is, electrodes from 0.
    pub measurements: Vec<Measurement>,
    /// Number of electrodes: the largest that a row names.
    pub electrodes: usize,
    /// Values that were infinite; they are left out, as if they were not there.
    pub infinite: usize,
    /// The frames in the order of the columns.
    pub columns: Vec<Column>,
}

const KEYS: [&str; 4] = ["drive_a", "drive_b", "sense_a", "sense_b"];

/// A column of the file: the frame it belongs to and whether it is its imaginary part.
struct Field {
    frame: usize,
    imaginary: bool,
}

/// A file that is read, for messages.
struct Place<'a> {
    file: &'a str,
}

impl Place<'_> {
    fn malformed(&self, line: u64, column: &str, expected: &str, found: &str) -> TableError {
        FileError::malformed(self.file, line, column, expected, found).into()
    }

    /// The lines that are neither empty nor comments, with their numbers from 1, as fields.
    fn lines(&self, bytes: &[u8]) -> Result<Vec<(u64, StringRecord)>, TableError> {
        let mut records = Vec::new();
        // Spreadsheets begin a file with a byte order mark.
        let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
        for (number, line) in (1..).zip(bytes.split(|b| *b == b'\n')) {
            let line = std::str::from_utf8(line)
                .map_err(|_| self.malformed(number, "1", "text in UTF-8", "other bytes"))?
                .trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            // Line by line, so that an error can name the line whatever comments stand before it.
            let record = csv::ReaderBuilder::new()
                .has_headers(false)
                .trim(csv::Trim::All)
                .from_reader(line.as_bytes())
                .records()
                .next()
                .and_then(Result::ok)
                .ok_or_else(|| self.malformed(number, "1", "comma-separated fields", line))?;
            records.push((number, record));
        }
        Ok(records)
    }

    /// The frames that a header names, and the fields that hold their values.
    fn header(&self, line: u64, header: &StringRecord) -> Result<(Vec<Column>, Vec<Field>), TableError> {
        for (k, key) in KEYS.iter().enumerate() {
            let found = header.get(k).unwrap_or("nothing");
            if found != *key {
                return Err(self.malformed(line, &(k + 1).to_string(), key, &format!("'{found}'")));
            }
        }
        let names: Vec<&str> = header.iter().skip(KEYS.len()).collect();
        let (columns, fields) = frames(&names).map_err(|(k, expected)| {
            let place = (KEYS.len() + k + 1).to_string();
            self.malformed(line, &place, &expected, &format!("'{}'", names[k]))
        })?;
        if columns.is_empty() {
            return Err(self.malformed(line, "5", "at least one frame", "nothing"));
        }
        Ok((columns, fields))
    }

    /// The electrodes of a line, from 0, in the order of [`KEYS`].
    fn electrodes(&self, line: u64, record: &StringRecord) -> Result<[usize; 4], TableError> {
        let mut electrodes = [0; 4];
        for (k, key) in KEYS.iter().enumerate() {
            electrodes[k] = match record[k].parse::<usize>() {
                Ok(e) if (1..=1024).contains(&e) => e - 1,
                _ => {
                    let found = format!("'{}'", &record[k]);
                    return Err(self.malformed(line, key, "an electrode's number from 1 to 1024", &found));
                }
            };
        }
        for (k, what) in [(1, "drive_b"), (3, "sense_b")] {
            if electrodes[k] == electrodes[k - 1] {
                let found = format!("'{}'", &record[k]);
                return Err(self.malformed(line, what, "another electrode than the pair's first", &found));
            }
        }
        Ok(electrodes)
    }
}

impl MeasurementTable {
    /// Reads a table from a file.
    ///
    /// # Errors
    /// [`TableError`] with the file, the line, the column and what was expected there.
    pub(crate) fn read(path: &Path) -> Result<Self, TableError> {
        let name = path.display().to_string();
        let file = std::fs::File::open(path).map_err(|cause| FileError::Io {
            file: name.clone(),
            cause,
        })?;
        Self::parse(&name, file)
    }

    /// Reads a table from anything; `file` is its name in messages.
    ///
    /// # Errors
    /// As for [`MeasurementTable::read`].
    pub(crate) fn parse(file: &str, mut text: impl Read) -> Result<Self, TableError> {
        let at = Place { file };
        let mut bytes = Vec::new();
        text.read_to_end(&mut bytes).map_err(|cause| FileError::Io {
            file: file.to_owned(),
            cause,
        })?;
        let mut lines = at.lines(&bytes)?.into_iter();
        let Some((header_line, header)) = lines.next() else {
            return Err(at.malformed(1, "1", "a header that begins with drive_a", "nothing"));
        };
        let (columns, fields) = at.header(header_line, &header)?;
        let mut table = Self {
            file: file.to_owned(),
            measurements: Vec::new(),
            electrodes: 0,
            infinite: 0,
            columns,
        };
        let mut seen = HashMap::new();
        for (line, record) in lines {
            if record.len() != header.len() {
                return Err(at.malformed(
                    line,
                    &(record.len().min(header.len()) + 1).to_string(),
                    &format!("{} fields as in the header", header.len()),
                    &format!("{}", record.len()),
                ));
            }
            let electrodes = at.electrodes(line, &record)?;
            if let Some(before) = seen.insert(electrodes, line) {
                let again = format!("the measurement of line {before} again");
                return Err(at.malformed(line, "drive_a", "every measurement once", &again));
            }
            let [drive_a, drive_b, sense_a, sense_b] = electrodes;
            table.measurements.push(Measurement {
                drive: Pair::new(drive_a, drive_b),
                sense: Pair::new(sense_b, sense_a),
            });
            table.electrodes = electrodes.iter().map(|e| e + 1).fold(table.electrodes, usize::max);
            table.take(&at, line, &header, &record, &fields)?;
        }
        if table.measurements.is_empty() {
            return Err(at.malformed(header_line + 1, "1", "at least one measurement", "the end of the file"));
        }
        Ok(table)
    }

    /// Takes the values of a line: an amplitude for every frame.
    fn take(
        &mut self,
        at: &Place,
        line: u64,
        header: &StringRecord,
        record: &StringRecord,
        fields: &[Field],
    ) -> Result<(), TableError> {
        let mut values = vec![[0.0_f64; 2]; self.columns.len()];
        let mut complex = vec![false; self.columns.len()];
        for (k, field) in (KEYS.len()..).zip(fields) {
            let text = &record[k];
            let value = match text.parse::<f64>() {
                _ if text.is_empty() => f64::NAN,
                Ok(v) if v.is_infinite() => {
                    self.infinite += 1;
                    f64::NAN
                }
                Ok(v) => v,
                _ => return Err(at.malformed(line, &header[k], "a number, nothing or NaN", &format!("'{text}'"))),
            };
            values[field.frame][usize::from(field.imaginary)] = value;
            complex[field.frame] |= field.imaginary;
        }
        for ((column, v), complex) in self.columns.iter_mut().zip(&values).zip(complex) {
            column.values.push(if complex { v[0].hypot(v[1]) } else { v[0] });
        }
        Ok(())
    }

    /// The frame of a name (`water_1` and `water_1_re` are the same frame).
    ///
    /// # Errors
    /// [`TableError::NoSuchFrame`] lists the names there are.
    pub(crate) fn frame(&self, name: &str) -> Result<usize, TableError> {
        let plain = name.strip_suffix("_re").or(name.strip_suffix("_im"));
        self.columns
            .iter()
            .position(|c| c.name == name || Some(c.name.as_str()) == plain)
            .ok_or_else(|| TableError::NoSuchFrame {
                file: self.file.clone(),
                name: name.to_owned(),
                available: self
                    .columns
                    .iter()
                    .map(|c| c.name.as_str())
                    .collect::<Vec<_>>()
                    .join(", "),
            })
    }
}

/// Frames of a header; an error is the column (from 0) and what was expected there.
fn frames(names: &[&str]) -> Result<(Vec<Column>, Vec<Field>), (usize, String)> {
    let mut columns: Vec<Column> = Vec::new();
    let mut fields = Vec::new();
    for (k, name) in names.iter().enumerate() {
        if name.is_empty() {
            return Err((k, "the name of a frame".to_owned()));
        }
        let partner = |from: &str, to: &str| {
            name.strip_suffix(from)
                .filter(|stem| names.contains(&format!("{stem}{to}").as_str()))
        };
        let (frame_name, imaginary) = match (partner("_re", "_im"), partner("_im", "_re")) {
            (Some(stem), _) => (stem, false),
            (_, Some(stem)) => (stem, true),
            _ => (*name, false),
        };
        let known = columns.iter().position(|c| c.name == frame_name);
        let frame = known.unwrap_or(columns.len());
        let taken = fields
            .iter()
            .any(|f: &Field| f.frame == frame && f.imaginary == imaginary);
        if taken {
            return Err((k, "a name that no other column has".to_owned()));
        }
        if known.is_none() {
            columns.push(Column {
                name: frame_name.to_owned(),
                values: Vec::new(),
            });
        }
        fields.push(Field { frame, imaginary });
    }
    Ok((columns, fields))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<MeasurementTable, TableError> {
        MeasurementTable::parse("t.csv", text.as_bytes())
    }

    #[test]
    fn plain_and_complex_frames_and_gaps() {
        let t = parse("# a comment\ndrive_a,drive_b,sense_a,sense_b,w_re,w_im,p\n1,2,3,4,3,-4,0.5\n1,2,4,5,,1,NaN\n")
            .unwrap();
        assert_eq!(t.electrodes, 5);
        assert_eq!(t.measurements[0].drive, Pair::new(0, 1));
        assert_eq!(t.measurements[0].sense, Pair::new(3, 2));
        assert_eq!(t.columns[0].name, "w");
        assert_eq!(t.columns[0].values[0], 5.0);
        assert!(t.columns[0].values[1].is_nan());
        assert_eq!(t.columns[1].values[0], 0.5);
        assert!(t.columns[1].values[1].is_nan());
        assert_eq!(t.frame("w_re").unwrap(), 0);
        assert!(t.frame("x").unwrap_err().to_string().contains("w, p"));
    }

    #[test]
    fn what_is_infinite_is_left_out_and_counted() {
        let head = "drive_a,drive_b,sense_a,sense_b,w_re,w_im,p\n";
        let with = parse(&format!("{head}1,2,3,4,1,2,inf\n1,2,4,5,-inf,1,1e999\n")).unwrap();
        let without = parse(&format!("{head}1,2,3,4,1,2,\n1,2,4,5,NaN,1,\n")).unwrap();
        assert_eq!((with.infinite, without.infinite), (3, 0));
        for (a, b) in with.columns.iter().zip(&without.columns) {
            let bits = |v: &[f64]| v.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&a.values), bits(&b.values));
        }
    }

    #[test]
    fn what_a_spreadsheet_makes_of_a_table_is_the_same_table() {
        let plain = "# made by hand\ndrive_a,drive_b,sense_a,sense_b,w,p\n1,2,3,4,1,2\n";
        let sheet =
            "\u{feff}# made by hand\r\n\"drive_a\",drive_b, sense_a ,sense_b,w,\"p\"\r\n1,2,3,4,\"1\",2\r\n\r\n";
        assert_eq!(parse(plain).unwrap(), parse(sheet).unwrap());
    }

    #[test]
    fn malformed_tables_name_file_line_column_and_expectation() {
        let head = "drive_a,drive_b,sense_a,sense_b,v\n";
        for (text, words) in [
            (String::new(), ["t.csv:1", "drive_a", "nothing"]),
            ("a,b\n".to_owned(), ["t.csv:1", "drive_a", "'a'"]),
            (
                "drive_a,drive_b,sense_a,sense_b\n".to_owned(),
                ["t.csv:1", "at least one frame", "nothing"],
            ),
            (format!("{head}1,2,3,4,x\n"), ["t.csv:2", "column v", "'x'"]),
            (
                format!("{head}1,2,3,4,1\n\n0,2,3,4,1\n"),
                ["t.csv:4", "column drive_a", "'0'"],
            ),
            (
                format!("{head}1,2,3,4,1\n1,2,5,6\n"),
                ["t.csv:3", "5 fields", "found 4"],
            ),
            (format!("{head}1,2,3,4,1\n1,2,3,4,1\n"), ["t.csv:3", "once", "line 2"]),
            (format!("{head}1,1,3,4,1\n"), ["t.csv:2", "drive_b", "'1'"]),
            (head.to_owned(), ["t.csv:2", "at least one measurement", "end"]),
            (
                "drive_a,drive_b,sense_a,sense_b,v,v\n".to_owned(),
                ["t.csv:1", "no other column", "'v'"],
            ),
        ] {
            let message = parse(&text).unwrap_err().to_string();
            for word in words {
                assert!(message.contains(word), "{text:?}: {message}");
            }
        }
    }
}
