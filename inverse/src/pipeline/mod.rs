//! From a frame to a picture and its touches.

pub mod reconstructor;
