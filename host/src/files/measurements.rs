//! Measurement tables: one row for every measurement, one column (or a `_re`, `_im` pair) for every frame.
//!
//! The format of tests/data: comma-separated, `#` lines are comments, the header names `drive_a, drive_b, sense_a,
//! sense_b` (electrodes from 1) and then the frames. The current enters at `drive_a`; a value is the potential of
//! `sense_b` less that of `sense_a`, which makes a homogeneous disc positive. Empty fields, `NaN` and
//! infinite values are measurements left out. A comment `# sheet:` says which sheet was measured (`sheet_line`).

use crate::drive::DriveKind;
use crate::files::arrays::{self, Kind, MOST_TABLE};
use crate::files::malformed::{FileError, decimal_comma};
use crate::files::order;
use crate::files::sheet_line::SheetLine;
use ::forward::file::MOST_ELECTRODES;
use ::forward::whole::is_utf16;
use ::forward::{Measurement, Pair};
use clap::ValueEnum;
use csv::StringRecord;
use std::collections::{HashMap, HashSet};
use std::path::Path;
use thiserror::Error;

/// What is wrong with a table.
#[derive(Debug, Error)]
#[non_exhaustive]
pub(crate) enum TableError {
    /// The file cannot be read, or a line does not have the form of a table.
    #[error(transparent)]
    File(#[from] FileError),
    /// Numbers alone: nothing says which measurements they are.
    #[error("{file}: one frame a line, and nothing says which measurements its values are. {hint}")]
    NeedsOrder {
        /// The file.
        file: String,
        /// The orders that may be meant.
        hint: String,
    },
    /// Two lines that name different sheets.
    #[error("{file}:{line}: a second sheet, {second}, where the header began with {first}; keep one")]
    TwoSheets {
        /// The file.
        file: String,
        /// Line from 1.
        line: u64,
        /// The sheet named first.
        first: String,
        /// The other one.
        second: String,
    },
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
    /// The sheet that the header names.
    pub sheet: Option<SheetLine>,
    /// How many rows the header says that there are.
    pub rows: Option<usize>,
    /// How the sheet was driven, as the header says.
    pub drive: Option<DriveKind>,
    /// What was assumed or not understood, a sentence each without a full stop.
    pub notes: Vec<String>,
}

const KEYS: [&str; 4] = ["drive_a", "drive_b", "sense_a", "sense_b"];

/// Names of frames that an error lists.
const MOST_LISTED: usize = 40;

/// What stands where text in UTF-8 should.
fn other(line: &[u8]) -> &'static str {
    if line.contains(&0) {
        "bytes of another kind of file"
    } else {
        "another encoding; save it as CSV in UTF-8"
    }
}

/// A column of the file: the frame it belongs to and whether it is its imaginary part.
struct Field {
    frame: usize,
    imaginary: bool,
}

/// The header line.
struct Header {
    line: u64,
    record: StringRecord,
    fields: Vec<Field>,
    /// Which frames have an imaginary part.
    complex: Vec<bool>,
}

/// A file that is read, for messages.
struct Place<'a> {
    file: &'a str,
}

