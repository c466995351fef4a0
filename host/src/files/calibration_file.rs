//! The calibration file: TOML with a unit in every key.

use crate::files::malformed::look_at;
use crate::files::replace::replace;
use inverse::force::calibration::StandardErrors;
use inverse::force::meter::Calibration;
use inverse::force::solid::Solid;

use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::Path;
use thiserror::Error;

/// What a calibration says that it is.
pub(crate) const SKIN: &str = "skin";
/// What one of presses alone said, as older programs wrote it.
pub(crate) const PRESSES: &str = "presses";

/// What a calibration says that it is; one of the rubber alone, as older programs wrote it, says nothing.
pub(crate) fn kind(text: &str) -> Option<String> {
    #[derive(Deserialize)]
    struct Kind {
        kind: String,
    }
    toml::from_str::<Kind>(text).ok().map(|k| k.kind)
}

/// Why a calibration file cannot be used.
#[derive(Debug, Error)]
pub(crate) enum CalibrationFileError {
    /// It cannot be read or written.
    #[error("{file}: {cause}{}", look_at(cause))]
    Io {
        /// The file.
        file: String,
        /// What the system said.
        cause: std::io::Error,
    },
    /// It is not a calibration; what and where is in the text.
    #[error("{file}: {message}\nmake one with skin calibrate")]
    Malformed {
        /// The file.
        file: String,
        /// What is wrong, with the line.
        message: String,
    },
}

/// The rubber's keys: a table of the file, or all of one that older programs wrote and recordings hold.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RubberKeys {
    delayed_ratio: f64,
    tau_s: f64,
    exponent: f64,
    unit_rise_mpa: f64,
    force_sd_n: f64,
    /// Standard errors of the above, for people.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    standard_error: Option<StandardErrors>,
}

impl RubberKeys {
    /// Of a calibration and the errors of its fit.
    pub(crate) fn of(calibration: &Calibration, errors: Option<StandardErrors>) -> Self {
        let solid = calibration.solid;
        Self {
            delayed_ratio: solid.delayed_ratio,
            tau_s: solid.tau_s,
            exponent: solid.exponent,
            unit_rise_mpa: solid.unit_rise_mpa,
            force_sd_n: calibration.force_sd_n,
            standard_error: errors,
        }
    }

    /// What they say; `file` is named in messages.
    ///
    /// # Errors
    /// [`CalibrationFileError::Malformed`] with the parameter that no rubber has.
    pub(crate) fn calibration(&self, file: &str) -> Result<Calibration, CalibrationFileError> {
        let malformed = |message: String| CalibrationFileError::Malformed {
            file: file.to_owned(),
            message,
        };
        let solid = Solid {
            delayed_ratio: self.delayed_ratio,
            tau_s: self.tau_s,
            exponent: self.exponent,
            unit_rise_mpa: self.unit_rise_mpa,
        };
        solid.check().map_err(|e| malformed(e.to_string()))?;
        if !(self.force_sd_n.is_finite() && self.force_sd_n >= 0.0) {
            return Err(malformed(format!(
                "force_sd_n is {}; give 0 or a positive number",
                self.force_sd_n
            )));
        }
        Ok(Calibration {
            solid,
            force_sd_n: self.force_sd_n,
        })
    }
}

/// The keys of a file that holds the rubber alone.
///
/// # Errors
/// It is another one.
pub(crate) fn old_keys(text: &str) -> Result<RubberKeys, toml::de::Error> {
    toml::from_str(text)
}

/// Longest line of an error, bytes.
const LONGEST_SHOWN: usize = 200;

const HEAD: &str = "\
# Calibration of a tactile skin for `skin run --calibration FILE`.
# delayed_ratio: delayed over instant compliance. tau_s: time constant of the delayed part.
# exponent: relative rise of the resistivity = (strain / unit_rise_mpa) ^ exponent, strain as the pressure that makes it at
# once. With exponent 1, unit_rise_mpa is the force (N) of each mm2 of integrated rise.
# force_sd_n: standard deviation of a force told from one frame.
";

/// The text of a calibration file.
///
/// # Errors
/// What the format cannot hold, which no calibration has.
pub(crate) fn text(calibration: &Calibration, errors: Option<StandardErrors>) -> Result<String, toml::ser::Error> {
    let keys = RubberKeys::of(calibration, errors);
    Ok(format!("{HEAD}{}", toml::to_string(&keys)?))
}

