//! Numeric factorisation and triangular solves.

use super::{BLOCK, CholeskyError, Symbolic};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{self as llt, LltParams, LltRegularization};
use faer::sparse::linalg::cholesky::supernodal;
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Par, Side, Spec};
use nalgebra::DMatrix;

/// The numbers of a factorisation; as many as wanted can share one [`Symbolic`].
pub(crate) struct Factor {
    pub(super) values: Vec<f64>,
    memory: MemBuffer,
}

impl Factor {
    pub(crate) fn new(symbolic: &Symbolic) -> Result<Self, CholeskyError> {
        let scratch = symbolic
            .factor
            .factorize_numeric_llt_scratch::<f64>(Par::Seq, Spec::default());
        Ok(Self {
            values: vec![0.0; symbolic.factor.len_val()],
            memory: MemBuffer::try_new(scratch).map_err(|_| CholeskyError::OutOfMemory { unknowns: symbolic.n })?,
        })
    }

    /// Factorises; `values` are in the pattern's slots.
    pub(crate) fn factorize(&mut self, symbolic: &Symbolic, values: &[f64]) -> Result<(), CholeskyError> {
        let matrix = SparseColMatRef::new(
            SymbolicSparseColMatRef::new_checked(
                symbolic.n,
                symbolic.n,
                &symbolic.column_start,
                None,
                &symbolic.row_index,
            ),
            values,
        );
        symbolic
            .factor
            .factorize_numeric_llt(
                &mut self.values,
                matrix,
                Side::Lower,
                LltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut self.memory),
                Spec::<LltParams, f64>::default(),
            )
            .map(|_| ())
            .map_err(|llt::LltError::NonPositivePivot { index }| CholeskyError::NotPositiveDefinite { unknown: index })
    }

    /// One supernode: its first column, how many columns, the rows below, and its values by column (the diagonal block
    /// first).
    fn supernode<'a>(
        &'a self,
        structure: &'a supernodal::SymbolicSupernodalCholesky<usize>,
        s: usize,
    ) -> Supernode<'a> {
        let start = structure.supernode_begin()[s];
        let columns = structure.supernode_end()[s] - start;
        let below = structure.supernode(s).pattern();
        let range = structure.col_ptr_for_val()[s]..structure.col_ptr_for_val()[s + 1];
        Supernode {
            start,
            columns,
            below,
            values: &self.values[range],
        }
    }

    /// The last `k` rows and columns of the factor: the Cholesky factor of the Schur complement of the last `k` unknowns.
    pub(crate) fn corner(&self, symbolic: &Symbolic, k: usize) -> DMatrix<f64> {
        let first = symbolic.n - k;
        let mut corner = DMatrix::zeros(k, k);
        let Some(structure) = symbolic.supernodal() else {
            return corner;
        };
        for s in (0..structure.n_supernodes()).rev() {
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
        let Some(structure) = symbolic.supernodal() else {
            return;
        };
        for s in (0..structure.n_supernodes()).rev() {
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
        let Some(structure) = symbolic.supernodal() else {
            return;
        };
        let from = structure.supernode_end().partition_point(|end| *end <= first);
        for s in from..structure.n_supernodes() {
            self.forward_step(&self.supernode(structure, s), x);
        }
    }

    /// The same where only these supernodes (in order) are reached, by [`Symbolic::reach`].
    pub(crate) fn forward_along(&self, symbolic: &Symbolic, x: &mut [[f64; BLOCK]], reach: &[usize]) {
        let Some(structure) = symbolic.supernodal() else {
            return;
        };
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
