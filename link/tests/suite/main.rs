//! The PC's end of the wire: every test of this crate from outside, in one program, so that it is linked once.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a failure here is a failed test"
)]

mod flash;
mod hostile;
mod phantom;
mod reconnect;
mod session;
mod settings;
