//! The physics of a conductive sheet with electrodes: geometry, mesh, complete electrode model, transfer impedances and
//! their sensitivity to resistivity.
//!
//! Lengths are millimetres, resistances ohm. The sheet is two-dimensional: its conductivity is the conductance of one
//! square, thickness over resistivity.
#![forbid(unsafe_code)]

pub mod impedance;
pub mod pattern;

pub use impedance::{Drive, ElectrodeMatrix};
pub use pattern::{Measurement, Pair, Pattern, PatternError};
