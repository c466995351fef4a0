//! What a frame says of splitting a touch into two.

use crate::touches::fit::interpolation::{add_scaled, dot};
use crate::touches::fit::responses::{EXPECTED, ResponseTable, SPLITS, SplitNorms};

/// Half distance between the halves of a touch that is split, over the expected radius.
const HALF_SPLIT: f64 = 1.1;

impl ResponseTable {
    /// The ends of a split in a direction.
    pub fn split(&self, at: [f64; 2], direction: usize) -> [[f64; 2]; 2] {
        let reach = HALF_SPLIT * self.radius_mm();
        let (sin, cos) = (direction as f64 * std::f64::consts::PI / SPLITS as f64).sin_cos();
        [1.0, -1.0].map(|s| [at[0] + s * reach * cos, at[1] + s * reach * sin])
    }

    /// How much of a vector of [`ResponseTable::stride`] entries lies along what splitting a touch changes, over the size of
    /// its strength, in the direction where that is most, with that direction; none where no split stays on the sheet.
    /// Of `strength` only the sign counts.
    pub fn best_split(&self, v: &[f64], at: [f64; 2], strength: f64) -> Option<(f64, usize)> {
        let off = |c: &[f64; 2]| (c[0] - at[0]).powi(2) + (c[1] - at[1]).powi(2);
        let nearest = self.coarse().iter().map(off).enumerate();
        let (nearest, _) = nearest.min_by(|a, b| a.1.total_cmp(&b.1))?;
        let norms = self.split_norms_at(nearest);
        let middle = self.product(v, at);
        (0..SPLITS)
            .filter_map(|direction| {
                let ends = self.split(at, direction);
                if !ends.iter().all(|e| self.holds(*e)) {
                    return None;
                }
                let change = self.product(v, ends[0]) + self.product(v, ends[1]) - 2.0 * middle;
                let norm = norms[direction].max(f64::MIN_POSITIVE);
                Some((strength.signum() * change / norm, direction))
            })
            .max_by(|a, b| a.0.total_cmp(&b.0))
    }

    fn split_norms_at(&self, coarse: usize) -> [f64; SPLITS] {
        let SplitNorms { known, room } = &mut *self.split_norms.borrow_mut();
        *known[coarse].get_or_insert_with(|| {
            let at = self.coarse()[coarse];
            std::array::from_fn(|direction| {
                let [a, b] = self.split(at, direction);
                room.fill(0.0);
                for (place, weight) in [(at, -2.0), (a, 1.0), (b, 1.0)] {
                    self.of_nodes(place, |values, by| {
                        add_scaled(self.arch(), values, weight * by, room);
                    });
                }
                room.iter().map(|v| v * v).sum::<f64>().sqrt()
            })
        })
    }

    /// Product of a vector with the values of a touch of unit strength and the expected radius.
    fn product(&self, v: &[f64], at: [f64; 2]) -> f64 {
        let mut sum = 0.0;
        self.of_nodes(at, |values, by| sum += by * dot(self.arch(), values, v));
        sum
    }

    /// The values of the nodes around a place for the expected radius, with their weights.
    fn of_nodes(&self, at: [f64; 2], mut visit: impl FnMut(&[f64], f64)) {
        let (stencil, n) = (self.stencil(at), self.stride());
        let columns = stencil.columns.map(|first| first + EXPECTED);
        self.values.with(&columns, |values, columns| {
            for (k, column) in columns.iter().enumerate() {
                visit(&values[column * n..][..n], stencil.across[k % 4] * stencil.up[k / 4]);
            }
        });
    }
}
