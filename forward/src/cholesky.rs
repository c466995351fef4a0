//! Sparse Cholesky factorisation of one pattern with many values: the symbolic part once, the numeric part as often as
//! the values change. The last unknowns (the electrodes) stay last, so that their Schur complement is a corner of the
//! factor and the electrodes' own impedances need no solve at all.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{self as llt, LltParams, LltRegularization};
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::amd;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky, supernodal,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Par, Side, Spec};
use nalgebra::DMatrix;
use thiserror::Error;

/// Why a factorisation failed.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum CholeskyError {
    /// The matrix is not positive definite to working precision.
    #[error(
        "the system is not positive definite at unknown {unknown}; \
         the conductivities or contact impedances span more than double precision can hold"
    )]
    NotPositiveDefinite {
        /// Where the pivot failed, in elimination order.
        unknown: usize,
    },
    /// No memory for the factor.
    #[error("no memory for the factor of {unknowns} unknowns; ask for less accuracy")]
    OutOfMemory {
        /// Size of the system.
        unknowns: usize,
    },
}

/// Columns of a right-hand side worked on at once.
pub(crate) const BLOCK: usize = 16;

/// Order, pattern and supernodes of a symmetric matrix; no values.
#[derive(Debug)]
pub(crate) struct Symbolic {
    n: usize,
    /// Position in elimination order of every unknown.
    position: Vec<usize>,
    column_start: Vec<usize>,
    row_index: Vec<usize>,
    factor: SymbolicCholesky<usize>,
}

impl Symbolic {
    /// Analyses a pattern of `n` unknowns. `pairs` lists coupled unknowns in any order, with repeats, the diagonal left
    /// out; the last `keep_last` unknowns are eliminated last, in their order.
    pub(crate) fn new(
        n: usize,
        keep_last: usize,
        pairs: &[[usize; 2]],
    ) -> Result<Self, CholeskyError> {
        let no_memory = |_| CholeskyError::OutOfMemory { unknowns: n };
        let inner = n - keep_last;
        let (start, rows) = columns(
            inner,
            pairs.iter().filter(|p| p[0] < inner && p[1] < inner),
            |i| i,
        );
        let pattern = SymbolicSparseColMatRef::new_checked(inner, inner, &start, None, &rows);
        let (mut order, mut position) = (vec![0; inner], vec![0; inner]);
        let scratch = amd::order_maybe_unsorted_scratch::<usize>(inner, rows.len());
        let mut memory =
            MemBuffer::try_new(scratch).map_err(|_| CholeskyError::OutOfMemory { unknowns: n })?;
        amd::order_maybe_unsorted(
            &mut order,
            &mut position,
            pattern,
            amd::Control::default(),
            MemStack::new(&mut memory),
        )
        .map_err(no_memory)?;
        position.extend(inner..n);

        // The pattern in elimination order, lower triangle.
        let (column_start, row_index) = columns(n, pairs.iter(), |i| position[i]);
        // faer analyses the upper triangle and factorises from the lower one.
        let (upper_start, upper_rows) = transposed(n, &column_start, &row_index);
        let factor = factorize_symbolic_cholesky(
            SymbolicSparseColMatRef::new_checked(n, n, &upper_start, None, &upper_rows),
            Side::Upper,
            SymmetricOrdering::Identity,
            CholeskySymbolicParams {
                supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
                ..Default::default()
            },
        )
        .map_err(no_memory)?;
        Ok(Self {
            n,
            position,
            column_start,
            row_index,
            factor,
        })
    }

    /// How many values the lower triangle has.
    pub(crate) fn values(&self) -> usize {
        self.row_index.len()
    }

    /// Number of unknowns.
    pub(crate) fn unknowns(&self) -> usize {
        self.n
    }

    /// Position of an unknown in elimination order.
    pub(crate) fn position(&self, unknown: usize) -> usize {
        self.position[unknown]
    }

    /// Entries of the factor, explicit zeros of its supernodes included.
    pub(crate) fn factor_entries(&self) -> usize {
        self.factor.len_val()
    }

    /// Where the value that couples two unknowns is kept. They must be in the pattern.
    pub(crate) fn slot(&self, i: usize, j: usize) -> usize {
        let (a, b) = (self.position[i], self.position[j]);
        let (column, row) = (a.min(b), a.max(b));
        let range = self.column_start[column]..self.column_start[column + 1];
        range.start + self.row_index[range].partition_point(|r| *r < row)
    }

    fn supernodal(&self) -> Option<&supernodal::SymbolicSupernodalCholesky<usize>> {
        match self.factor.raw() {
            SymbolicCholeskyRaw::Supernodal(s) => Some(s),
            SymbolicCholeskyRaw::Simplicial(_) => None,
        }
    }
}

/// Compressed columns of the lower triangle (diagonal included, rows sorted) of pairs under a renumbering.
fn columns<'a>(
    n: usize,
    pairs: impl Iterator<Item = &'a [usize; 2]>,
    number: impl Fn(usize) -> usize,
) -> (Vec<usize>, Vec<usize>) {
    let mut entries: Vec<(u32, u32)> = pairs
        .map(|[i, j]| {
            let (a, b) = (number(*i), number(*j));
            (a.min(b) as u32, a.max(b) as u32)
        })
        .chain((0..n).map(|i| (i as u32, i as u32)))
        .collect();
    entries.sort_unstable();
    entries.dedup();
    let mut start = vec![0; n + 1];
    for (column, _) in &entries {
        start[*column as usize + 1] += 1;
    }
    for k in 0..n {
        start[k + 1] += start[k];
    }
    (start, entries.iter().map(|e| e.1 as usize).collect())
}

