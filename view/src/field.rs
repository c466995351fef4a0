//! The values of the cells as a smooth field.
//!
//! The cells are the coefficients of a uniform cubic B-spline. It does not overshoot: where no cell is negative, the
//! field is not; a lone cell spreads to 4/9 of its height with its volume kept. Cells outside the sheet continue their
//! neighbours inside, so the field does not fade towards the edge.

use crate::picture::Grid;

/// Cells added around the grid, so that the spline can be evaluated up to its edge.
const MARGIN: usize = 2;

/// A smooth field over the sheet.
#[derive(Clone, Debug)]
pub struct Field {
    columns: usize,
    rows: usize,
    left_mm: f64,
    bottom_mm: f64,
    cell_mm: f64,
    coefficients: Vec<f32>,
}

impl Field {
    /// The field of one value per used cell; missing values and values that are not finite count as 0.
    pub fn new(grid: &Grid, values: &[f32]) -> Self {
        let (columns, rows) = (grid.columns() + 2 * MARGIN, grid.rows() + 2 * MARGIN);
        let mut coefficients = vec![f32::NAN; columns * rows];
        let filled = values.iter().copied().chain(std::iter::repeat(0.0));
        for (&(column, row), value) in grid.cells().iter().zip(filled) {
            let at = (usize::from(row) + MARGIN) * columns + usize::from(column) + MARGIN;
            coefficients[at] = if value.is_finite() { value } else { 0.0 };
        }
        for _ in 0..=MARGIN {
            coefficients = extended(&coefficients, columns);
        }
        coefficients.iter_mut().filter(|v| v.is_nan()).for_each(|v| *v = 0.0);
        let margin_mm = MARGIN as f64 * grid.cell_mm();
        Self {
            columns,
            rows,
            left_mm: grid.left_mm() - margin_mm,
            bottom_mm: grid.bottom_mm() - margin_mm,
            cell_mm: grid.cell_mm(),
            coefficients,
        }
    }

    /// The field at a point, in the unit of the values. Far outside the sheet it is 0.
    pub fn at(&self, x_mm: f64, y_mm: f64) -> f32 {
        let (column, across) = weights((x_mm - self.left_mm) / self.cell_mm - 0.5);
        let (row, up) = weights((y_mm - self.bottom_mm) / self.cell_mm - 0.5);
        let mut sum = 0.0;
        for (j, wy) in up.into_iter().enumerate() {
            for (i, wx) in across.into_iter().enumerate() {
                sum += wx * wy * self.coefficient(column + i as i64, row + j as i64);
            }
        }
        sum
    }

    fn coefficient(&self, column: i64, row: i64) -> f32 {
        let inside = |k: i64, n: usize| usize::try_from(k).ok().filter(|&k| k < n);
        match (inside(column, self.columns), inside(row, self.rows)) {
            (Some(column), Some(row)) => self.coefficients[row * self.columns + column],
            _ => 0.0,
        }
    }
}

/// First of the four coefficients that reach `position`, and their weights (uniform cubic B-spline).
pub(crate) fn weights(position: f64) -> (i64, [f32; 4]) {
    let start = position.floor();
    let t = (position - start) as f32;
    let s = 1.0 - t;
    let inner = |t: f32| (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0;
    (start as i64 - 1, [s * s * s / 6.0, inner(t), inner(s), t * t * t / 6.0])
}

/// Every empty (not-a-number) cell that touches filled ones becomes their mean.
fn extended(cells: &[f32], columns: usize) -> Vec<f32> {
    let rows = cells.len() / columns;
    let mut result = cells.to_vec();
    for (k, target) in result.iter_mut().enumerate().filter(|(_, v)| v.is_nan()) {
        let (column, row) = (k % columns, k / columns);
        let (mut sum, mut count) = (0.0, 0.0);
        for r in row.saturating_sub(1)..=(row + 1).min(rows - 1) {
            for c in column.saturating_sub(1)..=(column + 1).min(columns - 1) {
                let value = cells[r * columns + c];
                if !value.is_nan() {
                    sum += value;
                    count += 1.0;
                }
            }
        }
        if count > 0.0 {
            *target = sum / count;
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::circle_mm;

    fn disc() -> Grid {
        Grid::cover(&circle_mm(97.5, 180), 5.0).unwrap()
    }

    #[test]
    fn a_uniform_sheet_stays_uniform_to_its_edge() {
        let grid = disc();
        let field = Field::new(&grid, &vec![0.3; grid.len()]);
        for point in circle_mm(97.4, 500) {
            assert!((field.at(point[0], point[1]) - 0.3).abs() < 1e-6, "{point:?}");
        }
    }

    #[test]
    fn a_ramp_is_reproduced() {
        // Cubic B-splines reproduce straight lines exactly.
        let grid = disc();
        let values: Vec<f32> = grid.centres_mm().map(|c| (c[0] + 0.5 * c[1]) as f32).collect();
        let field = Field::new(&grid, &values);
        for p in circle_mm(70.0, 37) {
            assert!((f64::from(field.at(p[0], p[1])) - (p[0] + 0.5 * p[1])).abs() < 1e-3);
        }
    }

    #[test]
    fn a_lone_cell_spreads_as_theory_says() {
        let grid = disc();
        let values: Vec<f32> = grid.centres_mm().map(|c| f32::from(c[0].hypot(c[1]) < 1.0)).collect();
        let field = Field::new(&grid, &values);
        assert!((field.at(0.0, 0.0) - 4.0 / 9.0).abs() < 1e-6);
        assert!((field.at(5.0, 0.0) - 1.0 / 9.0).abs() < 1e-6);
        assert_eq!(field.at(10.1, 0.0), 0.0);
    }

    #[test]
    fn far_outside_is_zero_and_bad_values_are_too() {
        let grid = disc();
        assert_eq!(Field::new(&grid, &vec![1.0; grid.len()]).at(1e9, -1e9), 0.0);
        assert_eq!(Field::new(&grid, &[f32::NAN]).at(0.0, 0.0), 0.0);
    }
}
