//! Discs about the nodes of a lattice, as means of the cells that they cover.

use forward::CellGrid;
use nalgebra::{DMatrix, DMatrixView};
use std::sync::Arc;

/// Divisions of a cell's side when its part inside a disc is counted.
const CUTS: i32 = 16;

/// Cells of one row, beside one another, of which a disc covers the same part.
#[derive(Debug)]
struct Span {
    /// Columns from the first to before the last, and the row, all counted from the disc's centre.
    first: i64,
    last: i64,
    row: i64,
    part: f64,
}

/// What a disc around the centre of a cell covers; the parts sum up to 1.
fn coverage(radius_cells: f64) -> Vec<Span> {
    let reach = radius_cells.ceil() as i64 + 1;
    let mut out: Vec<Span> = Vec::new();
    for row in -reach..=reach {
        for column in -reach..=reach {
            let offset = |k: i32| (f64::from(k) + 0.5) / f64::from(CUTS) - 0.5;
            let mut inside = 0;
            for i in 0..CUTS {
                for j in 0..CUTS {
                    let d = (column as f64 + offset(i)).hypot(row as f64 + offset(j));
                    inside += i32::from(d < radius_cells);
                }
            }
            let part = f64::from(inside);
            match out.last_mut() {
                Some(span) if span.row == row && span.last == column && span.part == part => span.last += 1,
                _ if inside > 0 => out.push(Span {
                    first: column,
                    last: column + 1,
                    row,
                    part,
                }),
                _ => {}
            }
        }
    }
    let sum: f64 = out.iter().map(|s| s.part * (s.last - s.first) as f64).sum();
    out.iter_mut().for_each(|s| s.part /= sum);
    out
}

/// Sums of the cells' columns along every row of the grid, so that a span costs two of them however long it is.
#[derive(Clone, Debug)]
pub(super) struct RowSums {
    length: usize,
    columns: usize,
    rows: usize,
    /// For every row `columns + 1` places of sums, those of the cells before each column.
    places: Arc<[u32]>,
    /// Nothing, and the sums that differ from the one before them: cells off the sheet add nothing.
    sums: Vec<f64>,
}

impl RowSums {
    pub(super) fn new(grid: &CellGrid, cells: &DMatrix<f64>) -> Self {
        let (columns, rows) = grid.shape();
        let n = cells.nrows();
        let mut sums = Vec::with_capacity((cells.ncols() + 1) * n);
        sums.resize(n, 0.0);
        let mut places = Vec::with_capacity((columns + 1) * rows);
        let mut last = 0_u32;
        for row in 0..rows {
            let mut place = 0;
            places.push(place);
            for column in 0..columns {
                if let Some(cell) = grid.at(column, row) {
                    let before = place as usize * n;
                    sums.extend_from_within(before..before + n);
                    last += 1;
                    place = last;
                    let sum = &mut sums[place as usize * n..];
                    sum.iter_mut().zip(&cells.column(cell)).for_each(|(s, v)| *s += v);
                }
                places.push(place);
            }
        }
        Self {
            length: n,
            columns,
            rows,
            places: places.into(),
            sums,
        }
    }

    /// Those of the cells' columns times a matrix.
    pub(super) fn times(&self, by: &DMatrix<f64>) -> Self {
        let count = self.sums.len() / self.length.max(1);
        let sums = by * DMatrixView::from_slice(&self.sums, self.length, count);
        Self {
            length: by.nrows(),
            sums: sums.data.into(),
            places: Arc::clone(&self.places),
            ..*self
        }
    }

    /// Values of one cell.
    pub(super) fn length(&self) -> usize {
        self.length
    }

    /// Adds the cells of a span around a centre, times a weight; cells outside of the grid count as zero.
    fn add(&self, span: &Span, [column, row]: [i64; 2], weight: f64, out: &mut [f64]) {
        let row = match usize::try_from(row + span.row) {
            Ok(row) if row < self.rows => row,
            _ => return,
        };
        let [first, last] = [span.first, span.last].map(|k| (column + k).clamp(0, self.columns as i64) as usize);
        let of = |k: usize| {
            let place = self.places[row * (self.columns + 1) + k] as usize;
            &self.sums[place * self.length..][..self.length]
        };
        if first < last {
            for ((o, a), b) in out.iter_mut().zip(of(first)).zip(of(last)) {
                *o += weight * (b - a);
            }
        }
    }
}

/// The discs of a lattice: those of every radius about a node, then those about the next one.
#[derive(Debug)]
pub(super) struct Discs {
    /// Column and row of the cell of every node.
    nodes: Vec<[i64; 2]>,
    /// By radius.
    stencils: Vec<Vec<Span>>,
    cell_mm2: f64,
}

impl Discs {
    /// Of these radii about the centres of these cells of a grid.
    pub(super) fn new(nodes: Vec<[i64; 2]>, radii_mm: &[f64], cell_mm: f64) -> Self {
        Self {
            nodes,
            stencils: radii_mm.iter().map(|radius| coverage(radius / cell_mm)).collect(),
            cell_mm2: cell_mm * cell_mm,
        }
    }

    /// Writes a disc's mean of the cells' values over their area; zeros for a disc that there is not.
    pub(super) fn mean(&self, sums: &RowSums, disc: usize, out: &mut [f64]) {
        let radii = self.stencils.len();
        out.fill(0.0);
        let Some(node) = self.nodes.get(disc / radii) else {
            return;
        };
        for span in &self.stencils[disc % radii] {
            sums.add(span, *node, span.part / self.cell_mm2, out);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::{Geometry, Sheet};

    /// A disc inside the sheet has the mean of a linear function at its centre, and its sums times a matrix have that of the product.
    #[test]
    fn a_disc_has_the_mean_of_its_cells() {
        let geometry = Geometry::new(&Sheet::paper()).unwrap();
        let grid = CellGrid::new(&geometry, 5.0).unwrap();
        let value = |[x, y]: [f64; 2]| 3.0 + 0.2 * x - 0.1 * y;
        let cells = DMatrix::from_fn(2, grid.len(), |k, cell| (k + 1) as f64 * value(grid.centre(cell)));
        let sums = RowSums::new(&grid, &cells);
        let node = [12_usize, 17];
        let cell = grid.at(node[0], node[1]).unwrap();
        let discs = Discs::new(vec![[0, 0], node.map(|k| k as i64)], &[7.0, 12.0], 5.0);
        let by = DMatrix::from_row_slice(3, 2, &[1.0, 2.0, -1.0, 0.5, 4.0, 0.0]);
        let times = sums.times(&by);
        assert_eq!((sums.length(), times.length()), (2, 3));
        for disc in [2, 3] {
            let (mut mean, mut product) = (vec![f64::NAN; 2], vec![f64::NAN; 3]);
            discs.mean(&sums, disc, &mut mean);
            discs.mean(&times, disc, &mut product);
            let expected = value(grid.centre(cell)) / 25.0;
            assert!((mean[0] - expected).abs() < 1e-12 && (mean[1] - 2.0 * expected).abs() < 1e-12);
            let expected = &by * nalgebra::DVector::from_column_slice(&mean);
            assert!(expected.iter().zip(&product).all(|(a, b)| (a - b).abs() < 1e-12));
        }
        let mut beyond = [f64::NAN; 2];
        discs.mean(&sums, 4, &mut beyond);
        assert_eq!(beyond, [0.0; 2]);
    }
}
