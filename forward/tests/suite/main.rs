//! The physics against theory: every test of this crate from outside, in one program, so that it is linked once.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a failure here is a failed test"
)]

mod convergence;
mod disc;
mod electrodes;
mod extremes;
mod laws;
mod low_rank;
mod polar_grid;
mod scattering;
mod sensitivity;
mod theory;
mod touches;
