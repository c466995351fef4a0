//! Square cells over a sheet: the unknowns of a picture.

use crate::curve::Point;
use crate::geometry::Geometry;
use thiserror::Error;

/// Why no cells could be laid.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum CellError {
    /// A size that is not positive.
    #[error("the cell size is {cell_mm} mm; give a positive number")]
    NotPositive {
        /// What was given, mm.
        cell_mm: f64,
    },
    /// More cells than a picture can use.
    #[error("cells of {cell_mm} mm would be {cells} on this sheet, more than {most}; make them larger")]
    TooMany {
        /// What was given, mm.
        cell_mm: f64,
        /// How many that would be.
        cells: usize,
        /// The limit.
        most: usize,
    },
    /// Not one cell has its centre on the sheet.
    #[error("cells of {cell_mm} mm are too large for this sheet: none has its centre on it; make them smaller")]
    None {
        /// What was given, mm.
        cell_mm: f64,
    },
}

/// Most squares of a grid, far more than a picture has. The limit names a cell size in a wrong unit before time runs out.
const MOST_CELLS: usize = 250_000;

/// Square cells, their grid lines through the middle of the sheet's bounding box. A cell counts when its centre is on
/// the sheet; slivers of the sheet beyond belong to the nearest cell.
#[derive(Clone, Debug, PartialEq)]
pub struct CellGrid {
    cell_mm: f64,
    low_mm: Point,
    columns: usize,
    rows: usize,
    cells: Vec<[u32; 2]>,
    /// Owner of every square of the grid, row by row.
    owner: Vec<u32>,
}

impl CellGrid {
    /// Lays cells of a size over a sheet.
    ///
    /// # Errors
    /// A size that is not positive, too small or too large for the sheet.
    pub fn new(geometry: &Geometry, cell_mm: f64) -> Result<Self, CellError> {
        if !(cell_mm > 0.0 && cell_mm.is_finite()) {
            return Err(CellError::NotPositive { cell_mm });
        }
        let (low, high) = geometry.bounding_box();
        let half = |k: usize| ((0.5 * (high[k] - low[k]) / cell_mm) - 1e-9).ceil().max(1.0);
        let (half_columns, half_rows) = (half(0), half(1));
        let count = 4.0 * half_columns * half_rows;
        if count > MOST_CELLS as f64 {
            return Err(CellError::TooMany {
                cell_mm,
                cells: count as usize,
                most: MOST_CELLS,
            });
        }
        let (columns, rows) = (2 * half_columns as usize, 2 * half_rows as usize);
        let low_mm = [
            0.5 * (low[0] + high[0]) - half_columns * cell_mm,
            0.5 * (low[1] + high[1]) - half_rows * cell_mm,
        ];
        let mut grid = Self {
            cell_mm,
            low_mm,
            columns,
            rows,
            cells: Vec::new(),
            owner: vec![u32::MAX; columns * rows],
        };
        for row in 0..rows {
            for column in 0..columns {
                if geometry.contains(grid.square_centre(column, row)) {
                    grid.owner[row * columns + column] = grid.cells.len() as u32;
                    grid.cells.push([column as u32, row as u32]);
                }
            }
        }
        if grid.cells.is_empty() {
            return Err(CellError::None { cell_mm });
        }
        grid.adopt_slivers();
        Ok(grid)
    }

    /// Gives every square without a cell of its own to the nearest cell, ring by ring outwards.
    fn adopt_slivers(&mut self) {
        loop {
            let before = self.owner.clone();
            let mut changed = false;
            for row in 0..self.rows {
                for column in 0..self.columns {
                    let here = row * self.columns + column;
                    if before[here] != u32::MAX {
                        continue;
                    }
                    let neighbour = [(0, -1), (-1, 0), (1, 0), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)]
                        .into_iter()
                        .filter_map(|(dx, dy)| {
                            let (c, r) = (column as i64 + dx, row as i64 + dy);
                            let on = c >= 0 && r >= 0 && c < self.columns as i64 && r < self.rows as i64;
                            on.then(|| before[r as usize * self.columns + c as usize])
                        })
                        .find(|owner| *owner != u32::MAX);
                    if let Some(owner) = neighbour {
                        self.owner[here] = owner;
                        changed = true;
                    }
                }
            }
            if !changed {
                return;
            }
        }
    }

    fn square_centre(&self, column: usize, row: usize) -> Point {
        [
            self.low_mm[0] + (column as f64 + 0.5) * self.cell_mm,
            self.low_mm[1] + (row as f64 + 0.5) * self.cell_mm,
        ]
    }

    /// How many cells.
    pub fn len(&self) -> usize {
        self.cells.len()
    }

    /// Whether there are none (never, for a grid that was accepted).
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }

    /// Side of a cell, mm.
    pub fn cell_mm(&self) -> f64 {
        self.cell_mm
    }

    /// Columns and rows of the grid.
    pub fn shape(&self) -> (usize, usize) {
        (self.columns, self.rows)
    }

    /// Lower left corner of the grid, mm.
    pub fn low_mm(&self) -> Point {
        self.low_mm
    }

    /// Column and row of every cell; row 0 is the lowest.
    pub fn cells(&self) -> &[[u32; 2]] {
        &self.cells
    }

    /// Centre of a cell, mm.
    pub fn centre(&self, cell: usize) -> Point {
        let [column, row] = self.cells[cell];
        self.square_centre(column as usize, row as usize)
    }

    /// The cell of a column and a row, if there is one.
    pub fn at(&self, column: usize, row: usize) -> Option<usize> {
        if column >= self.columns || row >= self.rows {
            return None;
        }
        let owner = self.owner[row * self.columns + column] as usize;
        let own = self.cells.get(owner) == Some(&[column as u32, row as u32]);
        own.then_some(owner)
    }

    /// The cell that a square of the grid belongs to (its own, or the nearest); columns and rows are clamped to the grid.
    pub(crate) fn owner(&self, column: i64, row: i64) -> usize {
        let c = column.clamp(0, self.columns as i64 - 1) as usize;
        let r = row.clamp(0, self.rows as i64 - 1) as usize;
        self.owner[r * self.columns + c] as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Sheet;

    #[test]
    fn five_millimetre_cells_on_the_paper_disc() {
        let g = Geometry::new(&Sheet::paper()).unwrap();
        let grid = CellGrid::new(&g, 5.0).unwrap();
        assert_eq!(grid.len(), 1184);
        for k in 0..grid.len() {
            let [c, r] = grid.cells()[k];
            assert_eq!(grid.at(c as usize, r as usize), Some(k));
            let p = grid.centre(k);
            assert!(p[0].hypot(p[1]) < 97.5);
        }
    }

    #[test]
    fn nonsense_sizes_are_refused() {
        let g = Geometry::new(&Sheet::paper()).unwrap();
        assert!(matches!(CellGrid::new(&g, 0.0), Err(CellError::NotPositive { .. })));
        assert!(matches!(
            CellGrid::new(&g, f64::NAN),
            Err(CellError::NotPositive { .. })
        ));
        assert!(matches!(CellGrid::new(&g, 0.01), Err(CellError::TooMany { .. })));
        assert!(matches!(CellGrid::new(&g, 1000.0), Err(CellError::None { .. })));
    }
}
