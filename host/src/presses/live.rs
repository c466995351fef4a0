//! `skin run --calibration`: of the rubber's creep, or from presses at known places.

use super::file::{self, BetterModel, PressCalibration};
use super::{locate, store};
use crate::baselines;
use crate::files::calibration_file;
use crate::files::sheet_line::SheetLine;
use crate::recorded::CalibrationNote;
use crate::run_arguments::SourceArguments;
use crate::say::say;
use crate::usage::Usage;
use ::forward::{Pattern, Sheet};
use anyhow::{Result, bail};
use hil_sim::BOARD_NAME;
use inverse::force::meter::Calibration;
use inverse::reference::ToldSheet;
use link::Session;
use std::path::Path;
use std::sync::Arc;

/// What a session's calibration is.
#[derive(Default)]
pub(crate) struct Chosen {
    /// The rubber's, for forces.
    pub(crate) rubber: Option<Calibration>,
    /// What presses taught, where that takes the place of the model.
    pub(crate) learned: Option<PressCalibration>,
    /// What presses told of the model's sheet.
    pub(crate) told: Option<Arc<ToldSheet>>,
    /// What is told of it.
    pub(crate) note: Option<CalibrationNote>,
    /// The file and the sheet that it was made on, where that is known.
    made_on: Option<(String, Sheet)>,
    /// Whether one was asked for, or none: that of the board is not looked for then.
    asked: bool,
}

impl Chosen {
    /// Reads a calibration of any kind; `none` is none.
    ///
    /// # Errors
    /// It cannot be read, or it is asked for together with options of the model, whose place it takes.
    pub(crate) fn read(path: Option<&Path>, arguments: &SourceArguments) -> Result<Self> {
        match path {
            None => Ok(Self::default()),
            // Relative to a configuration file perhaps.
            Some(path) if path.file_name().is_some_and(|name| name == "none") && !path.exists() => Ok(Self {
                asked: true,
                ..Self::default()
            }),
            Some(path) => {
                let (chosen, said) = Self::of(path, arguments, false)?;
                said.iter().for_each(|text| say!("{text}"));
                Ok(chosen)
            }
        }
    }

    /// This one, or where nothing was said that which is stored for the board of a session, and the sheet that it was made on; with what is
    /// to be said of it. One that cannot be used is said, and left out. `sheet`: the one so far, and whether it was given.
    ///
    /// # Errors
    /// The sheet is another one than that of the calibration.
    pub(crate) fn or_stored(
        self,
        arguments: &SourceArguments,
        session: &Session,
        (sheet, is_given): (Sheet, bool),
    ) -> Result<(Self, Sheet, Vec<String>)> {
        // A simulated skin is simulated by now.
        let known = (is_given || session.hello().board == BOARD_NAME).then(|| sheet.clone());
        let (calibration, said) = self.stored(arguments, session, known.as_ref());
        let sheet = calibration.sheet(known)?.unwrap_or(sheet);
        Ok((calibration, sheet, said))
    }

    fn stored(self, arguments: &SourceArguments, session: &Session, given: Option<&Sheet>) -> (Self, Vec<String>) {
        let (hello, nothing) = (session.hello(), Vec::new());
        if self.asked {
            return (self, nothing);
        }
        let Some(folder) = baselines::folder(arguments.state_dir.as_deref(), hello) else {
            return (self, nothing);
        };
        let path = store::path(&folder, &hello.serial);
        if !path.exists() {
            return (self, nothing);
        }
        let stored = Self::of(&path, arguments, true).and_then(|(stored, said)| {
            stored.sheet(given.cloned())?;
            if let Some(learned) = &stored.learned {
                let pattern = Pattern::from_pairs(session.electrodes(), session.measurements())?;
                locate::found(learned, "the plan", pattern.measurements())?;
            }
            Ok((stored, said))
        });
        stored.unwrap_or_else(|why| {
            let why = format!("warning: the calibration that is stored for this board is not used: {why:#}");
            (self, vec![why])
        })
    }

    /// One of a file, with what is to be said where it is used.
    fn of(path: &Path, arguments: &SourceArguments, stored: bool) -> Result<(Self, Vec<String>)> {
        let mut said = Vec::new();
        let name = path.display().to_string();
        let note = |presses, force, creep| {
            Some(CalibrationNote {
                file: name.clone(),
                stored,
                presses,
                force,
                creep,
            })
        };
        let by_itself = if stored {
            "; --calibration none does without"
        } else {
            ""
        };
        if !file::is(path)? {
            let rubber = calibration_file::read(path)?;
            if stored {
                said.push(format!(
                    "calibration: {name}, stored for this board: the rubber's creep and force{by_itself}"
                ));
            }
            let chosen = Self {
                rubber: Some(rubber),
                note: note(None, true, true),
                made_on: file::made_on(path)?.map(|sheet| (name.clone(), sheet)),
                asked: true,
                learned: None,
                told: None,
            };
            return Ok((chosen, said));
        }
        let mut calibration = file::read(path)?;
        let rubber = calibration.rubber;
        let made_on = calibration.sheet.clone().map(|sheet| (name.clone(), sheet));
        if let Some(model) = calibration.better.take() {
            said.push(format!("calibration: {}{by_itself}", model_text(&name, &model)));
            let chosen = Self {
                note: note(None, rubber.is_some(), rubber.is_some()),
                made_on: Some((name.clone(), model.sheet)),
                rubber,
                asked: true,
                learned: None,
                told: model.told,
            };
            return Ok((chosen, said));
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
            said.push(format!(
                "notice: {name} was made from columns of changes: they have to be in volts, as the board's values are"
            ));
        }
        let of_board = if stored { ", stored for this board" } else { "" };
        let forces = match &calibration.gain {
            Some(_) => "with forces in newtons",
            None => "without forces: none were known",
        };
        said.push(format!(
            "calibration: {name}{of_board}, of {} presses, {:.1} mm median error; a touch's strength is over that of its usual press; {forces}{by_itself}",
            calibration.presses, calibration.error_mm
        ));
        let chosen = Self {
            rubber: None,
            note: note(Some(calibration.presses), calibration.gain.is_some(), false),
            made_on,
            learned: Some(calibration),
            told: None,
            asked: true,
        };
        Ok((chosen, said))
    }

    /// The sheet of a session for which perhaps one was given.
    ///
    /// # Errors
    /// It is another one than that of the calibration.
    pub(crate) fn sheet(&self, given: Option<Sheet>) -> Result<Option<Sheet>> {
        let Some((file, sheet)) = &self.made_on else {
            return Ok(given);
        };
        if let Some(given) = &given
            && let Some(difference) = SheetLine::of(sheet)?.differs(&SheetLine::of(given)?)
        {
            bail!(
                "{file}: it was made on another sheet than the one used: {difference}; calibrate on this sheet, or do without with --calibration none"
            );
        }
        Ok(Some(sheet.clone()))
    }
}

/// Says that the model is used.
pub(crate) fn model_text(file: &str, model: &BetterModel) -> String {
    let with = match model.told {
        Some(_) => ", with what they told of the sheet",
        None => "",
    };
    format!(
        "{file}: the sheet's model located its presses better than what they taught ({:.2} mm median error), and is used{with}",
        model.median_mm
    )
}
