//! The whole chain: every test of this crate from outside, in one program, so that it is linked once.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a failure here is a failed test"
)]

mod baseline;
mod board_files;
mod emulated;
mod faults;
mod gestures;
mod live_scenes;
mod looks;
mod manifests;
mod rim;
mod safety;
mod touches;
