//! How well the reconstruction works: every test of this crate from outside, in one program, so that it is linked once.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a failure here is a failed test"
)]

mod accuracy;
mod bad_frames;
mod contacts;
mod dataset;
mod drift;
mod faults;
mod flawed_sheet;
mod given_up;
mod hand;
mod landing;
mod limits;
mod model_error;
mod noise;
mod polarity;
mod screening;
mod watch;
