//! The experiments of the source paper again: Kato, Hayakawa, Mukai and others, "Tactile sensor without wire and
//! sensing element in the tactile region using EIT method". They are measured on the skin that a [`rig`] mounts, and
//! reported as one page and as numbers.

mod chart;
pub mod gradients;
mod map;
mod methods;
pub mod noise;
mod page;
pub mod reach;
pub mod recorded;
mod recorded_page;
pub mod rig;
pub mod simulated_rig;
pub mod touches;
pub mod tracking;

pub use crate::paper::map::Map;

use crate::error::StudyError;
use crate::paper::rig::{Rig, RigError};
use forward::{CellError, ForwardError, PatternError};
use inverse::force::calibration::CalibrationError;
use inverse::reference::imager::ImagerError;
use link::LinkError;
use protocol::PlanError;
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};
use thiserror::Error;
use view::canvas::ImageError;
use view::picture::PictureError;

/// Extent and seed of the experiments.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Options {
    /// Whether only a tenth of the frames is measured, for a quick look.
    pub quick: bool,
    /// Seed of all noise.
    pub seed: u64,
}

/// Why the experiments fail.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PaperError {
    /// The skin.
    #[error("there is no skin to measure: {0}")]
    Rig(RigError),
    /// Its board.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// A run without its baseline.
    #[error(
        "fewer than two frames of the unpressed sheet are known; take a recording that has the frames of its baseline"
    )]
    NoBaseline,
    /// The board stopped sending.
    #[error("the board sent too few frames; look at its link")]
    Silent,
    /// A plan.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The reconstruction.
    #[error(transparent)]
    Study(#[from] StudyError),
    /// The cells of the gradients.
    #[error(transparent)]
    Cells(#[from] CellError),
    /// The press-and-hold.
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
    /// A picture.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// The report's files.
    #[error("cannot write {file}: {cause}; check that the folder may be written to")]
    Write {
        /// The file.
        file: String,
        /// The error of the system.
        cause: std::io::Error,
    },
    /// A thread of the experiments ended early.
    #[error("an experiment was cut short")]
    CutShort,
}

macro_rules! by_way_of_study {
    ($($kind:ty),*) => {$(
        impl From<$kind> for PaperError {
            fn from(error: $kind) -> Self {
                Self::Study(error.into())
            }
        }
    )*};
}
by_way_of_study!(ForwardError, ImagerError, PictureError, PatternError);

impl From<forward::GeometryError> for PaperError {
    fn from(error: forward::GeometryError) -> Self {
        ForwardError::from(error).into()
    }
}

impl From<RigError> for PaperError {
    fn from(error: RigError) -> Self {
        Self::Rig(error)
    }
}

/// Everything that was measured.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Extent and seed.
    pub options: Options,
    /// Fig. 4.
    pub gradients: Vec<gradients::Gradient>,
    /// Figs. 7 and 8.
    pub touches: touches::Touches,
    /// Figs. 10 and 11.
    pub tracking: tracking::Tracking,
    /// Signal to noise, and time.
    pub ways: Vec<noise::Way>,
    /// Two touches, and the position over the sheet.
    pub reach: reach::Reach,
}

/// Runs all experiments; `progress` is called with the name of each before it begins.
///
/// # Errors
/// [`PaperError`] of the first experiment that fails.
pub fn run(rig: &dyn Rig, options: Options, progress: &(dyn Fn(&str) + Sync)) -> Result<Report, PaperError> {
    // Two halves of about the same duration have a thread each. Solve times are measured at the end, alone.
    let (reach, chain) = std::thread::scope(|scope| {
        let reach = scope.spawn(|| reach::run(options, progress));
        let chain = (|| {
            progress("products of the gradients");
            let gradients = gradients::run()?;
            let tracking = tracking::run(rig, options, progress)?;
            let ways = noise::run(rig, options, progress)?;
            Ok::<_, PaperError>((gradients, tracking, ways))
        })();
        (reach.join().unwrap_or(Err(PaperError::CutShort)), chain)
    });
    let (gradients, tracking, ways) = chain?;
    progress("one to four touches");
    Ok(Report {
        options,
        gradients,
        touches: touches::run(rig, options)?,
        tracking,
        ways,
        reach: reach?,
    })
}

impl Report {
    /// The report as one page, without other files.
    pub fn html(&self) -> String {
        page::html(self)
    }

    /// All numbers.
    ///
    /// # Errors
    /// None that is known: all of it is numbers and text.
    pub fn json(&self) -> Result<String, serde_json::Error> {
        serde_json::to_string_pretty(self)
    }

    /// Writes `report.html` and `report.json` into a folder, which is made if it does not exist.
    ///
    /// # Errors
    /// [`PaperError::Write`] with the file.
    pub fn write(&self, folder: &Path) -> Result<[PathBuf; 2], PaperError> {
        write_report(folder, &self.html(), self.json())
    }
}

/// Writes `report.html` and `report.json` into a folder, which is made if it does not exist.
fn write_report(
    folder: &Path,
    html: &str,
    json: Result<String, serde_json::Error>,
) -> Result<[PathBuf; 2], PaperError> {
    let wrong = |file: &Path, cause: std::io::Error| PaperError::Write {
        file: file.display().to_string(),
        cause,
    };
    std::fs::create_dir_all(folder).map_err(|e| wrong(folder, e))?;
    let files = [folder.join("report.html"), folder.join("report.json")];
    let json = json.map_err(|e| wrong(&files[1], e.into()))?;
    for (file, text) in files.iter().zip([html, &json]) {
        view::replace::replace(file, |new| new.write_all(text.as_bytes())).map_err(|e| wrong(file, e))?;
    }
    Ok(files)
}
