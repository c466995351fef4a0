//! What the board complains about.

use crate::plan_error::PlanError;
use core::fmt;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// Why a stretch of bytes between two delimiters was not a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
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
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum FrontEndFault {
    /// No samples came.
    Timeout,
    /// The multiplexers could not be set.
    Route,
    /// Anything else.
    Other,
    /// The source's amplitude is not what it is set to.
    Source,
}

/// What else a command can ask for that the board cannot do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Refusal {
    /// Not while frames are being measured.
    Busy,
    /// An amplitude of 0 or of more than 1000 thousandths.
    Excitation {
        /// Thousandths asked for.
        given: u16,
    },
    /// A number of the watch that must be more than it is.
    Watch {
        /// Which number, as the field is called.
        what: WatchNumber,
        /// The least that it can be.
        least: u16,
    },
    /// There is no watch.
    NoWatch,
    /// The settings could not be written or read.
    Store,
    /// What was written to the store is read as something else.
    ReadBack,
    /// The board measures amplitudes, and has no samples to send.
    NoSamples,
}

/// Numbers of a [`crate::Watch`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum WatchNumber {
    /// [`crate::Watch::learn_scans`].
    LearnScans,
    /// [`crate::Watch::threshold`].
    Threshold,
    /// [`crate::Watch::frames_between`].
    FramesBetween,
    /// [`crate::Watch::quiet_scans`].
    QuietScans,
    /// [`crate::Watch::heartbeat_scans`].
    HeartbeatScans,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Busy => f.write_str("it is measuring; stop it first"),
            Self::Excitation { given } => {
                write!(f, "an excitation of {given} thousandths; it can do 1 to 1000")
            }
            Self::Watch { what, least } => write!(
                f,
                "the watch's {} must be at least {least}",
                match what {
                    WatchNumber::LearnScans => "number of scans to learn from",
                    WatchNumber::Threshold => "threshold",
                    WatchNumber::FramesBetween => "number of frames between its scans",
                    WatchNumber::QuietScans => "number of quiet scans",
                    WatchNumber::HeartbeatScans => "number of scans between heartbeats",
                }
            ),
            Self::NoWatch => f.write_str("it has no watch; set one first"),
            Self::Store => f.write_str("its store does not work; the settings hold until it is switched off"),
            Self::ReadBack => f.write_str(
                "its store does not keep what is written; what was stored before stays, and the settings hold until it is switched off",
            ),
            Self::NoSamples => f.write_str("its front end measures amplitudes and has no samples"),
        }
    }
}

/// Why the board did not do what it was told, or stopped doing it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum BoardError {
    /// A command arrived that could not be read.
    Command(FrameError),
    /// The plan was refused; the one before stays in force.
    Plan(PlanError),
    /// The scan stopped and the excitation is off.
    FrontEnd(FrontEndFault),
    /// The watch was refused; the one before stays in force.
    Watch(PlanError),
    /// A folded period was refused; slot 0 is the one asked for.
    Period(PlanError),
    /// The command cannot be carried out.
    Refused(Refusal),
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
                    FrontEndFault::Source => "the source's amplitude is not what it is set to",
                }
            ),
            Self::Watch(e) => write!(f, "the board refused the watch: {e}"),
            Self::Period(e) => write!(f, "the board refused to measure a period: {e}"),
            Self::Refused(e) => write!(f, "the board refused a command: {e}"),
        }
    }
}

impl core::error::Error for BoardError {}
