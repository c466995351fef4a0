//! The boards' programs on the emulated chips: one test program, linked once. `tests/boards.sh` builds the boards' programs and
//! says where they are.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

mod common;

mod careful;
mod clocks;
mod h743;
mod log;
mod panics;
mod power_cut;
mod programs;
mod trouble;
