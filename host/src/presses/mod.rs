//! Presses at known places: calibrating from them, and locating others with what they taught.

pub(crate) mod bench;
pub(crate) mod calibrate;
mod changes;
pub(crate) mod extent;
pub(crate) mod file;
pub(crate) mod gcode;
mod guided;
pub(crate) mod live;
pub(crate) mod locate;
pub(crate) mod marks;
mod model;
mod picture;
mod similarity;
pub(crate) mod store;
pub(crate) mod truth;
