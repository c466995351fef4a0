//! A board that went away and came back: what is known of it, and what is told of it.

use protocol::{Hello, Plan};
use std::fmt;
use std::time::{Duration, Instant};

/// What became of the connection to a board.
#[derive(Clone, Debug, PartialEq)]
pub enum ConnectionEvent {
    /// It is lost. The board is looked for, by the port that is opened again.
    Lost {
        /// Why, as the system said it.
        why: String,
    },
    /// Another board came in its place; it is not asked for frames. The one that is missed is looked for still.
    OtherBoard {
        /// The other one's serial number.
        serial: String,
        /// The serial number of the one that is looked for.
        wanted: String,
    },
    /// The board is back, has the plan, the amplitude and the watch that it had, and measures.
    Restored {
        /// From when it was missed until now.
        away: Duration,
        /// Its firmware, where it is another one than before.
        firmware: Option<String>,
    },
}

impl fmt::Display for ConnectionEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Lost { why } => write!(f, "the connection to the board is lost ({why}); waiting for the board"),
            Self::OtherBoard { serial, wanted } => write!(
                f,
                "another board is behind the port now ({serial}); waiting for {wanted}. For the other one, end the program and start it again"
            ),
            Self::Restored { away, firmware } => {
                let s = away.as_secs_f64();
                match firmware {
                    None => write!(f, "the board is back after {s:.1} s, and measures as before"),
                    Some(firmware) => write!(f, "the board is back after {s:.1} s with other firmware ({firmware})"),
                }
            }
        }
    }
}

/// How a session and its board stand.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Connection {
    /// Frames are those of the plan.
    Up,
    /// The port was lost. Whoever comes by it has to introduce itself.
    Lost {
        since: Instant,
        /// Whether another board was met, and told of.
        other: bool,
    },
    /// The board introduced itself, and was told what to do; the plan is not confirmed yet.
    Told { since: Instant, firmware: Option<String> },
}

/// What an introduction says beside the one before.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Identity {
    /// The same board, which measures the same.
    Same,
    /// The same board with this firmware.
    OtherFirmware(String),
    /// A board of this serial number that measures in another way.
    Changed,
    /// Another one.
    Other,
}

impl Identity {
    /// Who a board is to whom knew it before.
    pub(crate) fn of(hello: &Hello, before: &Hello) -> Self {
        if hello.is_same_board(before) {
            return Self::Same;
        }
        if hello.serial != before.serial || hello.board != before.board {
            return Self::Other;
        }
        let measuring = Hello {
            version: before.version,
            schema: before.schema,
            firmware: before.firmware.clone(),
            git: before.git.clone(),
            ..hello.clone()
        };
        if measuring.is_same_board(before) {
            Self::OtherFirmware(hello.firmware.to_string())
        } else {
            Self::Changed
        }
    }
}

impl Connection {
    /// Whether a plan that the board says to have ends the wait: since when it was away, and its firmware where that is another.
    pub(crate) fn confirmed(&self, said: &Plan, plan: &Plan) -> Option<(Instant, Option<String>)> {
        match self {
            Self::Told { since, firmware } if said == plan => Some((*since, firmware.clone())),
            _ => None,
        }
    }
}
