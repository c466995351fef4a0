//! Elimination order, pattern and supernodes.

use super::CholeskyError;
use super::structure::Structure;

/// Order, pattern and supernodes of a symmetric matrix; no values.
#[derive(Debug)]
pub(crate) struct Symbolic {
    pub(super) n: usize,
    /// Position in elimination order of every unknown.
    position: Vec<usize>,
    pub(super) column_start: Vec<usize>,
    pub(super) row_index: Vec<usize>,
    pub(super) structure: Structure,
    /// Supernode of every column.
    supernode_of: Vec<u32>,
}

impl Symbolic {
    /// Analyses a pattern of `n` unknowns. `pairs` lists coupled unknowns in any order, with repeats, the diagonal left
    /// out; the last `keep_last` unknowns are eliminated last, in their order.
    pub(crate) fn new(n: usize, keep_last: usize, pairs: &[[usize; 2]]) -> Result<Self, CholeskyError> {
        let inner = n - keep_last;
        let (start, rows) = columns(inner, pairs.iter().filter(|p| p[0] < inner && p[1] < inner), |i| i);
        // The order depends on which triangle is given.
        let (start, rows) = transposed(inner, &start, &rows);
        let mut position: Vec<usize> = match amd::order(inner, &start, &rows, &amd::Control::default()) {
            Ok((_, position, _)) => position,
            // Not reached: the pattern is sorted and within its bounds.
            Err(_) => (0..inner).collect(),
        };
        position.extend(inner..n);

        // The pattern in elimination order, lower triangle; it is analysed from the upper one.
        let (column_start, row_index) = columns(n, pairs.iter(), |i| position[i]);
        let (upper_start, upper_rows) = transposed(n, &column_start, &row_index);
        let structure =
            Structure::new(n, &upper_start, &upper_rows).map_err(|_| CholeskyError::OutOfMemory { unknowns: n })?;
        let mut supernode_of = vec![0; n];
        for s in 0..structure.count() {
            supernode_of[structure.columns(s)].fill(s as u32);
        }
        Ok(Self {
            n,
            position,
            column_start,
            row_index,
            structure,
            supernode_of,
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
        let mut reached = vec![false; self.structure.count()];
        for p in positions {
            let mut s = self.supernode_of[*p] as usize;
            while !reached[s] {
                reached[s] = true;
                match self.structure.below(s).first() {
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
        let columns = self.structure.columns(s).len();
        (columns, columns + self.structure.below(s).len())
    }

    /// The columns of a supernode.
    pub(crate) fn supernode_columns(&self, s: usize) -> std::ops::Range<usize> {
        self.structure.columns(s)
    }

    /// How many supernodes.
    pub(crate) fn supernodes(&self) -> usize {
        self.structure.count()
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