impl Place<'_> {
    fn malformed(&self, line: u64, column: &str, expected: &str, found: &str) -> TableError {
        FileError::malformed(self.file, line, column, expected, found).into()
    }

    /// The fields of a line. Line by line, so that an error can name the line whatever comments stand before it.
    fn fields(&self, number: u64, line: &str) -> Result<StringRecord, TableError> {
        csv::ReaderBuilder::new()
            .has_headers(false)
            .trim(csv::Trim::All)
            .from_reader(line.as_bytes())
            .records()
            .next()
            .and_then(Result::ok)
            .ok_or_else(|| self.malformed(number, "1", "comma-separated fields", line))
    }

    /// The frames that a header names, and the fields that hold their values.
    fn header(&self, line: u64, record: StringRecord) -> Result<(Vec<Column>, Header), TableError> {
        for (k, key) in KEYS.iter().enumerate() {
            let found = record.get(k).unwrap_or("nothing");
            if found != *key {
                return Err(self.malformed(line, &(k + 1).to_string(), key, &format!("'{found}'")));
            }
        }
        let names: Vec<&str> = record.iter().skip(KEYS.len()).collect();
        let (columns, fields) = frames(&names).map_err(|(k, expected)| {
            let place = (KEYS.len() + k + 1).to_string();
            self.malformed(line, &place, &expected, &format!("'{}'", names[k]))
        })?;
        if columns.is_empty() {
            return Err(self.malformed(line, "5", "at least one frame", "nothing"));
        }
        let mut complex = vec![false; columns.len()];
        for field in &fields {
            complex[field.frame] |= field.imaginary;
        }
        let header = Header {
            line,
            record,
            fields,
            complex,
        };
        Ok((columns, header))
    }

    /// What to do about a header whose names are not separated by commas, as spreadsheets of some countries write it.
    fn separated_otherwise(&self, line: u64, header: &str) -> Option<TableError> {
        let found = match header
            .trim_start_matches(KEYS[0])
            .trim_start_matches(' ')
            .chars()
            .next()?
        {
            ';' => "semicolons; write ',' for ';', and decimal points where there are decimal commas",
            '\t' => "tabs; write ',' for each",
            _ => return None,
        };
        Some(self.malformed(line, "1", "columns separated by commas", found))
    }

    /// Whether the line below the header names four electrodes: the file is a table whose header is another.
    fn names_electrodes(&self, bytes: &[u8]) -> bool {
        let text = String::from_utf8_lossy(bytes);
        let mut lines = text
            .lines()
            .map(str::trim)
            .filter(|l| !l.is_empty() && !l.starts_with('#'));
        let first = lines.next().and_then(|header| header.split(',').next());
        let named = first.is_some_and(|name| name.trim().parse::<f64>().is_err());
        let row = lines.next().and_then(|line| self.fields(0, line).ok());
        named && row.is_some_and(|row| row.len() > KEYS.len() && self.electrodes(0, &row).is_ok())
    }

    /// The electrodes of a line, from 0, in the order of [`KEYS`].
    fn electrodes(&self, line: u64, record: &StringRecord) -> Result<[usize; 4], TableError> {
        let mut electrodes = [0; 4];
        for (k, key) in KEYS.iter().enumerate() {
            electrodes[k] = match record[k].parse::<usize>() {
                Ok(e) if (1..=MOST_ELECTRODES).contains(&e) => e - 1,
                _ => {
                    let from_0 = if &record[k] == "0" {
                        "; where electrodes count from 0, add 1 to each of the four columns"
                    } else {
                        ""
                    };
                    let found = format!("'{}'{from_0}", &record[k]);
                    let expected = format!("an electrode's number from 1 to {MOST_ELECTRODES}");
                    return Err(self.malformed(line, key, &expected, &found));
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
    /// Reads a table from a file; `told` hears how many of how many bytes are read.
    ///
    /// # Errors
    /// [`TableError`] with the file, the line, the column and what was expected there.
    pub(crate) fn read(path: &Path, told: impl FnMut(usize, usize)) -> Result<Self, TableError> {
        let name = path.display().to_string();
        let bytes = ::forward::whole::bytes(path, MOST_TABLE).map_err(|cause| FileError::Io {
            file: name.clone(),
            cause,
        })?;
        Self::parse(&name, &bytes, told)
    }

    /// Reads a table from bytes; `file` is their name in messages.
    ///
    /// # Errors
    /// As for [`MeasurementTable::read`].
    pub(crate) fn parse(file: &str, bytes: &[u8], mut told: impl FnMut(usize, usize)) -> Result<Self, TableError> {
        if Kind::of(bytes) != Kind::Text {
            let (_, arrays) = arrays::parse(file, bytes)?;
            return Err(TableError::NeedsOrder {
                file: file.to_owned(),
                hint: order::hint(&arrays),
            });
        }
        let at = Place { file };
        if is_utf16(bytes) {
            return Err(at.malformed(1, "1", "text in UTF-8", "text in UTF-16; save it as CSV in UTF-8"));
        }
        let mut table = Self {
            file: file.to_owned(),
            measurements: Vec::new(),
            electrodes: 0,
            infinite: 0,
            columns: Vec::new(),
            sheet: None,
            rows: None,
            drive: None,
            notes: Vec::new(),
        };
        let mut header = None;
        let mut seen = HashMap::new();
        let mut done = 0;
        // Spreadsheets begin a file with a byte order mark.
        let lines = bytes
            .strip_prefix(b"\xEF\xBB\xBF")
            .unwrap_or(bytes)
            .split(|b| *b == b'\n');
        for (number, line) in (1..).zip(lines) {
            done += line.len() + 1;
            told(done, bytes.len());
            let line = std::str::from_utf8(line)
                .map_err(|_| at.malformed(number, "1", "text in UTF-8", other(line)))?
                .trim();
            if line.starts_with('#') {
                table.comment(number, line)?;
            }
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let record = at.fields(number, line)?;
            match &header {
                None => {
                    let (columns, read) = at.header(number, record).map_err(|error| match () {
                        () if line.starts_with(KEYS[0]) => at.separated_otherwise(number, line).unwrap_or(error),
                        () if at.names_electrodes(bytes) => error,
                        () => numbers_alone(file, bytes).unwrap_or(error),
                    })?;
                    table.columns = columns;
                    header = Some(read);
                }
                Some(header) => table.row(&at, number, header, &record, &mut seen)?,
            }
        }
        let Some(header) = header else {
            let found = if bytes.contains(&b'\r') && !bytes.contains(&b'\n') {
                "lines that end with a carriage return alone; save it with line feeds"
            } else {
                "nothing"
            };
            return Err(at.malformed(1, "1", "a header that begins with drive_a", found));
        };
        if table.measurements.is_empty() {
            return Err(at.malformed(header.line + 1, "1", "at least one measurement", "the end of the file"));
        }
        let rows = table.measurements.len();
        if let Some(said) = table.rows.filter(|said| *said != rows) {
            table
                .notes
                .push(format!("the header says {said} rows, and there are {rows}"));
        }
        Ok(table)
    }

    /// Takes what a comment says of the sheet and of the number of rows.
    ///
    /// # Errors
    /// [`TableError::TwoSheets`].
    pub(crate) fn comment(&mut self, line: u64, text: &str) -> Result<(), TableError> {
        let plain = text.trim_start_matches('#').trim();
        if let Some(rows) = plain.strip_prefix("rows:").and_then(|n| n.trim().parse().ok()) {
            self.rows = Some(rows);
        }
        if let Some(drive) = plain.strip_prefix("drive:") {
            let word = drive.split_whitespace().next().unwrap_or_default();
            self.drive = DriveKind::from_str(word.trim_end_matches(','), true).ok();
        }
        let Some(sheet) = SheetLine::parse(text) else {
            if plain.starts_with("sheet:") {
                self.notes.push(format!(
                    "line {line} is not understood as a sheet, and no sheet is compared with it"
                ));
            }
            return Ok(());
        };
        match &self.sheet {
            Some(first) if first.electrodes != sheet.electrodes => {
                return Err(TableError::TwoSheets {
                    file: self.file.clone(),
                    line,
                    first: first.to_string(),
                    second: sheet.to_string(),
                });
            }
            // The line that says more counts.
            Some(first) if !first.outline.is_empty() && sheet.outline.is_empty() => {}
            _ => self.sheet = Some(sheet),
        }
        Ok(())
    }

    /// Takes a line below the header: a measurement, and an amplitude for every frame.
    fn row(
        &mut self,
        at: &Place,
        line: u64,
        header: &Header,
        record: &StringRecord,
        seen: &mut HashMap<[usize; 4], u64>,
    ) -> Result<(), TableError> {
        if record.len() != header.record.len() {
            return Err(at.malformed(
                line,
                &(record.len().min(header.record.len()) + 1).to_string(),
                &format!("{} fields as in the header", header.record.len()),
                &format!("{}", record.len()),
            ));
        }
        let electrodes = at.electrodes(line, record)?;
        if let Some(before) = seen.insert(electrodes, line) {
            let again = format!("the measurement of line {before} again");
            return Err(at.malformed(line, "drive_a", "every measurement once", &again));
        }
        let [drive_a, drive_b, sense_a, sense_b] = electrodes;
        self.measurements.push(Measurement {
            drive: Pair::new(drive_a, drive_b),
            sense: Pair::new(sense_b, sense_a),
        });
        self.electrodes = electrodes.iter().map(|e| e + 1).fold(self.electrodes, usize::max);
        let mut values = vec![[0.0_f64; 2]; self.columns.len()];
        for (k, field) in (KEYS.len()..).zip(&header.fields) {
            let text = &record[k];
            let value = match text.parse::<f64>() {
                _ if text.is_empty() => f64::NAN,
                Ok(v) if v.is_infinite() => {
                    self.infinite += 1;
                    f64::NAN
                }
                Ok(v) => v,
                _ => {
                    let found = format!("'{text}'{}", decimal_comma(text));
                    return Err(at.malformed(line, &header.record[k], "a number, nothing or NaN", &found));
                }
            };
            values[field.frame][usize::from(field.imaginary)] = value;
        }
        for ((column, v), complex) in self.columns.iter_mut().zip(&values).zip(&header.complex) {
            column.values.push(if *complex { v[0].hypot(v[1]) } else { v[0] });
        }
        Ok(())
    }

    /// The frames by their names.
    pub(crate) fn names(&self) -> Names<'_> {
        let places = self
            .columns
            .iter()
            .enumerate()
            .map(|(k, c)| (c.name.as_str(), k))
            .collect();
        Names { table: self, places }
    }
}

/// The frames of a table by their names.
pub(crate) struct Names<'a> {
    table: &'a MeasurementTable,
    places: HashMap<&'a str, usize>,
}

impl Names<'_> {
    /// The frame of a name (`water_1` and `water_1_re` are the same frame).
    pub(crate) fn get(&self, name: &str) -> Option<usize> {
        let plain = name.strip_suffix("_re").or(name.strip_suffix("_im"));
        let place = self.places.get(name).or_else(|| self.places.get(plain?));
        place.copied()
    }

    /// The frames of a name, or all from one to another (`1-8`).
    ///
    /// # Errors
    /// [`TableError::NoSuchFrame`] lists the names there are.
    pub(crate) fn range(&self, name: &str) -> Result<Vec<usize>, TableError> {
        if let Some(place) = self.get(name) {
            return Ok(vec![place]);
        }
        let ends = name.match_indices('-').find_map(|(k, _)| {
            let (first, last) = (self.get(&name[..k])?, self.get(&name[k + 1..])?);
            (first <= last).then_some((first, last))
        });
        ends.map(|(first, last)| (first..=last).collect())
            .ok_or_else(|| self.unknown(name))
    }

    /// The error of a name that no frame has.
    pub(crate) fn unknown(&self, name: &str) -> TableError {
        let columns = &self.table.columns;
        let mut available: Vec<&str> = columns.iter().take(MOST_LISTED).map(|c| c.name.as_str()).collect();
        let more = format!("{} more", columns.len().saturating_sub(MOST_LISTED));
        if columns.len() > MOST_LISTED {
            available.push(&more);
        }
        TableError::NoSuchFrame {
            file: self.table.file.clone(),
            name: name.to_owned(),
            available: available.join(", "),
        }
    }
}

