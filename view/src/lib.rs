//! Showing a [`Picture`](crate::picture::Picture): as a live page in a browser, and as an image file.
//!
//! Both draw the same thing: the field smoothed by a cubic B-spline ([`field`]), in one of the colour maps of
//! [`palette`], with labels beside the touches ([`labels`]). What the field shows, [`surface`] decides: the fitted touches
//! where they explain the frame ([`fitted`]), else the reconstruction, and then that is said.
//! The way of a frame through all crates: docs/architecture.md.
//!
//! A picture, drawn to a PNG in memory:
//!
//! ```
//! use std::sync::Arc;
//! use view::picture::{Grid, Picture, Stats, circle_mm};
//!
//! let outline_mm = circle_mm(97.5, 180);
//! let grid = Grid::cover(&outline_mm, 5.0)?;
//! let rise = |[x, y]: [f64; 2]| if (x - 30.0).hypot(y + 20.0) < 12.5 { 0.2 } else { 0.0 };
//! let picture = Picture {
//!     sequence: 1,
//!     time_s: 0.0,
//!     values: grid.centres_mm().map(rise).collect(),
//!     grid: Arc::new(grid),
//!     outline_mm: Arc::new(outline_mm),
//!     electrodes_mm: Arc::new(circle_mm(97.5, 16)),
//!     touches: Vec::new(),
//!     stats: Stats::default(),
//! };
//! let mut file = Vec::new();
//! view::png::render(&picture, 320)?.encode_png(&mut file)?;
//! assert!(file.starts_with(b"\x89PNG"));
//! assert_eq!(file[16..20], 320_u32.to_be_bytes());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]

pub mod canvas;
pub mod chart;
pub mod field;
pub mod fitted;
pub mod labels;
pub mod palette;
pub mod picture;
pub mod png;
pub mod replace;
pub mod sheet;
pub mod shown;
pub mod surface;
pub mod text;
pub mod web;
pub mod wire;

/// Least full scale of the colours, relative rise: noise of an untouched sheet stays dark.
pub const SCALE_FLOOR: f32 = 0.05;
