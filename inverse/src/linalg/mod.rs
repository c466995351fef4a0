//! Dense linear algebra of the solvers: vectorised, on aligned columns, without allocation after the first use.

pub(crate) mod aligned;
pub(crate) mod basis;
pub(crate) mod block;
pub(crate) mod columns;
pub(crate) mod dense;
pub(crate) mod eigen;
pub(crate) mod kernels;
pub(crate) mod pivoted;
pub(crate) mod signs;
pub(crate) mod vector;

#[cfg(test)]
pub(crate) mod tests;
