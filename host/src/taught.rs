//! Calibrations from presses for whoever has frames in memory: learned, read, written, and what they locate. `skin calibrate
//! presses` and `skin reconstruct --calibration` do the same with tables.

use crate::presses::extent::Extent;
use crate::presses::file::{self, PressCalibration};
use crate::presses::locate::found;
use ::forward::{Measurement, Sheet};
use anyhow::{Result, bail};
use inverse::learned::{Findings, Order, Presence, Press, Setting, learn, turn};
use std::path::Path;

/// A calibration from presses.
pub struct Taught(PressCalibration);

/// What the values of a frame are, and the sheet that they are of.
#[derive(Clone, Copy, Debug)]
pub struct Frames<'a> {
    /// The measurements of a frame's values, in their order.
    pub measurements: &'a [Measurement],
    /// The sheet, which says by what turns it is mapped onto itself.
    pub sheet: &'a Sheet,
}

impl Taught {
    /// Learns from presses in order of time. `difference`: their changes were given as such, and not as frames with one before each.
    /// The sheet's model is not tried beside what is learned.
    ///
    /// # Errors
    /// Too few presses, presses without a change, a sheet that makes no sense.
    pub fn learn(frames: Frames<'_>, presses: &[Press], difference: bool) -> Result<(Self, Findings)> {
        let setting = Setting {
            measurements: frames.measurements,
            electrodes: frames.sheet.electrodes.len(),
            turn: turn(frames.sheet)?,
            extent: Extent::of(frames.sheet)?.of_sheet(),
        };
        let (learned, found) = learn(presses, &setting, |_, _| {})?;
        // Read again: what a file holds is what locates, digits cut and all.
        let text = file::text(&file::Taught {
            learned: &learned,
            found: &found,
            model: None,
            gain: None,
            measurements: setting.measurements,
            electrodes: setting.electrodes,
            difference,
            of: file::Of::new(Some(frames.sheet), setting.measurements)?,
        })?;
        Ok((Self(file::parse("the calibration".to_owned(), text)?), found))
    }

    /// Reads a file of `skin calibrate presses`.
    ///
    /// # Errors
    /// It cannot be read, is none, or says that the sheet's model is better than what was learned.
    pub fn read(path: &Path) -> Result<Self> {
        let read = file::read(path)?;
        if read.better.is_some() {
            bail!(
                "{}: it says that the sheet's model locates better than what was learned; reconstruct the frames with the sheet instead",
                read.file
            );
        }
        Ok(Self(read))
    }

    /// Writes it as a file, in place of what was there.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        Ok(file::write(path, &self.0.text)?)
    }

    /// The measurements of a frame's values that it was made with, in their order.
    pub fn measurements(&self) -> &[Measurement] {
        &self.0.measurements
    }

    /// Presses that it was made of.
    pub fn presses(&self) -> usize {
        self.0.presses
    }

    /// Median distance of presses that were not learned from to where they are located, mm.
    pub fn error_mm(&self) -> f64 {
        self.0.error_mm
    }

    /// Where its measurements are among others, and in words which are not.
    ///
    /// # Errors
    /// Fewer than half of them are there.
    pub fn order(&self, among: &[Measurement]) -> Result<(Order, Option<String>)> {
        found(&self.0, "the frames", among)
    }

    /// The presses of a frame: its change in the measurements' own order, and the place of the press before where it is known.
    pub fn locate(&self, change: &[f64], before_mm: Option<[f64; 2]>) -> Presence {
        self.0.learned.locate(change, before_mm)
    }
}
