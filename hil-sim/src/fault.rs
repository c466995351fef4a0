//! What breaks, and when.

use serde::{Deserialize, Serialize};
use std::str::FromStr;
use thiserror::Error;

/// Something that breaks at a time, and perhaps mends itself. On the command line: [`Fault::from_str`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fault {
    /// When, s after the simulation began.
    pub at_s: f64,
    /// How long, s; absent: for ever, but a reset only for a moment.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub for_s: Option<f64>,
    /// What.
    pub kind: FaultKind,
}

/// One of the board's multiplexers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Multiplexer {
    /// Where the source enters the sheet.
    DrivePlus,
    /// Where it leaves the sheet.
    DriveMinus,
    /// Positive input of the amplifier that measures one pair after the other.
    SensePlus,
    /// Its negative input.
    SenseMinus,
}

/// One of the references that the drawn board's circuit rests on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reference {
    /// The middle of the analogue supply, about which the drive moves.
    Drive,
    /// The middle of the converter's range, where the amplifiers rest.
    Converter,
}

/// What breaks. In a TOML file `kind = "cable_pulled"`, or `kind = { electrode_open = { electrode = 5 } }`. Texts and files count
/// electrodes from 1, as people do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum FaultKind {
    /// Bytes vanish on the line, in both directions.
    BytesLost {
        /// Chance for each byte, 0 to 1.
        rate: f64,
    },
    /// One bit of a byte is inverted on the line, in both directions.
    BytesFlipped {
        /// Chance for each byte, 0 to 1.
        rate: f64,
    },
    /// Bytes arrive twice, in both directions.
    BytesDoubled {
        /// Chance for each byte, 0 to 1.
        rate: f64,
    },
    /// The line from the board is held at 0: a break condition. A reader gets one 0 byte for all of it.
    LineBreak,
    /// The line to the board is held at 0, as by a host that sends a break: the board's receiver gets a 0 byte with a framing
    /// error, and nothing that is sent meanwhile.
    BreakToBoard,
    /// The cable of the serial adapter is pulled: the port is gone, and whoever holds it open finds it dead. The board has a
    /// supply of its own and goes on.
    CablePulled,
    /// The board's reset line is pulled, as soon as a frame is half out. It then starts anew.
    BoardReset,
    /// The board's program hangs: its watchdog resets it, as soon as a frame is half out.
    BoardHangs,
    /// A wire is off an electrode. The amplifier's input then rests at the middle of its supply.
    ElectrodeOpen {
        /// Which one, from 0.
        #[serde(with = "from_1")]
        electrode: u8,
    },
    /// An electrode's contact has become worse.
    ContactRaised {
        /// Which one, from 0.
        #[serde(with = "from_1")]
        electrode: u8,
        /// By this, ohm.
        ohm: f64,
    },
    /// The wires of two electrodes touch each other.
    ElectrodesShort {
        /// Which ones, from 0.
        #[serde(with = "both_from_1")]
        electrodes: [u8; 2],
        /// Resistance between them, ohm.
        #[serde(default)]
        ohm: f64,
    },
    /// The source gives nothing.
    SourceLost,
    /// The source gives less than it is set to.
    SourceSags {
        /// Part of its amplitude that is left, 0 to 1.
        part: f64,
    },
    /// The converter gives the same code whatever it measures.
    AdcStuck {
        /// Which one, 0 to 4095.
        code: u16,
    },
    /// A multiplexer stays on one electrode.
    MultiplexerStuck {
        /// Which multiplexer.
        multiplexer: Multiplexer,
        /// Where it stays, from 0.
        #[serde(with = "from_1")]
        electrode: u8,
    },
    /// An amplifier is against its upper rail.
    Saturation {
        /// Which channel's; absent: all of them.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        channel: Option<u8>,
    },
    /// The amplifier of gain 0 gives nothing.
    AmplifierDead,
    /// The first stage of that amplifier stops before its supply. Seen only where the electronics have a supply.
    AmplifierSaturating {
        /// By how much more than it should, V.
        volt: f64,
    },
    /// The amplifier of one channel of a board that senses all pairs at once gives nothing.
    ChannelDead {
        /// Which channel's, from 0.
        channel: u8,
    },
    /// The first stage of such an amplifier stops before its supply. Seen only where the electronics have a supply.
    ChannelSaturating {
        /// Which channel's, from 0.
        channel: u8,
        /// By how much more than it should, V.
        volt: f64,
    },
    /// A closed switch has more resistance than the others. Sense multiplexers carry no current.
    SwitchResistance {
        /// Of which multiplexer.
        multiplexer: Multiplexer,
        /// Which electrode's switch, from 0.
        #[serde(with = "from_1")]
        electrode: u8,
        /// How much more, ohm.
        ohm: f64,
    },
    /// Two address lines of a multiplexer are swapped.
    AddressSwapped {
        /// Of which multiplexer.
        multiplexer: Multiplexer,
        /// Which lines, 0 to 2.
        lines: [u8; 2],
    },
    /// The wires of two electrodes are swapped.
    WiresSwapped {
        /// Which ones, from 0.
        #[serde(with = "both_from_1")]
        electrodes: [u8; 2],
    },
    /// A reference is at 0 V. That of the drive is seen only where the electronics have a supply.
    ReferenceLost {
        /// Which one.
        reference: Reference,
    },
    /// The converter's samples are overwritten before they are fetched.
    ConverterOverrun {
        /// Chance for each period of samples, 0 to 1.
        rate: f64,
    },
}

