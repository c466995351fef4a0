//! The program: every test of this crate from outside, in one program, so that it is linked once.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a failure here is a failed test"
)]

mod baseline;
mod calibrate;
mod dataset;
#[cfg(target_os = "linux")]
mod day;
mod doctor;
#[cfg(target_os = "linux")]
mod ending;
mod events;
mod from_recording;
mod guided;
mod hello;
mod help;
#[cfg(target_os = "linux")]
mod hours;
mod json_lines;
mod page_recording;
mod paper;
mod presses;
mod presses_live;
mod program;
mod real_data;
mod reconnect;
mod recordings;
mod ros2;
mod skins;
mod tables;
mod transcripts;
#[cfg(target_os = "linux")]
mod web_load;
mod wrong_tables;
