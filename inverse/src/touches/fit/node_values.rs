//! The columns of a table's nodes: as they were tabulated, or reduced when a touch first comes near.
//!
//! A reduction of all of them takes as long as hundreds of frames, and touches come near few.

use crate::linalg::aligned::Aligned;
use crate::linalg::columns::Columns;
use crate::linalg::kernels::{LANES, padded};
use nalgebra::DMatrix;
use std::cell::RefCell;
use std::sync::Arc;

/// Columns reduced by one product of matrices. It bounds the memory that this takes.
const COLUMNS_AT_ONCE: usize = 768;

/// The columns of all nodes, `columns` of them for each.
#[derive(Clone, Debug)]
pub(super) enum NodeValues {
    /// All are there.
    Whole(Arc<Aligned>),
    /// Others times a matrix.
    Reduced(Box<Reduced>),
}

#[derive(Clone, Debug)]
pub(super) struct Reduced {
    source: Arc<Aligned>,
    /// The rows of the matrix.
    by: Columns,
    made: RefCell<Made>,
}

/// What is there already.
#[derive(Clone, Debug)]
struct Made {
    values: Aligned,
    /// By column.
    ready: Vec<bool>,
}

impl NodeValues {
    /// The columns times a matrix. The `eager` ones are made at once, the others when [`NodeValues::with`] first asks for them.
    pub(super) fn reduced(&self, by: &DMatrix<f64>, eager: &[usize]) -> Self {
        let source = self.whole();
        let (from, to) = (padded(by.ncols(), LANES), padded(by.nrows(), LANES));
        let columns = source.len() / from.max(1);
        let mut values = Aligned::zeros(columns * to);
        for eager in eager.chunks(COLUMNS_AT_ONCE) {
            let out = by * DMatrix::from_fn(by.ncols(), eager.len(), |row, k| source[eager[k] * from + row]);
            for (k, column) in eager.iter().zip(out.column_iter()) {
                values[k * to..][..by.nrows()].copy_from_slice(column.as_slice());
            }
        }
        let mut ready = vec![false; columns];
        eager.iter().for_each(|k| ready[*k] = true);
        Self::Reduced(Box::new(Reduced {
            source,
            by: Columns::new(&by.transpose(), 1.0),
            made: RefCell::new(Made { values, ready }),
        }))
    }

    /// Looks at the columns, after those that are `needed` were made.
    pub(super) fn with<R>(&self, needed: impl Iterator<Item = usize>, look: impl FnOnce(&[f64]) -> R) -> R {
        match self {
            Self::Whole(values) => look(values),
            Self::Reduced(reduced) => {
                reduced.make(needed);
                look(&reduced.made.borrow().values)
            }
        }
    }

    fn whole(&self) -> Arc<Aligned> {
        match self {
            Self::Whole(values) => Arc::clone(values),
            Self::Reduced(reduced) => {
                let columns = reduced.made.borrow().ready.len();
                reduced.make(0..columns);
                Arc::new(reduced.made.borrow().values.clone())
            }
        }
    }
}

impl Reduced {
    fn make(&self, columns: impl Iterator<Item = usize>) {
        let made = &mut *self.made.borrow_mut();
        let (from, to) = (self.by.rows(), self.by.cells());
        for column in columns {
            if !std::mem::replace(&mut made.ready[column], true) {
                let source = &self.source[column * from..][..from];
                self.by.dots(source, &mut made.values[column * to..][..to]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let reduced = whole.reduced(&by, &eager);
        reduced.with([].into_iter(), |v| {
            assert!((0..columns).all(|c| near(v, c) == (c % 3 == 0)))
        });
        reduced.with([7, 8].into_iter(), |v| {
            assert!(near(v, 7) && near(v, 8) && !near(v, 10));
        });
        let all = reduced.whole();
        assert!((0..columns).all(|c| near(&all, c)));
    }
}
