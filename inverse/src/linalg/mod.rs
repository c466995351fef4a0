//! Dense linear algebra of the solvers: vectorised, on aligned columns, without allocation once they are made.

pub(crate) mod aligned;
pub(crate) mod basis;
pub(crate) mod block;
pub(crate) mod columns;
pub(crate) mod dense;
pub(crate) mod kernels;
pub(crate) mod signs;
