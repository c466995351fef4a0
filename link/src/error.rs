//! Why a link ended or a board did not answer.

use protocol::PlanError;
use thiserror::Error;

/// Why the link ended or an answer did not come.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum LinkError {
    /// The port is gone.
    #[error("the connection to the board is lost ({0}); plug it in again and restart")]
    Lost(String),
    /// No answer.
    #[error("the board did not answer {what} within {ms} ms; is it the right port, and the board powered?")]
    Silent {
        /// What was asked.
        what: &'static str,
        /// How long was waited, ms.
        ms: u128,
    },
    /// No frame and no sign of life.
    #[error("{}", no_frames(*.s, *.bytes))]
    NoFrames {
        /// How long its port was listened to, s.
        s: u64,
        /// Bytes that came meanwhile and were no frame.
        bytes: u64,
    },
    /// Bytes come, and none of them is a message.
    #[error(
        "{bytes} bytes came in {ms} ms, and none was a message of a board; is it the right device, with the right bit rate, and does nothing disturb the cable?"
    )]
    Damaged {
        /// How long was waited, ms.
        ms: u128,
        /// Bytes that came meanwhile.
        bytes: u64,
    },
    /// Signs of life, and no frame.
    #[error("the board watches although it was told to measure: for {s} s it has sent signs of life and no frame")]
    Watches {
        /// How long its port was listened to, s.
        s: u64,
    },
    /// The board speaks another protocol.
    #[error(
        "the board speaks protocol version {board}, this program {ours}; flash the firmware that belongs to this program"
    )]
    Version {
        /// The board's major version.
        board: u8,
        /// Ours.
        ours: u8,
    },
    /// The board came back as one that measures in another way.
    #[error(
        "the board that came back has the serial number of the one before, but measures in another way; start again"
    )]
    Changed,
    /// The board refused a command, or stopped by itself; in its own words.
    #[error("{0}")]
    Refused(String),
    /// There is no way to scan what is wired to the board.
    #[error("no scan plan suits this board: {0}")]
    Plan(PlanError),
}

// No source: the text above has all of it.
impl From<PlanError> for LinkError {
    fn from(error: PlanError) -> Self {
        Self::Plan(error)
    }
}

/// What a silence is, by what came meanwhile.
fn no_frames(s: u64, bytes: u64) -> String {
    match bytes {
        0 => format!("the board has sent no frame for {s} s; look at its cable and power"),
        n => format!(
            "no frame could be read for {s} s, although {n} bytes came; is it the right device, and does nothing disturb the cable?"
        ),
    }
}
