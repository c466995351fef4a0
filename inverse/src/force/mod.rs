//! From the rise of touches to newtons: the rubber creeps.
//!
//! [`solid`] is the rubber and its inverse. [`meter`] makes newtons of touches. [`press`] records a press-and-hold as a
//! [`recording`], from which [`calibration`] estimates the rubber's parameters. Equations and accuracy: docs/creep.md.

pub mod calibration;
pub mod meter;
pub mod press;
pub mod recording;
pub mod solid;

/// Force of each mm² of integrated rise of a typical rubber, N/mm²: 25 N on a disc tip of 25 mm raise the resistivity by 20 % at once
/// (docs/physics.md, "Assumed where the paper is silent"). An assumption: how far another rubber is from it only
/// its calibration tells.
pub const TYPICAL_N_PER_MM2: f64 = 25.0 / (std::f64::consts::PI * 12.5 * 12.5) / 0.2;
