//! The response of every measurement to a disc touch of unit strength, anywhere on the sheet and of any radius.
//!
//! The table holds the mean of the sensitivity's density over the disc, at the nodes of a square lattice and for a few
//! radii, from a finger's tip to a hand laid flat. Between the nodes it is interpolated by cubic convolution (Keys 1981), between
//! the radii by a parabola in R² through three of them. Away from the electrodes the fields are smooth, and the mean
//! over a disc is a power series in R² (f + R²/8 lap f + R⁴/192 lap lap f + ...). The result is within 0.5 % of a new
//! solution, and within 3 % for a hand that ends near the rim: the tests below hold that.

use crate::linalg::kernels::{LANES, dots_of, padded};
use crate::reference::imager::Imager;
use crate::touches::fit::discs::{Discs, RowSums};
use crate::touches::fit::interpolation::{Radii, Stencil, interpolate};
use crate::touches::fit::node_values::NodeValues;
use forward::{CellGrid, Drive, Model, Pattern, Sensitivity, Solver};
use nalgebra::DMatrix;
use pulp::Arch;
use std::cell::{OnceCell, RefCell};
use std::sync::Arc;

/// Radii tabulated, over the expected radius.
pub(super) const RADII: [f64; 8] = [0.5, 1.0, 1.5, 2.0, 2.7, 3.6, 4.6, 5.6];
/// How many of them one interpolation takes, and of how many nodes.
const AT_ONCE: usize = 3;
const NODES: usize = 16;
/// Smallest and largest radius that the interpolation is good for, over the expected radius.
const SMALLEST: f64 = 0.4;
const LARGEST: f64 = 5.6;
/// Which of them is the expected one.
pub(super) const EXPECTED: usize = 1;
/// Nodes outside the rim that the interpolation needs.
const MARGIN: i64 = 2;
/// Lattice steps from the sheet's middle to its farthest point: 2.4 mm each on the paper's disc. More makes the table
/// larger and more exact.
const STEPS: f64 = 40.0;
/// Most numbers that are tabulated, 154 MB. Of more the discs are summed up from the cells whenever they are needed: 16 electrodes have 9
/// million, 32 have 41.
const MOST_TABULATED: usize = 19_200_000;
/// Columns that are summed up from the cells in the time of an evaluation: 1.7 and 5 us of 928 values.
const SUMMED_IN_AN_EVALUATION: f64 = 3.0;

/// Where the nodes are; shared by the tables of one sheet.
#[derive(Debug)]
struct Lattice {
    first_mm: [f64; 2],
    step_mm: f64,
    columns: usize,
    rows: usize,
    /// Slot of every node in the table; `empty_slot` for nodes off the sheet.
    slot: Vec<u32>,
    /// The last slot, which holds zeros.
    empty_slot: u32,
    outline_mm: Vec<[f64; 2]>,
    /// Nodes on the sheet, every other column and row: where a touch is looked for.
    coarse: Vec<[f64; 2]>,
    /// Column of the table of every one of them, for the expected radius.
    coarse_columns: Vec<usize>,
    radius_mm: f64,
}

impl Lattice {
    /// Columns of the table, those of the empty slot included.
    fn count(&self) -> usize {
        RADII.len() * (self.empty_slot as usize + 1)
    }
}

/// The table, with values as volts (or whatever [`ResponseTable::reduced`] made of them) per mm² of strength.
#[derive(Clone, Debug)]
pub struct ResponseTable {
    lattice: Arc<Lattice>,
    arch: Arch,
    length: usize,
    /// For every slot the radii, each a column of `length` values and zeros up to a multiple of [`LANES`].
    pub(super) values: NodeValues,
    /// Norm of the values of every coarse node at the expected radius.
    norms: OnceCell<Vec<f64>>,
    /// Norms of what a split there changes, for every direction of [`SPLITS`]; made when a touch first comes near.
    pub(super) split_norms: RefCell<SplitNorms>,
}

/// By coarse place, and room for the values of a split.
#[derive(Clone, Debug)]
pub(super) struct SplitNorms {
    pub(super) known: Vec<Option<[f64; SPLITS]>>,
    pub(super) room: Vec<f64>,
}

/// Directions in which a touch is tried to be split, evenly spread over half a turn.
pub const SPLITS: usize = 4;

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

