//! The file of a calibration: TOML, with what was found for people and the numbers for the program. Presses, forces and the rubber's creep
//! are its parts, each of which may be missing.

mod of;

pub(crate) use of::Of;

use crate::files::baseline_file::unix_s;
use crate::files::calibration_file::{self, CalibrationFileError, PRESSES, RubberKeys, SKIN, kind};
use crate::files::replace::{replace, try_out};
use ::forward::file::{MOST_ELECTRODES, parse_sheet};
use ::forward::{Measurement, Pair, Sheet};
use inverse::force::meter::Calibration;
use inverse::learned::{Findings, Gain, Learned, LearnedSheet, Stored, StoredGain};
use inverse::reference::ToldSheet;
use of::{pattern_sha256, sha256};
use serde::{Deserialize, Serialize};
use std::io::{ErrorKind, Write};
use std::path::Path;
use std::sync::Arc;
use std::time::SystemTime;

/// The version that is written and read.
const VERSION: u32 = 4;
/// Versions before it, whose maps are not read; their other parts are.
const OTHER_MAPS: [u32; 2] = [2, 3];
/// Significant digits of the numbers; their uncertainty is far larger.
const DIGITS: usize = 7;

const HEAD: &str = "\
# Calibration of a tactile skin for `skin run --calibration FILE` and `skin reconstruct TABLE --calibration FILE`
# (docs/real-skins.md, \"One calibration\").
# [of]: what it was made on; hashes are SHA-256. [rubber]: creep, by `skin calibrate` (docs/creep.md).
# [force]: newtons of a press of the usual strength over the sheet. [presses]: maps, by `skin calibrate presses`;
# measurements are drive_a, drive_b, sense_a, sense_b of every value, electrodes from 1.
";

/// What people read in the file.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Found {
    presses: usize,
    explained: f64,
    error_median_mm: f64,
    error_95th_percentile_mm: f64,
    /// Which way round the electrodes are numbered; none where turned measurements do not respond alike.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    clockwise: Option<bool>,
    /// Rows of `measurements` without a value or a change, and rows that presses hardly explain, from 1.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    dead: Vec<usize>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    unexplained: Vec<usize>,
    /// Rows that hold what the press before did, from 1.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    stale: Vec<usize>,
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
    /// What the presses told of the sheet, where they did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub told: Option<ToldKeys>,
}

/// What presses told of the sheet of a model. The errors beside it are then those of each press by what the
/// others told.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ToldKeys {
    /// Distance at which the model locates the presses with nothing told, mm: median.
    pub untold_median_mm: f64,
    /// The same: 95th percentile.
    pub untold_95th_percentile_mm: f64,
    /// By how much it moves the presses, mm: root mean square.
    pub moved_mm: f64,
    /// The sheet as they told it.
    pub of_sheet: ToldSheet,
}

/// Maps and all that comes with them.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PressKeys {
    /// Whether it was made from columns that hold changes.
    difference: bool,
    electrodes: usize,
    measurements: Vec<[usize; 4]>,
    found: Found,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    model: Option<ModelKeys>,
    learned: Stored,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    kind: String,
    version: u32,
    #[serde(default)]
    of: Of,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    rubber: Option<RubberKeys>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    force: Option<StoredGain>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    presses: Option<PressKeys>,
}

impl Default for Keys {
    fn default() -> Self {
        Self {
            kind: SKIN.to_owned(),
            version: VERSION,
            of: Of::default(),
            rubber: None,
            force: None,
            presses: None,
        }
    }
}

