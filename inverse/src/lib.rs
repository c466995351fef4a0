//! From the frames of a sensor board to a picture of pressure and a list of touches.
//!
//! [`learned`] stands beside the others: touches on sheets that no model describes. Every other folder knows only those below
//! it: [`live`] (a stream of frames) and [`batch`] (a table of them), [`force`] (newtons from a rubber that creeps),
//! [`pipeline`] (one frame), [`quality`] (what can be believed of it), [`touches`] (found, fitted, followed), [`change`] (is
//! there anything new), [`reference`](mod@reference) (what frames are compared with), [`solvers`], `linalg` and `stats`. No
//! I/O; threads for whole tables only ([`batch::Batch::frames`]).
//! The way of a frame through all crates: docs/architecture.md.
//!
//! A touch on the paper's sheet, simulated on a mesh of its own and found again:
//!
//! ```
//! use forward::{DiscTouch, Drive, Model, ModelOptions, Pattern, Sheet, Solver};
//! use inverse::pipeline::{Reconstructor, ReconstructorOptions};
//! use inverse::reference::{Reference, imager::Imager, noise::FrameNoise};
//! use inverse::solvers::Method;
//!
//! let (sheet, drive, pattern) = (Sheet::paper(), Drive::PAPER, Pattern::adjacent(16)?);
//! let pressed = DiscTouch { centre_mm: [30.0, -20.0], radius_mm: 12.5, rise: 0.2 };
//! let mut rubber = Solver::new(Model::new(&sheet, &ModelOptions::for_touches(&[pressed]))?.into())?;
//! let baseline_v = drive.frame_v(rubber.electrode_matrix(), &pattern);
//! let frame_v = drive.frame_v(rubber.solve_touches(&[pressed])?, &pattern);
//!
//! let imager = Imager::new(&sheet, drive, pattern, 5.0)?;
//! let options = ReconstructorOptions::for_imager(&imager, Method::Nnls);
//! let reference = Reference::new(imager.into(), baseline_v, FrameNoise::Unknown)?;
//! let mut reconstructor = Reconstructor::new(reference, options);
//! let found = &reconstructor.frame(&frame_v)?.touches;
//! assert_eq!(found.len(), 1);
//! assert!((found[0].x_mm - 30.0).hypot(found[0].y_mm + 20.0) < 1.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]

pub mod batch;
pub mod change;
pub mod force;
pub mod learned;
mod linalg;
pub mod live;
pub mod pipeline;
pub mod quality;
pub mod reference;
pub mod solvers;
mod stats;
pub mod touches;
