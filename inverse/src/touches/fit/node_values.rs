//! The columns of a table's nodes: as they were tabulated, or reduced when a touch first comes near.
//!
//! A reduction of all of them takes as long as hundreds of frames and 50 MB, and touches come near few.

use crate::linalg::aligned::Aligned;
use crate::linalg::columns::Columns;
use crate::linalg::kernels::{LANES, VECTORS_AT_ONCE, padded};
use crate::touches::fit::discs::{Discs, RowSums};
use crate::touches::fit::responses::RADII;
use nalgebra::DMatrix;
use std::cell::RefCell;
use std::sync::Arc;

/// Columns reduced by one product of matrices. It bounds the memory that this takes.
const COLUMNS_AT_ONCE: usize = 768;

/// Nodes that are kept of those that touches come near, 7 MB of 16 electrodes: those of 60 touches. Of more all are made anew.
const MOST_NODES: usize = 1024;

/// Columns of a node: they stay beside one another.
const OF_NODE: usize = RADII.len();

/// The columns of all nodes, the discs of every radius for each.
#[derive(Clone, Debug)]
pub(super) enum NodeValues {
    /// All are there.
    Whole(Arc<Aligned>),
    /// Others times a matrix.
    Reduced(Box<Reduced>),
    /// Summed up from the cells whenever they are needed: too many to be kept.
    Summed(Arc<Discs>, Arc<RowSums<f32>>),
}

/// What columns are made of.
#[derive(Clone, Debug)]
enum Source {
    /// Others, by the rows of a matrix.
    Columns(Arc<Aligned>, Columns),
    /// The cells, times the matrix already.
    Cells(Arc<Discs>, RowSums<f32>),
}

#[derive(Clone, Debug)]
pub(super) struct Reduced {
    source: Source,
    stride: usize,
    /// The columns that every search looks at, one after the other, and the numbers 0, 1, 2 ...
    coarse: (Aligned, Vec<usize>),
    made: RefCell<Made>,
}

/// What is there already.
#[derive(Clone, Debug, Default)]
struct Made {
    values: Aligned,
    /// Where the first column of every node is, counted in columns, if it is there. Empty where all are, in their order.
    places: Vec<Option<u32>>,
    /// By column.
    ready: Vec<bool>,
    /// Room for the places of columns.
    found: Vec<usize>,
    /// Room for those that are to be made, with their places.
    missing: Vec<(usize, usize)>,
    /// Room for as many as are made at once.
    few: Vec<f64>,
    /// How many were summed up from the cells.
    summed: usize,
}

impl NodeValues {
    /// So many discs: tabulated where they have at most `most` numbers.
    pub(super) fn of_discs(discs: Discs, sums: RowSums, count: usize, most: usize) -> Self {
        let stride = padded(sums.length(), LANES);
        if count * stride > most {
            return Self::Summed(Arc::new(discs), Arc::new(sums.single()));
        }
        let mut values = Aligned::zeros(count * stride);
        for (disc, out) in values.chunks_exact_mut(stride.max(1)).enumerate() {
            discs.mean(&sums, disc, out);
        }
        Self::Whole(Arc::new(values))
    }

    /// The columns, `count` of them, times a matrix. The `coarse` ones are made at once, or all of them if they may be kept; the others
    /// when [`NodeValues::with`] first asks for them.
    pub(super) fn reduced(&self, by: &DMatrix<f64>, count: usize, coarse: &[usize], at_once: bool) -> Self {
        let stride = padded(by.nrows(), LANES);
        let mut few = Aligned::zeros(coarse.len() * stride);
        let mut made = Made {
            places: vec![None; count.div_ceil(OF_NODE)],
            ready: vec![false; count],
            ..Made::default()
        };
        let source = match self {
            Self::Summed(discs, sums) => {
                let sums = sums.times(by);
                for (disc, out) in coarse.iter().zip(few.chunks_exact_mut(stride.max(1))) {
                    discs.mean(&sums, *disc, out);
                }
                Source::Cells(Arc::clone(discs), sums)
            }
            Self::Whole(_) | Self::Reduced(_) => {
                let values = self.whole(count);
                product(by, &values, coarse, &mut few);
                if at_once {
                    let all: Vec<usize> = (0..count).collect();
                    made = Made {
                        values: Aligned::zeros(count * stride),
                        ..Made::default()
                    };
                    product(by, &values, &all, &mut made.values);
                }
                Source::Columns(values, Columns::new(&by.transpose(), 1.0))
            }
        };
        Self::Reduced(Box::new(Reduced {
            source,
            stride,
            coarse: (few, (0..coarse.len()).collect()),
            made: RefCell::new(made),
        }))
    }

