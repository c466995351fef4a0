//! The PC's end of the wire: a serial port, the messages that come over it, and what a board is told.
//!
//! [`Link`] turns bytes into messages on a thread of its own and counts what was lost. [`Session`] is a board that has
//! introduced itself and streams [`MeasuredFrame`]s. [`plans`] names what a frame measures, [`settings`] what the board keeps,
//! [`flash`] programs it, [`ports`] finds and opens serial ports. Nothing here knows the sheet or its picture.
//! The way of a frame through all crates: docs/architecture.md.
#![forbid(unsafe_code)]

mod ask;
mod error;
pub mod flash;
mod inbox;
mod link;
pub mod plans;
pub mod ports;
mod session;
pub mod settings;

pub use ask::greet;
pub use error::LinkError;
pub use link::{Link, LinkCounters, Port};
pub use session::{MeasuredFrame, Session};
