//! The frames of a table, made ready to be reconstructed on a sheet.

use crate::files::measurements::MeasurementTable;
use crate::progress;
use crate::table_baseline::{BaselineArguments, Prepared};
use ::forward::{Drive, Pattern, Sheet};
use anyhow::Result;
use inverse::batch::{Batch, BatchOptions};
use inverse::force::meter::Calibration;
use inverse::reference::ToldSheet;
use inverse::reference::imager::Imager;
use inverse::solvers::Method;
use inverse::touches::polarity::Polarity;
use std::sync::Arc;

/// How a table is reconstructed.
pub(crate) struct How {
    /// How the sheet was driven.
    pub drive: Drive,
    /// How the picture is computed.
    pub method: Method,
    /// Which way touches change the resistivity; none where the frames say it.
    pub polarity: Option<Polarity>,
    /// Whether the electrodes are where the sheet says.
    pub trust_electrodes: bool,
    /// Time from a frame to the next, s; none where they have nothing to do with each other.
    pub frame_s: Option<f64>,
    /// What forces are computed with.
    pub calibration: Option<Calibration>,
    /// What presses told of the sheet.
    pub told: Option<Arc<ToldSheet>>,
}

impl How {
    /// As a table is reconstructed for which nothing is said.
    pub(crate) fn plain() -> Self {
        Self {
            drive: Drive::PAPER,
            method: Method::Nnls,
            polarity: None,
            trust_electrodes: false,
            frame_s: None,
            calibration: None,
            told: None,
        }
    }
}

/// A table's frames and what reconstructs them.
pub(crate) struct TableBatch<'a> {
    /// The frames to reconstruct, and what they are compared with.
    pub prepared: Prepared<'a>,
    imager: Arc<Imager>,
    options: BatchOptions,
}

impl<'a> TableBatch<'a> {
    /// Models a sheet with the measurements of a table, and looks for what its frames are compared with.
    ///
    /// # Errors
    /// A sheet that makes no sense, a frame that is not there.
    pub(crate) fn new(
        table: &'a MeasurementTable,
        (sheet, pattern, cell_mm): (&Sheet, Pattern, f64),
        baseline: &BaselineArguments,
        how: &How,
    ) -> Result<Self> {
        let mut imager = progress::meanwhile("modelling the sheet", || {
            Imager::for_method(how.method, sheet, how.drive, pattern, cell_mm)
        })?;
        imager.told.clone_from(&how.told);
        let prepared = baseline.prepare(table, &imager)?;
        let defaults = BatchOptions::of(how.method);
        let options = BatchOptions {
            polarity: how.polarity,
            drifts: prepared.drifts,
            find_electrodes: defaults.find_electrodes && prepared.measured && !how.trust_electrodes,
            interval_s: how.frame_s,
            calibration: how.calibration,
            noise_frames: if prepared.tells_noise {
                defaults.noise_frames
            } else {
                usize::MAX
            },
            ..defaults
        };
        Ok(Self {
            prepared,
            imager: Arc::new(imager),
            options,
        })
    }

    /// What reconstructs the frames, which takes the baseline.
    ///
    /// # Errors
    /// A baseline of another length.
    pub(crate) fn batch(&self) -> Result<Batch> {
        let unpressed: Vec<&[f64]> = self.prepared.unpressed.iter().map(AsRef::as_ref).collect();
        Ok(progress::meanwhile("inspecting the baseline", || {
            Batch::new(Arc::clone(&self.imager), &unpressed, self.options)
        })?)
    }
}
