//! The factor's values and triangular solves.

use super::structure::Structure;
use super::{BLOCK, CholeskyError, Symbolic};
use nalgebra::DMatrix;

/// The numbers of a factorisation; as many as wanted can share one [`Symbolic`].
pub(crate) struct Factor {
    pub(super) values: Vec<f64>,
}

impl Factor {
    pub(crate) fn new(symbolic: &Symbolic) -> Result<Self, CholeskyError> {
        let mut values = Vec::new();
        values
            .try_reserve_exact(symbolic.structure.values())
            .map_err(|_| CholeskyError::OutOfMemory { unknowns: symbolic.n })?;
        values.resize(symbolic.structure.values(), 0.0);
        Ok(Self { values })
    }

    /// One supernode: its first column, how many columns, the rows below, and its values by column (the diagonal block
    /// first).
    fn supernode<'a>(&'a self, structure: &'a Structure, s: usize) -> Supernode<'a> {
        let columns = structure.columns(s);
        Supernode {
            start: columns.start,
            columns: columns.len(),
            below: structure.below(s),
            values: &self.values[structure.block(s)],
        }
    }

    /// The last `k` rows and columns of the factor: the Cholesky factor of the Schur complement of the last `k` unknowns.
    pub(crate) fn corner(&self, symbolic: &Symbolic, k: usize) -> DMatrix<f64> {
        let first = symbolic.n - k;
        let mut corner = DMatrix::zeros(k, k);
        let structure = &symbolic.structure;
        for s in (0..structure.count()).rev() {
            let node = self.supernode(structure, s);
            if node.start + node.columns <= first {
                break;
            }
            for c in 0..node.columns {
                if node.start + c < first {
                    continue;
                }
                let column = node.column(c);
                for (r, v) in column[c..].iter().enumerate() {
                    corner[(node.row(c + r) - first, node.start + c - first)] = *v;
                }
            }
        }
        corner
    }

    /// Solves `L^T X = B` in place, in elimination order.
    pub(crate) fn back_substitute(&self, symbolic: &Symbolic, x: &mut [[f64; BLOCK]]) {
        let structure = &symbolic.structure;
        for s in (0..structure.count()).rev() {
            let node = self.supernode(structure, s);
            for c in (0..node.columns).rev() {
                let column = node.column(c);
                let mut sum = x[node.start + c];
                for (v, row) in column[node.columns..].iter().zip(node.below) {
                    subtract(&mut sum, *v, &x[*row]);
                }
                for (r, v) in column[c + 1..node.columns].iter().enumerate() {
                    subtract(&mut sum, *v, &x[node.start + c + 1 + r]);
                }
                let pivot = 1.0 / column[c];
                sum.iter_mut().for_each(|y| *y *= pivot);
                x[node.start + c] = sum;
            }
        }
    }

    /// Solves `L X = B` in place, in elimination order. Rows before `first` of B are zero and stay so.
    pub(crate) fn forward_substitute(&self, symbolic: &Symbolic, x: &mut [[f64; BLOCK]], first: usize) {
        let structure = &symbolic.structure;
        let from = structure.end().partition_point(|end| *end <= first);
        for s in from..structure.count() {
            self.forward_step(&self.supernode(structure, s), x);
        }
    }

    /// The same where only these supernodes (in order) are reached, by [`Symbolic::reach`].
    pub(crate) fn forward_along(&self, symbolic: &Symbolic, x: &mut [[f64; BLOCK]], reach: &[usize]) {
        let structure = &symbolic.structure;
        for s in reach {
            self.forward_step(&self.supernode(structure, *s), x);
        }
    }

    fn forward_step(&self, node: &Supernode<'_>, x: &mut [[f64; BLOCK]]) {
        for c in 0..node.columns {
            let column = node.column(c);
            let pivot = 1.0 / column[c];
            let mut y = x[node.start + c];
            if y == [0.0; BLOCK] {
                continue;
            }
            y.iter_mut().for_each(|y| *y *= pivot);
            x[node.start + c] = y;
            for (r, v) in column[c + 1..node.columns].iter().enumerate() {
                subtract(&mut x[node.start + c + 1 + r], *v, &y);
            }
            for (v, row) in column[node.columns..].iter().zip(node.below) {
                subtract(&mut x[*row], *v, &y);
            }
        }
    }
}

struct Supernode<'a> {
    start: usize,
    columns: usize,
    below: &'a [usize],
    values: &'a [f64],
}

impl Supernode<'_> {
    fn column(&self, c: usize) -> &[f64] {
        let height = self.columns + self.below.len();
        &self.values[c * height..(c + 1) * height]
    }

    fn row(&self, r: usize) -> usize {
        if r < self.columns {
            self.start + r
        } else {
            self.below[r - self.columns]
        }
    }
}

#[inline(always)]
fn subtract(sum: &mut [f64; BLOCK], factor: f64, row: &[f64; BLOCK]) {
    for (s, x) in sum.iter_mut().zip(row) {
        *s -= factor * x;
    }
}
