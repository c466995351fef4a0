//! The board's code: every test of this crate from outside, in one program, so that it is linked once.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a failure here is a failed test"
)]

mod analyser;
mod change;
mod fake;
mod lockin;
mod scan;
mod wide;
