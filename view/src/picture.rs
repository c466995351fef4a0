//! What is shown: one picture of the sheet and everything a viewer needs to draw it.
//!
//! Lengths are millimetres, origin at the sheet's centre, x to the right and y up as seen from the touched side. Rises are
//! relative: 0.2 is a resistivity 20 % above the baseline. Nothing here depends on the number of electrodes or on the
//! outline being a disc.

use forward::curve::contains;
use inverse::touches::touch::Touch;
use serde::Serialize;
use std::sync::Arc;

/// Side of a cell unless told otherwise, mm.
pub const DEFAULT_CELL_MM: f64 = 5.0;

/// The most cells a grid may have along one side.
const MAX_SIDE: usize = 1024;

/// Square cells that cover a sheet: a rectangle of `columns` by `rows`, of which only the cells inside the outline are
/// used. Row 0 is at the bottom, column 0 at the left.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Grid {
    columns: usize,
    rows: usize,
    cell_mm: f64,
    left_mm: f64,
    bottom_mm: f64,
    cells: Vec<(u16, u16)>,
}

/// Why a grid or a picture cannot be shown.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PictureError {
    /// The outline is not a polygon with an area.
    #[error("an outline needs at least three finite points that enclose an area; {points} were given")]
    Outline {
        /// Points given.
        points: usize,
    },
    /// The cell size is not a positive number, or gives no cells or far too many.
    #[error(
        "cells of {cell_mm} mm give {columns} x {rows} cells on this sheet; choose a size that gives 1 to {MAX_SIDE} along a side"
    )]
    Cells {
        /// Side of a cell, mm.
        cell_mm: f64,
        /// Columns that would be needed.
        columns: usize,
        /// Rows that would be needed.
        rows: usize,
    },
    /// A cell lies outside the rectangle.
    #[error("cell ({column}, {row}) is outside a grid of {columns} x {rows}")]
    Outside {
        /// Column of the cell.
        column: u16,
        /// Row of the cell.
        row: u16,
        /// Columns of the grid.
        columns: usize,
        /// Rows of the grid.
        rows: usize,
    },
    /// The number of values is not the number of cells.
    #[error("{values} values were given for {cells} cells")]
    Length {
        /// Values given.
        values: usize,
        /// Cells of the grid.
        cells: usize,
    },
}

impl Grid {
    /// A grid of given cells: `cells[i]` is the (column, row) of the i-th value; `left_mm` and `bottom_mm` are the lower
    /// left corner of the rectangle.
    ///
    /// # Errors
    /// [`PictureError::Cells`] for an empty or oversized rectangle or a size that is not positive,
    /// [`PictureError::Outside`] for a cell outside it.
    pub fn new(
        columns: usize,
        rows: usize,
        cell_mm: f64,
        left_mm: f64,
        bottom_mm: f64,
        cells: Vec<(u16, u16)>,
    ) -> Result<Self, PictureError> {
        let side = 1..=MAX_SIDE;
        let finite = cell_mm.is_finite() && left_mm.is_finite() && bottom_mm.is_finite();
        if !finite || cell_mm <= 0.0 || !side.contains(&columns) || !side.contains(&rows) {
            return Err(PictureError::Cells { cell_mm, columns, rows });
        }
        let outside = |&&(column, row): &&(u16, u16)| usize::from(column) >= columns || usize::from(row) >= rows;
        if let Some(&(column, row)) = cells.iter().find(outside) {
            return Err(PictureError::Outside {
                column,
                row,
                columns,
                rows,
            });
        }
        Ok(Self {
            columns,
            rows,
            cell_mm,
            left_mm,
            bottom_mm,
            cells,
        })
    }

    /// Cells of `cell_mm` whose centres are inside `outline_mm`, in a rectangle centred on the outline's bounds.
    ///
    /// # Errors
    /// [`PictureError::Outline`] if the outline encloses nothing, [`PictureError::Cells`] if the size does not fit it.
    pub fn cover(outline_mm: &[[f64; 2]], cell_mm: f64) -> Result<Self, PictureError> {
        let bounds = Bounds::of(outline_mm).ok_or(PictureError::Outline {
            points: outline_mm.len(),
        })?;
        // A whole number of cells that falls short by rounding only still counts as whole.
        let count = |length: f64| (length / cell_mm - 1e-6).ceil().clamp(0.0, 1e6) as usize;
        let (columns, rows) = (count(bounds.width()), count(bounds.height()));
        let left = bounds.left + 0.5 * (bounds.width() - columns as f64 * cell_mm);
        let bottom = bounds.bottom + 0.5 * (bounds.height() - rows as f64 * cell_mm);
        let mut grid = Self::new(columns, rows, cell_mm, left, bottom, Vec::new())?;
        let all = (0..rows as u16).flat_map(|row| (0..columns as u16).map(move |column| (column, row)));
        grid.cells = all.filter(|&cell| contains(outline_mm, grid.at_mm(cell))).collect();
        if grid.cells.is_empty() {
            return Err(PictureError::Cells { cell_mm, columns, rows });
        }
        Ok(grid)
    }

