//! The physics of a conductive sheet with electrodes: from a sheet and its resistivity to the voltages between its
//! electrodes. A [`Sheet`] is data; a [`Model`] is its mesh with the complete electrode model; a [`Solver`] gives transfer
//! impedances, and [`Sensitivity`] their derivatives. Reconstruction and simulator share this crate, which knows no other
//! crate of the project: docs/architecture.md shows its place, docs/forward.md explains the model.
//!
//! Lengths are millimetres, resistances ohm. The sheet is two-dimensional: its conductivity is the conductance of one
//! square, thickness over resistivity.
//!
//! ```
//! use forward::{Drive, Model, ModelOptions, Pattern, Sheet, Solver};
//!
//! let model = Model::new(&Sheet::paper(), &ModelOptions::default())?;
//! let solver = Solver::new(model.into())?;
//! let pattern = Pattern::adjacent(16)?;
//! let frame_v = Drive::PAPER.frame_v(solver.electrode_matrix(), &pattern);
//! assert_eq!(frame_v.len(), 208);
//!
//! // Reciprocity: drive and sense exchanged give the same transfer impedance.
//! for there in pattern.measurements() {
//!     let back = there.reciprocal();
//!     let ohm = |m: &forward::Measurement| solver.electrode_matrix().transfer_ohm(m.drive, m.sense);
//!     assert!((ohm(there) - ohm(&back)).abs() < 1e-9 * ohm(there).abs());
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]

mod accuracy;
pub mod cells;
mod cholesky;
pub mod curve;
pub mod electrodes;
mod element;
mod error;
pub mod field;
pub mod file;
mod fit;
pub mod geometry;
pub mod impedance;
pub mod mesh;
mod model;
mod options;
pub mod order;
pub mod pattern;
mod precision;
pub mod scattering;
pub mod sensitivity;
mod solver;
mod system;
mod touched;
mod update;
pub mod whole;

pub use cells::{CellError, CellGrid};
pub use cholesky::CholeskyError;
pub use error::ForwardError;
pub use field::DiscTouch;
pub use geometry::{Electrode, Geometry, GeometryError, Outline, Place, Sheet};
pub use impedance::{Drive, ElectrodeMatrix};
pub use mesh::{Mesh, MeshError, MeshSizes, Order};
pub use model::Model;
pub use options::ModelOptions;
pub use pattern::{Measurement, Pair, Pattern, PatternError};
pub use sensitivity::Sensitivity;
pub use solver::{Solver, Work};
pub use system::Tensor;
pub use touched::touched_frame;
