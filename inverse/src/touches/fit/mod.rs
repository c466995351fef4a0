//! Touches fitted to the measurements: where the picture's peaks begin, a handful of parameters ends.
//!
//! A touch is a disc of raised resistivity with four parameters: x and y of its centre (mm), its radius R (mm) and its
//! strength S (mm²), the rise integrated over it as the linear model sees it. In a uniform sheet the answer to a disc of any
//! contrast is that of the linear model with the rise c replaced by 2 c / (2 + c), for every order of the field's
//! multipoles; only what touches do to one another and the rim's image of a touch are left out, below 1 % for +20 %. So S
//! is fitted, and the true rise is c = 2 s / (2 - s) with s = S / (pi R²).
//!
//! [`responses`] holds the answer to a disc of unit strength over the sheet and interpolates it with its derivatives,
//! [`levenberg_marquardt`] fits a given number of touches, [`model_order`] chooses the number, [`nonlinear`] tells what the linear model leaves
//! out, [`linearisation_error`] carries that from frame to frame, [`fitter`] does it all frame after frame, and this module turns the outcome into touches with their uncertainty.

pub mod disc;
pub mod electrode_uncertainty;
pub mod fitter;
pub mod frame_fit;
mod interpolation;
pub mod levenberg_marquardt;
pub mod linearisation_error;
pub mod model_order;
pub mod nonlinear;
pub mod prior;
pub mod responses;

pub use disc::{Disc, Discs, MOST_TOUCHES};
pub use frame_fit::{Fitted, Frame, Start, fit};
pub use prior::FitOptions;
