//! Why there is no dataset.

use forward::{ForwardError, PatternError};
use hil_sim::MeterError;
use thiserror::Error;

/// Why a dataset cannot be made.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum DatasetError {
    /// A key that cannot have its value.
    #[error("{0}: {1}")]
    Key(&'static str, String),
    /// Electronics that cannot be.
    #[error("board.electronics: {0}")]
    Electronics(String),
    /// A sheet that cannot be modelled.
    #[error("a sheet that was drawn cannot be modelled: {0}")]
    Forward(#[from] ForwardError),
    /// The measurements.
    #[error(transparent)]
    Pattern(#[from] PatternError),
    /// The board.
    #[error(transparent)]
    Meter(#[from] MeterError),
    /// A number that cannot be computed with.
    #[error("{0}: a number that was drawn is beyond what a sheet or a board can have; draw others")]
    Drawn(&'static str),
    /// Touches that do not fit.
    #[error(
        "no room was found for {count} touches on the sheet; make touch.radius_mm, touch.apart_mm or touch.rim_mm smaller, or leave \
         out their number from touch.count"
    )]
    NoRoom {
        /// How many were drawn.
        count: usize,
    },
}
