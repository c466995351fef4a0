//! Touches fitted to the measurements: the picture's peaks are the start, a few parameters the result.
//!
//! A touch is a disc of raised resistivity with four parameters: x and y of its centre (mm), its radius R (mm) and its
//! strength S (mm²). The strength is the rise integrated over the disc, as the linear model sees it. In a uniform sheet
//! the response to a disc of any rise c is that of the linear model with the rise s = 2 c / (2 + c). That holds for
//! every order of the field's multipoles. It leaves out what touches do to one another and the rim's image of a touch:
//! below 1 % for +20 %. The fit therefore finds S, and the true rise is c = 2 s / (2 - s) with s = S / (pi R²).
//!
//! From the bottom up:
//!
//! - [`disc`]: a touch as it is fitted; [`prior`]: what is known of touches before.
//! - [`responses`]: the response to a disc of unit strength over the sheet, interpolated with its derivatives.
//! - [`levenberg_marquardt`]: fits a given number of touches.
//! - [`model_order`]: chooses the number.
//! - [`frame_fit`]: fits one frame, and states the uncertainties.
//! - [`nonlinear`]: the linearisation error of discs; [`linearisation_error`]: the same, carried from frame to frame.
//! - `matched_filter`: the touches that explain best what no discs explain.
//! - [`electrode_uncertainty`]: what the electrodes' uncertainty adds to that of touches.
//! - `nuisance`: what changes frames beside touches, and what it does to their accuracy.
//! - [`reduction`]: brings frames of the model into the space of the data.
//! - [`fitter`]: fits frame after frame, with all of these.
//!
//! The thresholds are in `FitOptions`, `FitterOptions`, `ModelOrderOptions`, `LevenbergMarquardtOptions` and
//! `ErrorGrowth`.

pub mod disc;
mod discs;
pub mod electrode_uncertainty;
pub mod fitter;
pub mod fitter_options;
pub mod frame_fit;
mod interpolation;
pub mod levenberg_marquardt;
pub mod linearisation_error;
pub(crate) mod matched_filter;
pub mod model_order;
mod node_values;
pub mod nonlinear;
pub(crate) mod nuisance;
pub mod prior;
pub mod reduction;
pub mod responses;
mod splits;

pub use disc::{Disc, Discs, MOST_TOUCHES};
pub use frame_fit::{Fitted, Frame, Seeds, Start, fit};
pub use prior::FitOptions;
