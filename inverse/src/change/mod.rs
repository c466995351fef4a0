//! Whether a frame shows anything, and anything new.

pub(crate) mod detector;
mod rest_mean;
mod slide;

pub use detector::ChangeOptions;
