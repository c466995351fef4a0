//! What is wrong with a file of lines and columns.

use thiserror::Error;

/// Most letters of a file that an error repeats.
const MOST_FOUND: usize = 200;

/// What to look at where a file cannot be read or written.
pub(crate) fn look_at(cause: &std::io::Error) -> &'static str {
    use std::io::ErrorKind::{FileTooLarge, InvalidData};
    // They say it themselves.
    if matches!(cause.kind(), FileTooLarge | InvalidData) {
        ""
    } else {
        "; check the path and the permissions"
    }
}

/// What to do about a number that would be one with a decimal point.
pub(crate) fn decimal_comma(text: &str) -> &'static str {
    let digits = |part: &str, at: fn(&str) -> Option<char>| at(part).is_some_and(|c| c.is_ascii_digit());
    let between = text.split_once(',').is_some_and(|(whole, decimals)| {
        digits(whole, |s| s.chars().next_back()) && digits(decimals, |s| s.chars().next())
    });
    if between && text.replacen(',', ".", 1).parse::<f64>().is_ok() {
        "; write a decimal point for the comma"
    } else {
        ""
    }
}

/// A file that cannot be used.
#[derive(Debug, Error)]
pub(crate) enum FileError {
    /// It cannot be read.
    #[error("{file}: {cause}{}", look_at(cause))]
    Io {
        /// The file.
        file: String,
        /// What the system said.
        cause: std::io::Error,
    },
    /// Its bytes are not what they should be.
    #[error("{file}: {what}")]
    Unusable {
        /// The file.
        file: String,
        /// What is wrong, and what to do.
        what: String,
    },
    /// A line that does not have the form it should.
    #[error("{file}:{line}: column {column}: expected {expected}, found {found}")]
    Malformed {
        /// The file.
        file: String,
        /// Line from 1.
        line: u64,
        /// Name of the column, or its number from 1.
        column: String,
        /// What should be there.
        expected: String,
        /// What is there.
        found: String,
    },
}

impl FileError {
    pub(crate) fn malformed(file: &str, line: u64, column: &str, expected: &str, found: &str) -> Self {
        Self::Malformed {
            file: file.to_owned(),
            line,
            column: column.to_owned(),
            expected: expected.to_owned(),
            found: match found.char_indices().nth(MOST_FOUND) {
                Some((end, _)) => format!("{} ...", &found[..end]),
                None => found.to_owned(),
            },
        }
    }
}