/// The transpose of a compressed column pattern, rows sorted.
fn transposed(n: usize, start: &[usize], rows: &[usize]) -> (Vec<usize>, Vec<usize>) {
    let mut out_start = vec![0; n + 1];
    for r in rows {
        out_start[r + 1] += 1;
    }
    for k in 0..n {
        out_start[k + 1] += out_start[k];
    }
    let mut next = out_start.clone();
    let mut out = vec![0; rows.len()];
    for column in 0..n {
        for r in &rows[start[column]..start[column + 1]] {
            out[next[*r]] = column;
            next[*r] += 1;
        }
    }
    (out_start, out)
}

/// The numbers of a factorisation; as many as wanted can share one [`Symbolic`].
pub(crate) struct Factor {
    values: Vec<f64>,
    memory: MemBuffer,
}

impl Factor {
    pub(crate) fn new(symbolic: &Symbolic) -> Result<Self, CholeskyError> {
        let scratch = symbolic
            .factor
            .factorize_numeric_llt_scratch::<f64>(Par::Seq, Spec::default());
        Ok(Self {
            values: vec![0.0; symbolic.factor.len_val()],
            memory: MemBuffer::try_new(scratch).map_err(|_| CholeskyError::OutOfMemory {
                unknowns: symbolic.n,
            })?,
        })
    }

    /// Factorises; `values` are in the pattern's slots.
    pub(crate) fn factorize(
        &mut self,
        symbolic: &Symbolic,
        values: &[f64],
    ) -> Result<(), CholeskyError> {
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
            .map_err(|llt::LltError::NonPositivePivot { index }| {
                CholeskyError::NotPositiveDefinite { unknown: index }
            })
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
    pub(crate) fn forward_substitute(
        &self,
        symbolic: &Symbolic,
        x: &mut [[f64; BLOCK]],
        first: usize,
    ) {
        let Some(structure) = symbolic.supernodal() else {
            return;
        };
        let from = structure
            .supernode_end()
            .partition_point(|end| *end <= first);
        for s in from..structure.n_supernodes() {
            let node = self.supernode(structure, s);
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

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};

    /// A random sparse symmetric matrix, diagonally dominant.
    fn example(n: usize) -> (Vec<[usize; 2]>, DMatrix<f64>) {
        let mut rng = rand::rngs::StdRng::seed_from_u64(7);
        let mut pairs = Vec::new();
        let mut dense = DMatrix::identity(n, n);
        for _ in 0..3 * n {
            let (i, j) = (rng.random_range(0..n), rng.random_range(0..n));
            if i != j {
                let v = rng.random_range(-1.0..1.0);
                pairs.push([i, j]);
                dense[(i, j)] += v;
                dense[(j, i)] += v;
                dense[(i, i)] += 2.0;
                dense[(j, j)] += 2.0;
            }
        }
        (pairs, dense)
    }

    #[test]
    fn agrees_with_a_dense_factorisation() {
        let (n, keep) = (120, 7);
        let (pairs, dense) = example(n);
        let symbolic = Symbolic::new(n, keep, &pairs).unwrap();
        let mut values = vec![0.0; symbolic.values()];
        for i in 0..n {
            values[symbolic.slot(i, i)] = dense[(i, i)];
        }
        for [i, j] in &pairs {
            values[symbolic.slot(*i, *j)] = dense[(*i, *j)];
        }
        let mut factor = Factor::new(&symbolic).unwrap();
        factor.factorize(&symbolic, &values).unwrap();

        let inverse = dense.clone().try_inverse().unwrap();
        let corner = factor.corner(&symbolic, keep);
        let schur = &corner * corner.transpose();
        let expected = inverse
            .view((n - keep, n - keep), (keep, keep))
            .clone_owned()
            .try_inverse()
            .unwrap();
        assert!((schur - expected).amax() < 1e-12);

        let mut x = vec![[0.0; BLOCK]; n];
        let columns: Vec<usize> = (0..BLOCK).map(|k| 5 * k).collect();
        for (k, i) in columns.iter().enumerate() {
            x[symbolic.position[*i]][k] = 1.0;
        }
        factor.forward_substitute(&symbolic, &mut x, 0);
        factor.back_substitute(&symbolic, &mut x);
        for (k, i) in columns.iter().enumerate() {
            for j in 0..n {
                let got = x[symbolic.position[j]][k];
                assert!((got - inverse[(j, *i)]).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn an_indefinite_matrix_is_an_error() {
        let symbolic = Symbolic::new(3, 1, &[[0, 1], [1, 2]]).unwrap();
        let mut values = vec![0.0; symbolic.values()];
        for i in 0..3 {
            values[symbolic.slot(i, i)] = 1.0;
        }
        values[symbolic.slot(0, 1)] = 2.0;
        let mut factor = Factor::new(&symbolic).unwrap();
        assert!(matches!(
            factor.factorize(&symbolic, &values),
            Err(CholeskyError::NotPositiveDefinite { .. })
        ));
    }
}
