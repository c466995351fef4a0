//! What is wrong with a file of lines and columns.

use thiserror::Error;

/// A file that cannot be used.
#[derive(Debug, Error)]
pub(crate) enum FileError {
    /// It cannot be read.
    #[error("{file}: {cause}; check the path and the permissions")]
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
            found: found.to_owned(),
        }
    }
}
