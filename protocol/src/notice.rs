//! What the board says unasked, since version 2.1. A program of version 2.0 takes it for an unknown message.

use core::fmt;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// Something that the board noticed about itself, its source or the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Notice {
    /// More came than it answers that was no command.
    PassedOver {
        /// Stretches of bytes between two delimiters that were neither commands nor answered, since this was last said.
        count: u32,
    },
    /// It was restarted by faults of its own, a panic or its watchdog, and does less than it was told to keep.
    Careful {
        /// How often in a row.
        resets: u8,
        /// Whether the stored settings are in force: all but autostart.
        settings: bool,
    },
    /// The amplitude or the phase of the source is not what it was when measuring began; told every second while it is
    /// so, and once when it is right again.
    Source {
        /// Amplitude now, in thousandths of [`crate::Hello::excitation_uv`].
        permille: u16,
        /// The same when measuring began.
        began_permille: u16,
        /// Whether it is right again.
        right: bool,
    },
}

impl fmt::Display for Notice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::PassedOver { count } => write!(
                f,
                "the board got {count} messages that it could not read, beside those that it answered; look at the cable, and at what else sends to it"
            ),
            Self::Careful { resets, settings } => {
                write!(f, "the board was restarted ")?;
                match resets {
                    1 => write!(f, "by a fault of its own")?,
                    n => write!(f, "{n} times in a row by faults of its own")?,
                }
                f.write_str(if *settings {
                    ", and did not start to measure by itself; `skin hello` says what happened"
                } else {
                    ", and left its stored settings alone; `skin hello` says what happened, and after its supply was off it takes them up again"
                })
            }
            Self::Source {
                permille,
                began_permille,
                right,
            } => {
                let percent = |permille: u16| f32::from(permille) / 10.0;
                let (now, began) = (percent(*permille), percent(*began_permille));
                if *right {
                    write!(f, "the source is right again, at {now:.1} % of full scale")
                } else if permille == began_permille {
                    write!(f, "the source is out of phase; look at its supply and its filter")
                } else {
                    write!(
                        f,
                        "the source is at {now:.1} % of full scale, and was at {began:.1} % when measuring began: all values changed as much; look at its supply"
                    )
                }
            }
        }
    }
}
