//! Small CSV files: a header that names the columns, and a line for each thing. Lines that begin with `#` are passed over.

use super::malformed::FileError;
use std::path::Path;

/// Such a file, of which every line has as many fields as the header.
pub(crate) struct Columns<'a> {
    /// Its name in messages.
    file: &'a str,
    header: csv::StringRecord,
    records: Vec<csv::StringRecord>,
}

/// A line of it.
#[derive(Clone, Copy)]
pub(crate) struct Line<'a> {
    file: &'a str,
    record: &'a csv::StringRecord,
}

/// Reads a file by what reads its text; the first argument of that is its name in messages.
///
/// # Errors
/// [`FileError::Io`], and those of the text.
pub(crate) fn read<T>(path: &Path, parse: impl FnOnce(&str, &str) -> Result<T, FileError>) -> Result<T, FileError> {
    let file = path.display().to_string();
    match ::forward::whole::text(path) {
        Ok(text) => parse(&file, &text),
        Err(cause) => Err(FileError::Io { file, cause }),
    }
}

impl<'a> Columns<'a> {
    /// The text of a file.
    ///
    /// # Errors
    /// [`FileError::Malformed`] of a line with more or fewer fields than the header.
    pub(crate) fn parse(file: &'a str, text: &str) -> Result<Self, FileError> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let mut reader = csv::ReaderBuilder::new()
            .comment(Some(b'#'))
            .trim(csv::Trim::All)
            .from_reader(text.as_bytes());
        let broken = |cause: &csv::Error| {
            let line = cause.position().map_or(1, csv::Position::line);
            FileError::malformed(file, line, "1", "as many fields as in the header", &cause.to_string())
        };
        let header = reader.headers().map_err(|cause| broken(&cause))?.clone();
        let records: Result<_, _> = reader.into_records().collect();
        Ok(Self {
            file,
            header,
            records: records.map_err(|cause| broken(&cause))?,
        })
    }

    /// Where the column of the first of these names is that there is, from 0.
    pub(crate) fn find(&self, names: &[&str]) -> Option<usize> {
        names
            .iter()
            .find_map(|name| self.header.iter().position(|h| h == *name))
    }

    /// Where the column of this name is, from 0.
    ///
    /// # Errors
    /// It is not there.
    pub(crate) fn column(&self, name: &str) -> Result<usize, FileError> {
        self.find(&[name])
            .ok_or_else(|| self.missing(name, "a column of this name"))
    }

    /// A column that is not there, and those that are.
    pub(crate) fn missing(&self, name: &str, expected: &str) -> FileError {
        let there: Vec<&str> = self.header.iter().collect();
        FileError::malformed(self.file, 1, name, expected, &there.join(","))
    }

    /// Its lines in their order.
    pub(crate) fn lines(&self) -> impl Iterator<Item = Line<'_>> {
        self.records.iter().map(|record| Line {
            file: self.file,
            record,
        })
    }
}

impl<'a> Line<'a> {
    /// Its number in the file, from 1.
    pub(crate) fn number(self) -> u64 {
        self.record.position().map_or(1, csv::Position::line)
    }

    /// The text in a column.
    pub(crate) fn text(self, column: usize) -> &'a str {
        self.record.get(column).unwrap_or_default()
    }

    /// The finite number in a column of this name.
    ///
    /// # Errors
    /// There is none.
    pub(crate) fn value(self, column: usize, name: &str, expected: &str) -> Result<f64, FileError> {
        let text = self.text(column);
        let value = text.parse::<f64>().ok().filter(|v| v.is_finite());
        value.ok_or_else(|| self.malformed(name, expected, &format!("'{text}'")))
    }

    /// What is wrong with it in a column of this name.
    pub(crate) fn malformed(self, name: &str, expected: &str, found: &str) -> FileError {
        FileError::malformed(self.file, self.number(), name, expected, found)
    }
}