/// Electrodes count from 1 in files.
mod from_1 {
    use serde::de::{Deserialize, Deserializer, Error};
    use serde::ser::Serializer;

    pub(super) fn serialize<S: Serializer>(electrode: &u8, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_u16(u16::from(*electrode) + 1)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<u8, D::Error> {
        index(u16::deserialize(from)?)
    }

    pub(super) fn index<E: Error>(number: u16) -> Result<u8, E> {
        let index = number.checked_sub(1).and_then(|k| u8::try_from(k).ok());
        index.ok_or_else(|| E::custom(format!("there is no electrode {number}; electrodes count from 1")))
    }
}

/// The same for a pair.
mod both_from_1 {
    use super::from_1;
    use serde::de::{Deserialize, Deserializer};
    use serde::ser::{Serialize, Serializer};

    pub(super) fn serialize<S: Serializer>(electrodes: &[u8; 2], to: S) -> Result<S::Ok, S::Error> {
        electrodes.map(|e| u16::from(e) + 1).serialize(to)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<[u8; 2], D::Error> {
        let [a, b] = <[u16; 2]>::deserialize(from)?;
        Ok([from_1::index(a)?, from_1::index(b)?])
    }
}

/// What is wrong with a fault.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum FaultError {
    /// A number that it cannot have.
    #[error("fault: {field} is {value}; it must be {allowed}")]
    Range {
        /// Which one.
        field: &'static str,
        /// What was given.
        value: f64,
        /// What it may be.
        allowed: &'static str,
    },
    /// An electrode that the sheet has not.
    #[error("fault: there is no electrode {} on a sheet with {count}; they count from 1", u16::from(*given) + 1)]
    Electrode {
        /// The number given, from 0.
        given: u8,
        /// How many there are.
        count: usize,
    },
    /// A text that is none.
    #[error(
        "`{0}` is no fault: write KIND@SECONDS or KIND@SECONDS+SECONDS, such as cable_pulled@5+2, bytes_lost:0.001@5, \
         electrode_open:3@5+10, electrodes_short:3,4@5 or multiplexer_stuck:drive_plus,3@5; electrodes count from 1"
    )]
    Text(String),
}

impl Fault {
    /// A fault for ever.
    pub fn new(at_s: f64, kind: FaultKind) -> Self {
        Self {
            at_s,
            for_s: None,
            kind,
        }
    }

    /// A fault for a time.
    pub fn lasting(at_s: f64, for_s: f64, kind: FaultKind) -> Self {
        Self {
            at_s,
            for_s: Some(for_s),
            kind,
        }
    }

    /// When it is over, s.
    pub fn end_s(&self) -> f64 {
        let natural_s = match self.kind {
            FaultKind::BoardReset | FaultKind::BoardHangs => 0.0,
            _ => f64::INFINITY,
        };
        self.at_s + self.for_s.unwrap_or(natural_s)
    }

