//! What a calibration was made on: board, sheet and pattern, with their hashes.

use super::row;
use ::forward::file::sheet_text;
use ::forward::{Measurement, Sheet};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::fmt::Write as _;

/// What a calibration was made on; what is not known is left out.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Of {
    /// The board's name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub board: Option<String>,
    /// Its serial number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial: Option<String>,
    /// When it was made, s since 1970.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub made_unix_s: Option<f64>,
    /// Of the text of `sheet`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sheet_sha256: Option<String>,
    /// Of the rows of the measurements, as a table of frames has them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pattern_sha256: Option<String>,
    /// The sheet, as a file of its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sheet: Option<String>,
}

impl Of {
    /// Of a sheet, where it is known, and of measurements.
    ///
    /// # Errors
    /// What the format cannot hold, which no sheet has.
    pub(crate) fn new(sheet: Option<&Sheet>, measurements: &[Measurement]) -> Result<Self, toml::ser::Error> {
        let sheet = sheet.map(sheet_text).transpose()?;
        Ok(Self {
            sheet_sha256: sheet.as_deref().map(sha256),
            sheet,
            pattern_sha256: Some(pattern_sha256(measurements)),
            ..Self::default()
        })
    }

    /// Of a sheet alone.
    ///
    /// # Errors
    /// As of [`Of::new`].
    pub(crate) fn sheet(sheet: &Sheet) -> Result<Self, toml::ser::Error> {
        Ok(Self {
            pattern_sha256: None,
            ..Self::new(Some(sheet), &[])?
        })
    }

    /// The same, made with a board.
    pub(crate) fn with_board(mut self, board: &str, serial: &str) -> Self {
        self.board = Some(board.to_owned());
        self.serial = Some(serial.to_owned());
        self
    }
}

/// SHA-256 in hexadecimal digits.
pub(super) fn sha256(text: &str) -> String {
    Sha256::digest(text.as_bytes())
        .iter()
        .fold(String::new(), |mut out, byte| {
            // Writing to a text cannot fail.
            let _ = write!(out, "{byte:02x}");
            out
        })
}

/// Of the rows of measurements.
pub(super) fn pattern_sha256(measurements: &[Measurement]) -> String {
    let line = |m: &Measurement| row(m).map(|e| e.to_string()).join(",") + "\n";
    sha256(&measurements.iter().map(line).collect::<String>())
}
