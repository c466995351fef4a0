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
    /// The board refused a command, or stopped by itself; in its own words.
    #[error("{0}")]
    Refused(String),
    /// There is no way to scan what is wired to the board.
    #[error("no scan plan suits this board: {0}")]
    Plan(#[from] PlanError),
}