/// A parabola in q = R² through three of the radii (R over the expected radius, `unit` mm): the lowest three up to the
/// third, then those around R. At the third radius and those after it one parabola hands over to the next: all pass
/// through these.
fn radii_at(r: f64, unit: f64) -> Radii {
    let first = RADII[AT_ONCE - 1..RADII.len() - 1]
        .iter()
        .filter(|top| r > **top)
        .count();
    let [a, b, c] = [0, 1, 2].map(|k| RADII[first + k].powi(2));
    let (q, dq) = (r * r, 2.0 * r / unit);
    let below = [(a - b) * (a - c), (b - a) * (b - c), (c - a) * (c - b)];
    Radii {
        first,
        value: [
            (q - b) * (q - c) / below[0],
            (q - a) * (q - c) / below[1],
            (q - a) * (q - b) / below[2],
        ],
        slope: [
            (2.0 * q - b - c) / below[0] * dq,
            (2.0 * q - a - c) / below[1] * dq,
            (2.0 * q - a - b) / below[2] * dq,
        ],
    }
}

fn lattice_step(model: &Model) -> f64 {
    let (low, high) = model.geometry().bounding_box();
    0.5 * (high[0] - low[0]).max(high[1] - low[1]) / STEPS
}

impl ResponseTable {
    /// Tabulates a sheet. `radius_mm` is the expected radius. `None` when the model cannot be solved or the sheet is
    /// too small for a touch of that size.
    pub fn new(model: &Arc<Model>, drive: Drive, pattern: &Pattern, radius_mm: f64) -> Option<Self> {
        let grid = CellGrid::new(model.geometry(), lattice_step(model)).ok()?;
        let solver = Solver::new(Arc::clone(model)).ok()?;
        let cells = Sensitivity::by_cell(&solver, &grid).matrix_v(drive, solver.electrode_matrix(), pattern);
        Some(Self::of_cells(model, &grid, &cells, radius_mm))
    }

    /// The same of the sheet that presses told an imager; `None` where they told nothing of it.
    pub fn told(imager: &Imager, radius_mm: f64) -> Option<Self> {
        let told = imager.told.as_ref().filter(|told| !told.unknowns.is_empty())?;
        let grid = CellGrid::new(imager.model.geometry(), lattice_step(&imager.model)).ok()?;
        let cells = told.responses(imager, &grid)?;
        Some(Self::of_cells(&imager.model, &grid, &cells, radius_mm))
    }

    fn of_cells(model: &Model, grid: &CellGrid, cells: &DMatrix<f64>, radius_mm: f64) -> Self {
        let step = lattice_step(model);
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
        let on_sheet = (0..(nc * nr) as i64).filter(|k| near(k % nc as i64 - MARGIN, k / nc as i64 - MARGIN));
        let empty_slot = on_sheet.clone().count() as u32;
        let mut slot = vec![empty_slot; nc * nr];
        let (mut coarse, mut coarse_columns) = (Vec::new(), Vec::new());
        let mut nodes = Vec::new();
        for (count, node) in on_sheet.enumerate() {
            let (column, row) = (node % nc as i64, node / nc as i64);
            let (c, r) = (column - MARGIN, row - MARGIN);
            slot[node as usize] = count as u32;
            if at(c, r).is_some() && column % 2 == 0 && row % 2 == 0 {
                let p = [column, row];
                coarse.push([0, 1].map(|k| first_mm[k] + p[k] as f64 * step));
                coarse_columns.push(RADII.len() * count + EXPECTED);
            }
            nodes.push([c, r]);
        }
        let lattice = Lattice {
            first_mm,
            step_mm: step,
            columns: nc,
            rows: nr,
            slot,
            empty_slot,
            outline_mm: model.geometry().outline().polyline().to_vec(),
            coarse,
            coarse_columns,
            radius_mm,
        };
        // Per mm² of strength: the discs' means of the cells' sensitivity over their area.
        let discs = Discs::new(nodes, &RADII.map(|k| k * radius_mm), step);
        let sums = RowSums::new(grid, cells);
        let values = NodeValues::of_discs(discs, sums, lattice.count(), MOST_TABULATED);
        Self::of(Arc::new(lattice), length, values)
    }

    fn of(lattice: Arc<Lattice>, length: usize, values: NodeValues) -> Self {
        Self {
            split_norms: RefCell::new(SplitNorms {
                known: vec![None; lattice.coarse.len()],
                room: vec![0.0; padded(length, LANES)],
            }),
            norms: OnceCell::new(),
            lattice,
            arch: Arch::new(),
            length,
            values,
        }
    }

    /// The table with its values times a matrix: the reduced and weighted measurements, say. Unless all is made
    /// `at_once`, all but those of the coarse places are made when a touch first comes near.
    pub fn reduced(&self, by: &DMatrix<f64>, at_once: bool) -> Self {
        let values = self
            .values
            .reduced(by, self.lattice.count(), &self.lattice.coarse_columns, at_once);
        let reduced = Self::of(Arc::clone(&self.lattice), by.nrows(), values);
        // A frame is not to wait for them.
        reduced.coarse_norms();
        reduced
    }

