//! The answer of every measurement to a disc touch of unit strength, anywhere on the sheet and of any radius.
//!
//! Tabulated at the nodes of a square lattice for three radii: the mean over the disc of the sensitivity's density. Between
//! the nodes cubic convolution (Keys 1981), between the radii a parabola in R²: for the smooth fields away from the
//! electrodes the mean over a disc is a power series in R² (f + R²/8 lap f + R⁴/192 lap lap f + ...).

use forward::{CellGrid, Drive, Model, Pattern, Sensitivity, Solver};
use nalgebra::DVector;
use std::sync::Arc;

/// Radii tabulated, over the expected radius.
const RADII: [f64; 3] = [0.5, 1.0, 1.5];
/// Nodes beyond the rim that the interpolation needs.
const MARGIN: i64 = 2;
/// Lattice steps from the sheet's middle to its farthest point.
const STEPS: f64 = 40.0;
/// Divisions of a cell's side when its part inside a disc is measured.
const CUTS: i32 = 16;
const NONE: u32 = u32::MAX;

/// Where the nodes are; shared by the tables of one sheet.
#[derive(Debug)]
struct Lattice {
    first_mm: [f64; 2],
    step_mm: f64,
    columns: usize,
    rows: usize,
    /// Place of every node in the table.
    slot: Vec<u32>,
    outline_mm: Vec<[f64; 2]>,
    /// Nodes on the sheet, every other column and row: where a touch is looked for.
    coarse: Vec<(u32, [f64; 2])>,
    radius_mm: f64,
}

/// The table, with values as volts (or whatever [`TouchTable::map`] made of them) per mm² of strength.
#[derive(Clone, Debug)]
pub struct TouchTable {
    lattice: Arc<Lattice>,
    length: usize,
    /// For every slot the three radii, each `length` values.
    values: Vec<f64>,
    /// Norm of the values of every coarse node at the expected radius.
    norms: Vec<f64>,
}

/// Weights of the four nodes around a fraction of a step, and their derivatives per step.
fn keys(t: f64) -> ([f64; 4], [f64; 4]) {
    let (t2, t3) = (t * t, t * t * t);
    (
        [
            0.5 * (-t3 + 2.0 * t2 - t),
            0.5 * (3.0 * t3 - 5.0 * t2 + 2.0),
            0.5 * (-3.0 * t3 + 4.0 * t2 + t),
            0.5 * (t3 - t2),
        ],
        [
            0.5 * (-3.0 * t2 + 4.0 * t - 1.0),
            0.5 * (9.0 * t2 - 10.0 * t),
            0.5 * (-9.0 * t2 + 8.0 * t + 1.0),
            0.5 * (3.0 * t2 - 2.0 * t),
        ],
    )
}

/// Part of every cell around a disc's centre (itself a cell's centre) that the disc covers; the parts sum up to the disc.
fn coverage(radius_cells: f64) -> Vec<(i64, i64, f64)> {
    let reach = radius_cells.ceil() as i64 + 1;
    let mut out = Vec::new();
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
            if inside > 0 {
                out.push((column, row, f64::from(inside)));
            }
        }
    }
    let sum: f64 = out.iter().map(|o| o.2).sum();
    out.iter_mut().for_each(|o| o.2 /= sum);
    out
}

impl TouchTable {
    /// Tabulates a sheet. `radius_mm` is the expected radius. `None` when the model cannot be solved or the sheet is too
    /// small for a touch of that size.
    pub fn new(model: &Arc<Model>, drive: Drive, pattern: &Pattern, radius_mm: f64) -> Option<Self> {
        let (low, high) = model.geometry().bounding_box();
        let extent = 0.5 * (high[0] - low[0]).max(high[1] - low[1]);
        let step = extent / STEPS;
        let grid = CellGrid::new(model.geometry(), step).ok()?;
        let solver = Solver::new(Arc::clone(model)).ok()?;
        let cells = Sensitivity::by_cell(&solver, &grid).matrix_v(drive, solver.electrode_matrix(), pattern);
        let length = cells.nrows();
        let (columns, rows) = grid.shape();
        let (nc, nr) = (columns + 2 * MARGIN as usize, rows + 2 * MARGIN as usize);
        let corner = grid.low_mm();
        let first_mm = [0, 1].map(|k| corner[k] + (0.5 - MARGIN as f64) * grid.cell_mm());
        let at = |c: i64, r: i64| match (usize::try_from(c), usize::try_from(r)) {
            (Ok(c), Ok(r)) => grid.at(c, r),
            _ => None,
        };
        let near =
            |c: i64, r: i64| (-MARGIN..=MARGIN).any(|dr| (-MARGIN..=MARGIN).any(|dc| at(c + dc, r + dr).is_some()));
        let stencils = RADII.map(|k| coverage(k * radius_mm / grid.cell_mm()));
        let mut slot = vec![NONE; nc * nr];
        let mut values = Vec::new();
        let mut coarse = Vec::new();
        let mut count = 0u32;
        for row in 0..nr as i64 {
            for column in 0..nc as i64 {
                let (c, r) = (column - MARGIN, row - MARGIN);
                if !near(c, r) {
                    continue;
                }
                slot[row as usize * nc + column as usize] = count;
                if at(c, r).is_some() && column % 2 == 0 && row % 2 == 0 {
                    let p = [column, row];
                    coarse.push((count, [0, 1].map(|k| first_mm[k] + p[k] as f64 * step)));
                }
                count += 1;
                for stencil in &stencils {
                    let start = values.len();
                    values.resize(start + length, 0.0);
                    let out = &mut values[start..];
                    for (dc, dr, part) in stencil {
                        if let Some(cell) = at(c + dc, r + dr) {
                            // Per mm² of strength: the disc's mean of the cells' sensitivity over their area.
                            let weight = part / (step * step);
                            for (o, v) in out.iter_mut().zip(cells.column(cell).as_slice()) {
                                *o += weight * v;
                            }
                        }
                    }
                }
            }
        }
        let lattice = Lattice {
            first_mm,
            step_mm: step,
            columns: nc,
            rows: nr,
            slot,
            outline_mm: model.geometry().outline().polyline().to_vec(),
            coarse,
            radius_mm,
        };
        Some(
            Self {
                lattice: Arc::new(lattice),
                length,
                values,
                norms: Vec::new(),
            }
            .with_norms(),
        )
    }

