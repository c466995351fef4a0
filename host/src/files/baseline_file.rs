//! A stored baseline: TOML with a unit in every key, in a folder with one file for each board.

use crate::files::replace::replace;
use ::forward::Sheet;
use inverse::reference::baseline::Baseline;
use protocol::{Hello, Plan};
use serde::{Deserialize, Serialize};
use std::fmt::{Debug, Write as _};
use std::io::{self, ErrorKind, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use thiserror::Error;

/// Why a stored baseline cannot be used.
#[derive(Debug, Error)]
pub(crate) enum BaselineFileError {
    /// There is none.
    #[error(
        "{file}: no baseline of this board is stored; start once with nothing on the sheet, without --baseline stored"
    )]
    Missing {
        /// The file.
        file: String,
    },
    /// It cannot be read.
    #[error("{file}: {cause}; check the permissions")]
    Io {
        /// The file.
        file: String,
        /// What the system said.
        cause: io::Error,
    },
    /// It is not a baseline.
    #[error("{file}: {message}\nremove it, and start once with nothing on the sheet")]
    Malformed {
        /// The file.
        file: String,
        /// What is wrong.
        message: String,
    },
    /// It is of something else.
    #[error(
        "{file}: the stored baseline is of {what}; start once with nothing on the sheet, without --baseline stored"
    )]
    Other {
        /// The file.
        file: String,
        /// Of what, and what is there now.
        what: String,
    },
}

/// What a baseline belongs to: a board, a sheet and a plan.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Subject {
    board: String,
    serial: String,
    electrodes: usize,
    values: usize,
    /// Hashes.
    sheet: String,
    plan: String,
}

impl Subject {
    /// What is measured now.
    pub(crate) fn new(hello: &Hello, sheet: &Sheet, plan: &Plan) -> Self {
        Self {
            board: hello.board.to_string(),
            serial: hello.serial.to_string(),
            electrodes: hello.electrodes.into(),
            values: plan.value_count(),
            sheet: hash(sheet),
            plan: hash(plan),
        }
    }

    /// What another one is of that this one is not.
    fn difference(&self, other: &Self) -> Option<String> {
        if (&self.board, &self.serial) != (&other.board, &other.serial) {
            return Some(format!(
                "the board {} {}, not of {} {}",
                other.board, other.serial, self.board, self.serial
            ));
        }
        if self.electrodes != other.electrodes {
            return Some(format!(
                "{} electrodes, the board has {}",
                other.electrodes, self.electrodes
            ));
        }
        if self.sheet != other.sheet {
            return Some("another sheet than --sheet describes now".to_owned());
        }
        if (self.values, &self.plan) != (other.values, &other.plan) {
            return Some(format!(
                "another plan: {} values in a frame, {} now; choose that plan with --plan, or",
                other.values, self.values
            ));
        }
        None
    }
}

/// FNV-1a (Fowler, Noll, Vo) of what a value shows of itself: numbers are written out in full.
fn hash(value: &impl Debug) -> String {
    let step = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
    let hash = format!("{value:?}").bytes().fold(0xcbf2_9ce4_8422_2325, step);
    format!("{hash:016x}")
}

/// The keys of the file.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    /// s since 1970 (UTC).
    taken_unix_s: f64,
    frames: usize,
    noise_v: f64,
    values_v: Vec<f64>,
    value_noise_v: Vec<f64>,
    of: Subject,
}

const HEAD: &str = "\
# The last good baseline of a board, written by skin for `skin run --baseline stored`.
# values_v: mean of every value; value_noise_v: its standard deviation in one frame; noise_v: the same over all values.
";

/// A baseline and when it was taken.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Stored {
    pub(crate) baseline: Baseline,
    pub(crate) taken: SystemTime,
}

/// The file of a board in a folder. Letters, digits and hyphens of the serial are in its name, all else as its code.
pub(crate) fn path(folder: &Path, subject: &Subject) -> PathBuf {
    let mut name = "baseline-".to_owned();
    for byte in format!("{}-{}", subject.board, subject.serial).bytes() {
        if byte.is_ascii_alphanumeric() || byte == b'-' {
            name.push(byte.into());
        } else {
            // Writing to a text cannot fail.
            let _ = write!(name, "_{byte:02x}");
        }
    }
    folder.join(name + ".toml")
}

/// Stores a baseline in the place of the one before, which stays where that fails.
///
/// # Errors
/// What the system said.
pub(crate) fn write(path: &Path, subject: &Subject, stored: &Stored) -> io::Result<()> {
    let text = text(subject, stored).map_err(|e| io::Error::new(ErrorKind::InvalidData, e))?;
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder)?;
    }
    replace(path, |file| file.write_all(text.as_bytes()))
}

/// The text of a file.
fn text(subject: &Subject, stored: &Stored) -> Result<String, toml::ser::Error> {
    let keys = Keys {
        taken_unix_s: unix_s(stored.taken),
        frames: stored.baseline.frames,
        noise_v: stored.baseline.noise_v,
        values_v: stored.baseline.values_v.clone(),
        value_noise_v: stored.baseline.value_noise_v(),
        of: subject.clone(),
    };
    Ok(format!("{HEAD}{}", toml::to_string(&keys)?))
}

