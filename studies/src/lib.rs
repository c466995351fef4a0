//! How well frames are turned into touches, measured on simulated frames whose truth is known.
//!
//! A [`TestSheet`] simulates the frames of a [`Scene`], and a [`Score`] compares the touches found with the truth.
//! The other modules are studies on such frames, and [`paper`] repeats the experiments of the source paper.
//! The way of a frame through all crates: docs/architecture.md. The results: docs/results.md and docs/benchmarks.md.
//!
//! ```
//! use forward::Drive;
//! use studies::{Kind, TestSheet, imager, rng};
//!
//! let mut rng = rng(1);
//! let imager = imager(Drive::PAPER, 10.0)?; // cells of 10 mm
//! let mut sheet = TestSheet::new(&imager, Drive::PAPER, 0.0, 0.0, &mut rng)?;
//! let scene = Kind::Equal(1).scene(&mut rng, 27.0); // one touch, noise at 27 dB
//! let frame = sheet.frame(&scene, &mut rng)?;
//! let mut reconstructor = sheet.reconstructor()?;
//! let touches = &reconstructor.frame(&frame)?.touches;
//! let [x, y] = scene.touches[0].centre_mm;
//! assert_eq!(touches.len(), 1);
//! assert!((touches[0].x_mm - x).hypot(touches[0].y_mm - y) < 1.0);
//! # Ok::<(), studies::StudyError>(())
//! ```
#![forbid(unsafe_code)]

pub mod chain;
pub mod compare;
pub mod conformal;
pub mod cost;
pub mod dataset;
pub mod drift;
pub mod error;
pub mod faults;
pub mod fig7;
pub mod flawed_sheet;
pub mod greit;
pub mod live_sheet;
pub mod merit;
pub mod paper;
pub mod reliability;
pub mod savings;
pub mod scene;
pub mod score;
pub mod screening;
pub mod stress;
pub mod test_sheet;
pub mod trial;

pub use drift::{Drift, smooth_field};
pub use error::StudyError;
pub use live_sheet::LiveSheet;
pub use scene::{Fault, Kind, Scene, Worse, rng};
pub use score::{MISSED_MM, Score, quantile};
pub use test_sheet::{
    TestSheet, imager, imager_for, live_reconstructor, misplaced, noise_v, noisy, reconstructor, slipped,
};