    /// Cells from left to right, used or not.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Cells from bottom to top, used or not.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Side of a cell, mm.
    pub fn cell_mm(&self) -> f64 {
        self.cell_mm
    }

    /// Left edge of column 0, mm.
    pub fn left_mm(&self) -> f64 {
        self.left_mm
    }

    /// Lower edge of row 0, mm.
    pub fn bottom_mm(&self) -> f64 {
        self.bottom_mm
    }

    /// (column, row) of every used cell, in the order of the values.
    pub fn cells(&self) -> &[(u16, u16)] {
        &self.cells
    }

    /// Number of used cells.
    pub fn len(&self) -> usize {
        self.cells.len()
    }

    /// Whether no cell is used.
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }

    /// Centres of the used cells, mm, in the order of the values.
    pub fn centres_mm(&self) -> impl Iterator<Item = [f64; 2]> + '_ {
        self.cells.iter().map(|&cell| self.at_mm(cell))
    }

    fn at_mm(&self, (column, row): (u16, u16)) -> [f64; 2] {
        let centre = |start: f64, k: u16| start + (f64::from(k) + 0.5) * self.cell_mm;
        [centre(self.left_mm, column), centre(self.bottom_mm, row)]
    }
}

/// Which baseline a picture is against.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BaselineNote {
    /// When it was taken, s since 1970 (UTC).
    pub taken_unix_s: f64,
    /// Whether it was not taken now but stored.
    pub stored: bool,
    /// How many earlier ones an undo can bring back.
    pub earlier: usize,
    /// What speaks against it, for people.
    pub warning: Option<String>,
}

/// How the picture came about.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Stats {
    /// Frames received in a second.
    pub frames_per_s: f32,
    /// Time the reconstruction took, µs; none if there was nothing to reconstruct.
    pub solve_us: Option<f32>,
    /// Part of the measurement the picture leaves unexplained, 0..1; none if not known.
    pub residual: Option<f32>,
    /// Frames lost since the start: gaps in the numbering and frames that failed their check.
    pub lost_frames: u64,
    /// Frames received since the start and passed over for newer ones, because the reconstruction was busy.
    pub skipped_frames: u64,
    /// Where the frames come from: "simulated skin", "/dev/ttyUSB0", a file.
    pub source: String,
    /// The baseline in force; none before the first one.
    pub baseline: Option<BaselineNote>,
    /// Electrodes that are broken, from 0, in order; drawn so.
    pub faulty: Vec<usize>,
    /// What to tell the user now, such as "taking the baseline, do not touch".
    pub status: Option<String>,
    /// Why no newer picture comes, where the board is away and waited for.
    pub away: Option<String>,
    /// Whether the baseline is being taken, so that nothing can be looked for yet.
    pub preparing: bool,
    /// Whether forces are those of a typical rubber, without a calibration.
    pub uncalibrated: bool,
    /// Whether the values are those of the reconstruction, which is wider and flatter than what presses, and not those of the fitted
    /// touches.
    pub smoothed: bool,
}

/// A picture to show. The parts that stay the same from frame to frame are shared.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Number of the frame it was made from.
    pub sequence: u64,
    /// The board's time of that frame, s.
    pub time_s: f64,
    /// Where the values are.
    pub grid: Arc<Grid>,
    /// The sheet's edge, a simple polygon in either direction, mm.
    pub outline_mm: Arc<Vec<[f64; 2]>>,
    /// Centres of the electrodes, mm; shown with the numbers 1..n.
    pub electrodes_mm: Arc<Vec<[f64; 2]>>,
    /// Relative change of resistivity per used cell of the grid, without its sign; which, [`Stats::smoothed`] says.
    pub values: Vec<f32>,
    /// Touches, in any order.
    pub touches: Vec<Touch>,
    /// How it came about.
    pub stats: Stats,
}

