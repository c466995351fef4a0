//! Which electrodes are connected to what.

use crate::error::ErrorType;
use protocol::Pair;

/// What the converter's channels see.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Sense {
    /// One channel, on this pair.
    One(Pair),
    /// As many channels as electrodes: channel n on electrode `n + step` (positive input, modulo the number of
    /// electrodes) against n.
    All {
        /// Distance between the electrodes of a pair.
        step: u8,
    },
    /// One channel, on the source's own output before the switches, through a gain of its own
    /// ([`source_gain_milli`](crate::BoardInfo::source_gain_milli)). Drive pair and the route's gain stay as they are set.
    Source,
}

/// A setting of all switches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Route {
    /// Where the excitation enters and leaves the sheet.
    pub drive: Pair,
    /// What is measured.
    pub sense: Sense,
    /// Number of the gain, from 0, of the board's table.
    pub gain: u8,
}

/// Sets the multiplexers.
pub trait Router: ErrorType {
    /// Connects `route` and nothing else, at once.
    ///
    /// The implementor's duties: break before make, so that no two electrodes are ever joined through the switches on
    /// the way; addresses change only while all switches are open, so that no third electrode is selected. The caller
    /// has checked electrodes and gain against what the board said it has.
    ///
    /// # Errors
    /// The switches could not be set; what is connected is then unknown.
    fn select(&mut self, route: &Route) -> Result<(), Self::Error>;

    /// Whether all pairs of electrodes `step` apart can be sensed at once through a gain, on a board with channels enough:
    /// its amplifiers may be wired to neighbours for good. Plans that ask for another step or gain are refused.
    fn senses_all(&self, _step: u8, _gain: u8) -> bool {
        true
    }
}

impl<T: Router + ?Sized> Router for &mut T {
    fn select(&mut self, route: &Route) -> Result<(), Self::Error> {
        T::select(self, route)
    }

    fn senses_all(&self, step: u8, gain: u8) -> bool {
        T::senses_all(self, step, gain)
    }
}