    fn with_norms(mut self) -> Self {
        let norms = self
            .coarse()
            .map(|(_, v)| v.iter().map(|x| x * x).sum::<f64>().sqrt())
            .collect();
        self.norms = norms;
        self
    }

    /// The table with every column of values replaced by another: the reduced and weighted measurements, say.
    pub fn map(&self, mut f: impl FnMut(&DVector<f64>) -> DVector<f64>) -> Self {
        let mut values = Vec::new();
        let mut length = 0;
        for column in self.values.chunks_exact(self.length.max(1)) {
            let out = f(&DVector::from_column_slice(column));
            length = out.len();
            values.extend_from_slice(out.as_slice());
        }
        Self {
            lattice: Arc::clone(&self.lattice),
            length,
            values,
            norms: Vec::new(),
        }
        .with_norms()
    }

    /// Values of one touch: the length of the data.
    pub fn length(&self) -> usize {
        self.length
    }

    /// Distance between two nodes, mm.
    pub fn step_mm(&self) -> f64 {
        self.lattice.step_mm
    }

    /// Whether a place is on the sheet and inside the table.
    pub fn holds(&self, at: [f64; 2]) -> bool {
        crate::picture::contains(&self.lattice.outline_mm, at)
    }

    /// Smallest and largest radius that the table is good for, mm.
    pub fn radii_mm(&self) -> [f64; 2] {
        [0.4 * self.lattice.radius_mm, 1.8 * self.lattice.radius_mm]
    }

