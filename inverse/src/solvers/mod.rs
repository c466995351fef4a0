//! From a normalised difference to a picture of the resistivity's rise: the solvers.
//!
//! All solve `A x = b` for x, the relative rise in resistivity of every cell. A is the weighted sensitivity, b the
//! weighted difference. How the solvers work and what they cost: docs/solver.md.
//!
//! - [`Problem`] reduces A to its row space, once for a sheet. [`Factored`] makes those without some of its values.
//! - [`Nnls`] is the solver of every frame. `newton` solves with a ridge, on the `factor` of the present passive set.
//!   `active_set` solves without one, on a `passive_set`; its columns come from `queue` or `column_search`. `stacked`
//!   solves with a ridge that is too small for `newton`.
//! - [`lawson_hanson`](fn@lawson_hanson) is the reference of the tests, and the paper's method.
//! - [`tikhonov`](fn@tikhonov) and [`pseudo_inverse`] know no sign.
#![allow(
    clippy::neg_cmp_op_on_partial_ord,
    reason = "a comparison with a number that is none must fail"
)]

mod active_set;
mod column_search;
mod factor;
mod factored;
mod lawson_hanson;
mod method;
mod newton;
mod nnls;
mod passive_set;
mod problem;
mod products;
mod projector;
mod queue;
mod solution;
mod stacked;
#[cfg(test)]
mod tests;
mod tikhonov;

pub use crate::solvers::factored::Factored;
pub use crate::solvers::lawson_hanson::lawson_hanson;
pub use crate::solvers::method::{Method, UnknownMethod};
pub use crate::solvers::nnls::{Nnls, NnlsOptions};
pub use crate::solvers::problem::Problem;
pub use crate::solvers::projector::Projector;
pub use crate::solvers::solution::{Outcome, Solution, Status};
pub use crate::solvers::tikhonov::{discrepancy_ridge, pseudo_inverse, tikhonov};
