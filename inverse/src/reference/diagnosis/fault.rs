//! Faults by name.

use crate::reference::written::{resistance, two_digits};
use serde::{Serialize, Serializer};
use std::fmt;

/// Most electrodes of one fault.
pub const MOST_ELECTRODES: usize = 3;

/// Up to [`MOST_ELECTRODES`] electrodes, counted from 0, in order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Electrodes {
    list: [usize; MOST_ELECTRODES],
    count: usize,
}

impl Electrodes {
    /// Of a list, sorted; what is too many is left out.
    pub fn of(electrodes: &[usize]) -> Self {
        let mut out = Self::default();
        for (to, l) in out.list.iter_mut().zip(electrodes) {
            *to = *l;
            out.count += 1;
        }
        out.list[..out.count].sort_unstable();
        out
    }

    /// Which ones.
    pub fn list(&self) -> &[usize] {
        &self.list[..self.count]
    }
}

/// `electrode 3`, `electrodes 3, 8 and 13`.
impl fmt::Display for Electrodes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.list() {
            [] => write!(f, "no electrode"),
            [one] => write!(f, "electrode {}", one + 1),
            [first @ .., last] => {
                let first: Vec<String> = first.iter().map(|l| (l + 1).to_string()).collect();
                write!(f, "electrodes {} and {}", first.join(", "), last + 1)
            }
        }
    }
}

/// What is broken, as frames tell it. Electrodes and values count from 0; a person reads them from 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// The values of these electrodes say nothing: no contact, or a broken wire.
    Open(Electrodes),
    /// The wires or electrodes of two electrodes are connected.
    Short {
        /// Which ones.
        electrodes: [usize; 2],
        /// Resistance between them, ohm.
        ohm: f64,
    },
    /// Between the wires or electrodes of two electrodes leaks a small part of what goes through the sheet.
    Leak {
        /// Which ones.
        electrodes: [usize; 2],
        /// Resistance between them, ohm.
        ohm: f64,
    },
    /// The contacts of these electrodes changed since the baseline.
    Contacts(Electrodes),
    /// The contacts of these electrodes come and go.
    Loose(Electrodes),
    /// The source gives nothing.
    Source,
    /// All voltages are this many times those of the baseline: less than a fifth, or below 0 where they have the other sign.
    Scale(f64),
    /// The converter gives always the same.
    Converter,
    /// All values that the baseline has are out of the converter's range.
    Range,
    /// The values of one amplifier, between these electrodes, are out of range.
    Rail([usize; 2]),
    /// The first stage of all amplifiers ends before it should.
    Saturated,
    /// The values of one amplifier, between these electrodes, are wrong, by no gain and no offset.
    Channel([usize; 2]),
    /// The gain of one amplifier, between these electrodes, changed by this factor.
    Gain([usize; 2], f64),
    /// The offset of one amplifier, between these electrodes, changed.
    Offset([usize; 2]),
    /// What drives one pair of electrodes changed by this factor.
    Drive([usize; 2], f64),
    /// The offset of all values changed, by more than it drifts.
    OffsetOfAll,
    /// One value is wrong: its index, the drive pair and the sense pair.
    Value(usize, [usize; 4]),
    /// A multiplexer stays on an electrode.
    Multiplexer {
        /// Of the drive or of the sense pair.
        drive: bool,
        /// Its positive or negative end.
        plus: bool,
        /// Where it stays.
        electrode: usize,
    },
    /// Two address lines of a multiplexer are exchanged.
    Address {
        /// Of the drive or of the sense pair.
        drive: bool,
        /// Its positive or negative end.
        plus: bool,
        /// Which lines, from 0.
        lines: [usize; 2],
    },
    /// Two wires are exchanged.
    Exchanged([usize; 2]),
}

impl Fault {
    /// The electrodes that are to be looked at, in order; none where it is no electrode's.
    pub fn electrodes(&self) -> Electrodes {
        match self {
            Self::Open(electrodes) | Self::Contacts(electrodes) | Self::Loose(electrodes) => *electrodes,
            Self::Short { electrodes, .. } | Self::Leak { electrodes, .. } | Self::Exchanged(electrodes) => {
                Electrodes::of(electrodes)
            }
            Self::Multiplexer { electrode, .. } => Electrodes::of(&[*electrode]),
            Self::Source
            | Self::Scale(_)
            | Self::Converter
            | Self::Range
            | Self::Rail(_)
            | Self::Saturated
            | Self::Channel(_)
            | Self::Gain(..)
            | Self::Offset(_)
            | Self::Drive(..)
            | Self::Address { .. }
            | Self::OffsetOfAll
            | Self::Value(..) => Electrodes::default(),
        }
    }

