//! Discs about the nodes of a lattice, as means of the cells that they cover.

use crate::linalg::kernels::{LANES, SINGLE_LANES, add_columns, add_columns_single, padded};
use forward::CellGrid;
use nalgebra::{DMatrix, DMatrixView};
use pulp::Arch;
use std::sync::Arc;

/// Divisions of a cell's side when its part inside a disc is counted.
const CUTS: i32 = 16;
/// Edges whose sums are added at once.
const EDGES_AT_ONCE: usize = 64;

/// An edge between two cells of one row of which a disc covers different parts.
#[derive(Debug)]
struct Edge {
    /// The cell after it, counted from the disc's centre.
    column: i64,
    row: i64,
    /// The part covered of the cell before it, less that of the cell after it.
    step: f64,
}

/// The edges of a disc around the centre of a cell. The parts covered of all cells sum up to 1.
fn coverage(radius_cells: f64) -> Vec<Edge> {
    let reach = radius_cells.ceil() as i64 + 1;
    let offset = |k: i32| (f64::from(k) + 0.5) / f64::from(CUTS) - 0.5;
    let inside = |column: i64, row: i64| {
        let cuts = (0..CUTS).flat_map(|i| (0..CUTS).map(move |j| [i, j]));
        let within = |[i, j]: &[i32; 2]| (column as f64 + offset(*i)).hypot(row as f64 + offset(*j)) < radius_cells;
        cuts.filter(within).count()
    };
    let mut out: Vec<Edge> = Vec::new();
    let mut sum = 0;
    for row in -reach..=reach {
        let mut before = 0;
        for column in -reach..=reach + 1 {
            let here = inside(column, row);
            sum += here;
            if here != before {
                let step = before as f64 - here as f64;
                out.push(Edge { column, row, step });
            }
            before = here;
        }
    }
    out.iter_mut().for_each(|edge| edge.step /= sum as f64);
    out
}

/// What sums are kept in.
pub(super) trait Precision: Sized {
    /// `y += sum of x_j column_j` over a list of `(j, x_j)`.
    fn add_columns(arch: Arch, columns: &[Self], list: &[(usize, f64)], y: &mut [f64]);
}

impl Precision for f64 {
    fn add_columns(arch: Arch, columns: &[Self], list: &[(usize, f64)], y: &mut [f64]) {
        add_columns(arch, columns, list, y);
    }
}

impl Precision for f32 {
    fn add_columns(arch: Arch, columns: &[Self], list: &[(usize, f64)], y: &mut [f64]) {
        add_columns_single(arch, columns, list, y);
    }
}

/// Sums of the cells' columns along every row of the grid, so that cells beside one another cost two of them however many they are.
#[derive(Clone, Debug)]
pub(super) struct RowSums<T = f64> {
    length: usize,
    /// Numbers from the sum of one place to that of the next.
    stride: usize,
    columns: usize,
    rows: usize,
    /// For every row `columns + 1` places of sums, those of the cells before each column.
    places: Arc<[u32]>,
    /// Nothing, and the sums that differ from the one before them: cells off the sheet add nothing.
    sums: Vec<T>,
}

impl RowSums {
    pub(super) fn new(grid: &CellGrid, cells: &DMatrix<f64>) -> Self {
        let (columns, rows) = grid.shape();
        let n = padded(cells.nrows(), LANES);
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
            length: cells.nrows(),
            stride: n,
            columns,
            rows,
            places: places.into(),
            sums,
        }
    }

    /// The same in single precision, which is as exact as a response has to be, and takes half of the time.
    pub(super) fn single(&self) -> RowSums<f32> {
        let stride = padded(self.length, SINGLE_LANES);
        let count = self.sums.len() / self.stride.max(1);
        let mut sums = vec![0.0; stride * count];
        let columns = self.sums.chunks_exact(self.stride.max(1));
        for (to, from) in sums.chunks_exact_mut(stride.max(1)).zip(columns) {
            to.iter_mut().zip(from).for_each(|(to, from)| *to = *from as f32);
        }
        RowSums {
            length: self.length,
            stride,
            columns: self.columns,
            rows: self.rows,
            places: Arc::clone(&self.places),
            sums,
        }
    }
}

