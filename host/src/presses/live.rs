//! `skin run --calibration`: of the rubber's creep, or from presses at known places.

use super::file::{self, PressCalibration};
use crate::files::calibration_file;
use crate::files::sheet_line::SheetLine;
use crate::run_arguments::SourceArguments;
use crate::say::say;
use crate::usage::Usage;
use ::forward::Sheet;
use anyhow::{Result, bail};
use inverse::force::meter::Calibration;
use std::path::Path;

/// What a session's calibration is.
#[derive(Default)]
pub(crate) struct Chosen {
    /// The rubber's, for forces.
    pub(crate) rubber: Option<Calibration>,
    /// What presses taught, where that takes the place of the model.
    pub(crate) learned: Option<PressCalibration>,
    /// The file and the sheet of a model that located the presses better than what they taught.
    model: Option<(String, Sheet)>,
}

impl Chosen {
    /// Reads a calibration of either kind.
    ///
    /// # Errors
    /// It cannot be read, or it is asked for together with options of the model, whose place it takes.
    pub(crate) fn read(path: Option<&Path>, arguments: &SourceArguments) -> Result<Self> {
        let Some(path) = path else { return Ok(Self::default()) };
        if !file::is(path)? {
            return Ok(Self {
                rubber: Some(calibration_file::read(path)?),
                ..Self::default()
            });
        }
        let mut calibration = file::read(path)?;
        let file = &calibration.file;
        if let Some((sheet, median_mm)) = calibration.better.take() {
            say!("calibration: {}", model_text(file, median_mm));
            return Ok(Self {
                model: Some((calibration.file, sheet)),
                ..Self::default()
            });
        }
        let of_the_model = [
            (arguments.rise.is_some(), "--rise"),
            (arguments.trust_electrodes, "--trust-electrodes"),
            (!arguments.wires.is_empty(), "--wires"),
        ];
        let given: Vec<&str> = of_the_model
            .iter()
            .filter_map(|(given, name)| given.then_some(*name))
            .collect();
        if !given.is_empty() {
            let why = "a calibration from presses takes the place of the sheet's model; leave out";
            return Err(Usage(format!("{why} {}", given.join(", "))).into());
        }
        if calibration.difference {
            say!(
                "notice: {file} was made from columns of changes: they have to be in volts, as the board's values are"
            );
        }
        say!(
            "calibration: {file}, of {} presses, {:.1} mm median error; a touch's strength is over that of its usual press",
            calibration.presses,
            calibration.error_mm
        );
        Ok(Self {
            learned: Some(calibration),
            ..Self::default()
        })
    }

    /// The sheet of a session for which perhaps one was given.
    ///
    /// # Errors
    /// It is another one than that of the calibration.
    pub(crate) fn sheet(&self, given: Option<Sheet>) -> Result<Option<Sheet>> {
        let Some((file, sheet)) = &self.model else {
            return Ok(given);
        };
        if let Some(given) = &given
            && let Some(difference) = SheetLine::of(sheet)?.differs(&SheetLine::of(given)?)
        {
            bail!("{file}: it was made on another sheet than the one used: {difference}; calibrate on this sheet");
        }
        Ok(Some(sheet.clone()))
    }
}

/// Says that the model is used.
pub(crate) fn model_text(file: &str, median_mm: f64) -> String {
    format!(
        "{file}: the sheet's model located its presses better than what they taught ({median_mm:.2} mm median error), and is used"
    )
}
