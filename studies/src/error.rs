//! Why a study fails.

use forward::{ForwardError, PatternError};
use inverse::learned::LearnError;
use inverse::reference::imager::ImagerError;
use link::LinkError;
use protocol::PlanError;
use thiserror::Error;
use view::picture::PictureError;

/// Why something could not be measured.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum StudyError {
    /// The sheet or its picture.
    #[error(transparent)]
    Imager(#[from] ImagerError),
    /// The simulated sheet.
    #[error(transparent)]
    Forward(#[from] ForwardError),
    /// The cells of the picture.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// The measurements.
    #[error(transparent)]
    Pattern(#[from] PatternError),
    /// What presses teach.
    #[error(transparent)]
    Learn(#[from] LearnError),
    /// The board or its link.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// What a board is to measure.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The simulated board does not come up.
    #[error("the simulated board does not start: {0}")]
    Simulator(String),
    /// The board sends no frame.
    #[error("the board sent no frame; look at its link")]
    Silent,
    /// Numbers that are none, or too few.
    #[error("a number is not finite, or there are not as many as needed")]
    Numbers,
}