    /// Places where a touch is looked for, with the values of one of unit strength and the expected radius there.
    pub fn coarse(&self) -> impl Iterator<Item = ([f64; 2], &[f64])> + '_ {
        self.lattice.coarse.iter().map(|(slot, at)| {
            let start = (*slot as usize * 3 + 1) * self.length;
            (*at, &self.values[start..start + self.length])
        })
    }

    /// Norms of the values of [`TouchTable::coarse`].
    pub fn coarse_norms(&self) -> &[f64] {
        &self.norms
    }

    /// Values of a touch of unit strength with their derivatives by x, y (per mm) and radius (per mm), each `length` long;
    /// zero off the sheet.
    pub fn at(&self, at: [f64; 2], radius: f64, out: [&mut [f64]; 4]) {
        let [value, by_x, by_y, by_radius] = out;
        let n = self.length;
        let (value, by_x, by_y, by_radius) = (&mut value[..n], &mut by_x[..n], &mut by_y[..n], &mut by_radius[..n]);
        for o in [&mut *value, &mut *by_x, &mut *by_y, &mut *by_radius] {
            o.fill(0.0);
        }
        let l = &*self.lattice;
        let u = [0, 1].map(|k| (at[k] - l.first_mm[k]) / l.step_mm);
        let base = u.map(|v| v.floor());
        let (wx, dx) = keys(u[0] - base[0]);
        let (wy, dy) = keys(u[1] - base[1]);
        // A parabola in q = R² through the three radii.
        let q = (radius / l.radius_mm).powi(2);
        let [a, b, c] = RADII.map(|r| r * r);
        let dq = 2.0 * radius / (l.radius_mm * l.radius_mm);
        let basis = [
            (
                (q - b) * (q - c) / ((a - b) * (a - c)),
                (2.0 * q - b - c) / ((a - b) * (a - c)) * dq,
            ),
            (
                (q - a) * (q - c) / ((b - a) * (b - c)),
                (2.0 * q - a - c) / ((b - a) * (b - c)) * dq,
            ),
            (
                (q - a) * (q - b) / ((c - a) * (c - b)),
                (2.0 * q - a - b) / ((c - a) * (c - b)) * dq,
            ),
        ];
        for (j, (wy, dy)) in wy.into_iter().zip(dy).enumerate() {
            let row = base[1] as i64 + j as i64 - 1;
            for (i, (wx, dx)) in wx.into_iter().zip(dx).enumerate() {
                let column = base[0] as i64 + i as i64 - 1;
                let inside = column >= 0 && row >= 0 && column < l.columns as i64 && row < l.rows as i64;
                if !inside {
                    continue;
                }
                let slot = l.slot[row as usize * l.columns + column as usize];
                if slot == NONE {
                    continue;
                }
                for (k, (b, db)) in basis.into_iter().enumerate() {
                    let start = (slot as usize * 3 + k) * n;
                    let values = &self.values[start..start + n];
                    let w = [
                        wx * wy * b,
                        dx * wy * b / l.step_mm,
                        wx * dy * b / l.step_mm,
                        wx * wy * db,
                    ];
                    for (m, v) in values.iter().enumerate() {
                        value[m] += w[0] * v;
                        by_x[m] += w[1] * v;
                        by_y[m] += w[2] * v;
                        by_radius[m] += w[3] * v;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::field::conductivity_of_discs;
    use forward::{DiscTouch, ModelOptions, Sheet};

    fn paper() -> (Arc<Model>, TouchTable) {
        let options = ModelOptions {
            accuracy: 5e-5,
            ..ModelOptions::default()
        };
        let model = Arc::new(Model::new(&Sheet::paper(), &options).unwrap());
        let table = TouchTable::new(&model, Drive::PAPER, &Pattern::adjacent(16).unwrap(), 12.5).unwrap();
        (model, table)
    }

    fn at(table: &TouchTable, p: [f64; 2], radius: f64) -> [Vec<f64>; 4] {
        let mut out: [Vec<f64>; 4] = std::array::from_fn(|_| vec![0.0; table.length()]);
        let [a, b, c, d] = &mut out;
        table.at(p, radius, [a, b, c, d]);
        out
    }

    fn norm(v: &[f64]) -> f64 {
        v.iter().map(|x| x * x).sum::<f64>().sqrt()
    }

    #[test]
    fn the_weights_of_the_nodes_add_up_to_one() {
        for k in 0..=10 {
            let (w, d) = keys(f64::from(k) / 10.0);
            assert!((w.iter().sum::<f64>() - 1.0).abs() < 1e-14);
            assert!(d.iter().sum::<f64>().abs() < 1e-14);
        }
    }

    /// The frame of a weak disc by a new solution: places and radii between the nodes.
    #[test]
    fn a_weak_disc_answers_as_tabulated() {
        let (model, table) = paper();
        let mut solver = Solver::new(Arc::clone(&model)).unwrap();
        let pattern = Pattern::adjacent(16).unwrap();
        let unpressed = Drive::PAPER.frame_v(solver.electrode_matrix(), &pattern);
        for (p, radius) in [
            ([1.3, 0.7], 12.5),
            ([41.1, -33.9], 9.0),
            ([-70.2, 20.6], 12.5),
            ([3.0, 62.3], 15.5),
        ] {
            let touch = DiscTouch {
                centre_mm: p,
                radius_mm: radius,
                rise: 0.01,
            };
            solver.solve(&conductivity_of_discs(model.mesh(), &[touch])).unwrap();
            let v = Drive::PAPER.frame_v(solver.electrode_matrix(), &pattern);
            let change: Vec<f64> = v.iter().zip(&unpressed).map(|(v, u)| v - u).collect();
            // The rise that the linear model sees: 2 c / (2 + c).
            let strength = 0.02 / 2.01 * std::f64::consts::PI * radius * radius;
            let off: Vec<f64> = at(&table, p, radius)[0]
                .iter()
                .zip(&change)
                .map(|(t, c)| strength * t - c)
                .collect();
            let relative = norm(&off) / norm(&change);
            assert!(relative < 0.004, "{p:?} {radius}: {relative}");
        }
    }

    #[test]
    fn derivatives_are_those_of_the_values() {
        let (_, table) = paper();
        let (p, radius, step) = ([20.3, -41.7], 11.0, 1e-4);
        let values = at(&table, p, radius);
        let moves = [([step, 0.0], 0.0), ([0.0, step], 0.0), ([0.0, 0.0], step)];
        for (k, (d, dr)) in moves.into_iter().enumerate() {
            let up = at(&table, [p[0] + d[0], p[1] + d[1]], radius + dr);
            let down = at(&table, [p[0] - d[0], p[1] - d[1]], radius - dr);
            let off: Vec<f64> = (0..table.length())
                .map(|m| (up[0][m] - down[0][m]) / (2.0 * step) - values[k + 1][m])
                .collect();
            assert!(norm(&off) < 1e-6 * norm(&values[k + 1]), "{k}");
        }
    }

    #[test]
    fn a_place_off_the_table_is_nothing() {
        let (_, table) = paper();
        assert!(!table.holds([98.0, 0.0]) && table.holds([90.0, 0.0]));
        assert!(at(&table, [1e4, -1e4], 12.5).iter().flatten().all(|v| *v == 0.0));
    }
}
