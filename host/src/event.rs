//! What happens beside the pictures: on the line to the board, and with the baseline.

use link::{ConnectionEvent, LinkNotice};
use protocol::Notice;
use serde::{Deserialize, Serialize};

/// Something that happened.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub(crate) enum Event {
    /// The connection to the board is lost, and the board is waited for.
    BoardAway { why: String },
    /// Another board is where it was.
    OtherBoard { serial: String, wanted: String },
    /// The board is back and measures as before.
    BoardBack {
        away_s: f64,
        /// Where it is another one than before.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        firmware: Option<String>,
    },
    /// The board was reset, and measures again.
    BoardReset,
    /// Frames are lost.
    FramesLost {
        lost: u64,
        of: u64,
        damaged: u64,
        /// Recordings of older programs have none.
        #[serde(default)]
        late: u64,
    },
    /// Nothing comes.
    Silence { silent_s: f64 },
    /// The board was restarted by faults of its own, and does less than it was told to keep.
    BoardCareful { resets: u8, settings: bool },
    /// The board got what it could not read, and passed over so much of it.
    CommandsUnread { count: u32 },
    /// The source is not what it was when measuring began, or is again; in thousandths of full scale.
    SourceChanged {
        permille: u16,
        began_permille: u16,
        right: bool,
    },
    /// A baseline is taken from now on.
    BaselineBegun,
    /// A baseline is in force.
    BaselineInForce { stored: bool },
}

/// An event, and how it is said.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Said {
    #[serde(flatten)]
    pub(crate) event: Event,
    pub(crate) text: String,
}

impl From<&ConnectionEvent> for Said {
    fn from(of: &ConnectionEvent) -> Self {
        let text = of.to_string();
        let event = match of.clone() {
            ConnectionEvent::Lost { why } => Event::BoardAway { why },
            ConnectionEvent::OtherBoard { serial, wanted } => Event::OtherBoard { serial, wanted },
            ConnectionEvent::Restored { away, firmware } => Event::BoardBack {
                // Longer than a tenth of that is what it takes to find the port.
                away_s: (1e2 * away.as_secs_f64()).round() / 1e2,
                firmware,
            },
        };
        Self { event, text }
    }
}

impl From<&LinkNotice> for Said {
    fn from(of: &LinkNotice) -> Self {
        let event = match *of {
            LinkNotice::Lost { lost, of, arrival } => Event::FramesLost {
                lost,
                of,
                damaged: arrival.damaged,
                late: arrival.late,
            },
            LinkNotice::Silent { s } => Event::Silence { silent_s: s },
            LinkNotice::Reset => Event::BoardReset,
        };
        Self {
            event,
            text: of.to_string(),
        }
    }
}

impl From<&Notice> for Said {
    fn from(of: &Notice) -> Self {
        let event = match *of {
            Notice::PassedOver { count } => Event::CommandsUnread { count },
            Notice::Careful { resets, settings } => Event::BoardCareful { resets, settings },
            Notice::Source {
                permille,
                began_permille,
                right,
            } => Event::SourceChanged {
                permille,
                began_permille,
                right,
            },
        };
        Self {
            event,
            text: of.to_string(),
        }
    }
}

impl Said {
    /// A baseline is taken from now on.
    pub(crate) fn baseline_begun() -> Self {
        Self {
            event: Event::BaselineBegun,
            text: "a baseline is taken: do not touch".to_owned(),
        }
    }

    /// A baseline is in force, taken now or stored.
    pub(crate) fn baseline_in_force(stored: bool) -> Self {
        let which = if stored {
            "the stored baseline"
        } else {
            "a new baseline"
        };
        Self {
            event: Event::BaselineInForce { stored },
            text: format!("{which} is in force"),
        }
    }

    /// Whether it is of the line, and not of the baseline.
    pub(crate) fn is_of_line(&self) -> bool {
        !matches!(self.event, Event::BaselineBegun | Event::BaselineInForce { .. })
    }

    /// Whether it is no warning.
    pub(crate) fn is_good(&self) -> bool {
        matches!(
            self.event,
            Event::BoardBack { .. }
                | Event::BaselineBegun
                | Event::BaselineInForce { .. }
                | Event::SourceChanged { right: true, .. }
        )
    }
}
