//! The sensor board's logic: everything between the chip's peripherals and the bytes on the wire, without the chip.
//!
//! A board (or a simulator) implements three small traits, together a [`FrontEnd`], and three more, together a [`Support`],
//! and hands them with a serial port to a [`Controller`], whose [`poll`](Controller::poll) it calls over and over. Nothing here blocks, allocates, uses
//! floating point or can panic.
//!
//! ```text
//! plan -> Route -> Router, Capture -> blocks of samples -> Folded -> Phasor -> values -> frame -> Outbox -> serial port
//! ```
#![no_std]
#![forbid(unsafe_code)]
#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

#[cfg(test)]
extern crate std;

mod board_info;
mod capture;
mod change;
mod controller;
mod fold;
mod front_end;
pub mod laws;
mod measuring;
mod outbox;
mod phasor;
mod reference;
mod route;
mod scan;
mod self_test;
pub mod settings;
mod support;

pub use board_info::BoardInfo;
pub use capture::{Block, Blocking, Capture, QUARTER_SAMPLES, Rails, Window};
pub use change::{ChangeTest, LEVEL_ONE};
pub use controller::{Activity, Controller, Memory};
pub use fold::{FoldError, Folded, MAX_CHANNELS, MAX_PERIODS, Scatter};
pub use front_end::{Error, ErrorKind, ErrorType, Excitation, FrontEnd};
pub use outbox::Outbox;
pub use phasor::{Phasor, Rotation};
pub use reference::{COSINE, FRACTION, HALF, SAMPLES_PER_PERIOD, SINE};
pub use route::{Route, Router, Sense};
pub use scan::{MAX_AMPLITUDES, Pace, Progress, Scan, ScanError};
pub use support::{Clock, Sector, Store, Support, Watchdog};

/// Highest code of the converter: 12 bits. A sample of 0 or of this touches a rail.
pub const FULL_SCALE: u16 = 4095;
