//! What fitted touches look like: the picture that agrees with their labels.
//!
//! A regularised picture is smoother than what presses: a finger is wider and flatter in it, and the smaller one the more. Beside
//! the rise of the fitted disc its colours would tell another story. So where discs explain a frame, the discs are drawn.

use crate::field::weights;
use crate::picture::Grid;
use inverse::touches::touch::Touch;

/// A fitted touch on the grid: a disc whose edge is as wide as a cell.
struct Spot {
    at_mm: [f64; 2],
    radius_mm: f64,
    cell_mm: f64,
    /// What a cell inside is given: more than the rise where the field between the cells would level the spot.
    height: f64,
}

impl Spot {
    /// None for a touch without a place or a rise.
    fn of(touch: &Touch, grid: &Grid) -> Option<Self> {
        let (at_mm, cell_mm) = ([touch.x_mm, touch.y_mm], grid.cell_mm());
        // A disc smaller than that would fall between the cells.
        let radius_mm = (touch.area_mm2 / std::f64::consts::PI).sqrt().max(cell_mm);
        let mut spot = Self {
            at_mm,
            radius_mm,
            cell_mm,
            height: 1.0,
        };
        spot.height = touch.rise.abs() / spot.middle(grid);
        let finite = at_mm.iter().chain([&radius_mm, &spot.height]).all(|v| v.is_finite());
        finite.then_some(spot)
    }

    /// Value at a point, mm.
    fn at(&self, [x, y]: [f64; 2]) -> f64 {
        let distance = (x - self.at_mm[0]).hypot(y - self.at_mm[1]);
        self.height * ((self.radius_mm - distance) / self.cell_mm + 0.5).clamp(0.0, 1.0)
    }

    /// The smooth field of this spot alone, in its middle.
    fn middle(&self, grid: &Grid) -> f64 {
        let low = [grid.left_mm(), grid.bottom_mm()];
        let position = |axis: usize| (self.at_mm[axis] - low[axis]) / self.cell_mm - 0.5;
        let ((column, across), (row, up)) = (weights(position(0)), weights(position(1)));
        let centre = |axis: usize, k: i64| low[axis] + (k as f64 + 0.5) * self.cell_mm;
        let mut sum = 0.0;
        for (r, wy) in (row..).zip(up) {
            for (c, wx) in (column..).zip(across) {
                sum += f64::from(wx * wy) * self.at([centre(0, c), centre(1, r)]);
            }
        }
        sum
    }
}

/// A value for every cell: the size of the rise under each touch, such that the smooth field ([`Field`](crate::field::Field)) has
/// the touch's rise in its middle. The larger one where touches overlap. A disc smaller than a cell is drawn as wide as one.
pub fn values(grid: &Grid, touches: &[Touch]) -> Vec<f32> {
    let spots: Vec<Spot> = touches.iter().filter_map(|touch| Spot::of(touch, grid)).collect();
    let at = |centre| spots.iter().map(|spot| spot.at(centre)).fold(0.0, f64::max);
    grid.centres_mm().map(|centre| at(centre) as f32).collect()
}

#[cfg(test)]
#[path = "fitted_tests.rs"]
mod tests;
