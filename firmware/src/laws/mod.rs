//! The duties of every trait as tests that run on every implementor: fakes, simulators and, as a self-test, boards.

mod detect;
mod front_end;
mod support;

pub use detect::{DetectViolation, detect};
pub use front_end::{Violation, check};
pub use support::{SupportViolation, clock, scratch, store, watchdog};
