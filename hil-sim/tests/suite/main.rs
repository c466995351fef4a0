//! The simulated board: every test of this crate from outside, in one program, so that it is linked once.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a failure here is a failed test"
)]

mod agreement;
mod board;
mod calibration;
mod common;
mod descriptions;
mod drawn_board;
mod electronics;
mod faults;
mod flaws;
mod golden;
mod long_scan;
mod port;
mod pty;
mod reliability;
mod rubber;
mod scene_files;
mod scene_start;
mod self_test;
mod settings;
mod support;
#[path = "../../../forward/tests/suite/theory/mod.rs"]
mod theory;
mod times;
mod values;
mod visibility;
mod watch;
mod water;
