//! The columns of a table's nodes: as they were tabulated, or reduced when a touch first comes near.
//!
//! A reduction of all of them takes as long as hundreds of frames, and touches come near few.

use crate::linalg::aligned::Aligned;
use crate::linalg::columns::Columns;
use crate::linalg::kernels::{LANES, padded};
use crate::touches::fit::discs::{Discs, RowSums};
use nalgebra::DMatrix;
use std::cell::RefCell;
use std::sync::Arc;

/// Columns reduced by one product of matrices. It bounds the memory that this takes.
const COLUMNS_AT_ONCE: usize = 768;

/// The columns of all nodes, the discs of every radius for each.
#[derive(Clone, Debug)]
pub(super) enum NodeValues {
    /// All are there.
    Whole(Arc<Aligned>),
    /// Others times a matrix.
    Reduced(Box<Reduced>),
    /// Summed up from the cells whenever they are needed: too many to be kept.
    Summed(Arc<Discs>, Arc<RowSums>),
}

/// What columns are made of.
#[derive(Clone, Debug)]
enum Source {
    /// Others, by the rows of a matrix.
    Columns(Arc<Aligned>, Columns),
    /// The cells, times the matrix already.
    Cells(Arc<Discs>, RowSums),
}

#[derive(Clone, Debug)]
pub(super) struct Reduced {
    source: Source,
    made: RefCell<Made>,
}

/// What is there already.
#[derive(Clone, Debug)]
struct Made {
    values: Aligned,
    stride: usize,
    /// By column.
    ready: Vec<bool>,
}

impl NodeValues {
    /// So many discs: tabulated where they have at most `most` numbers.
    pub(super) fn of_discs(discs: Discs, sums: RowSums, count: usize, most: usize) -> Self {
        let stride = padded(sums.length(), LANES);
        if count * stride > most {
            return Self::Summed(Arc::new(discs), Arc::new(sums));
        }
        let mut values = Aligned::zeros(count * stride);
        for (disc, out) in values.chunks_exact_mut(stride.max(1)).enumerate() {
            discs.mean(&sums, disc, &mut out[..sums.length()]);
        }
        Self::Whole(Arc::new(values))
    }

    /// The columns, `count` of them, times a matrix. The `eager` ones are made at once, or all of them if they may be kept; the others
    /// when [`NodeValues::with`] first asks for them.
    pub(super) fn reduced(&self, by: &DMatrix<f64>, count: usize, eager: &[usize], at_once: bool) -> Self {
        let to = padded(by.nrows(), LANES);
        let mut made = Made {
            values: Aligned::zeros(count * to),
            stride: to,
            ready: vec![false; count],
        };
        let source = match self {
            Self::Summed(discs, sums) => {
                return Self::Reduced(Box::new(Reduced {
                    source: Source::Cells(Arc::clone(discs), sums.times(by)),
                    made: RefCell::new(made),
                }));
            }
            Self::Whole(values) => Arc::clone(values),
            Self::Reduced(reduced) => reduced.whole(),
        };
        let all: Vec<usize>;
        let eager = if at_once {
            all = (0..count).collect();
            &all
        } else {
            eager
        };
        let from = padded(by.ncols(), LANES);
        for eager in eager.chunks(COLUMNS_AT_ONCE) {
            let out = by * DMatrix::from_fn(by.ncols(), eager.len(), |row, k| source[eager[k] * from + row]);
            for (k, column) in eager.iter().zip(out.column_iter()) {
                made.values[k * to..][..by.nrows()].copy_from_slice(column.as_slice());
            }
        }
        eager.iter().for_each(|k| made.ready[*k] = true);
        Self::Reduced(Box::new(Reduced {
            source: Source::Columns(source, Columns::new(&by.transpose(), 1.0)),
            made: RefCell::new(made),
        }))
    }

    /// Looks at columns, after those that are `needed` were made: `look` is told where they are.
    pub(super) fn with<R>(&self, needed: &[usize], look: impl FnOnce(&[f64], &[usize]) -> R) -> R {
        match self {
            Self::Whole(values) => look(values, needed),
            Self::Reduced(reduced) => {
                reduced.make(needed.iter().copied());
                look(&reduced.made.borrow().values, needed)
            }
            Self::Summed(discs, sums) => {
                let stride = padded(sums.length(), LANES);
                let mut values = Aligned::zeros(needed.len() * stride);
                for (disc, out) in needed.iter().zip(values.chunks_exact_mut(stride.max(1))) {
                    discs.mean(sums, *disc, &mut out[..sums.length()]);
                }
                let places: Vec<usize> = (0..needed.len()).collect();
                look(&values, &places)
            }
        }
    }
}

impl Reduced {
    fn whole(&self) -> Arc<Aligned> {
        let columns = self.made.borrow().ready.len();
        self.make(0..columns);
        Arc::new(self.made.borrow().values.clone())
    }

    fn make(&self, columns: impl Iterator<Item = usize>) {
        let made = &mut *self.made.borrow_mut();
        let to = made.stride;
        for column in columns {
            if std::mem::replace(&mut made.ready[column], true) {
                continue;
            }
            let out = &mut made.values[column * to..][..to];
            match &self.source {
                Source::Columns(source, by) => by.dots(&source[column * by.rows()..][..by.rows()], out),
                Source::Cells(discs, sums) => discs.mean(sums, column, &mut out[..sums.length()]),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::{CellGrid, Geometry, Sheet};

    /// What is made at once, when asked for, and all together is the product, and columns that nobody asked for are not made.
    #[test]
    fn columns_are_the_product_whenever_they_are_made() {
        let (rows, length, columns) = (11, 21, 15);
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
        let near = |values: &[f64], column: usize| {
            let off = product(column) - nalgebra::DVector::from_column_slice(&values[column * to..][..rows]);
            off.amax() < 1e-13
        };
        let whole = NodeValues::Whole(Arc::new(source.clone()));
        let eager: Vec<usize> = (0..columns).step_by(3).collect();
        let reduced = whole.reduced(&by, columns, &eager, false);
        reduced.with(&[], |v, _| assert!((0..columns).all(|c| near(v, c) == (c % 3 == 0))));
        reduced.with(&[7, 8], |v, places| {
            assert!(near(v, 7) && near(v, 8) && !near(v, 10));
            assert_eq!(places, [7, 8]);
        });
        let NodeValues::Reduced(reduced) = reduced else {
            panic!("reduced columns are not reduced");
        };
        let all = reduced.whole();
        assert!((0..columns).all(|c| near(&all, c)));
        let at_once = whole.reduced(&by, columns, &eager, true);
        at_once.with(&[], |v, _| assert!((0..columns).all(|c| near(v, c))));
    }

    /// Columns that are summed up from the cells are those that are tabulated, to the last bit, and so are their reductions but for
    /// rounding.
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
        assert_eq!(column(&kept, length, &needed), column(&summed, length, &needed));
        let by = DMatrix::from_fn(5, length, |i, j| (1.3 * i as f64 + 0.7 * j as f64).cos());
        let reduced = [&kept, &summed].map(|v| column(&v.reduced(&by, count, &needed, false), 5, &needed));
        let pairs = reduced[0].iter().flatten().zip(reduced[1].iter().flatten());
        assert!(pairs.clone().count() == 25 && pairs.clone().any(|(a, _)| *a != 0.0));
        assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-14));
    }
}
