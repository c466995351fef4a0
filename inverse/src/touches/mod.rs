//! Touches: found as peaks of the picture, fitted to the measurements, followed from frame to frame.

mod assignment;
pub mod fit;
pub mod gestures;
pub mod peaks;
pub mod polarity;
pub mod radius_filter;
pub mod touch;
pub mod tracker;
