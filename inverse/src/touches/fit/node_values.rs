//! The columns of a table's nodes: as they were tabulated, or reduced when a touch first comes near.
//!
//! A reduction of all nodes takes as long as hundreds of frames, and touches come near few of them.

use crate::linalg::aligned::Aligned;
use crate::linalg::columns::Columns;
use crate::linalg::kernels::{LANES, padded};
use nalgebra::DMatrix;
use std::cell::RefCell;
use std::ops::Range;
use std::sync::Arc;

/// Nodes reduced by one product of matrices. It bounds the memory that this takes.
const NODES_AT_ONCE: usize = 768;

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
    /// Columns of a node.
    columns: usize,
    made: RefCell<Made>,
}

/// What is there already.
#[derive(Clone, Debug)]
struct Made {
    values: Aligned,
    /// By node.
    ready: Vec<bool>,
}

impl NodeValues {
    /// The columns times a matrix, `columns` for every node. These of every node are made at once, the others when
    /// [`NodeValues::with`] first asks for the node.
    pub(super) fn reduced(&self, by: &DMatrix<f64>, columns: usize, eager: Range<usize>) -> Self {
        let source = self.whole();
        let (from, to) = (padded(by.ncols(), LANES), padded(by.nrows(), LANES));
        let nodes = source.len() / (from * columns).max(1);
        let mut values = Aligned::zeros(nodes * columns * to);
        let (each, first_of_node) = (eager.len().max(1), eager.start);
        for first in (0..nodes).step_by(NODES_AT_ONCE) {
            let count = NODES_AT_ONCE.min(nodes - first) * each;
            let at = |k: usize| (first + k / each) * columns + first_of_node + k % each;
            let out = by * DMatrix::from_fn(by.ncols(), count, |row, k| source[at(k) * from + row]);
            for (k, column) in out.column_iter().enumerate() {
                values[at(k) * to..][..by.nrows()].copy_from_slice(column.as_slice());
            }
        }
        let ready = vec![eager.len() >= columns; nodes];
        Self::Reduced(Box::new(Reduced {
            source,
            by: Columns::new(&by.transpose(), 1.0),
            columns,
            made: RefCell::new(Made { values, ready }),
        }))
    }

    /// Looks at the columns, after those of the nodes that begin at these columns were made.
    pub(super) fn with<R>(&self, nodes: &[usize], look: impl FnOnce(&[f64]) -> R) -> R {
        match self {
            Self::Whole(values) => look(values),
            Self::Reduced(reduced) => {
                reduced.make(nodes.iter().map(|column| column / reduced.columns));
                look(&reduced.made.borrow().values)
            }
        }
    }

    fn whole(&self) -> Arc<Aligned> {
        match self {
            Self::Whole(values) => Arc::clone(values),
            Self::Reduced(reduced) => {
                let nodes = reduced.made.borrow().ready.len();
                reduced.make(0..nodes);
                Arc::new(reduced.made.borrow().values.clone())
            }
        }
    }
}

impl Reduced {
    fn make(&self, nodes: impl Iterator<Item = usize>) {
        let made = &mut *self.made.borrow_mut();
        let (from, to) = (self.by.rows(), self.by.cells());
        for node in nodes {
            if std::mem::replace(&mut made.ready[node], true) {
                continue;
            }
            for column in node * self.columns..(node + 1) * self.columns {
                self.by.dots(
                    &self.source[column * from..][..from],
                    &mut made.values[column * to..][..to],
                );
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is made at once, when asked for, and all together is the product, and nodes that nobody asked for are not made.
    #[test]
    fn columns_are_the_product_whenever_they_are_made() {
        let (rows, length, columns, nodes) = (11, 21, 3, 5);
        let (from, to) = (padded(length, LANES), padded(rows, LANES));
        let mut source = Aligned::zeros(nodes * columns * from);
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
        let reduced = NodeValues::Whole(Arc::new(source.clone())).reduced(&by, columns, 1..2);
        reduced.with(&[], |v| {
            assert!((0..nodes).all(|n| near(v, columns * n + 1) && !near(v, columns * n)))
        });
        reduced.with(&[2 * columns], |v| {
            assert!((0..columns).all(|c| near(v, 2 * columns + c)));
            assert!(!near(v, columns));
        });
        let all = reduced.whole();
        assert!((0..nodes * columns).all(|c| near(&all, c)));
        let at_once = NodeValues::Whole(Arc::new(source.clone())).reduced(&by, columns, 0..columns);
        at_once.with(&[], |v| assert!((0..nodes * columns).all(|c| near(v, c))));
    }
}