impl RowSums<f32> {
    /// Those of the cells' columns times a matrix.
    pub(super) fn times(&self, by: &DMatrix<f64>) -> Self {
        let count = self.sums.len() / self.stride.max(1);
        let stride = padded(by.nrows(), SINGLE_LANES);
        let mut sums = DMatrix::zeros(stride, count);
        let own = DMatrixView::from_slice_with_strides(&self.sums, self.length, count, 1, self.stride);
        sums.rows_mut(0, by.nrows()).gemm(1.0, &by.map(|v| v as f32), &own, 0.0);
        Self {
            length: by.nrows(),
            stride,
            sums: sums.data.into(),
            places: Arc::clone(&self.places),
            ..*self
        }
    }
}

impl<T> RowSums<T> {
    /// Values of one cell.
    pub(super) fn length(&self) -> usize {
        self.length
    }

    /// Where the sum up to an edge is, about a centre; none where it is nothing. Cells outside of the grid count as zero.
    fn place(&self, edge: &Edge, [column, row]: [i64; 2]) -> Option<usize> {
        let row = usize::try_from(row + edge.row).ok().filter(|row| *row < self.rows)?;
        let column = (column + edge.column).clamp(0, self.columns as i64) as usize;
        let place = self.places[row * (self.columns + 1) + column] as usize;
        (place > 0).then_some(place)
    }
}

/// The discs of a lattice: those of every radius about a node, then those about the next one.
#[derive(Debug)]
pub(super) struct Discs {
    /// Column and row of the cell of every node.
    nodes: Vec<[i64; 2]>,
    /// By radius.
    stencils: Vec<Vec<Edge>>,
    cell_mm2: f64,
    arch: Arch,
}

impl Discs {
    /// Of these radii about the centres of these cells of a grid.
    pub(super) fn new(nodes: Vec<[i64; 2]>, radii_mm: &[f64], cell_mm: f64) -> Self {
        Self {
            nodes,
            stencils: radii_mm.iter().map(|radius| coverage(radius / cell_mm)).collect(),
            cell_mm2: cell_mm * cell_mm,
            arch: Arch::new(),
        }
    }

    /// Writes a disc's mean of the cells' values over their area; zeros for a disc that there is not. `out`: the length of one cell, padded
    /// to whole registers.
    pub(super) fn mean<T: Precision>(&self, sums: &RowSums<T>, disc: usize, out: &mut [f64]) {
        let radii = self.stencils.len();
        out.fill(0.0);
        let Some(node) = self.nodes.get(disc / radii) else {
            return;
        };
        for edges in self.stencils[disc % radii].chunks(EDGES_AT_ONCE) {
            let mut list = [(0, 0.0); EDGES_AT_ONCE];
            let mut count = 0;
            for edge in edges {
                if let Some(place) = sums.place(edge, *node) {
                    list[count] = (place, edge.step / self.cell_mm2);
                    count += 1;
                }
            }
            T::add_columns(self.arch, &sums.sums, &list[..count], out);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::{Geometry, Sheet};

    /// That of single precision, in sums along a row.
    const ROUNDING: f64 = 1e-5;

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
        let times = sums.single().times(&by);
        assert_eq!((sums.length(), times.length()), (2, 3));
        for disc in [2, 3] {
            let (mut mean, mut product) = (vec![f64::NAN; LANES], vec![f64::NAN; LANES]);
            discs.mean(&sums, disc, &mut mean);
            discs.mean(&times, disc, &mut product);
            let expected = value(grid.centre(cell)) / 25.0;
            assert!((mean[0] - expected).abs() < 1e-12 && (mean[1] - 2.0 * expected).abs() < 1e-12);
            let expected = &by * nalgebra::DVector::from_column_slice(&mean[..2]);
            let off = |(a, b): (&f64, &f64)| (a - b).abs();
            let most = expected.iter().zip(&product).map(off).fold(0.0, f64::max);
            assert!(most < ROUNDING * expected.amax(), "{most}");
        }
        let mut beyond = [f64::NAN; LANES];
        discs.mean(&sums, 4, &mut beyond);
        assert_eq!(beyond, [0.0; LANES]);
    }
}
