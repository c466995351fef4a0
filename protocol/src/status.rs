//! What the board is set to and does.

use crate::watch::Watching;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// How the store goes together with what is in force.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Stored {
    /// Nothing is stored: at power-up the board is as it was made.
    #[default]
    Nothing,
    /// What is in force is stored.
    InForce,
    /// Others than those in force are stored.
    Others,
    /// Something is stored that this firmware cannot carry out, or the store does not work.
    Unusable,
    /// What is stored was not looked at, since the board was restarted by its own faults too often.
    Unread,
}

/// What the board is set to, beside its plan and its watch, and what it does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Status {
    /// Whether it was told to measure.
    pub running: bool,
    /// What it does about its watch.
    pub watching: Watching,
    /// Whether it starts by itself at power-up, once stored.
    pub autostart: bool,
    /// Amplitude of the source, in thousandths of [`crate::Hello::excitation_uv`].
    pub excitation_permille: u16,
    /// What of plan, watch, excitation and autostart is stored.
    pub stored: Stored,
}