    /// Whether the values that are left tell touches right.
    pub fn leaves_touches(&self) -> bool {
        match self {
            Self::Open(_)
            | Self::Leak { .. }
            | Self::Contacts(_)
            | Self::Loose(_)
            | Self::Rail(_)
            | Self::Channel(_)
            | Self::Gain(..)
            | Self::Offset(_)
            | Self::Drive(..)
            | Self::Value(..) => true,
            Self::Short { .. }
            | Self::Source
            | Self::Scale(_)
            | Self::OffsetOfAll
            | Self::Converter
            | Self::Range
            | Self::Saturated
            | Self::Multiplexer { .. }
            | Self::Address { .. }
            | Self::Exchanged(_) => false,
        }
    }

    /// The same fault, whatever its size.
    pub fn is_same(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Short { electrodes: a, .. }, Self::Short { electrodes: b, .. })
            | (Self::Leak { electrodes: a, .. }, Self::Leak { electrodes: b, .. }) => a == b,
            (Self::Gain(a, _), Self::Gain(b, _)) | (Self::Drive(a, _), Self::Drive(b, _)) => a == b,
            (Self::Scale(_), Self::Scale(_)) => true,
            _ => self == other,
        }
    }

    fn kind(&self) -> &'static str {
        match self {
            Self::Open(_) => "electrode_open",
            Self::Short { .. } => "electrodes_short",
            Self::Leak { .. } => "electrodes_leak",
            Self::Contacts(_) => "contacts_changed",
            Self::Loose(_) => "contacts_loose",
            Self::Source => "source_lost",
            Self::Scale(_) => "scale_changed",
            Self::Converter => "converter_stuck",
            Self::Range => "out_of_range",
            Self::Rail(_) => "channel_out_of_range",
            Self::Saturated => "amplifiers_saturated",
            Self::Channel(_) => "channel_wrong",
            Self::Gain(..) => "channel_gain",
            Self::Offset(_) => "channel_offset",
            Self::Drive(..) => "drive_gain",
            Self::OffsetOfAll => "offset_changed",
            Self::Value(..) => "value",
            Self::Multiplexer { .. } => "multiplexer_stuck",
            Self::Address { .. } => "address_swapped",
            Self::Exchanged(_) => "wires_exchanged",
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let pair = |p: &[usize; 2]| format!("electrodes {} and {}", p[0] + 1, p[1] + 1);
        match self {
            Self::Open(electrodes) => write!(
                f,
                "{electrodes} {} no signal: the values are left out; look at the wire and the clamp",
                if electrodes.list().len() == 1 { "gives" } else { "give" }
            ),
            Self::Short { electrodes, ohm } if *ohm < 1.0 => write!(
                f,
                "{} are shorted: no touches are shown; look where their wires and clamps touch",
                pair(electrodes)
            ),
            Self::Short { electrodes, ohm } if *ohm < 1000.0 => write!(
                f,
                "{} are connected over {}: no touches are shown; look where their wires and clamps touch",
                pair(electrodes),
                resistance(*ohm)
            ),
            Self::Short { electrodes, ohm } => write!(
                f,
                "{} are connected over {}: no touches are shown; look for moisture and dirt between their wires and clamps",
                pair(electrodes),
                resistance(*ohm)
            ),
            Self::Leak { electrodes, ohm } => write!(
                f,
                "{} are connected over {}: what that changes is left out; look for moisture and dirt between their wires and clamps",
                pair(electrodes),
                resistance(*ohm)
            ),
            Self::Contacts(electrodes) => {
                let [contact, is, look] = match electrodes.list().len() {
                    1 => ["contact", "is", "its clamp and cable"],
                    _ => ["contacts", "are", "their clamps and cables"],
                };
                write!(
                    f,
                    "the {contact} of {electrodes} changed since the baseline and {is} left out: look at {look}, then take a new \
                     baseline"
                )
            }
            Self::Loose(electrodes) => {
                let [contact, comes, goes, is] = match electrodes.list().len() {
                    1 => ["contact", "comes", "goes", "is"],
                    _ => ["contacts", "come", "go", "are"],
                };
                write!(
                    f,
                    "the {contact} of {electrodes} {comes} and {goes} and {is} left out: look for a loose clamp, plug or cable"
                )
            }
            Self::Source => write!(
                f,
                "the source gives nothing, or all amplifiers do: no touches are shown; look at the excitation, its cable and the amplifiers' supply"
            ),
            Self::Scale(factor) => write!(
                f,
                "the voltages are {} times those of the baseline: no touches are shown; look at the source and at the {}, or take a \
                 new baseline",
                two_digits(*factor),
                if *factor < 0.0 {
                    "signs of the wires"
                } else {
                    "amplifiers"
                }
            ),
            Self::Converter => write!(
                f,
                "the converter gives always the same value: no touches are shown; look at the board"
            ),
            Self::Range => write!(
                f,
                "all values are out of range: the converter or all amplifiers are at a rail; look at the board and its supply"
            ),
            Self::Rail(p) => write!(
                f,
                "the amplifier between {} is at its rail: its values are left out; look at the board",
                pair(p)
            ),
            Self::Saturated => write!(
                f,
                "the amplifiers saturate: no touches are shown; look at their supply and their gains"
            ),
            Self::Channel(p) => write!(
                f,
                "the amplifier between {} gives values that no sheet has: they are left out; look at it and at its supply",
                pair(p)
            ),
            Self::Gain(p, factor) => write!(
                f,
                "the amplifier between {} gives {factor:.3} of what it gave: its values are left out; take a new baseline",
                pair(p)
            ),
            Self::Offset(p) => write!(
                f,
                "the amplifier between {} has another offset than in the baseline: its values are left out; take a new baseline",
                pair(p)
            ),
            Self::Drive(p, factor) => write!(
                f,
                "what drives {} gives {factor:.3} of what it gave: its values are left out; look at the switches of the drive \
                 multiplexers, or take a new baseline",
                pair(p)
            ),
            Self::OffsetOfAll => write!(
                f,
                "all values have another offset than in the baseline: no touches are shown; look at the converter and at what couples \
                 into it from the source, or take a new baseline"
            ),
            Self::Value(_, [a, b, c, d]) => write!(
                f,
                "the value of drive {}-{}, sense {}-{} is wrong: it is left out",
                a + 1,
                b + 1,
                c + 1,
                d + 1
            ),
            Self::Multiplexer { drive, plus, electrode } => write!(
                f,
                "the {} multiplexer stays on electrode {}: no touches are shown; look at its control lines",
                multiplexer(*drive, *plus),
                electrode + 1
            ),
            Self::Address {
                drive,
                plus,
                lines: [a, b],
            } => write!(
                f,
                "the {} multiplexer has its address lines {a} and {b} exchanged: no touches are shown; look at its control lines",
                multiplexer(*drive, *plus)
            ),
            Self::Exchanged(electrodes) => write!(
                f,
                "the wires of {} are exchanged since the baseline: no touches are shown; put them back, or take a new baseline",
                pair(electrodes)
            ),
        }
    }
}

