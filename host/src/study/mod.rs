//! How well frames are turned into touches, measured on frames whose truth is known.
//!
//! [`scenes`] simulates and judges; [`compare`] sets run time against error for all methods; [`cost`] tells what a frame
//! costs by what happens on the sheet, [`savings`] what each shortcut is worth; [`merit`] has the GREIT figures of the
//! pictures; [`conformal`] what no baseline tells of the electrodes; [`stress`] tries what must hold on any data.

pub mod compare;
pub mod conformal;
pub mod cost;
pub mod merit;
pub mod savings;
pub mod scenes;
pub mod screening;
pub mod stress;

use crate::imager::ImagerError;
use crate::picture::PictureError;
use forward::{ForwardError, PatternError};
use thiserror::Error;

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
    /// Numbers that are none, or too few.
    #[error("a number is not finite, or there are not as many as needed")]
    Numbers,
}
