//! The program: every test of this crate from outside, in one program, so that it is linked once.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a failure here is a failed test"
)]

mod baseline;
mod calibrate;
mod hello;
mod paper;
mod program;
mod real_data;
mod recordings;
mod tables;
mod transcripts;
