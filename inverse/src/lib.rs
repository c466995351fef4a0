//! From the frames of a sensor board to a picture of pressure and a list of touches.
//!
//! Every folder knows only those below it: [`live`] (a stream of frames), [`batch`] (a table of them), [`force`] (newtons from a rubber that creeps),
//! [`pipeline`] (one frame), [`quality`] (what can be believed of it), [`touches`] (found, fitted, followed), [`change`] (is there
//! anything new), [`reference`](mod@reference) (what frames are compared with), [`solvers`], `linalg`. No I/O, no threads.
//! The way of a frame through all crates: docs/architecture.md.
#![forbid(unsafe_code)]

pub mod batch;
pub mod change;
pub mod force;
mod linalg;
pub mod live;
pub mod pipeline;
pub mod quality;
pub mod reference;
pub mod solvers;
pub mod touches;