    /// Values of one touch: the length of the data.
    pub fn length(&self) -> usize {
        self.length
    }

    /// The same with the zeros that follow.
    pub fn stride(&self) -> usize {
        padded(self.length, LANES)
    }

    /// The vector unit in use.
    pub(super) fn arch(&self) -> Arch {
        self.arch
    }

    /// Distance between two nodes, mm.
    pub fn step_mm(&self) -> f64 {
        self.lattice.step_mm
    }

    /// Whether a place is on the sheet and inside the table.
    pub fn holds(&self, at: [f64; 2]) -> bool {
        forward::curve::contains(&self.lattice.outline_mm, at)
    }

    /// Whether a place is on the sheet and so far from its rim, as far as eight directions tell.
    pub(super) fn is_inside(&self, at: [f64; 2], from_rim_mm: f64) -> bool {
        let (dx, dy) = (from_rim_mm, from_rim_mm * std::f64::consts::FRAC_1_SQRT_2);
        let around = [[dx, 0.0], [dy, dy], [0.0, dx], [-dy, dy]];
        around
            .iter()
            .flat_map(|[x, y]| [[at[0] + x, at[1] + y], [at[0] - x, at[1] - y]])
            .all(|p| self.holds(p))
    }

    /// The expected radius, mm.
    pub fn radius_mm(&self) -> f64 {
        self.lattice.radius_mm
    }

    /// Smallest and largest radius that the table is good for, mm.
    pub fn radii_mm(&self) -> [f64; 2] {
        [SMALLEST, LARGEST].map(|r| r * self.lattice.radius_mm)
    }

    /// Area of the sheet, as far as the places where a touch is looked for tell, mm².
    pub fn area_mm2(&self) -> f64 {
        4.0 * self.lattice.coarse.len() as f64 * self.lattice.step_mm.powi(2)
    }

    /// Places where a touch is looked for, mm.
    pub fn coarse(&self) -> &[[f64; 2]] {
        &self.lattice.coarse
    }

    /// Norms of the values of a touch of unit strength and the expected radius at those places.
    pub fn coarse_norms(&self) -> &[f64] {
        self.norms.get_or_init(|| {
            let stride = self.stride();
            self.values
                .with_coarse(&self.lattice.coarse_columns, |values, columns| {
                    let norm = |column: &usize| {
                        let v = &values[column * stride..][..self.length];
                        v.iter().map(|x| x * x).sum::<f64>().sqrt()
                    };
                    columns.iter().map(norm).collect()
                })
        })
    }

    /// Products of those values with a vector of [`ResponseTable::stride`] entries; `out` is emptied first.
    pub fn coarse_products(&self, v: &[f64], out: &mut Vec<f64>) {
        if v.len() == self.stride() && !v.is_empty() {
            self.values
                .with_coarse(&self.lattice.coarse_columns, |values, columns| {
                    dots_of(self.arch, values, columns, v, out)
                });
        } else {
            out.clear();
        }
    }

    /// What was taken to sum up responses from the cells so far, in evaluations of the response to one touch: of sheets with many values
    /// they are not tabulated.
    pub(super) fn summing(&self) -> f64 {
        self.values.summed() as f64 / SUMMED_IN_AN_EVALUATION
    }

    pub(super) fn stencil(&self, at: [f64; 2]) -> Stencil {
        let l = &*self.lattice;
        let u = [0, 1].map(|k| (at[k] - l.first_mm[k]) / l.step_mm);
        let base = u.map(|v| v.floor());
        let (across, across_slope) = keys(u[0] - base[0]);
        let (up, up_slope) = keys(u[1] - base[1]);
        Stencil {
            columns: std::array::from_fn(|k| {
                let (column, row) = (base[0] as i64 + (k % 4) as i64 - 1, base[1] as i64 + (k / 4) as i64 - 1);
                let inside = column >= 0 && row >= 0 && column < l.columns as i64 && row < l.rows as i64;
                let slot = if inside {
                    l.slot[row as usize * l.columns + column as usize]
                } else {
                    l.empty_slot
                };
                slot as usize * RADII.len()
            }),
            across,
            across_slope: across_slope.map(|d| d / l.step_mm),
            up,
            up_slope: up_slope.map(|d| d / l.step_mm),
        }
    }

