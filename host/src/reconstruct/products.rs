//! Products of a matrix's columns with one another, kept for the columns that have been asked for.
//!
//! The same cells are chosen frame after frame; a row of products costs one look at the whole matrix the first time, and
//! nothing from then on.

use super::aligned::Aligned;
use super::columns::Columns;

/// Rows kept at least, where the matrix has as many columns.
const ROWS: usize = 1024;
const NONE: usize = usize::MAX;

/// `a_i . a_j` of columns scaled to norm 1 (0 with a column of zeros), row by row as they are needed.
#[derive(Clone, Debug)]
pub(super) struct Products {
    rows: Vec<f64>,
    cells: usize,
    /// Where a column's row is kept, and whose row is kept there.
    slots: Vec<usize>,
    owners: Vec<usize>,
    most: usize,
    /// One over the columns' norms; 0 for a column of zeros.
    scales: Vec<f64>,
    work: Aligned,
}

impl Products {
    /// No row yet, with room for those of any passive set and more.
    pub(super) fn new(columns: &Columns) -> Self {
        let cells = columns.cells();
        let most = cells.min(ROWS.max(2 * columns.rows()));
        Self {
            // Memory that is not written to yet is the system's to give when it is.
            rows: vec![0.0; most * cells],
            cells,
            slots: vec![NONE; cells],
            owners: Vec::with_capacity(most),
            most,
            scales: columns
                .norms()
                .iter()
                .map(|n| if *n >= f64::MIN_POSITIVE { 1.0 / n } else { 0.0 })
                .collect(),
            work: Aligned::zeros(cells),
        }
    }

    /// One over the norm of a column; 0 for a column of zeros.
    #[inline(always)]
    pub(super) fn scale(&self, j: usize) -> f64 {
        self.scales[j]
    }

    /// The same of every column.
    #[inline(always)]
    pub(super) fn scales(&self) -> &[f64] {
        &self.scales
    }

    /// Makes sure that a column's row is kept. When there is no room, all rows but those of `members` are let go, and the answer is
    /// true: the rows of the members may begin elsewhere.
    pub(super) fn want(&mut self, columns: &Columns, j: usize, members: &[usize]) -> bool {
        if self.slots[j] != NONE {
            return false;
        }
        let full = self.owners.len() == self.most;
        if full {
            self.make_room(members);
        }
        let slot = self.owners.len();
        columns.dots(columns.column(j), &mut self.work);
        let row = &mut self.rows[slot * self.cells..(slot + 1) * self.cells];
        for (to, (product, scale)) in row.iter_mut().zip(self.work.iter().zip(&self.scales)) {
            *to = product * scale * self.scales[j];
        }
        self.slots[j] = slot;
        self.owners.push(j);
        full
    }

    fn make_room(&mut self, members: &[usize]) {
        for j in &self.owners {
            self.slots[*j] = NONE;
        }
        // Members' rows move to the front. Going through the slots upwards none is overwritten before it has moved.
        let mut kept = 0;
        for slot in 0..self.owners.len() {
            let owner = self.owners[slot];
            if members.contains(&owner) {
                self.rows
                    .copy_within(slot * self.cells..(slot + 1) * self.cells, kept * self.cells);
                self.owners[kept] = owner;
                self.slots[owner] = kept;
                kept += 1;
            }
        }
        self.owners.truncate(kept);
    }

    /// Where a column's row, which is kept, begins.
    #[inline(always)]
    pub(super) fn start(&self, j: usize) -> usize {
        self.slots[j] * self.cells
    }

    /// Product of the column whose row begins here with the j-th.
    #[inline(always)]
    pub(super) fn at(&self, start: usize, j: usize) -> f64 {
        self.rows[start + j]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

    #[test]
    fn rows_are_products_whatever_was_let_go() {
        let matrix = DMatrix::from_fn(5, 2100, |i, j| ((i * 37 + j * 101) % 23) as f64 - 11.0);
        let columns = Columns::new(&matrix, 1.0);
        let mut products = Products::new(&columns);
        assert!(products.most < 2100);
        let members = [3, 1400, 77];
        for j in 0..2100 {
            for member in members {
                products.want(&columns, member, &members);
            }
            products.want(&columns, j, &members);
            if j % 50 != 0 {
                continue;
            }
            for member in members {
                let out = products.at(products.start(member), j);
                let expected =
                    matrix.column(member).dot(&matrix.column(j)) * products.scale(member) * products.scale(j);
                assert!((out - expected).abs() < 1e-14, "{member} {j}");
            }
        }
    }
}
