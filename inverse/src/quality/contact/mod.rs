//! Electrodes whose contact changed since the baseline: distinguished from touches, and taken out of the frame.
//!
//! A contact that gets worse does two things to the voltages of a frame. A voltage source drives less current through it: the
//! two drives that the electrode is part of are scaled, `s = D / (D + dz)`. Its metal also shunts the sheet before it less,
//! which is what a touch at the rim does too. The complete electrode model gives the shape of both: the derivative by the
//! contact impedance, and the change for a few large ones (`Contacts`).
//!
//! Small changes of all contacts are drift: the fit estimates them beside the touches
//! ([`Drift`](crate::reference::drift::Drift)), and touches are right. A contact that changed more than the others is a fault
//! ([`Drift::contact`](crate::reference::drift::Drift::contact)). The shapes of a large change are not linear, and phantom
//! touches may take their place. The estimate from the frame alone, without touches, then tells the electrode, and the frame is
//! fitted once more with all shapes of that contact left out. The response to a touch at the rim lies at least a tenth, mostly
//! a third, of its own norm outside these shapes: the two are distinguished by how well they explain a frame. The drives'
//! scales are undone before, because they scale the responses to touches as well. `ContactMonitor` accepts a contact only after
//! several frames.
//!
//! A weak leak between the wires of two electrodes near one another is like falls between these. It takes one direction, whatever its
//! resistance, and is tested in the same way.

mod cause;
mod evidence;
mod monitor;
mod options;
mod shapes;

pub(crate) use cause::Cause;
pub(crate) use evidence::Evidence;
pub(crate) use monitor::{ContactMonitor, Decision};
pub use options::ContactOptions;
pub(crate) use shapes::{Contacts, RimShape};
