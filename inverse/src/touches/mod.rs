//! Touches: found as peaks of the picture, fitted to the measurements, followed from frame to frame.

pub mod fit;
pub mod peaks;
pub mod polarity;
pub mod radius_filter;
pub mod touch;
pub mod tracker;
