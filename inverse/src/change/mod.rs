//! Whether a frame shows anything, and anything new.

pub(crate) mod detector;
mod rest_mean;

pub use detector::ChangeOptions;
