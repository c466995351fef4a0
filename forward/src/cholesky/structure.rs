//! Supernodes of the factor: neighbouring columns with one pattern below them, or nearly so, kept as one dense block.

use std::collections::TryReserveError;
use std::ops::Range;

/// Two supernodes become one where the zeros that this stores are at most this part of what is stored, by the largest
/// number of columns together. (Ashcraft and Grimes 1989; the values are CHOLMOD's.)
const MOST_ZEROS: [(usize, f64); 4] = [(4, 1.0), (16, 0.8), (48, 0.1), (usize::MAX, 0.05)];

const NONE: usize = usize::MAX;

/// Where the dense blocks are. The block of a supernode is kept by columns: first its own rows, then those below.
#[derive(Debug, Default)]
pub(crate) struct Structure {
    /// First column of every supernode; at the end the number of columns.
    begin: Vec<usize>,
    /// Where the rows below every supernode start in `rows`; at the end their number.
    row_start: Vec<usize>,
    rows: Vec<usize>,
    /// Where the values of every supernode start; at the end their number.
    value_start: Vec<usize>,
    /// Where the descendants of every supernode start in `descendants`; at the end their number.
    descendant_start: Vec<usize>,
    descendants: Vec<usize>,
}

impl Structure {
    /// Analyses a matrix of `n` unknowns in elimination order. `start` and `rows` are the columns of its upper triangle.
    ///
    /// # Errors
    /// No memory for the rows.
    pub(crate) fn new(n: usize, start: &[usize], rows: &[usize]) -> Result<Self, TryReserveError> {
        let above = |j: usize| rows[start[j]..start[j + 1]].iter().copied().filter(move |i| *i < j);
        let (parent, counts) = elimination_tree(n, above);
        let (sizes, degrees) = merged(fundamental(&parent, &counts), &parent, &counts);

        let mut this = Self::default();
        let (mut first, mut row, mut value) = (0, 0, 0);
        let mut supernode_of = Vec::with_capacity(n);
        for (s, (size, degree)) in sizes.iter().zip(&degrees).enumerate() {
            this.begin.push(first);
            this.row_start.push(row);
            this.value_start.push(value);
            supernode_of.resize(first + size, s);
            first += size;
            row += degree;
            value += size * (size + degree);
        }
        this.begin.push(n);
        this.row_start.push(row);
        this.value_start.push(value);

        let mut found = Vec::new();
        found.try_reserve_exact(row)?;
        found.resize(row, 0);
        this.rows = found;
        let mut next = this.row_start.clone();
        let mut visited = vec![NONE; sizes.len()];
        let mut pairs = Vec::new();
        for k in 0..n {
            let own = supernode_of[k];
            visited[own] = k;
            for i in above(k) {
                let mut s = supernode_of[i];
                while visited[s] != k {
                    if this.rows[this.row_start[s]..next[s]].last().map(|r| supernode_of[*r]) != Some(own) {
                        pairs.push((own, s));
                    }
                    this.rows[next[s]] = k;
                    next[s] += 1;
                    visited[s] = k;
                    s = supernode_of[parent[this.begin[s + 1] - 1]];
                }
            }
        }
        pairs.sort_unstable();
        this.descendant_start = (0..=sizes.len()).map(|s| pairs.partition_point(|p| p.0 < s)).collect();
        this.descendants = pairs.into_iter().map(|p| p.1).collect();
        Ok(this)
    }

    /// How many supernodes.
    pub(crate) fn count(&self) -> usize {
        self.end().len()
    }

    /// How many values the blocks hold.
    pub(crate) fn values(&self) -> usize {
        self.value_start.last().copied().unwrap_or(0)
    }

    /// The first column of every supernode.
    pub(crate) fn begin(&self) -> &[usize] {
        &self.begin[..self.count()]
    }

    /// The column after the last of every supernode.
    pub(crate) fn end(&self) -> &[usize] {
        self.begin.get(1..).unwrap_or(&[])
    }

    /// The columns of a supernode.
    pub(crate) fn columns(&self, s: usize) -> Range<usize> {
        self.begin[s]..self.begin[s + 1]
    }

    /// The rows below a supernode, ascending.
    pub(crate) fn below(&self, s: usize) -> &[usize] {
        &self.rows[self.row_start[s]..self.row_start[s + 1]]
    }

    /// Where the values of a supernode are.
    pub(crate) fn block(&self, s: usize) -> Range<usize> {
        self.value_start[s]..self.value_start[s + 1]
    }

    /// The earlier supernodes with a row in this one, ascending.
    pub(super) fn descendants(&self, s: usize) -> &[usize] {
        &self.descendants[self.descendant_start[s]..self.descendant_start[s + 1]]
    }
}

/// The parent of every column in the elimination tree ([`NONE`] at a root), and how many entries of the factor every
/// column has (Liu 1990).
fn elimination_tree<I: Iterator<Item = usize>>(n: usize, above: impl Fn(usize) -> I) -> (Vec<usize>, Vec<usize>) {
    let (mut parent, mut counts, mut visited) = (vec![NONE; n], vec![1; n], vec![NONE; n]);
    for j in 0..n {
        visited[j] = j;
        for mut i in above(j) {
            while visited[i] != j {
                if parent[i] == NONE {
                    parent[i] = j;
                }
                counts[i] += 1;
                visited[i] = j;
                i = parent[i];
            }
        }
    }
    (parent, counts)
}

/// How many columns every fundamental supernode has: each column the only child of the next, with the same pattern.
fn fundamental(parent: &[usize], counts: &[usize]) -> Vec<usize> {
    let mut children = vec![0; parent.len()];
    for p in parent.iter().filter(|p| **p != NONE) {
        children[*p] += 1;
    }
    let mut sizes: Vec<usize> = Vec::new();
    for j in 0..parent.len() {
        match sizes.last_mut() {
            Some(size) if parent[j - 1] == j && children[j] == 1 && counts[j - 1] == counts[j] + 1 => *size += 1,
            _ => sizes.push(1),
        }
    }
    sizes
}

/// Merges a supernode with the one before it where that is its child and few zeros come of it. Columns and rows below of
/// every supernode that is left.
fn merged(mut sizes: Vec<usize>, parent: &[usize], counts: &[usize]) -> (Vec<usize>, Vec<usize>) {
    let ends: Vec<usize> = sizes
        .iter()
        .scan(0, |end, size| {
            *end += size;
            Some(*end)
        })
        .collect();
    let degrees: Vec<usize> = ends.iter().map(|end| counts[end - 1] - 1).collect();
    let mut zeros = vec![0; sizes.len()];
    for s in 1..sizes.len() {
        let child = s - 1;
        let of_child = parent[ends[child] - 1];
        if !(ends[child]..ends[s]).contains(&of_child) {
            continue;
        }
        let new = (sizes[s] + degrees[s] - degrees[child]) * sizes[child];
        let all = new + zeros[s] + zeros[child];
        let columns = sizes[s] + sizes[child];
        let stored = (columns * (columns + 1) / 2 + degrees[s] * columns) as f64;
        let few = |(most, part): &(usize, f64)| *most >= columns && stored * part >= all as f64;
        if new == 0 || MOST_ZEROS.iter().any(few) {
            sizes[s] = columns;
            sizes[child] = 0;
            zeros[s] = all;
        }
    }
    sizes.into_iter().zip(degrees).filter(|(size, _)| *size > 0).unzip()
}
