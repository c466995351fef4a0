//! The physics of a conductive sheet with electrodes: geometry, mesh, complete electrode model, transfer impedances and
//! their sensitivity to resistivity.
//!
//! Lengths are millimetres, resistances ohm. The sheet is two-dimensional: its conductivity is the conductance of one
//! square, thickness over resistivity.
#![forbid(unsafe_code)]

mod accuracy;
pub mod cells;
mod cholesky;
pub mod curve;
pub mod electrodes;
mod element;
pub mod field;
pub mod file;
mod fit;
pub mod geometry;
pub mod impedance;
pub mod mesh;
mod model;
pub mod pattern;
mod precision;
pub mod sensitivity;
mod solver;
mod system;
mod update;

pub use cells::{CellError, CellGrid};
pub use cholesky::CholeskyError;
pub use field::DiscTouch;
pub use geometry::{Electrode, Geometry, GeometryError, Outline, Place, Sheet};
pub use impedance::{Drive, ElectrodeMatrix};
pub use mesh::{Mesh, MeshError, MeshSizes, Order};
pub use model::{ForwardError, Model, ModelOptions};
pub use pattern::{Measurement, Pair, Pattern, PatternError};
pub use sensitivity::Sensitivity;
pub use solver::{Solver, Work};
pub use system::Tensor;