/// What is broken at the same time: one fault, or two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Faults {
    first: Fault,
    other: Option<Fault>,
}

impl Faults {
    /// One fault, with another beside it.
    pub(crate) fn two(first: Fault, other: Fault) -> Self {
        Self {
            first,
            other: Some(other),
        }
    }

    /// The fault, where it is one.
    pub(crate) fn single(self) -> Option<Fault> {
        self.other.is_none().then_some(self.first)
    }

    /// Whether they are one, of several electrodes that are open.
    pub(crate) fn are_many_open(self) -> bool {
        matches!(self.single(), Some(Fault::Open(open)) if open.list().len() > 1)
    }

    /// The same faults as others, of other sizes, in the others' order.
    pub(crate) fn in_order_of(self, others: Self) -> Self {
        match self.other {
            Some(other) if !self.first.is_same(&others.first) => Self::two(other, self.first),
            _ => self,
        }
    }

    /// Each of them.
    pub(crate) fn iter(self) -> impl Iterator<Item = Fault> {
        [Some(self.first), self.other].into_iter().flatten()
    }

    /// Whether the values that are left tell touches right.
    pub(crate) fn leaves_touches(self) -> bool {
        self.iter().all(|fault| fault.leaves_touches())
    }

    /// The same faults, whatever their sizes, and whichever is first.
    pub(crate) fn is_same(self, other: Self) -> bool {
        let has_all_of = |of: Self| of.iter().all(|a| self.iter().any(|b| a.is_same(&b)));
        self.iter().count() == other.iter().count() && has_all_of(other)
    }
}

impl From<Fault> for Faults {
    fn from(first: Fault) -> Self {
        Self { first, other: None }
    }
}

/// `drive +`.
fn multiplexer(drive: bool, plus: bool) -> String {
    format!(
        "{} {}",
        if drive { "drive" } else { "sense" },
        if plus { "+" } else { "-" }
    )
}

/// As the page and JSON have it: kind, electrodes from 1, text.
impl Serialize for Fault {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Line {
            kind: &'static str,
            electrodes: Vec<usize>,
            text: String,
        }
        let pair = match self {
            Self::Rail(p) | Self::Channel(p) | Self::Gain(p, _) | Self::Offset(p) | Self::Drive(p, _) => p.to_vec(),
            Self::Value(_, p) => p.to_vec(),
            _ => self.electrodes().list().to_vec(),
        };
        Line {
            kind: self.kind(),
            electrodes: pair.iter().map(|l| l + 1).collect(),
            text: self.to_string(),
        }
        .serialize(serializer)
    }
}