    /// All columns, in their order.
    fn whole(&self, count: usize) -> Arc<Aligned> {
        let stride = match self {
            Self::Whole(values) => return Arc::clone(values),
            Self::Reduced(reduced) => reduced.stride,
            Self::Summed(_, sums) => padded(sums.length(), LANES),
        };
        let all: Vec<usize> = (0..count).collect();
        self.with(&all, |values, places| {
            let mut whole = Aligned::zeros(count * stride);
            for (out, place) in whole.chunks_exact_mut(stride.max(1)).zip(places) {
                out.copy_from_slice(&values[place * stride..][..stride]);
            }
            Arc::new(whole)
        })
    }

    /// Looks at columns, after those that are `needed` were made: `look` is told where they are, and must not ask for others. Those of a
    /// node stay beside one another.
    pub(super) fn with<R>(&self, needed: &[usize], look: impl FnOnce(&[f64], &[usize]) -> R) -> R {
        match self {
            Self::Whole(values) => look(values, needed),
            Self::Reduced(reduced) => {
                let mut made = reduced.made.borrow_mut();
                if made.places.is_empty() {
                    return look(&made.values, needed);
                }
                made.make(&reduced.source, reduced.stride, needed);
                look(&made.values, &made.found)
            }
            Self::Summed(discs, sums) => {
                let stride = padded(sums.length(), LANES);
                let mut values = Aligned::zeros(needed.len() * stride);
                for (disc, out) in needed.iter().zip(values.chunks_exact_mut(stride.max(1))) {
                    discs.mean(sums, *disc, out);
                }
                let places: Vec<usize> = (0..needed.len()).collect();
                look(&values, &places)
            }
        }
    }

    /// How many columns were summed up from the cells when they were asked for, where that is counted: of columns that are kept.
    pub(super) fn summed(&self) -> usize {
        match self {
            Self::Reduced(reduced) => reduced.made.borrow().summed,
            Self::Whole(_) | Self::Summed(..) => 0,
        }
    }

    /// Looks at the columns that were named coarse, and in this order.
    pub(super) fn with_coarse<R>(&self, coarse: &[usize], look: impl FnOnce(&[f64], &[usize]) -> R) -> R {
        match self {
            Self::Reduced(reduced) => look(&reduced.coarse.0, &reduced.coarse.1),
            Self::Whole(_) | Self::Summed(..) => self.with(coarse, look),
        }
    }
}

/// Columns of `values` times a matrix, one after the other.
fn product(by: &DMatrix<f64>, values: &[f64], columns: &[usize], out: &mut [f64]) {
    let (from, to) = (padded(by.ncols(), LANES), padded(by.nrows(), LANES));
    let columns = columns.chunks(COLUMNS_AT_ONCE);
    for (columns, out) in columns.zip(out.chunks_mut((COLUMNS_AT_ONCE * to).max(1))) {
        let product = by * DMatrix::from_fn(by.ncols(), columns.len(), |row, k| values[columns[k] * from + row]);
        for (out, column) in out.chunks_exact_mut(to.max(1)).zip(product.column_iter()) {
            out[..by.nrows()].copy_from_slice(column.as_slice());
        }
    }
}

