//! What the board complains about.

use crate::plan_error::PlanError;
use core::fmt;
use serde::{Deserialize, Serialize};

/// Why a stretch of bytes between two delimiters was not a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FrameError {
    /// Longer than the receiver holds.
    Overflow,
    /// Not valid COBS: it ends inside a block.
    Cobs,
    /// Too short to hold a CRC and a message.
    Short,
    /// The CRC does not match.
    Crc,
    /// Undamaged, but no message that this version knows.
    Unknown,
}

impl fmt::Display for FrameError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Overflow => "longer than any message",
            Self::Cobs => "cut short on the way",
            Self::Short => "too short for a message",
            Self::Crc => "damaged on the way (CRC does not match)",
            Self::Unknown => "undamaged but unknown; the two sides speak different protocol versions",
        })
    }
}

impl core::error::Error for FrameError {}

/// A fault of the front end that stopped the scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FrontEndFault {
    /// No samples came.
    Timeout,
    /// The multiplexers could not be set.
    Route,
    /// Anything else.
    Other,
}

/// Why the board did not do what it was told, or stopped doing it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum BoardError {
    /// A command arrived that could not be read.
    Command(FrameError),
    /// The plan was refused; the one before stays in force.
    Plan(PlanError),
    /// The scan stopped and the excitation is off.
    FrontEnd(FrontEndFault),
}

impl fmt::Display for BoardError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Command(e) => write!(f, "the board could not read a command: {e}"),
            Self::Plan(e) => write!(f, "the board refused the plan: {e}"),
            Self::FrontEnd(e) => write!(
                f,
                "the board stopped scanning because of its front end ({}); start it again, or power it off and on",
                match e {
                    FrontEndFault::Timeout => "no samples came",
                    FrontEndFault::Route => "the multiplexers did not switch",
                    FrontEndFault::Other => "fault unknown",
                }
            ),
        }
    }
}

impl core::error::Error for BoardError {}
