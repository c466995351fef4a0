//! Turns the frames of a sensor board into a picture of pressure and a list of touches.
//!
//! The way of a frame: [`link`] (bytes to messages), [`session`] (a board that introduced itself), [`baseline`] (the
//! unpressed sheet), [`live`] (baseline, then pictures), [`health`] (what cannot be believed), [`reconstructor`] (gate,
//! weigh, solve, find touches; on [`imager`]'s model, the noise told by [`noise`], with the solvers of [`reconstruct`]),
//! [`electrodes`] (where they are), [`fit`] (touches to the measurements), [`tracker`] (numbers for touches), [`creep`]
//! (their forces), [`view`] (what a person sees). Beside it: [`plans`] (what a frame measures), [`settings`] (what the board
//! keeps), [`flash`] (a new program for the board), [`study`] (all that, measured on simulated frames), [`paper`] (the source
//! paper's experiments again).
#![forbid(unsafe_code)]

pub mod baseline;
mod contact;
pub mod creep;
mod difference;
pub mod doubt;
pub mod electrodes;
pub mod fit;
pub mod greit;
pub mod health;
pub mod imager;
pub mod live;
pub mod malformed;
pub mod noise;
pub mod paper;
pub mod picture;
pub mod reconstruct;
pub mod reconstructor;
pub mod steady;
pub mod study;
pub mod table;
pub mod touch;
pub mod touches;
pub mod tracker;
pub mod view;
mod watch;