impl Keys {
    /// `Err` says what is wrong with the text.
    fn parse(text: &str) -> Result<Self, String> {
        let message = |e: toml::de::Error| e.message().to_owned();
        // Once: maps are long.
        let table: toml::Table = toml::from_str(text).map_err(message)?;
        let number = table.get("version").ok_or("missing field `version`")?.as_integer();
        let version = number
            .and_then(|n| u32::try_from(n).ok())
            .ok_or("its version is no number of a version; calibrate anew")?;
        let of_presses_alone = table.get("kind").and_then(toml::Value::as_str) == Some(PRESSES);
        if of_presses_alone || OTHER_MAPS.contains(&version) && table.contains_key("presses") {
            return Err(
                "its presses are of an older program, whose maps are not read; calibrate anew from its table and its list of presses"
                    .to_owned(),
            );
        }
        if version != VERSION && !OTHER_MAPS.contains(&version) {
            return Err(format!(
                "version {version} is not known to this program, which reads {VERSION}; calibrate anew, or use the program that wrote it"
            ));
        }
        let mut keys: Self = table.try_into().map_err(message)?;
        if keys.kind != SKIN {
            return Err(format!("kind \"{}\" is no calibration", keys.kind));
        }
        keys.version = VERSION;
        Ok(keys)
    }

    fn text(&self) -> Result<String, toml::ser::Error> {
        Ok(format!("{HEAD}{}", toml::to_string(self)?))
    }
}

/// A model that locates presses better than what was learned.
pub(crate) struct BetterModel {
    /// Its sheet.
    pub sheet: Sheet,
    /// Median distance of the presses, mm.
    pub median_mm: f64,
    /// What they told of it.
    pub told: Option<Arc<ToldSheet>>,
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
    /// A model that locates the presses better.
    pub better: Option<BetterModel>,
    /// The sheet that it was made on, where that is known.
    pub sheet: Option<Sheet>,
    /// Newtons over the sheet, where forces were known.
    pub gain: Option<Arc<Gain>>,
    /// The rubber's creep, where the file has it too.
    pub rubber: Option<Calibration>,
}

