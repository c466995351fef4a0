//! From the rise of touches to newtons: the rubber creeps.
//!
//! [`solid`] is the rubber and its inverse; [`meter`] makes newtons of touches; [`press`] records a press-and-hold as a
//! [`recording`], in which [`calibration`] finds the rubber's parameters.

pub mod calibration;
pub mod meter;
pub mod press;
pub mod recording;
pub mod solid;
