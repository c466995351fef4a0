//! The file of a calibration from presses: TOML, with what was found for people and the numbers for the program.

use crate::files::calibration_file::{CalibrationFileError, PRESSES, kind};
use crate::files::replace::replace;
use ::forward::file::{MOST_ELECTRODES, parse_sheet};
use ::forward::{Measurement, Pair, Sheet};
use inverse::learned::{Findings, Learned, LearnedSheet, Stored};
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

/// The version that is written and read.
const VERSION: u32 = 1;
/// Significant digits of the numbers; their uncertainty is far larger.
const DIGITS: usize = 7;

const HEAD: &str = "\
# Calibration of a tactile skin from presses at known places, for `skin run --calibration FILE` and
# `skin reconstruct TABLE --calibration FILE`.
# measurements: drive_a, drive_b, sense_a, sense_b of every value that it was made with; electrodes count from 1.
# [found] says what was found, [model] how well the sheet's model locates the same presses. [learned] holds the maps
# (docs/real-skins.md).
";

/// What people read in the file.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Found {
    presses: usize,
    explained: f64,
    error_median_mm: f64,
    error_95th_percentile_mm: f64,
}

/// The sheet's model beside what was learned.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ModelKeys {
    /// Distance at which it locates the same presses, mm: median.
    pub error_median_mm: f64,
    /// The same: 95th percentile.
    pub error_95th_percentile_mm: f64,
    /// Whether it locates them better than what was learned, so that it is used.
    pub better: bool,
    /// The sheet, as a file of its own.
    pub sheet: String,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    kind: String,
    version: u32,
    /// Whether it was made from columns that hold changes.
    difference: bool,
    electrodes: usize,
    measurements: Vec<[usize; 4]>,
    found: Found,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    model: Option<ModelKeys>,
    learned: Stored,
}

/// A calibration from presses.
pub(crate) struct PressCalibration {
    /// The file it was read from.
    pub file: String,
    /// Its text.
    pub text: String,
    /// What locates presses.
    pub learned: Arc<Learned>,
    /// The measurements that a frame's values are of, in this order.
    pub measurements: Vec<Measurement>,
    /// Whether it was made from columns that hold changes.
    pub difference: bool,
    /// Presses that it was made of.
    pub presses: usize,
    /// Median distance of presses that were not learned from to where they are located, mm.
    pub error_mm: f64,
    /// The sheet of a model that locates the presses better, with the median distance of these, mm.
    pub better: Option<(Sheet, f64)>,
}

impl PressCalibration {
    /// What it taught, for frames of a board.
    pub(crate) fn taught(&self) -> LearnedSheet {
        LearnedSheet {
            learned: Arc::clone(&self.learned),
            measurements: self.measurements.clone(),
        }
    }
}

fn row(m: &Measurement) -> [usize; 4] {
    [m.drive.plus, m.drive.minus, m.sense.minus, m.sense.plus].map(|e| e + 1)
}

fn shortened(value: &mut f64) {
    if let Ok(short) = format!("{value:.*e}", DIGITS - 1).parse() {
        *value = short;
    }
}

/// The text of such a file.
///
/// # Errors
/// What the format cannot hold, which no calibration has.
pub(crate) fn text(
    learned: &Learned,
    found: &Findings,
    model: Option<&ModelKeys>,
    (measurements, electrodes): (&[Measurement], usize),
    difference: bool,
) -> Result<String, toml::ser::Error> {
    let mut stored = learned.stored();
    let maps = &mut stored.maps;
    let lists = [
        &mut maps.shared,
        &mut maps.own,
        &mut maps.memory,
        &mut maps.spread,
        &mut stored.covariance,
    ];
    lists.into_iter().flatten().flatten().for_each(shortened);
    maps.scale.iter_mut().chain(&mut maps.gains).for_each(shortened);
    if let Some(correction) = &mut stored.correction {
        let ridge = &mut correction.ridge;
        ridge.known.iter_mut().flatten().for_each(shortened);
        ridge.weights.iter_mut().flatten().for_each(shortened);
        ridge.scale.iter_mut().for_each(shortened);
    }
    let keys = Keys {
        kind: PRESSES.to_owned(),
        version: VERSION,
        difference,
        electrodes,
        measurements: measurements.iter().map(row).collect(),
        found: Found {
            presses: found.presses,
            explained: found.explained,
            error_median_mm: found.error_mm[0],
            error_95th_percentile_mm: found.error_mm[1],
        },
        model: model.cloned(),
        learned: stored,
    };
    Ok(format!("{HEAD}{}", toml::to_string(&keys)?))
}

