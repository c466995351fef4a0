//! A factorisation that rounds alike on every machine: sums in an order that the pattern alone decides, multiplications
//! and additions each rounded by itself. The tuned kernels choose their instructions, and with them their rounding, by the
//! processor. This factorisation is left-looking by supernodes (Ng and Peyton 1993), in the layout of the tuned one.

use super::{CholeskyError, Factor, Symbolic};

/// Side of the blocks that the products are computed in. No sum depends on it.
const SIDE: usize = 4;
/// Columns of a supernode that are finished together.
const PANEL: usize = 16;
const NONE: usize = usize::MAX;

impl Factor {
    /// Factorises as [`Factor::factorize`] does, to the last bit the same on every machine.
    pub(crate) fn factorize_portably(&mut self, symbolic: &Symbolic, values: &[f64]) -> Result<(), CholeskyError> {
        let structure = &symbolic.structure;
        let (begin, end) = (structure.begin(), structure.end());
        let count = structure.count();
        // For every supernode a list of the earlier ones whose next row is in it, and where in their rows that is.
        let (mut first_of, mut next_of, mut reached) = (vec![NONE; count], vec![NONE; count], vec![0; count]);
        let mut local = vec![0; symbolic.n];
        let (mut update, mut places) = (Vec::new(), Vec::new());
        for s in 0..count {
            let below = structure.below(s);
            let width = end[s] - begin[s];
            let height = width + below.len();
            for (k, row) in (begin[s]..end[s]).chain(below.iter().copied()).enumerate() {
                local[row] = k;
            }
            let (done, rest) = self.values.split_at_mut(structure.block(s).start);
            let panel = &mut rest[..width * height];
            panel.fill(0.0);
            for (column, panel) in (begin[s]..end[s]).zip(panel.chunks_exact_mut(height)) {
                for slot in symbolic.column_start[column]..symbolic.column_start[column + 1] {
                    panel[local[symbolic.row_index[slot]]] = values[slot];
                }
            }
            let mut d = std::mem::replace(&mut first_of[s], NONE);
            while d != NONE {
                let after = next_of[d];
                let pattern = structure.below(d);
                let rows = &pattern[reached[d]..];
                let columns = rows.partition_point(|r| *r < end[s]);
                let wide = end[d] - begin[d];
                let source = Columns {
                    values: &done[structure.block(d)],
                    height: wide + pattern.len(),
                    width: wide,
                    first: wide + reached[d],
                };
                source.products(columns, &mut update);
                places.clear();
                places.extend(rows.iter().map(|r| local[*r]));
                for (j, update) in update.chunks_exact(rows.len()).enumerate() {
                    let column = &mut panel[places[j] * height..(places[j] + 1) * height];
                    for (place, value) in places[j..].iter().zip(&update[j..]) {
                        column[*place] -= value;
                    }
                }
                reached[d] += columns;
                if let Some(row) = pattern.get(reached[d]) {
                    let to = symbolic.supernode_of(*row);
                    next_of[d] = std::mem::replace(&mut first_of[to], d);
                }
                d = after;
            }
            dense(panel, height, width, &mut update).map_err(|column| CholeskyError::NotPositiveDefinite {
                unknown: begin[s] + column,
            })?;
            if let Some(row) = below.first() {
                let to = symbolic.supernode_of(*row);
                next_of[s] = std::mem::replace(&mut first_of[to], s);
            }
        }
        Ok(())
    }
}

/// Rows from `first` on of a matrix kept by columns.
struct Columns<'a> {
    values: &'a [f64],
    height: usize,
    width: usize,
    first: usize,
}

impl Columns<'_> {
    /// Products of each of the first `columns` of these rows with every row from it on: `out[column][row]`, summed from the
    /// first column of the matrix to the last. What is above is left as it was.
    fn products(&self, columns: usize, out: &mut Vec<f64>) {
        let rows = self.height - self.first;
        out.clear();
        out.resize(columns * rows, 0.0);
        for j in (0..columns).step_by(SIDE) {
            for i in (j..rows).step_by(SIDE) {
                if j + SIDE <= columns && i + SIDE <= rows {
                    let block = self.block(i, j);
                    for (x, values) in block.iter().enumerate() {
                        out[(j + x) * rows + i..(j + x) * rows + i + SIDE].copy_from_slice(values);
                    }
                    continue;
                }
                for x in j..columns.min(j + SIDE) {
                    for y in i..rows.min(i + SIDE) {
                        out[x * rows + y] = self.one(y, x);
                    }
                }
            }
        }
    }

    fn block(&self, i: usize, j: usize) -> [[f64; SIDE]; SIDE] {
        let mut sum = [[0.0; SIDE]; SIDE];
        for column in self.values.chunks_exact(self.height).take(self.width) {
            let rows = &column[self.first..];
            let (Some(a), Some(b)) = (rows[i..].first_chunk::<SIDE>(), rows[j..].first_chunk::<SIDE>()) else {
                break;
            };
            for (sum, b) in sum.iter_mut().zip(b) {
                for (s, a) in sum.iter_mut().zip(a) {
                    *s += a * b;
                }
            }
        }
        sum
    }

    fn one(&self, i: usize, j: usize) -> f64 {
        let columns = self.values.chunks_exact(self.height).take(self.width);
        let mut sum = 0.0;
        for column in columns {
            sum += column[self.first + i] * column[self.first + j];
        }
        sum
    }
}

/// Factorises the upper `width` rows of a matrix kept by columns, and solves for the rows below; fails at a column whose
/// pivot is not positive.
fn dense(panel: &mut [f64], height: usize, width: usize, update: &mut Vec<f64>) -> Result<(), usize> {
    for first in (0..width).step_by(PANEL) {
        let columns = PANEL.min(width - first);
        let (left, right) = panel.split_at_mut(first * height);
        let source = Columns {
            values: left,
            height,
            width: first,
            first,
        };
        source.products(columns, update);
        for (j, column) in right.chunks_exact_mut(height).take(columns).enumerate() {
            let update = &update[j * (height - first)..(j + 1) * (height - first)];
            for (value, product) in column[first + j..].iter_mut().zip(&update[j..]) {
                *value -= product;
            }
        }
        for j in 0..columns {
            let (before, rest) = right.split_at_mut(j * height);
            let column = &mut rest[first + j..height];
            for other in before.chunks_exact(height) {
                let other = &other[first + j..];
                let factor = other[0];
                for (value, x) in column.iter_mut().zip(other) {
                    *value -= factor * x;
                }
            }
            let pivot = column[0];
            if pivot.is_nan() || pivot <= 0.0 {
                return Err(first + j);
            }
            let root = pivot.sqrt();
            let scale = 1.0 / root;
            column[0] = root;
            column[1..].iter_mut().for_each(|v| *v *= scale);
        }
    }
    Ok(())
}