    /// Whether a sheet with so many electrodes can have it.
    ///
    /// # Errors
    /// [`FaultError`] names what cannot be.
    pub fn validate(&self, electrodes: usize) -> Result<(), FaultError> {
        let number = |field, value: f64, most: f64, allowed| {
            if (0.0..=most).contains(&value) {
                Ok(())
            } else {
                Err(FaultError::Range { field, value, allowed })
            }
        };
        let known = |given: u8| {
            if usize::from(given) < electrodes {
                Ok(())
            } else {
                Err(FaultError::Electrode {
                    given,
                    count: electrodes,
                })
            }
        };
        number("at_s", self.at_s, f64::MAX, "0 or more, and finite")?;
        number("for_s", self.for_s.unwrap_or(0.0), f64::INFINITY, "0 or more")?;
        let not_below = "0 or more, and finite";
        let known_channel = |channel: u8| {
            let most = firmware::MAX_CHANNELS as f64 - 1.0;
            number("channel", channel.into(), most, "between 0 and 15")
        };
        match self.kind {
            FaultKind::BytesLost { rate }
            | FaultKind::BytesFlipped { rate }
            | FaultKind::BytesDoubled { rate }
            | FaultKind::ConverterOverrun { rate } => number("rate", rate, 1.0, "between 0 and 1"),
            FaultKind::ElectrodeOpen { electrode } | FaultKind::MultiplexerStuck { electrode, .. } => known(electrode),
            FaultKind::ContactRaised { electrode, ohm } => {
                known(electrode)?;
                number("ohm", ohm, f64::MAX, not_below)
            }
            FaultKind::SwitchResistance { electrode, ohm, .. } => {
                known(electrode)?;
                number("ohm", ohm, f64::MAX, not_below)
            }
            FaultKind::ElectrodesShort { electrodes, ohm } => {
                two_of(electrodes, known)?;
                number("ohm", ohm, f64::MAX, not_below)
            }
            FaultKind::WiresSwapped { electrodes } => two_of(electrodes, known),
            FaultKind::AddressSwapped { lines: [a, b], .. } => {
                number("line", a.into(), 2.0, "between 0 and 2")?;
                number("line", b.into(), 2.0, "between 0 and 2")?;
                if a == b {
                    return Err(FaultError::Range {
                        field: "the second line",
                        value: b.into(),
                        allowed: "another line than the first",
                    });
                }
                Ok(())
            }
            FaultKind::SourceSags { part } => number("part", part, 1.0, "between 0 and 1"),
            FaultKind::AmplifierSaturating { volt } => number("volt", volt, 1000.0, "between 0 and 1000"),
            FaultKind::AdcStuck { code } => number("code", code.into(), 4095.0, "between 0 and 4095"),
            FaultKind::Saturation { channel } => known_channel(channel.unwrap_or(0)),
            FaultKind::ChannelDead { channel } => known_channel(channel),
            FaultKind::ChannelSaturating { channel, volt } => {
                known_channel(channel)?;
                number("volt", volt, 1000.0, "between 0 and 1000")
            }
            FaultKind::LineBreak
            | FaultKind::BreakToBoard
            | FaultKind::CablePulled
            | FaultKind::BoardReset
            | FaultKind::BoardHangs
            | FaultKind::AmplifierDead
            | FaultKind::ReferenceLost { .. }
            | FaultKind::SourceLost => Ok(()),
        }
    }
}

/// Whether there are both electrodes, and they are two.
fn two_of([a, b]: [u8; 2], known: impl Fn(u8) -> Result<(), FaultError>) -> Result<(), FaultError> {
    known(a)?;
    known(b)?;
    if a == b {
        return Err(FaultError::Range {
            field: "the second electrode",
            value: f64::from(b) + 1.0,
            allowed: "another electrode than the first",
        });
    }
    Ok(())
}

impl FromStr for Fault {
    type Err = FaultError;

    /// `KIND@AT` or `KIND@AT+FOR`, times in seconds; a kind with parameters is `kind:first,second`.
    fn from_str(text: &str) -> Result<Self, FaultError> {
        parsed(text).ok_or_else(|| FaultError::Text(text.to_owned()))
    }
}