/// Reads the baseline of a board.
///
/// # Errors
/// [`BaselineFileError`] says what to do.
pub(crate) fn read(path: &Path, subject: &Subject) -> Result<Stored, BaselineFileError> {
    let file = path.display().to_string();
    match ::forward::whole::text(path) {
        Ok(text) => parse(&file, &text, subject),
        Err(e) if e.kind() == ErrorKind::NotFound => Err(BaselineFileError::Missing { file }),
        Err(cause) => Err(BaselineFileError::Io { file, cause }),
    }
}

/// The same from text; `file` is its name in messages.
///
/// # Errors
/// As for [`read`].
pub(crate) fn parse(file: &str, text: &str, subject: &Subject) -> Result<Stored, BaselineFileError> {
    let malformed = |message: String| BaselineFileError::Malformed {
        file: file.to_owned(),
        message,
    };
    let keys: Keys = toml::from_str(text).map_err(|e| malformed(e.to_string().trim_end().to_owned()))?;
    if let Some(what) = subject.difference(&keys.of) {
        let file = file.to_owned();
        return Err(BaselineFileError::Other { file, what });
    }
    if keys.values_v.len() != subject.values || keys.value_noise_v.len() != subject.values {
        return Err(malformed(format!(
            "{} values and {} noises for a plan of {}",
            keys.values_v.len(),
            keys.value_noise_v.len(),
            subject.values
        )));
    }
    // What is missing is NaN; nothing is infinite, and no noise is negative.
    let wild = |v: &f64| v.is_infinite();
    if keys.values_v.iter().any(wild) || keys.value_noise_v.iter().any(|v| wild(v) || *v < 0.0) {
        return Err(malformed("a value or a noise that no board measures".to_owned()));
    }
    let taken = Duration::try_from_secs_f64(keys.taken_unix_s)
        .ok()
        .and_then(|since| UNIX_EPOCH.checked_add(since))
        .ok_or_else(|| malformed(format!("taken_unix_s is {}", keys.taken_unix_s)))?;
    if !(keys.frames >= 2 && keys.noise_v >= 0.0 && keys.noise_v.is_finite()) {
        return Err(malformed(format!(
            "{} frames with a noise of {} V",
            keys.frames, keys.noise_v
        )));
    }
    Ok(Stored {
        baseline: Baseline {
            values_v: keys.values_v,
            noise_v: keys.noise_v,
            deviations: Baseline::deviations_of(&keys.value_noise_v, keys.frames),
            frames: keys.frames,
            unlike: 0,
            moved: 0.0,
        },
        taken,
    })
}

/// Seconds since 1970 (UTC); 0 for a clock that was never set.
pub(crate) fn unix_s(time: SystemTime) -> f64 {
    time.duration_since(UNIX_EPOCH).map_or(0.0, |d| d.as_secs_f64())
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A file and whose it is.
    pub(crate) fn sample() -> (Subject, String) {
        (subject(), text(&subject(), &stored()).unwrap())
    }

    fn subject() -> Subject {
        Subject {
            board: "skin-sim".to_owned(),
            serial: "sim".to_owned(),
            electrodes: 16,
            values: 3,
            sheet: "0".to_owned(),
            plan: "1".to_owned(),
        }
    }

    fn stored() -> Stored {
        Stored {
            baseline: Baseline {
                values_v: vec![0.1, f64::NAN, 1.0 / 3.0],
                noise_v: 1e-3,
                deviations: Baseline::deviations_of(&[1e-3, f64::NAN, 2e-3], 24),
                frames: 24,
                unlike: 0,
                moved: 0.0,
            },
            taken: UNIX_EPOCH + Duration::from_millis(1_700_000_000_250),
        }
    }

    #[test]
    fn what_is_written_is_read_to_the_last_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = path(&folder.path().join("new"), &subject());
        write(&path, &subject(), &stored()).unwrap();
        let read = read(&path, &subject()).unwrap();
        // Not a number is not equal to itself, but shows itself alike.
        assert_eq!(format!("{read:?}"), format!("{:?}", stored()));
    }

    #[test]
    fn a_baseline_of_something_else_is_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = path(folder.path(), &subject());
        assert!(matches!(
            read(&path, &subject()),
            Err(BaselineFileError::Missing { .. })
        ));
        write(&path, &subject(), &stored()).unwrap();
        type Change = fn(&mut Subject);
        let cases: [(&str, Change); 4] = [
            ("the board skin-sim", |s| s.serial = "other".to_owned()),
            ("the board has 8", |s| s.electrodes = 8),
            ("another sheet", |s| s.sheet = "7".to_owned()),
            ("another plan", |s| s.plan = "7".to_owned()),
        ];
        for (says, change) in cases {
            let mut other = subject();
            change(&mut other);
            let error = read(&path, &other).unwrap_err().to_string();
            assert!(error.contains(says) && error.contains("start once"), "{error}");
        }
        for damage in ["", "taken_unix_s = 1", "nonsense ="] {
            std::fs::write(&path, damage).unwrap();
            assert!(matches!(
                read(&path, &subject()),
                Err(BaselineFileError::Malformed { .. })
            ));
        }
    }

    #[test]
    fn no_serial_leaves_the_folder() {
        let mut subject = subject();
        subject.serial = "../../etc/x".to_owned();
        let path = path(Path::new("/state"), &subject);
        assert_eq!(
            path,
            Path::new("/state/baseline-skin-sim-_2e_2e_2f_2e_2e_2fetc_2fx.toml")
        );
    }
}