/// Writes it in place of what was there, as a whole or not at all.
///
/// # Errors
/// [`CalibrationFileError::Io`].
pub(crate) fn write(path: &Path, text: &str) -> Result<(), CalibrationFileError> {
    replace(path, |file| file.write_all(text.as_bytes())).map_err(|cause| CalibrationFileError::Io {
        file: path.display().to_string(),
        cause,
    })
}

/// Whether a file says that it is of this kind.
///
/// # Errors
/// It cannot be read.
pub(crate) fn is(path: &Path) -> Result<bool, CalibrationFileError> {
    let file = path.display().to_string();
    let text = ::forward::whole::text(path).map_err(|cause| CalibrationFileError::Io { file, cause })?;
    Ok(kind(&text).as_deref() == Some(PRESSES))
}

/// Reads one.
///
/// # Errors
/// [`CalibrationFileError`] says what to do.
pub(crate) fn read(path: &Path) -> Result<PressCalibration, CalibrationFileError> {
    let file = path.display().to_string();
    match ::forward::whole::text(path) {
        Ok(text) => parse(file, text),
        Err(cause) => Err(CalibrationFileError::Io { file, cause }),
    }
}

/// Reads the text of one; `file` is its name in messages.
///
/// # Errors
/// [`CalibrationFileError`] says what to do.
pub(crate) fn parse(file: String, text: String) -> Result<PressCalibration, CalibrationFileError> {
    let malformed = |message: String| CalibrationFileError::Malformed {
        file: file.clone(),
        message,
    };
    let keys: Keys = toml::from_str(&text).map_err(|e| malformed(e.message().to_owned()))?;
    if keys.version != VERSION {
        let message = format!(
            "version {} is not known to this program, which reads {VERSION}",
            keys.version
        );
        return Err(malformed(message));
    }
    if keys.electrodes > MOST_ELECTRODES {
        let message = format!(
            "{} electrodes are more than the {MOST_ELECTRODES} a skin may have",
            keys.electrodes
        );
        return Err(malformed(message));
    }
    let told = keys.model.as_ref().map_or(0.0, |model| model.error_median_mm);
    if ![keys.found.error_median_mm, told].iter().all(|mm| mm.is_finite()) {
        return Err(malformed("an error of it is no number".to_owned()));
    }
    let inside = |e: &usize| (1..=keys.electrodes).contains(e);
    let measurements = keys
        .measurements
        .iter()
        .map(|row| {
            let [a, b, minus, plus] = row.iter().all(inside).then(|| row.map(|e| e - 1))?;
            Some(Measurement {
                drive: Pair::new(a, b),
                sense: Pair::new(plus, minus),
            })
        })
        .collect::<Option<Vec<_>>>()
        .ok_or_else(|| malformed("a measurement names an electrode that is not there".to_owned()))?;
    let learned =
        Learned::restore(&keys.learned, &measurements, keys.electrodes).map_err(|e| malformed(e.to_string()))?;
    let better = (keys.model.filter(|model| model.better))
        .map(|model| parse_sheet(&model.sheet).map(|(sheet, _)| (sheet, model.error_median_mm)))
        .transpose()
        .map_err(|e| malformed(format!("its sheet: {e}")))?;
    Ok(PressCalibration {
        file,
        text,
        better,
        learned: Arc::new(learned),
        measurements,
        difference: keys.difference,
        presses: keys.found.presses,
        error_mm: keys.found.error_median_mm,
    })
}