fn multiplexer(word: &str) -> Option<Multiplexer> {
    Some(match word {
        "drive_plus" => Multiplexer::DrivePlus,
        "drive_minus" => Multiplexer::DriveMinus,
        "sense_plus" => Multiplexer::SensePlus,
        "sense_minus" => Multiplexer::SenseMinus,
        _ => return None,
    })
}

fn parsed(text: &str) -> Option<Fault> {
    let (what, when) = text.split_once('@')?;
    let (at_s, for_s) = match when.split_once('+') {
        Some((at, length)) => (at.parse().ok()?, Some(length.parse().ok()?)),
        None => (when.parse().ok()?, None),
    };
    let (name, given) = what.split_once(':').unwrap_or((what, ""));
    let electrode = |word: &str| word.parse::<u16>().ok()?.checked_sub(1)?.try_into().ok();
    let mut given = given.split(',').filter(|word| !word.is_empty());
    let kind = match name {
        "bytes_lost" => FaultKind::BytesLost {
            rate: given.next()?.parse().ok()?,
        },
        "bytes_flipped" => FaultKind::BytesFlipped {
            rate: given.next()?.parse().ok()?,
        },
        "bytes_doubled" => FaultKind::BytesDoubled {
            rate: given.next()?.parse().ok()?,
        },
        "line_break" => FaultKind::LineBreak,
        "break_to_board" => FaultKind::BreakToBoard,
        "cable_pulled" => FaultKind::CablePulled,
        "board_reset" => FaultKind::BoardReset,
        "board_hangs" => FaultKind::BoardHangs,
        "electrode_open" => FaultKind::ElectrodeOpen {
            electrode: electrode(given.next()?)?,
        },
        "contact_raised" => FaultKind::ContactRaised {
            electrode: electrode(given.next()?)?,
            ohm: given.next()?.parse().ok()?,
        },
        "electrodes_short" => FaultKind::ElectrodesShort {
            electrodes: [electrode(given.next()?)?, electrode(given.next()?)?],
            ohm: given.next().map_or(Ok(0.0), str::parse).ok()?,
        },
        "source_lost" => FaultKind::SourceLost,
        "source_sags" => FaultKind::SourceSags {
            part: given.next()?.parse().ok()?,
        },
        "adc_stuck" => FaultKind::AdcStuck {
            code: given.next()?.parse().ok()?,
        },
        "multiplexer_stuck" => FaultKind::MultiplexerStuck {
            multiplexer: multiplexer(given.next()?)?,
            electrode: electrode(given.next()?)?,
        },
        "amplifier_dead" => FaultKind::AmplifierDead,
        "amplifier_saturating" => FaultKind::AmplifierSaturating {
            volt: given.next()?.parse().ok()?,
        },
        "channel_dead" => FaultKind::ChannelDead {
            channel: given.next()?.parse().ok()?,
        },
        "channel_saturating" => FaultKind::ChannelSaturating {
            channel: given.next()?.parse().ok()?,
            volt: given.next()?.parse().ok()?,
        },
        "switch_resistance" => FaultKind::SwitchResistance {
            multiplexer: multiplexer(given.next()?)?,
            electrode: electrode(given.next()?)?,
            ohm: given.next()?.parse().ok()?,
        },
        "address_swapped" => FaultKind::AddressSwapped {
            multiplexer: multiplexer(given.next()?)?,
            lines: [given.next()?.parse().ok()?, given.next()?.parse().ok()?],
        },
        "wires_swapped" => FaultKind::WiresSwapped {
            electrodes: [electrode(given.next()?)?, electrode(given.next()?)?],
        },
        "reference_lost" => FaultKind::ReferenceLost {
            reference: match given.next()? {
                "drive" => Reference::Drive,
                "converter" => Reference::Converter,
                _ => return None,
            },
        },
        "saturation" => FaultKind::Saturation {
            channel: given.next().map(str::parse).transpose().ok()?,
        },
        "converter_overrun" => FaultKind::ConverterOverrun {
            rate: given.next()?.parse().ok()?,
        },
        _ => return None,
    };
    given.next().is_none().then_some(Fault { at_s, for_s, kind })
}