    /// Values of a touch of unit strength with their derivatives by x, y (per mm) and radius (per mm), each
    /// [`ResponseTable::stride`] long; zero off the sheet.
    pub fn at(&self, at: [f64; 2], radius: f64, out: [&mut [f64]; 4]) {
        let l = &*self.lattice;
        let mut stencil = self.stencil(at);
        let mut radii = radii_at(radius / l.radius_mm, l.radius_mm);
        let n = self.stride();
        let needed: [usize; NODES * AT_ONCE] =
            std::array::from_fn(|k| stencil.columns[k / AT_ONCE] + radii.first + k % AT_ONCE);
        self.values.with(&needed, |values, columns| {
            // The radii of a node stay beside one another, wherever they are.
            stencil.columns = std::array::from_fn(|k| columns[k * AT_ONCE]);
            radii.first = 0;
            interpolate(self.arch, values, &radii, &stencil, out.map(|o| &mut o[..n]));
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::field::conductivity_of_discs;
    use forward::{DiscTouch, ModelOptions, Sheet};

    fn paper() -> (Arc<Model>, ResponseTable) {
        let options = ModelOptions {
            accuracy: 5e-5,
            ..ModelOptions::default()
        };
        let model = Arc::new(Model::new(&Sheet::paper(), &options).unwrap());
        let table = ResponseTable::new(&model, Drive::PAPER, &Pattern::adjacent(16).unwrap(), 12.5).unwrap();
        (model, table)
    }

    fn at(table: &ResponseTable, p: [f64; 2], radius: f64) -> [Vec<f64>; 4] {
        let mut out: [Vec<f64>; 4] = std::array::from_fn(|_| vec![0.0; table.stride()]);
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
    fn a_weak_disc_responds_as_tabulated() {
        let (model, table) = paper();
        let mut solver = Solver::new(Arc::clone(&model)).unwrap();
        let pattern = Pattern::adjacent(16).unwrap();
        let unpressed = Drive::PAPER.frame_v(solver.electrode_matrix(), &pattern);
        for (p, radius, most) in [
            ([1.3, 0.7], 12.5, 0.004),
            ([41.1, -33.9], 9.0, 0.004),
            ([-70.2, 20.6], 12.5, 0.004),
            ([3.0, 62.3], 15.5, 0.004),
            // Palms.
            ([11.0, -38.7], 26.0, 0.004),
            ([-20.6, 31.3], 22.0, 0.004),
            ([4.1, 3.3], 34.0, 0.004),
            // Hands; the last one ends 10 mm from the rim.
            ([11.0, -8.7], 45.0, 0.004),
            ([-20.6, 31.3], 45.0, 0.004),
            ([4.1, 3.3], 60.0, 0.005),
            ([4.1, 3.3], 70.0, 0.004),
            ([30.6, 10.3], 55.0, 0.03),
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
            assert!(relative < most, "{p:?} {radius}: {relative}");
        }
    }

    #[test]
    fn derivatives_are_those_of_the_values() {
        let (_, table) = paper();
        let (p, step) = ([20.3, -41.7], 1e-4);
        for radius in [11.0, 21.0, 30.0, 40.0, 52.0, 65.0, 69.0] {
            derivatives_at(&table, p, radius, step);
        }
    }

    fn derivatives_at(table: &ResponseTable, p: [f64; 2], radius: f64, step: f64) {
        let values = at(table, p, radius);
        let moves = [([step, 0.0], 0.0), ([0.0, step], 0.0), ([0.0, 0.0], step)];
        for (k, (d, dr)) in moves.into_iter().enumerate() {
            let up = at(table, [p[0] + d[0], p[1] + d[1]], radius + dr);
            let down = at(table, [p[0] - d[0], p[1] - d[1]], radius - dr);
            let off: Vec<f64> = (0..table.length())
                .map(|m| (up[0][m] - down[0][m]) / (2.0 * step) - values[k + 1][m])
                .collect();
            assert!(norm(&off) < 1e-6 * norm(&values[k + 1]), "{k}");
        }
    }

    #[test]
    fn one_parabola_hands_over_to_the_next_at_a_tabulated_radius() {
        let (_, table) = paper();
        let p = [-33.0, 24.6];
        for radius in [1.5, 2.0, 2.7, 3.6, 4.6].map(|k| k * 12.5) {
            let (below, above) = (at(&table, p, radius - 1e-9), at(&table, p, radius + 1e-9));
            let jump: Vec<f64> = below[0].iter().zip(&above[0]).map(|(a, b)| a - b).collect();
            assert!(norm(&jump) < 1e-8 * norm(&below[0]), "{radius}");
        }
    }

    #[test]
    fn a_place_off_the_table_is_nothing() {
        let (_, table) = paper();
        assert!(!table.holds([98.0, 0.0]) && table.holds([90.0, 0.0]));
        assert!(at(&table, [1e4, -1e4], 12.5).iter().flatten().all(|v| *v == 0.0));
    }
}