impl PressCalibration {
    /// What it taught, for frames of a board.
    pub(crate) fn taught(&self) -> LearnedSheet {
        LearnedSheet {
            learned: Arc::clone(&self.learned),
            measurements: self.measurements.clone(),
            gain: self.gain.clone(),
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

/// What was learned from presses, to be put into a file.
pub(crate) struct Taught<'a> {
    pub learned: &'a Learned,
    pub found: &'a Findings,
    pub model: Option<&'a ModelKeys>,
    pub gain: Option<&'a Gain>,
    pub measurements: &'a [Measurement],
    pub electrodes: usize,
    pub difference: bool,
    pub of: Of,
}

impl Taught<'_> {
    fn keys(&self) -> PressKeys {
        let mut stored = self.learned.stored();
        let maps = &mut stored.maps;
        let lists = [
            &mut maps.shared,
            &mut maps.own,
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
        let found = self.found;
        let from_one = |list: &[usize]| list.iter().map(|k| k + 1).collect();
        PressKeys {
            difference: self.difference,
            electrodes: self.electrodes,
            measurements: self.measurements.iter().map(row).collect(),
            found: Found {
                presses: found.presses,
                explained: found.explained,
                error_median_mm: found.error_mm[0],
                error_95th_percentile_mm: found.error_mm[1],
                clockwise: found.shared.then_some(found.clockwise),
                dead: from_one(&found.dead),
                unexplained: from_one(&found.unexplained),
                stale: from_one(&found.stale),
            },
            model: self.model.cloned(),
            learned: stored,
        }
    }
}

/// The keys of a file that parts are put into: those that are there, or none. A file of the rubber alone, as older programs wrote it, counts as one.
fn there(path: &Path) -> Result<Keys, CalibrationFileError> {
    let file = path.display().to_string();
    let text = match ::forward::whole::text(path) {
        Ok(text) => text,
        Err(cause) if cause.kind() == ErrorKind::NotFound => return Ok(Keys::default()),
        Err(cause) => return Err(CalibrationFileError::Io { file, cause }),
    };
    if let Ok(rubber) = calibration_file::old_keys(&text) {
        return Ok(Keys {
            rubber: Some(rubber),
            ..Keys::default()
        });
    }
    Keys::parse(&text).map_err(|message| CalibrationFileError::Malformed {
        file,
        message: format!(
            "{message}; it stands where the calibration is to be written: remove it, or write elsewhere with --out"
        ),
    })
}

/// Whether a file that parts are to be put into holds presses already.
///
/// # Errors
/// It cannot be read or written, or is no calibration.
pub(crate) fn holds_presses(path: &Path) -> Result<bool, CalibrationFileError> {
    let keys = there(path)?;
    try_out(path).map_err(|cause| CalibrationFileError::Io {
        file: path.display().to_string(),
        cause,
    })?;
    Ok(keys.presses.is_some())
}

fn replaced(path: &Path, keys: &Keys) -> Result<(), CalibrationFileError> {
    let malformed = |e: toml::ser::Error| CalibrationFileError::Malformed {
        file: path.display().to_string(),
        message: e.to_string(),
    };
    write(path, &keys.text().map_err(malformed)?)
}

/// A file of what presses taught alone, as text.
///
/// # Errors
/// What the format cannot hold.
pub(crate) fn text(taught: &Taught<'_>) -> Result<String, toml::ser::Error> {
    let keys = Keys {
        of: taught.of.clone(),
        force: taught.gain.map(|gain| gain.stored().clone()),
        presses: Some(taught.keys()),
        ..Keys::default()
    };
    keys.text()
}

/// Puts what presses taught into a file, beside the rubber's creep where it holds that; whether it does.
///
/// # Errors
/// The file cannot be read or written, or holds the creep of another sheet or board.
pub(crate) fn put_presses(path: &Path, taught: &Taught<'_>) -> Result<bool, CalibrationFileError> {
    let mut keys = there(path)?;
    if keys.rubber.is_some()
        && let Some(what) = another(&keys.of, &taught.of)
    {
        return Err(CalibrationFileError::Malformed {
            file: path.display().to_string(),
            message: format!("it holds the rubber's creep of another {what}; write elsewhere with --out"),
        });
    }
    keys.of = Of {
        board: taught.of.board.clone().or(keys.of.board),
        serial: taught.of.serial.clone().or(keys.of.serial),
        made_unix_s: Some(unix_s(SystemTime::now()).round()),
        ..taught.of.clone()
    };
    keys.force = taught.gain.map(|gain| gain.stored().clone());
    keys.presses = Some(taught.keys());
    replaced(path, &keys)?;
    Ok(keys.rubber.is_some())
}

/// Puts the rubber's creep into a file, beside what presses taught where it holds that; whether it does.
///
/// # Errors
/// The file cannot be read or written, or holds presses on another sheet or board.
pub(crate) fn put_rubber(path: &Path, rubber: RubberKeys, of: Of) -> Result<bool, CalibrationFileError> {
    let mut keys = there(path)?;
    if keys.presses.is_some()
        && let Some(what) = another(&keys.of, &of)
    {
        return Err(CalibrationFileError::Malformed {
            file: path.display().to_string(),
            message: format!("it holds presses on another {what}; write elsewhere with --out"),
        });
    }
    if keys.presses.is_none() {
        keys.of = Of {
            made_unix_s: Some(unix_s(SystemTime::now()).round()),
            ..of
        };
    }
    keys.rubber = Some(rubber);
    replaced(path, &keys)?;
    Ok(keys.presses.is_some())
}

/// What two calibrations were made on that is not the same, as far as both say it.
fn another(a: &Of, b: &Of) -> Option<&'static str> {
    let differ = |a: &Option<String>, b: &Option<String>| matches!((a, b), (Some(a), Some(b)) if a != b);
    if differ(&a.sheet_sha256, &b.sheet_sha256) {
        return Some("sheet");
    }
    differ(&a.serial, &b.serial).then_some("board")
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

/// Whether a file holds what presses taught.
///
/// # Errors
/// It cannot be read.
pub(crate) fn is(path: &Path) -> Result<bool, CalibrationFileError> {
    let file = path.display().to_string();
    let text = ::forward::whole::text(path).map_err(|cause| CalibrationFileError::Io { file, cause })?;
    Ok(match kind(&text).as_deref() {
        Some(PRESSES) => true,
        Some(SKIN) => toml::from_str::<toml::Table>(&text).is_ok_and(|table| table.contains_key("presses")),
        _ => false,
    })
}

/// The sheet that a calibration was made on, where the file tells it.
///
/// # Errors
/// [`CalibrationFileError`] says what to do.
pub(crate) fn made_on(path: &Path) -> Result<Option<Sheet>, CalibrationFileError> {
    let file = path.display().to_string();
    let text = match ::forward::whole::text(path) {
        Ok(text) => text,
        Err(cause) => return Err(CalibrationFileError::Io { file, cause }),
    };
    let malformed = |message: String| CalibrationFileError::Malformed {
        file: file.clone(),
        message,
    };
    if kind(&text).as_deref() != Some(SKIN) {
        return Ok(None);
    }
    let keys = Keys::parse(&text).map_err(malformed)?;
    let sheet = keys
        .of
        .sheet
        .as_ref()
        .map(|text| parse_sheet(text).map(|(sheet, _)| sheet));
    sheet.transpose().map_err(|e| malformed(format!("its sheet: {e}")))
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
    let whole = Keys::parse(&text).map_err(malformed)?;
    let keys = whole
        .presses
        .ok_or_else(|| malformed("it holds no presses, which skin calibrate presses adds".to_owned()))?;
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
    let better = keys.model.filter(|model| model.better);
    if better
        .as_ref()
        .and_then(|model| model.told.as_ref())
        .is_some_and(|told| !told.of_sheet.is_sound())
    {
        return Err(malformed(
            "what presses told of the sheet: its numbers do not fit one another; calibrate anew".to_owned(),
        ));
    }
    let better = better
        .map(|model| {
            parse_sheet(&model.sheet).map(|(sheet, _)| BetterModel {
                sheet,
                median_mm: model.error_median_mm,
                told: model.told.map(|told| Arc::new(told.of_sheet)),
            })
        })
        .transpose()
        .map_err(|e| malformed(format!("its sheet: {e}")))?;
    let of_pattern = whole.of.pattern_sha256.as_ref();
    if of_pattern.is_some_and(|sha| *sha != pattern_sha256(&measurements)) {
        return Err(malformed(
            "its measurements are not those of its pattern_sha256: it was changed; calibrate anew".to_owned(),
        ));
    }
    let of_sheet = whole.of.sheet_sha256.as_ref().zip(whole.of.sheet.as_deref());
    if of_sheet.is_some_and(|(sha, sheet)| *sha != sha256(sheet)) {
        return Err(malformed(
            "its sheet is not that of its sheet_sha256: it was changed; calibrate anew".to_owned(),
        ));
    }
    let parsed = |text: &String| parse_sheet(text).map(|(sheet, _)| sheet);
    let sheet = whole.of.sheet.as_ref().map(parsed).transpose();
    let sheet = sheet.map_err(|e| malformed(format!("its sheet: {e}")))?;
    let gain = match &whole.force {
        Some(stored) => {
            let gain = Gain::restore(stored);
            Some(Arc::new(gain.ok_or_else(|| {
                malformed("[force]: its numbers do not fit one another".to_owned())
            })?))
        }
        None => None,
    };
    let rubber = whole.rubber.map(|keys| keys.calibration(&file)).transpose()?;
    Ok(PressCalibration {
        better,
        sheet,
        gain,
        rubber,
        file,
        text,
        learned: Arc::new(learned),
        measurements,
        difference: keys.difference,
        presses: keys.found.presses,
        error_mm: keys.found.error_median_mm,
    })
}

#[cfg(test)]
mod tests;
