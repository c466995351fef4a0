//! The parts against models of them that were made from the data sheets, not from the drivers.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

mod amplifiers;
mod bench;
mod crosspoints;
mod multiplexers;
mod store;
