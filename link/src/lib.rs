//! The PC's end of the wire: a serial port, the messages that come over it, and what a board is told.
//!
//! [`Link`] turns bytes into messages on a thread of its own and counts what was lost. [`Session`] is a board that has
//! introduced itself and streams [`MeasuredFrame`]s. [`plans`] names what a frame measures, [`settings`] what the board keeps,
//! [`phantom`] tests it on a ring of resistors, [`flash`] programs it, [`ports`] finds and opens serial ports. Nothing here knows the sheet or its picture.
//! The way of a frame through all crates: docs/architecture.md.
//!
//! One frame of a simulated board; a serial port of [`ports`] takes the place of `SimPort` for a real one:
//!
//! ```
//! use hil_sim::{Pace, SimPort};
//! use link::{Session, plans::PlanChoice};
//! use std::time::Duration;
//!
//! let board = hil_sim::SceneFile::demo(forward::Sheet::paper()).board()?;
//! let port = SimPort::new(board, Pace::Unpaced)?;
//! let plan: PlanChoice = "auto".parse()?;
//! let session = Session::start(Box::new(port), |hello| plan.plan(hello))?;
//! let frame = session.frame(Duration::from_secs(60))?.ok_or("no frame came")?;
//! assert_eq!(frame.values_v.len(), session.measurements().count());
//! assert!(frame.values_v.iter().all(|v| v.is_finite() && *v > 0.0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]

mod ask;
mod connection;
mod error;
pub mod flash;
mod inbox;
mod link;
mod notices;
pub mod phantom;
pub mod plans;
mod port;
pub mod ports;
mod printable;
mod pump;
mod session;
pub mod settings;
mod usb;

pub use ask::greet;
pub use connection::ConnectionEvent;
pub use error::LinkError;
pub use link::{Link, Stopper};
pub use notices::{LinkNotice, LinkNotices};
pub use port::{Arrival, LinkCounters, Port, Reopen};
pub use session::{MeasuredFrame, Session};
