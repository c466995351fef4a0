//! Arrays of numbers from the files of other programs: numpy's, MATLAB's, and lines of text.

mod bytes;
mod lines;
mod mat;
mod npy;
mod npz;
pub(crate) mod write;

use crate::files::malformed::FileError;
use std::path::Path;

/// Largest file of a table or of arrays, bytes: a table takes twice as much memory. These are half an hour of frames.
pub(crate) const MOST_TABLE: u64 = 512 << 20;

/// A table of numbers with a name.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Array {
    /// The variable's name; empty where the file has none.
    pub name: String,
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub columns: usize,
    /// Row by row. Of complex numbers the magnitude.
    pub values: Vec<f64>,
    /// Whether the numbers were complex.
    pub complex: bool,
    /// Comments that begin with #, with their lines from 1; of text only.
    pub comments: Vec<(u64, String)>,
}

/// What a file's bytes are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// A single array of numpy.
    Npy,
    /// Arrays of numpy in a zip archive.
    Npz,
    /// Variables of MATLAB, level 5.
    Mat,
    /// Text.
    Text,
}

impl Kind {
    /// By the first bytes, whatever the file is called.
    pub(crate) fn of(bytes: &[u8]) -> Self {
        if bytes.starts_with(npy::MAGIC) {
            Self::Npy
        } else if bytes.starts_with(b"PK\x03\x04") {
            Self::Npz
        } else if bytes.starts_with(b"MATLAB") || bytes.starts_with(mat::HDF5) {
            Self::Mat
        } else {
            Self::Text
        }
    }
}

/// Reads all arrays of numbers with one or two dimensions that a file has.
///
/// # Errors
/// [`FileError`] names the file, what is wrong with it and what to do.
pub(crate) fn read(path: &Path) -> Result<(Kind, Vec<Array>), FileError> {
    let file = path.display().to_string();
    let bytes = ::forward::whole::bytes(path, MOST_TABLE).map_err(|cause| FileError::Io {
        file: file.clone(),
        cause,
    })?;
    parse(&file, &bytes)
}

/// The same of bytes; `file` is their name in messages.
///
/// # Errors
/// As for [`read`].
pub(crate) fn parse(file: &str, bytes: &[u8]) -> Result<(Kind, Vec<Array>), FileError> {
    let kind = Kind::of(bytes);
    let unusable = |what: String| FileError::Unusable {
        file: file.to_owned(),
        what,
    };
    let arrays = match kind {
        Kind::Npy => vec![npy::parse("", bytes).map_err(unusable)?],
        Kind::Npz => npz::parse(bytes).map_err(unusable)?,
        Kind::Mat => mat::parse(bytes).map_err(unusable)?,
        Kind::Text => vec![lines::parse(file, bytes)?],
    };
    Ok((kind, arrays))
}
