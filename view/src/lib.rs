//! Showing a [`Picture`](crate::picture::Picture): as a live page in a browser, and as an image file.
//!
//! Both draw the same thing: the field smoothed by a cubic B-spline ([`field`]), in one of the colour maps of
//! [`palette`], with the labels laid out by the same rule ([`labels`]).
//! The way of a frame through all crates: docs/architecture.md.
#![forbid(unsafe_code)]

pub mod canvas;
pub mod chart;
pub mod field;
pub mod labels;
pub mod palette;
pub mod picture;
pub mod png;
pub mod sheet;
pub mod shown;
pub mod surface;
pub mod text;
pub mod web;
pub mod wire;

/// Least full scale of the colours, relative rise: noise of an untouched sheet stays dark.
pub const SCALE_FLOOR: f32 = 0.05;
