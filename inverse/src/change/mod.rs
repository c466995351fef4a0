//! Whether a frame shows anything, and anything new.

pub(crate) mod detector;