impl Picture {
    /// Whether the parts fit together.
    ///
    /// # Errors
    /// [`PictureError::Length`] or [`PictureError::Outline`].
    pub fn check(&self) -> Result<(), PictureError> {
        if self.values.len() != self.grid.len() {
            return Err(PictureError::Length {
                values: self.values.len(),
                cells: self.grid.len(),
            });
        }
        match Bounds::of(&self.outline_mm) {
            Some(_) => Ok(()),
            None => Err(PictureError::Outline {
                points: self.outline_mm.len(),
            }),
        }
    }

    /// The size of the greatest rise among the touches: what a scale must hold; 0 without any.
    pub fn greatest_rise(&self) -> f32 {
        let sizes = self.touches.iter().map(|t| t.rise.abs() as f32);
        sizes.filter(|size| size.is_finite()).fold(0.0, f32::max)
    }

    /// The touches, strongest first.
    pub fn strongest_first(&self) -> Vec<Touch> {
        let mut touches = self.touches.clone();
        touches.sort_by(|a, b| b.rise.abs().total_cmp(&a.rise.abs()));
        touches
    }
}

/// A rectangle around points, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Least x, mm.
    pub left: f64,
    /// Least y, mm.
    pub bottom: f64,
    /// Greatest x, mm.
    pub right: f64,
    /// Greatest y, mm.
    pub top: f64,
}

impl Bounds {
    /// The bounds of a polygon; none if it has fewer than three points, one that is not finite, or no extent.
    pub fn of(points: &[[f64; 2]]) -> Option<Self> {
        let empty = Self {
            left: f64::INFINITY,
            bottom: f64::INFINITY,
            right: f64::NEG_INFINITY,
            top: f64::NEG_INFINITY,
        };
        let bounds = points.iter().fold(empty, |b, p| Self {
            left: b.left.min(p[0]),
            bottom: b.bottom.min(p[1]),
            right: b.right.max(p[0]),
            top: b.top.max(p[1]),
        });
        let finite = points.iter().flatten().all(|v| v.is_finite());
        (points.len() >= 3 && finite && bounds.width() > 0.0 && bounds.height() > 0.0).then_some(bounds)
    }

    /// Extent in x, mm.
    pub fn width(&self) -> f64 {
        self.right - self.left
    }

    /// Extent in y, mm.
    pub fn height(&self) -> f64 {
        self.top - self.bottom
    }
}

/// A circle of `points` points around the origin, counter-clockwise from +x: an outline, or the centres of electrodes.
pub fn circle_mm(radius_mm: f64, points: usize) -> Vec<[f64; 2]> {
    let step = std::f64::consts::TAU / points as f64;
    (0..points)
        .map(|k| (k as f64 * step).sin_cos())
        .map(|(s, c)| [radius_mm * c, radius_mm * s])
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_of_a_disc_fill_its_area() {
        let grid = Grid::cover(&circle_mm(97.5, 360), 5.0).unwrap();
        assert_eq!((grid.columns(), grid.rows()), (39, 39));
        let area = grid.len() as f64 * 25.0;
        let disc = std::f64::consts::PI * 97.5 * 97.5;
        assert!((area / disc - 1.0).abs() < 0.01, "{area} mm² of {disc} mm²");
        // The middle of an odd number of cells is the centre of the sheet.
        assert!(grid.centres_mm().any(|c| c[0].hypot(c[1]) < 1e-9));
    }

    #[test]
    fn any_simple_outline_is_covered() {
        let ell = [
            [0.0, 0.0],
            [60.0, 0.0],
            [60.0, 20.0],
            [20.0, 20.0],
            [20.0, 60.0],
            [0.0, 60.0],
        ];
        let grid = Grid::cover(&ell, 10.0).unwrap();
        assert_eq!(grid.len(), 6 * 2 + 2 * 4);
        let mut backwards = ell;
        backwards.reverse();
        assert_eq!(Grid::cover(&backwards, 10.0).unwrap().cells(), grid.cells());
    }

    #[test]
    fn nonsense_is_refused_with_a_reason() {
        let line = [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]];
        assert_eq!(Grid::cover(&line, 5.0), Err(PictureError::Outline { points: 3 }));
        let disc = circle_mm(97.5, 90);
        for cell_mm in [0.0, -1.0, f64::NAN, 1e-6] {
            assert!(
                matches!(Grid::cover(&disc, cell_mm), Err(PictureError::Cells { .. })),
                "{cell_mm}"
            );
        }
        assert!(matches!(
            Grid::new(2, 2, 5.0, 0.0, 0.0, vec![(2, 0)]),
            Err(PictureError::Outside { .. })
        ));
    }
}
