//! One way to describe a skin.

use super::frame::Frame;
use super::maps::{Maps, Presses, Prior};
use super::orbits::Orbits;
use forward::Measurement;

/// What is said of a list of presses before anything is learned.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting<'a> {
    /// The measurements, in the order of the values.
    pub measurements: &'a [Measurement],
    /// Electrodes on the rim.
    pub electrodes: usize,
    /// A turn by so many electrodes maps the sheet onto itself; the number of electrodes where none does.
    pub turn: usize,
}

/// One way to learn.
#[derive(Clone)]
pub(super) struct Choice {
    pub(super) frame: Frame,
    pub(super) prior: Prior,
    pub(super) turn: usize,
    pub(super) orbits: Orbits,
}

impl Choice {
    pub(super) fn maps(&self, presses: &Presses) -> Option<Maps> {
        Maps::fit(presses, self.frame, self.prior, &self.orbits)
    }
}