/// What is wrong with a text, and where. The line itself is shown where it is no map's: those are thousands of characters long.
fn wrong(text: &str, error: &toml::de::Error) -> String {
    let whole = error.to_string().trim_end().to_owned();
    if whole.lines().all(|line| line.len() <= LONGEST_SHOWN) {
        return whole;
    }
    let before = error.span().map_or(0, |span| span.start).min(text.len());
    let line = 1 + text.as_bytes()[..before].iter().filter(|byte| **byte == b'\n').count();
    let cut = if text.ends_with('\n') {
        ""
    } else {
        "; the file seems to be cut off"
    };
    format!("line {line}: {}{cut}", error.message())
}

/// Reads a calibration; `file` is its name in messages.
///
/// # Errors
/// [`CalibrationFileError::Malformed`] with the line, or the parameter that no rubber has.
pub(crate) fn parse(file: &str, text: &str) -> Result<Calibration, CalibrationFileError> {
    let malformed = |message: String| CalibrationFileError::Malformed {
        file: file.to_owned(),
        message,
    };
    if text.trim().is_empty() {
        return Err(malformed("it is empty".to_owned()));
    }
    let message = |e: toml::de::Error| malformed(wrong(text, &e));
    let keys = match kind(text).as_deref() {
        Some(SKIN) => {
            #[derive(Deserialize)]
            struct Whole {
                rubber: Option<RubberKeys>,
            }
            let whole: Whole = toml::from_str(text).map_err(message)?;
            let none = "it holds no creep of the rubber, which skin calibrate adds from a press-and-hold";
            whole.rubber.ok_or_else(|| malformed(none.to_owned()))?
        }
        Some(PRESSES) => {
            let none = "it is a calibration from presses, which skin run and skin reconstruct use; the rubber's is needed here";
            return Err(malformed(none.to_owned()));
        }
        _ => old_keys(text).map_err(message)?,
    };
    keys.calibration(file)
}

/// Reads a calibration from a file.
///
/// # Errors
/// [`CalibrationFileError`] says what to do.
pub(crate) fn read(path: &Path) -> Result<Calibration, CalibrationFileError> {
    let file = path.display().to_string();
    match ::forward::whole::text(path) {
        Ok(text) => parse(&file, &text),
        Err(cause) => Err(CalibrationFileError::Io { file, cause }),
    }
}

/// Writes text into a file.
///
/// # Errors
/// [`CalibrationFileError::Io`].
pub(crate) fn write(path: &Path, text: &str) -> Result<(), CalibrationFileError> {
    replace(path, |file| file.write_all(text.as_bytes())).map_err(|cause| CalibrationFileError::Io {
        file: path.display().to_string(),
        cause,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read() {
        let calibration = Calibration {
            solid: Solid {
                delayed_ratio: 0.31,
                tau_s: 7.25,
                exponent: 1.0,
                unit_rise_mpa: 0.2546,
            },
            force_sd_n: 0.125,
        };
        let errors = StandardErrors {
            tau_s: 0.1,
            ..StandardErrors::default()
        };
        for errors in [None, Some(errors)] {
            assert_eq!(parse("c", &text(&calibration, errors).unwrap()).unwrap(), calibration);
        }
    }

    #[test]
    fn a_file_that_is_cut_off_is_told_without_its_lines() {
        let map = format!("kind = \"skin\"\n[presses]\nmap = [{}", "0.125, ".repeat(2000));
        let message = parse("c.toml", &map).unwrap_err().to_string();
        assert!(
            message.contains("line 3") && message.contains("cut off") && message.len() < 200,
            "{message}"
        );
        let empty = parse("c.toml", "\n").unwrap_err().to_string();
        assert!(empty.contains("it is empty"), "{empty}");
    }

    #[test]
    fn what_is_wrong_is_named_with_its_place() {
        let good = "delayed_ratio = 0.3\ntau_s = 5.0\nexponent = 1.0\nunit_rise_mpa = 0.25\nforce_sd_n = 0.1\n";
        parse("c.toml", good).unwrap();
        for (from, to, words) in [
            ("tau_s = 5.0", "tau_s = -5.0", ["c.toml", "tau_s is -5"]),
            ("tau_s = 5.0", "tau_ms = 5.0", ["line 2", "tau_ms"]),
            ("exponent = 1.0\n", "", ["exponent", "skin calibrate"]),
            ("0.25", "\"much\"", ["line 4", "string"]),
            (
                "force_sd_n = 0.1",
                "force_sd_n = nan",
                ["force_sd_n", "0 or a positive"],
            ),
        ] {
            let message = parse("c.toml", &good.replace(from, to)).unwrap_err().to_string();
            assert!(words.iter().all(|w| message.contains(w)), "{message}");
        }
    }
}