/// The error of a file that has numbers alone; none where it is something else.
fn numbers_alone(file: &str, bytes: &[u8]) -> Option<TableError> {
    let (_, arrays) = arrays::parse(file, bytes).ok()?;
    Some(TableError::NeedsOrder {
        file: file.to_owned(),
        hint: order::hint(&arrays),
    })
}

/// Frames of a header; an error is the column (from 0) and what was expected there.
fn frames(names: &[&str]) -> Result<(Vec<Column>, Vec<Field>), (usize, String)> {
    let all: HashSet<&str> = names.iter().copied().collect();
    let mut places: HashMap<&str, usize> = HashMap::new();
    let mut taken = HashSet::new();
    let mut columns: Vec<Column> = Vec::new();
    let mut fields = Vec::new();
    for (k, name) in names.iter().enumerate() {
        if name.is_empty() {
            return Err((k, "the name of a frame".to_owned()));
        }
        let partner = |from: &str, to: &str| {
            name.strip_suffix(from)
                .filter(|stem| all.contains(format!("{stem}{to}").as_str()))
        };
        let (frame_name, imaginary) = match (partner("_re", "_im"), partner("_im", "_re")) {
            (Some(stem), _) => (stem, false),
            (_, Some(stem)) => (stem, true),
            _ => (*name, false),
        };
        let frame = *places.entry(frame_name).or_insert(columns.len());
        if !taken.insert((frame, imaginary)) {
            return Err((k, "a name that no other column has".to_owned()));
        }
        if frame == columns.len() {
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
        MeasurementTable::parse("t.csv", text.as_bytes(), |_, _| ())
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
        assert_eq!(t.names().range("w_re").unwrap(), [0]);
        assert_eq!(t.names().range("w-p").unwrap(), [0, 1]);
        assert!(t.names().range("x").unwrap_err().to_string().contains("w, p"));
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
    fn the_sheet_of_the_header_is_kept() {
        let body = "drive_a,drive_b,sense_a,sense_b,w\n1,2,3,4,1\n";
        let one = parse(&format!(
            "# simulated: model, 16 electrodes\n# sheet: disc, 195.0 x 195.0 mm, 298.6 cm2, 16 electrodes\n{body}"
        ));
        let sheet = one.unwrap().sheet.unwrap();
        assert_eq!((sheet.electrodes, sheet.outline.as_str()), (16, "disc"));
        let two = parse(&format!("# 16-electrode tank\n# 32-electrode tank\n{body}"))
            .unwrap_err()
            .to_string();
        assert!(two.contains("t.csv:2") && two.contains("32 electrodes"), "{two}");
        let short = parse(&format!("# rows: 2\n{body}")).unwrap();
        assert!(short.notes[0].contains("2 rows, and there are 1"), "{:?}", short.notes);
        let vague = parse(&format!("# sheet: the blue one\n{body}")).unwrap();
        assert!(
            vague.sheet.is_none() && vague.notes[0].contains("line 1"),
            "{:?}",
            vague.notes
        );
    }

    #[test]
    fn numbers_alone_are_answered_with_the_orders_that_fit() {
        let line = vec!["1.0"; 208].join(",");
        for text in [line.clone(), format!("magnitudes : {line}\n")] {
            let message = parse(&text).unwrap_err().to_string();
            assert!(
                message.contains("--order adjacent16") && message.contains("--order pyeit"),
                "{message}"
            );
        }
        let message = parse("1,2,3\n").unwrap_err().to_string();
        assert!(message.contains("No known order"), "{message}");
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
                format!("{head}1,2,3,4,\"0,25\"\n"),
                ["t.csv:2", "column v", "'0,25'; write a decimal point"],
            ),
            (
                head.replace(',', ";") + "1;2;3;4;0,1\n",
                ["t.csv:1", "separated by commas", "semicolons"],
            ),
            (
                head.replace(',', "\t") + "1\t2\t3\t4\t1\n",
                ["t.csv:1", "separated by commas", "tabs"],
            ),
            // As bytes they are UTF-16 without its mark.
            ("d\0r\0i\0v\0e\0".to_owned(), ["t.csv:1", "UTF-8", "UTF-16"]),
            (
                format!("# a\r{}1,2,3,4,1\r", head.replace('\n', "\r")),
                ["t.csv:1", "drive_a", "carriage return"],
            ),
            (
                format!("{head}1,2,3,4,1\n\n0,2,3,4,1\n"),
                ["t.csv:4", "column drive_a", "'0'; where electrodes count from 0, add 1"],
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
            (
                "drive_a,drive_b,sense_a,sense_b,v,v\n1,2,3,4,0.1,0.2\n".to_owned(),
                ["t.csv:1", "no other column", "'v'"],
            ),
            (
                "source,sink,plus,minus,v\n1,2,3,4,0.1\n".to_owned(),
                ["t.csv:1", "drive_a", "'source'"],
            ),
        ] {
            let message = parse(&text).unwrap_err().to_string();
            for word in words {
                assert!(message.contains(word), "{text:?}: {message}");
            }
        }
    }
}
