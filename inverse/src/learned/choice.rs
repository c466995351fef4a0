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
    /// How far the sheet extends, where that is known; none where the presses are to tell.
    pub extent: Option<Extent>,
}

/// How far a sheet extends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// Its middle, mm.
    pub middle_mm: [f64; 2],
    /// From there to the farthest point of its rim, mm.
    pub reach_mm: f64,
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
