//! How well frames are turned into touches, measured on frames whose truth is known.
//!
//! [`scenes`] simulates and judges; [`compare`] sets run time against error for all methods; [`cost`] tells what a frame
//! costs by what happens on the sheet, [`chain`] runs scenes through board and link, [`savings`] what each shortcut is worth; [`merit`] has the GREIT figures of the
//! pictures ([`greit`]); [`conformal`] what no baseline tells of the electrodes; [`stress`] tries what must hold on any data;
//! [`paper`] has the source paper's experiments again, [`fig7`] its figure of pictures.
//! The way of a frame through all crates: docs/architecture.md.
#![forbid(unsafe_code)]

pub mod chain;
pub mod compare;
pub mod conformal;
pub mod cost;
pub mod fig7;
pub mod greit;
pub mod merit;
pub mod paper;
pub mod savings;
pub mod scenes;
pub mod screening;
pub mod stress;

use forward::{ForwardError, PatternError};
use inverse::reference::imager::ImagerError;
use link::LinkError;
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
    /// The board or its link.
    #[error(transparent)]
    Link(#[from] LinkError),
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
