//! Elimination order, pattern and supernodes.

use super::CholeskyError;
use faer::Side;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::amd;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering, factorize_symbolic_cholesky,
    supernodal,
};

/// Order, pattern and supernodes of a symmetric matrix; no values.
#[derive(Debug)]
pub(crate) struct Symbolic {
    pub(super) n: usize,
    /// Position in elimination order of every unknown.
    position: Vec<usize>,
    pub(super) column_start: Vec<usize>,
    pub(super) row_index: Vec<usize>,
    pub(super) factor: SymbolicCholesky<usize>,
    /// Supernode of every column.
    supernode_of: Vec<u32>,
}

impl Symbolic {
    /// Analyses a pattern of `n` unknowns. `pairs` lists coupled unknowns in any order, with repeats, the diagonal left
    /// out; the last `keep_last` unknowns are eliminated last, in their order.
    pub(crate) fn new(n: usize, keep_last: usize, pairs: &[[usize; 2]]) -> Result<Self, CholeskyError> {
        let no_memory = |_| CholeskyError::OutOfMemory { unknowns: n };
        let inner = n - keep_last;
        let (start, rows) = columns(inner, pairs.iter().filter(|p| p[0] < inner && p[1] < inner), |i| i);
        let pattern = SymbolicSparseColMatRef::new_checked(inner, inner, &start, None, &rows);
        let (mut order, mut position) = (vec![0; inner], vec![0; inner]);
        let scratch = amd::order_maybe_unsorted_scratch::<usize>(inner, rows.len());
        let mut memory = MemBuffer::try_new(scratch).map_err(|_| CholeskyError::OutOfMemory { unknowns: n })?;
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
        let mut this = Self {
            n,
            position,
            column_start,
            row_index,
            factor,
            supernode_of: vec![0; n],
        };
        let mut supernode_of = std::mem::take(&mut this.supernode_of);
        if let Some(s) = this.supernodal() {
            for (k, (begin, end)) in s.supernode_begin().iter().zip(s.supernode_end()).enumerate() {
                supernode_of[*begin..*end].fill(k as u32);
            }
        }
        this.supernode_of = supernode_of;
        Ok(this)
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

    /// Where the value that couples two unknowns is kept. They must be in the pattern.
    pub(crate) fn slot(&self, i: usize, j: usize) -> usize {
        let (a, b) = (self.position[i], self.position[j]);
        let (column, row) = (a.min(b), a.max(b));
        let range = self.column_start[column]..self.column_start[column + 1];
        range.start + self.row_index[range].partition_point(|r| *r < row)
    }

    /// Columns and rows (both in elimination order) of the matrix's lower triangle, one pair for every value.
    pub(crate) fn pairs(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        (0..self.n).flat_map(|c| {
            let rows = &self.row_index[self.column_start[c]..self.column_start[c + 1]];
            rows.iter().map(move |r| (c, *r))
        })
    }

    /// The supernodes that right-hand sides with entries at these positions reach, in order.
    pub(crate) fn reach(&self, positions: &[usize]) -> Vec<usize> {
        let Some(structure) = self.supernodal() else {
            return Vec::new();
        };
        let mut reached = vec![false; structure.n_supernodes()];
        for p in positions {
            let mut s = self.supernode_of[*p] as usize;
            while !reached[s] {
                reached[s] = true;
                match structure.supernode(s).pattern().first() {
                    Some(row) => s = self.supernode_of[*row] as usize,
                    None => break,
                }
            }
        }
        (0..reached.len()).filter(|s| reached[*s]).collect()
    }

    /// The supernode of a column.
    pub(super) fn supernode_of(&self, column: usize) -> usize {
        self.supernode_of[column] as usize
    }

    /// Columns of a supernode and entries of one of them.
    pub(crate) fn supernode_shape(&self, s: usize) -> (usize, usize) {
        self.supernodal().map_or((0, 0), |structure| {
            let columns = structure.supernode_end()[s] - structure.supernode_begin()[s];
            (columns, columns + structure.supernode(s).pattern().len())
        })
    }

    /// The columns of a supernode.
    pub(crate) fn supernode_columns(&self, s: usize) -> std::ops::Range<usize> {
        self.supernodal().map_or(0..0, |structure| {
            structure.supernode_begin()[s]..structure.supernode_end()[s]
        })
    }

    /// How many supernodes.
    pub(crate) fn supernodes(&self) -> usize {
        self.supernodal().map_or(0, |s| s.n_supernodes())
    }

    pub(super) fn supernodal(&self) -> Option<&supernodal::SymbolicSupernodalCholesky<usize>> {
        match self.factor.raw() {
            SymbolicCholeskyRaw::Supernodal(s) => Some(s),
            SymbolicCholeskyRaw::Simplicial(_) => None,
        }
    }
}

/// Compressed columns of the lower triangle (diagonal included, rows sorted) of pairs under a renumbering.
fn columns<'a>(
    n: usize,
    pairs: impl Iterator<Item = &'a [usize; 2]> + Clone,
    number: impl Fn(usize) -> usize,
) -> (Vec<usize>, Vec<usize>) {
    let ordered = |[i, j]: &[usize; 2]| {
        let (a, b) = (number(*i), number(*j));
        (a.min(b), a.max(b))
    };
    // A counting sort by column with room for the diagonal, then every short column by itself.
    let mut next = vec![0; n + 1];
    for pair in pairs.clone() {
        next[ordered(pair).0 + 1] += 1;
    }
    for k in 0..n {
        next[k + 1] += next[k] + 1;
    }
    let bounds = next.clone();
    let mut raw = vec![0; next[n]];
    for (column, at) in next.iter_mut().enumerate().take(n) {
        raw[*at] = column;
        *at += 1;
    }
    for pair in pairs {
        let (column, row) = ordered(pair);
        raw[next[column]] = row;
        next[column] += 1;
    }
    let mut start = Vec::with_capacity(n + 1);
    let mut rows: Vec<usize> = Vec::with_capacity(raw.len());
    start.push(0);
    for k in 0..n {
        let column = &mut raw[bounds[k]..bounds[k + 1]];
        column.sort_unstable();
        let first = rows.len();
        for row in column {
            if rows[first..].last() != Some(row) {
                rows.push(*row);
            }
        }
        start.push(rows.len());
    }
    (start, rows)
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
