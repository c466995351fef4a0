//! Why a plan cannot be measured.

use core::fmt;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// What is wrong with a plan. Slots and electrodes count from 0 in the fields, from 1 in the messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum PlanError {
    /// Nothing to measure.
    Empty,
    /// More slots than the board holds.
    Slots {
        /// Slots asked for.
        given: u8,
        /// Slots it holds.
        most: u8,
    },
    /// More values than a frame or the board holds.
    Values {
        /// Values asked for.
        given: u16,
        /// Values it holds.
        most: u16,
    },
    /// A slot names an electrode that the board has not.
    Electrode {
        /// Which slot.
        slot: u8,
        /// The electrode named.
        electrode: u8,
        /// Electrodes that the board has.
        count: u8,
    },
    /// A slot drives from an electrode to itself.
    SameElectrode {
        /// Which slot.
        slot: u8,
        /// The electrode.
        electrode: u8,
    },
    /// A sense step of 0, or not less than the number of electrodes.
    SenseStep {
        /// Which slot.
        slot: u8,
        /// The step.
        step: u8,
        /// Electrodes that the board has.
        count: u8,
    },
    /// A slot senses nothing.
    NoSense {
        /// Which slot.
        slot: u8,
    },
    /// A gain that the board has not.
    Gain {
        /// Which slot.
        slot: u8,
        /// The number of the gain.
        gain: u8,
        /// Gains that the board has.
        count: u8,
    },
    /// No period, or more periods than the board can integrate.
    Integrate {
        /// Periods asked for.
        given: u16,
        /// Most periods.
        most: u16,
    },
    /// More settling than the board can count.
    Settle {
        /// Quarter periods asked for.
        given: u16,
        /// Most quarter periods.
        most: u16,
    },
    /// Sampling all pairs at once asked of a board that has too few channels.
    Channels {
        /// Channels needed.
        needed: u8,
        /// Channels it has.
        count: u8,
    },
    /// In-phase and quadrature amplitudes together are more than the board holds.
    Quadrature {
        /// Amplitudes asked for.
        needed: u16,
        /// Amplitudes it holds.
        most: u16,
    },
    /// Sampling all pairs at once asked of amplifiers that are wired to other pairs, or have another gain.
    NotWired {
        /// Which slot.
        slot: u8,
        /// The step between the electrodes of its pairs.
        step: u8,
        /// The number of its gain.
        gain: u8,
    },
}

/// As people count.
fn from_1(index: u8) -> u16 {
    u16::from(index) + 1
}

impl fmt::Display for PlanError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Empty => write!(f, "it has no slot; give at least one drive pair"),
            Self::Slots { given, most } => {
                write!(f, "it has {given} slots, the board takes at most {most}")
            }
            Self::Values { given, most } => {
                write!(f, "it has {given} values, a frame of this board holds at most {most}")
            }
            Self::Electrode { slot, electrode, count } => write!(
                f,
                "slot {} names electrode {}, but there are {count} (1 to {count})",
                from_1(slot),
                from_1(electrode)
            ),
            Self::SameElectrode { slot, electrode } => {
                write!(
                    f,
                    "slot {} drives electrode {} against itself; name two electrodes",
                    from_1(slot),
                    from_1(electrode)
                )
            }
            Self::SenseStep { slot, step, count } => write!(
                f,
                "slot {} has a sense step of {step}; with {count} electrodes it must be 1 to {last}",
                from_1(slot),
                last = count.saturating_sub(1)
            ),
            Self::NoSense { slot } => {
                write!(f, "slot {} senses nothing; set at least one bit", from_1(slot))
            }
            Self::Gain { slot, gain, count } => write!(
                f,
                "slot {} asks for gain {gain}, but the board has {count} (from 0)",
                from_1(slot)
            ),
            Self::Integrate { given, most } => {
                write!(f, "it integrates {given} periods; the board can do 1 to {most}")
            }
            Self::Settle { given, most } => {
                write!(
                    f,
                    "it settles for {given} quarter periods; the board can do at most {most}"
                )
            }
            Self::Channels { needed, count } => write!(
                f,
                "it samples {needed} pairs at once, but the board has {count} channels; use sequential sampling"
            ),
            Self::Quadrature { needed, most } => write!(
                f,
                "with quadrature it has {needed} amplitudes, the board holds at most {most}; leave the quadrature out"
            ),
            Self::NotWired { slot, step, gain } => write!(
                f,
                "slot {} samples all pairs of sense step {step} at once through gain {gain}, for which the board has no amplifiers; \
                 use sequential sampling, or the sense step and the gain of the board's own plan",
                from_1(slot)
            ),
        }
    }
}

impl core::error::Error for PlanError {}