impl Made {
    /// Makes columns that are not there yet, and finds all.
    fn make(&mut self, source: &Source, stride: usize, columns: &[usize]) {
        self.found.clear();
        if self.values.len() > MOST_NODES * OF_NODE * stride {
            self.values.clear();
            self.places.fill(None);
            self.ready.fill(false);
        }
        for &column in columns {
            let (node, of_node) = (column / OF_NODE, column % OF_NODE);
            let first = *self.places[node].get_or_insert_with(|| {
                let first = self.values.len() / stride.max(1);
                self.values.grow((first + OF_NODE) * stride);
                first as u32
            });
            let place = first as usize + of_node;
            self.found.push(place);
            if !std::mem::replace(&mut self.ready[column], true) {
                self.missing.push((column, place));
            }
        }
        match source {
            Source::Columns(values, by) => self.multiply(values, by, stride),
            Source::Cells(discs, sums) => {
                self.summed += self.missing.len();
                for (column, place) in self.missing.drain(..) {
                    discs.mean(sums, column, &mut self.values[place * stride..][..stride]);
                }
            }
        }
    }

    /// Makes the missing columns, several at once: the matrix is larger than what the processor keeps nearest.
    fn multiply(&mut self, from: &[f64], by: &Columns, stride: usize) {
        let column = |column: usize| &from[column * by.rows()..][..by.rows()];
        self.few.resize(VECTORS_AT_ONCE * stride, 0.0);
        let (fours, rest) = self.missing.as_chunks::<VECTORS_AT_ONCE>();
        for four in fours {
            by.dots_with(four.map(|(c, _)| column(c)), &mut self.few);
            for ((_, place), made) in four.iter().zip(self.few.chunks_exact(stride.max(1))) {
                self.values[place * stride..][..stride].copy_from_slice(made);
            }
        }
        for (c, place) in rest {
            by.dots(column(*c), &mut self.values[place * stride..][..stride]);
        }
        self.missing.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::{CellGrid, Geometry, Sheet};

    /// What is made at once, when asked for, and all together is the product, and columns that nobody asked for are not made.
    #[test]
    fn columns_are_the_product_whenever_they_are_made() {
        let (rows, length, columns) = (11, 21, 3 * OF_NODE);
        let (from, to) = (padded(length, LANES), padded(rows, LANES));
        let mut source = Aligned::zeros(columns * from);
        for (k, v) in source.iter_mut().enumerate() {
            *v = if k % from < length {
                (0.37 * k as f64).sin()
            } else {
                0.0
            };
        }
        let by = DMatrix::from_fn(rows, length, |i, j| (1.3 * i as f64 + 0.7 * j as f64).cos());
        let product = |column: usize| &by * nalgebra::DVector::from_column_slice(&source[column * from..][..length]);
        let near = |values: &[f64], place: usize, column: usize| {
            let off = product(column) - nalgebra::DVector::from_column_slice(&values[place * to..][..rows]);
            off.amax() < 1e-13
        };
        let whole = NodeValues::Whole(Arc::new(source.clone()));
        let coarse: Vec<usize> = (0..columns).step_by(3).collect();
        let reduced = whole.reduced(&by, columns, &coarse, false);
        reduced.with_coarse(&coarse, |v, places| {
            assert_eq!((v.len(), places.len()), (OF_NODE * to, OF_NODE));
            assert!(coarse.iter().zip(places).all(|(c, place)| near(v, *place, *c)));
        });
        // A node's columns are beside one another; nobody asked for the others.
        let needed = [OF_NODE + 2, OF_NODE + 3, 2 * OF_NODE + 4];
        reduced.with(&needed, |v, places| {
            assert_eq!((v.len(), places), (2 * OF_NODE * to, [2, 3, OF_NODE + 4].as_slice()));
            assert!(places.iter().zip(needed).all(|(place, column)| near(v, *place, column)));
            let others = (0..2 * OF_NODE).filter(|k| !places.contains(k));
            assert!({ others }.all(|k| v[k * to..][..to].iter().all(|x| *x == 0.0)));
        });
        let at_once = whole.reduced(&by, columns, &coarse, true);
        at_once.with(&[], |v, _| assert!((0..columns).all(|c| near(v, c, c))));
        for all in [reduced.whole(columns), at_once.whole(columns)] {
            assert!(all.len() == columns * to && (0..columns).all(|c| near(&all, c, c)));
        }
    }

    /// Where no value takes part nothing is left of the columns.
    #[test]
    fn columns_of_no_rows_are_empty() {
        let whole = NodeValues::Whole(Arc::new(Aligned::zeros(OF_NODE * LANES)));
        for at_once in [false, true] {
            let reduced = whole.reduced(&DMatrix::zeros(0, 3), OF_NODE, &[1], at_once);
            reduced.with_coarse(&[1], |v, places| assert!(v.is_empty() && places.len() == 1));
            reduced.with(&[0, 1], |v, places| assert!(v.is_empty() && places.len() == 2));
        }
    }

    /// Touches that come near every node, twice: the columns are the product all the same, and take the memory of some nodes.
    #[test]
    fn of_many_nodes_some_are_kept() {
        let (rows, nodes) = (3, 2 * MOST_NODES);
        let stride = padded(rows, LANES);
        let values = Aligned::zeros(nodes * OF_NODE * stride);
        let mut whole = NodeValues::Whole(Arc::new(values));
        if let NodeValues::Whole(values) = &mut whole {
            let values = Arc::get_mut(values).unwrap();
            for (k, v) in values.iter_mut().enumerate().filter(|(k, _)| k % stride < rows) {
                *v = k as f64;
            }
        }
        let by = DMatrix::from_diagonal_element(rows, rows, 2.0);
        let reduced = whole.reduced(&by, nodes * OF_NODE, &[], false);
        let mut most = 0;
        for node in (0..nodes).chain(0..nodes) {
            let needed = [OF_NODE * node + 1, OF_NODE * node + 2];
            reduced.with(&needed, |v, places| {
                most = most.max(v.len());
                for (column, place) in needed.iter().zip(places) {
                    let of_column = (0..rows).map(|k| 2.0 * (column * stride + k) as f64);
                    assert!(v[place * stride..].iter().zip(of_column).all(|(v, of)| *v == of));
                }
            });
        }
        assert!(most <= (MOST_NODES + 1) * OF_NODE * stride);
    }

    /// Columns that are summed up from the cells are those that are tabulated, and so are their reductions, to single precision.
    #[test]
    fn columns_are_the_same_whether_they_are_kept_or_not() {
        let geometry = Geometry::new(&Sheet::paper()).unwrap();
        let grid = CellGrid::new(&geometry, 10.0).unwrap();
        let length = 13;
        let cells = DMatrix::from_fn(length, grid.len(), |i, j| (0.3 * i as f64 + 1.1 * j as f64).sin());
        let nodes: Vec<[i64; 2]> = (0..20).map(|k| [k, k]).collect();
        let (radii, count) = ([8.0, 15.0], 2 * 21);
        let of = |most| {
            let discs = Discs::new(nodes.clone(), &radii, 10.0);
            NodeValues::of_discs(discs, RowSums::new(&grid, &cells), count, most)
        };
        let (kept, summed) = (of(usize::MAX), of(count * padded(length, LANES) - 1));
        assert!(matches!(kept, NodeValues::Whole(_)) && matches!(summed, NodeValues::Summed(..)));
        let needed = [3, 40, 41, 8, 19];
        let column = |values: &NodeValues, rows: usize, needed: &[usize]| -> Vec<Vec<f64>> {
            let stride = padded(rows, LANES);
            values.with(needed, |v, places| {
                places.iter().map(|k| v[k * stride..][..rows].to_vec()).collect()
            })
        };
        let same = |a: &[Vec<f64>], b: &[Vec<f64>]| {
            assert_eq!(a.len(), b.len());
            for (a, b) in a.iter().zip(b) {
                let largest = a.iter().map(|v| v.abs()).fold(0.0, f64::max);
                assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-5 * largest));
            }
            assert!(a.concat().iter().any(|v| *v != 0.0));
        };
        same(&column(&kept, length, &needed), &column(&summed, length, &needed));
        let by = DMatrix::from_fn(5, length, |i, j| (1.3 * i as f64 + 0.7 * j as f64).cos());
        let reduced = [&kept, &summed].map(|v| v.reduced(&by, count, &needed, false));
        let columns = || reduced.each_ref().map(|v| column(v, 5, &needed));
        let [of_kept, of_summed] = columns();
        same(&of_kept, &of_summed);
        // What is there already is not summed up once more, and only what is summed up counts.
        columns();
        assert_eq!(reduced.each_ref().map(NodeValues::summed), [0, needed.len()]);
    }
}
