//! Why a recording cannot be read or written.

use std::io;
use thiserror::Error;

/// Why a recording cannot be read or written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// The system said so.
    #[error("{file}: {cause}")]
    Io {
        /// The file.
        file: String,
        /// What the system said.
        cause: io::Error,
    },
    /// It would replace a file.
    #[error("{file}: there is such a file; name another one, or remove it")]
    Exists {
        /// The file.
        file: String,
    },
    /// It is something else.
    #[error("{file}: this is no recording of skin ({what}); make one with skin record")]
    Foreign {
        /// The file.
        file: String,
        /// What it is instead.
        what: String,
    },
    /// A later program wrote it.
    #[error("{file}: format {format} of recordings, this program knows {FORMAT}; read it with the program that wrote it", FORMAT = crate::FORMAT)]
    Format {
        /// The file.
        file: String,
        /// Its format.
        format: u32,
    },
    /// What a command needs is not in it.
    #[error("{file}: the recording holds no {what}")]
    Lacks {
        /// The file.
        file: String,
        /// What is missing.
        what: &'static str,
    },
    /// The writer of the format refused.
    #[error("{file}: {cause}")]
    Mcap {
        /// The file.
        file: String,
        /// What it said.
        cause: mcap::McapError,
    },
}

impl RecordingError {
    pub(crate) fn io(file: &str, cause: io::Error) -> Self {
        let file = file.to_owned();
        if cause.kind() == io::ErrorKind::AlreadyExists {
            Self::Exists { file }
        } else {
            Self::Io { file, cause }
        }
    }

    pub(crate) fn mcap(file: &str, cause: mcap::McapError) -> Self {
        let file = file.to_owned();
        match cause {
            mcap::McapError::Io(cause) => Self::Io { file, cause },
            cause => Self::Mcap { file, cause },
        }
    }
}
