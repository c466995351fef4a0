//! The sensor board's logic: everything between the chip's peripherals and the bytes on the wire, without the chip.
//! It excites the sheet, routes, captures samples in step with the excitation, and correlates them with it (lock-in).
//! Nothing here blocks, allocates, uses floating point or can panic. The crate knows `protocol` only: docs/architecture.md
//! shows its place, docs/firmware.md explains how it works.
//!
//! A board (or a simulator) implements three small traits, together a [`FrontEnd`], and four more, together a [`Support`].
//! Most give samples ([`Capture`]); one whose chip measures amplitude and phase itself gives those ([`Detect`]).
//! It hands them with a serial port to a [`Controller`] and calls [`poll`](Controller::poll) over and over.
//!
//! ```
//! use firmware::{Block, FoldError, Folded, Rails, SAMPLES_PER_PERIOD};
//!
//! // Four periods of a sine of 1000 codes about the middle of the converter's range.
//! let angle = |k: usize| std::f64::consts::TAU * k as f64 / SAMPLES_PER_PERIOD as f64;
//! let samples: Vec<u16> = (0..4 * SAMPLES_PER_PERIOD).map(|k| (2048.0 + 1000.0 * angle(k).sin()).round() as u16).collect();
//!
//! let mut folded = Folded::new();
//! folded.reset(1);
//! folded.add(&Block { samples: &samples, channels: 1, sequence: 0, time: 0, rails: Rails::Unknown })?;
//! let (phasor, _noise) = folded.correlate(0);
//! let (amplitude, fits) = phasor.in_phase_value(folded.periods());
//! assert!(fits && (f64::from(amplitude.sixteenths()) / 16.0 - 1000.0).abs() < 0.5);
//! # Ok::<(), FoldError>(())
//! ```
//!
//! ```text
//! plan -> Route -> Router, Capture -> blocks of samples -> Folded -> Phasor -> values -> frame -> Outbox -> serial port
//!                     or Detect -> a reading a channel ---^
//! ```
#![no_std]
#![forbid(unsafe_code)]
#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

#[cfg(test)]
extern crate std;

#[macro_use]
mod log;

mod answers;
mod board_info;
mod capture;
mod change;
mod codes;
mod controller;
mod detect;
mod error;
mod excitation;
mod fold;
mod front_end;
pub mod laws;
mod lives;
mod measuring;
mod memory;
mod outbox;
mod phasor;
mod reading;
mod reference;
mod route;
mod scan;
mod scan_error;
mod scatter;
mod self_test;
pub mod settings;
mod support;
mod task;
mod watch_state;
mod wiring;

pub use board_info::BoardInfo;
pub use capture::{Block, Blocking, Capture, QUARTER_SAMPLES, Rails, Window};
pub use change::{ChangeTest, LEVEL_ONE};
pub use codes::{FULL_SCALE, LEAST_BITS, MOST_BITS, full_scale, max_periods};
pub use controller::{Activity, Controller};
pub use detect::Detect;
pub use error::{Error, ErrorKind, ErrorType};
pub use excitation::Excitation;
pub use fold::{FoldError, Folded, MAX_CHANNELS, MAX_PERIODS};
pub use front_end::FrontEnd;
pub use memory::Memory;
pub use outbox::Outbox;
pub use phasor::{Phasor, Rotation};
pub use reading::Reading;
pub use reference::{COSINE, FRACTION, HALF, SAMPLES_PER_PERIOD, SINE};
pub use route::{Route, Router, Sense};
pub use scan::{MAX_AMPLITUDES, Pace, Progress, Scan};
pub use scan_error::ScanError;
pub use scatter::Scatter;
pub use support::{Clock, Scratch, Sector, Store, Support, Watchdog};
pub use wiring::Wiring;
