//! The response of every measurement to a small rise in resistivity: the adjoint formula, by element or by cell.
//!
//! Let u_m be the potential of drive pair m for a unit current, and x the relative rise of a region. The transfer impedance
//! changes by `dZ[m,n]/dx = + integral over the region of sigma grad u_m . grad u_n` (Geselowitz 1971; the paper's eq. 3
//! signed for resistivity). For a voltage drive the current changes as well:
//! `dV[m,n] = U0 (dZ[m,n] / D_m - Z[m,n] dZ[m,m] / D_m^2)`, `D_m = Z[m,m] + 2 R_on`.

use crate::cells::CellGrid;
use crate::curve::{Point, cross};
use crate::element::{DEGREE_2, DEGREE_4, MOST_NODES, gradients, position};
use crate::impedance::{Drive, ElectrodeMatrix};
use crate::mesh::{Mesh, Order};
use crate::pattern::{Pair, Pattern};
use crate::solver::Solver;
use nalgebra::DMatrix;
use pulp::Arch;

/// For every region the matrix of `integral of sigma grad phi_l . grad phi_k`, ohm per unit of relative rise. Here phi_l is
/// the potential for 1 A into electrode l. All sensitivities are differences of the matrix's entries.
#[derive(Clone, Debug)]
pub struct Sensitivity {
    electrodes: usize,
    regions: usize,
    /// Row-major electrode by electrode matrices, one after the other; symmetric.
    gram: Vec<f64>,
}

/// Electrodes worked on at once: loops of a fixed length are several times faster.
const LANES: usize = 16;

/// Integrals over the pieces of one element: first between its shape functions, then between the electrodes' potentials.
/// A piece has several quadrature points but one pair of products with the potentials.
struct Sampler<'a> {
    arch: Arch,
    mesh: &'a Mesh,
    electrodes: usize,
    /// Node by node the potentials of all electrodes, V, filled up with zeros to whole blocks.
    potentials: Vec<[f64; LANES]>,
    /// The element's potentials less those of its first node, block by block.
    differences: Vec<[[f64; LANES]; MOST_NODES]>,
    /// `integral of grad N_a . sigma grad N_b` over the piece, lower triangle.
    local: [[f64; MOST_NODES]; MOST_NODES],
}

impl Sampler<'_> {
    /// Adds a quadrature point at barycentric `l`; `share` is its share of the straight triangle's area.
    fn point(&mut self, element: usize, l: [f64; 3], share: f64, sigma: [f64; 3]) {
        let (g, count, det) = gradients(self.mesh, element, l);
        let [xx, xy, yy] = sigma.map(|s| s * share * 0.5 * det);
        for a in 0..count {
            let j = [xx * g[a][0] + xy * g[a][1], xy * g[a][0] + yy * g[a][1]];
            for (sum, g) in self.local[a].iter_mut().zip(&g[..=a]) {
                *sum += j[0] * g[0] + j[1] * g[1];
            }
        }
    }

    /// Takes up an element's potentials. (A constant has no gradient: the first node's potential can be left out.)
    fn start(&mut self, element: usize) {
        let mut nodes = [0; MOST_NODES];
        for (slot, node) in nodes.iter_mut().zip(self.mesh.element_nodes(element)) {
            *slot = node;
        }
        let blocks = self.differences.len();
        let count = self.mesh.element_nodes(element).count();
        for (block, d) in self.differences.iter_mut().enumerate() {
            let first = self.potentials[nodes[0] * blocks + block];
            for (node, d) in nodes[..count].iter().zip(d) {
                let u = &self.potentials[node * blocks + block];
                *d = std::array::from_fn(|k| u[k] - first[k]);
            }
        }
    }

    /// Adds the piece to its region's matrix (lower triangle) and starts a new one.
    fn finish(&mut self, gram: &mut [f64]) {
        // The same sums in the same order, in wider registers: nothing is rounded otherwise.
        self.arch.dispatch(|| self.add_piece(gram));
        self.local = [[0.0; MOST_NODES]; MOST_NODES];
    }

    #[inline(always)]
    fn add_piece(&self, gram: &mut [f64]) {
        let n = self.electrodes;
        for (column_block, right) in self.differences.iter().enumerate() {
            let mut half = [[0.0; LANES]; MOST_NODES];
            for (a, half) in half.iter_mut().enumerate().skip(1) {
                for (b, right) in right.iter().enumerate().skip(1) {
                    let k = self.local[a.max(b)][a.min(b)];
                    for (h, u) in half.iter_mut().zip(right) {
                        *h += k * u;
                    }
                }
            }
            let columns = column_block * LANES..n.min((column_block + 1) * LANES);
            for i in columns.start..n {
                let left = &self.differences[i / LANES];
                let mut row = [0.0; LANES];
                for a in 1..MOST_NODES {
                    let u = left[a][i % LANES];
                    for (r, h) in row.iter_mut().zip(&half[a]) {
                        *r += u * h;
                    }
                }
                let out = &mut gram[i * n + columns.start..i * n + columns.end];
                for (o, r) in out.iter_mut().zip(&row) {
                    *o += r;
                }
            }
        }
    }
}

/// Quadrature points (barycentric, share of the triangle's area) of one piece of an element.
type Piece = Vec<([f64; 3], f64)>;

impl Sensitivity {
    /// One region for every element of the mesh.
    pub fn by_element(solver: &Solver) -> Self {
        let mesh = solver.mesh();
        let elements = mesh.triangles.len();
        Self::integrate(solver, elements, |element, piece, add| {
            // The gradients' product is of degree 2 on straight elements.
            let rule: &[_] = if mesh.curved[element] { &DEGREE_4 } else { &DEGREE_2 };
            piece.extend_from_slice(rule);
            add(element, piece);
        })
    }

    /// One region for every cell of a grid.
    pub fn by_cell(solver: &Solver, grid: &CellGrid) -> Self {
        let mesh = solver.mesh();
        Self::integrate(solver, grid.len(), |element, piece, add| {
            fragments(mesh, element, grid, piece, add);
        })
    }

    fn integrate(
        solver: &Solver,
        regions: usize,
        mut pieces: impl FnMut(usize, &mut Piece, &mut dyn FnMut(usize, &Piece)),
    ) -> Self {
        let model = solver.model();
        let n = model.electrodes();
        let blocks = n.div_ceil(LANES);
        let all = solver.potentials_v();
        let mut potentials = vec![[0.0; LANES]; all.nrows() * blocks];
        for electrode in 0..n {
            for (node, v) in all.column(electrode).iter().enumerate() {
                potentials[node * blocks + electrode / LANES][electrode % LANES] = *v;
            }
        }
        let mut sampler = Sampler {
            arch: Arch::new(),
            mesh: solver.mesh(),
            electrodes: n,
            potentials,
            differences: vec![[[0.0; LANES]; MOST_NODES]; blocks],
            local: [[0.0; MOST_NODES]; MOST_NODES],
        };
        let mut piece = Piece::new();
        let conductance = 1.0 / model.sheet().sheet_resistance_ohm;
        let mut gram = vec![0.0; regions * n * n];
        for (element, tensor) in solver.conductivity().iter().enumerate() {
            let sigma = tensor.map(|s| s * conductance);
            piece.clear();
            sampler.start(element);
            pieces(element, &mut piece, &mut |region, piece| {
                for (l, share) in piece {
                    sampler.point(element, *l, *share, sigma);
                }
                sampler.finish(&mut gram[region * n * n..(region + 1) * n * n]);
            });
        }
        for block in gram.chunks_exact_mut(n * n) {
            for i in 0..n {
                for j in 0..i {
                    block[j * n + i] = block[i * n + j];
                }
            }
        }
        Self {
            electrodes: n,
            regions,
            gram,
        }
    }

    pub(crate) fn from_gram(electrodes: usize, regions: usize, gram: Vec<f64>) -> Self {
        Self {
            electrodes,
            regions,
            gram,
        }
    }

    /// How many regions.
    pub fn regions(&self) -> usize {
        self.regions
    }

    /// Change of the transfer impedance of two pairs for a unit relative rise of a region, ohm.
    pub fn transfer_ohm(&self, region: usize, drive: Pair, sense: Pair) -> f64 {
        let n = self.electrodes;
        let g = &self.gram[region * n * n..(region + 1) * n * n];
        let at = |i: usize, j: usize| g[i * n + j];
        (at(drive.plus, sense.plus) - at(drive.plus, sense.minus))
            - (at(drive.minus, sense.plus) - at(drive.minus, sense.minus))
    }

    /// The sensitivity matrix, `[measurement, region]`: change of the measured amplitude (V) for a unit relative rise in
    /// resistivity, under this drive. `sheet` is the solution the sensitivity was taken at.
    pub fn matrix_v(&self, drive: Drive, sheet: &ElectrodeMatrix, pattern: &Pattern) -> DMatrix<f64> {
        struct Row {
            drive: Pair,
            sense: Pair,
            current: f64,
            /// By what the drive's own resistance changes the current, times the transfer impedance.
            slope: f64,
        }
        let rows: Vec<Row> = pattern
            .measurements()
            .iter()
            .map(|m| {
                let own = sheet.transfer_ohm(m.drive, m.drive);
                // d current / d own resistance, over the current.
                let slope = match drive {
                    Drive::Voltage { switch_ohm, .. } => -1.0 / (own + 2.0 * switch_ohm),
                    Drive::Current { .. } => 0.0,
                };
                Row {
                    drive: m.drive,
                    sense: m.sense,
                    current: drive.current_a(own),
                    slope: sheet.transfer_ohm(m.drive, m.sense) * slope,
                }
            })
            .collect();
        let mut out = DMatrix::zeros(pattern.len(), self.regions);
        // Region by region: its matrix fits the cache.
        for (region, mut column) in out.column_iter_mut().enumerate() {
            for (row, out) in rows.iter().zip(column.iter_mut()) {
                let mut dv = self.transfer_ohm(region, row.drive, row.sense);
                if row.slope != 0.0 {
                    dv += row.slope * self.transfer_ohm(region, row.drive, row.drive);
                }
                *out = row.current * dv;
            }
        }
        out
    }
}

/// Cuts an element along the cells: calls `add(cell, quadrature points)` for every piece. `points` is scratch, empty.
fn fragments(mesh: &Mesh, element: usize, grid: &CellGrid, points: &mut Piece, add: &mut dyn FnMut(usize, &Piece)) {
    let corners = mesh.corners(element);
    let low = grid.low_mm();
    let h = grid.cell_mm();
    let square = |p: Point| {
        (
            ((p[0] - low[0]) / h).floor() as i64,
            ((p[1] - low[1]) / h).floor() as i64,
        )
    };
    let [a, b, c] = corners.map(square);
    let (c0, c1) = (a.0.min(b.0).min(c.0), a.0.max(b.0).max(c.0));
    let (r0, r1) = (a.1.min(b.1).min(c.1), a.1.max(b.1).max(c.1));
    if c0 == c1 && r0 == r1 {
        points.extend_from_slice(match (mesh.order, mesh.curved[element]) {
            (_, true) => &DEGREE_4,
            (Order::Quadratic, false) => &DEGREE_2,
            (Order::Linear, false) => &[([1.0 / 3.0; 3], 1.0)],
        });
        add(grid.owner(c0, r0), points);
        return;
    }
    let whole = cross(corners[0], corners[1], corners[2]);
    let barycentric = |p: Point| {
        let l1 = cross(corners[0], p, corners[2]) / whole;
        let l2 = cross(corners[0], corners[1], p) / whole;
        [1.0 - l1 - l2, l1, l2]
    };
    let (mut strip, mut piece, mut spare) = (Polygon::EMPTY, Polygon::EMPTY, Polygon::EMPTY);
    for row in r0..=r1 {
        let bottom = low[1] + row as f64 * h;
        clip(&corners, 1, bottom, 1.0, &mut spare);
        clip(spare.points(), 1, bottom + h, -1.0, &mut strip);
        for column in c0..=c1 {
            let left = low[0] + column as f64 * h;
            clip(strip.points(), 0, left, 1.0, &mut spare);
            clip(spare.points(), 0, left + h, -1.0, &mut piece);
            let Some(([first], rest)) = piece.points().split_first_chunk() else {
                continue;
            };
            points.clear();
            for side in rest.windows(2) {
                let fan = [*first, side[0], side[1]];
                let share = cross(fan[0], fan[1], fan[2]) / whole;
                if share > 1e-14 {
                    points.extend(
                        DEGREE_2
                            .iter()
                            .map(|(l, w)| (barycentric(position(fan, *l)), w * share)),
                    );
                }
            }
            if !points.is_empty() {
                add(grid.owner(column, row), points);
            }
        }
    }
}

/// A triangle cut by the four sides of a square has at most seven corners.
struct Polygon {
    corners: [Point; 8],
    count: usize,
}

impl Polygon {
    const EMPTY: Self = Self {
        corners: [[0.0; 2]; 8],
        count: 0,
    };

    fn points(&self) -> &[Point] {
        &self.corners[..self.count]
    }

    fn push(&mut self, p: Point) {
        if let Some(corner) = self.corners.get_mut(self.count) {
            *corner = p;
            self.count += 1;
        }
    }
}

/// The part of a convex polygon where `sign * (p[axis] - limit) >= 0` (Sutherland and Hodgman 1974).
fn clip(polygon: &[Point], axis: usize, limit: f64, sign: f64, out: &mut Polygon) {
    out.count = 0;
    for (k, a) in polygon.iter().enumerate() {
        let b = polygon[(k + 1) % polygon.len()];
        let (da, db) = (sign * (a[axis] - limit), sign * (b[axis] - limit));
        if da >= 0.0 {
            out.push(*a);
        }
        if (da > 0.0 && db < 0.0) || (da < 0.0 && db > 0.0) {
            let t = da / (da - db);
            out.push([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Model;
    use crate::options::ModelOptions;
    use crate::{Geometry, Sheet};
    use std::sync::Arc;

    fn coarse(order: Order) -> Arc<Model> {
        let options = ModelOptions {
            accuracy: 1e-2,
            order,
            ..ModelOptions::default()
        };
        Arc::new(Model::new(&Sheet::paper(), &options).unwrap())
    }

    const DRIVES: [Drive; 2] = [Drive::PAPER, Drive::Current { amplitude_a: 1e-3 }];

    #[test]
    fn by_element_equals_finite_differences() {
        for order in [Order::Linear, Order::Quadratic] {
            let model = coarse(order);
            let pattern = Pattern::adjacent(16).unwrap();
            let mut solver = Solver::new(model.clone()).unwrap();
            let s = Sensitivity::by_element(&solver);
            for drive in DRIVES {
                let j = s.matrix_v(drive, solver.electrode_matrix(), &pattern);
                let scale = j.amax();
                for element in [0, 17, s.regions() / 2, s.regions() - 1] {
                    let frame = |solver: &mut Solver, x: f64| {
                        let mut c = vec![[1.0, 0.0, 1.0]; s.regions()];
                        c[element] = [1.0 / (1.0 + x), 0.0, 1.0 / (1.0 + x)];
                        let z = solver.solve(&c).unwrap().clone();
                        drive.frame_v(&z, &pattern)
                    };
                    let step = 1e-3;
                    let (up, down) = (frame(&mut solver, step), frame(&mut solver, -step));
                    for row in 0..pattern.len() {
                        let difference = (up[row] - down[row]) / (2.0 * step);
                        let off = (difference - j[(row, element)]).abs();
                        assert!(
                            off < 1e-5 * j.column(element).amax() + 1e-9 * scale,
                            "{order:?} {element} {row}"
                        );
                    }
                }
                solver.solve(&vec![[1.0, 0.0, 1.0]; s.regions()]).unwrap();
            }
        }
    }

    #[test]
    fn cells_and_elements_add_up_to_the_same() {
        let model = coarse(Order::Quadratic);
        let solver = Solver::new(model.clone()).unwrap();
        let grid = CellGrid::new(&Geometry::new(&Sheet::paper()).unwrap(), 5.0).unwrap();
        let cells = Sensitivity::by_cell(&solver, &grid);
        let elements = Sensitivity::by_element(&solver);
        for (drive, sense) in [
            (Pair::new(0, 1), Pair::new(0, 1)),
            (Pair::new(0, 1), Pair::new(7, 8)),
            (Pair::new(3, 4), Pair::new(6, 7)),
        ] {
            let sum = |s: &Sensitivity| (0..s.regions()).map(|r| s.transfer_ohm(r, drive, sense)).sum::<f64>();
            let (a, b) = (sum(&cells), sum(&elements));
            assert!((a / b - 1.0).abs() < 1e-4, "{a} {b}");
        }
    }

    #[test]
    fn a_uniform_rise_adds_up_over_the_cells() {
        // A rise of the whole sheet by 1 + x: exact by a new solution.
        let model = coarse(Order::Quadratic);
        let mut solver = Solver::new(model.clone()).unwrap();
        let grid = CellGrid::new(model.geometry(), 5.0).unwrap();
        let s = Sensitivity::by_cell(&solver, &grid);
        let (drive, sense) = (Pair::new(0, 1), Pair::new(5, 6));
        let sum: f64 = (0..s.regions()).map(|r| s.transfer_ohm(r, drive, sense)).sum();
        let z = |solver: &mut Solver, x: f64| {
            let c = vec![[1.0 / (1.0 + x), 0.0, 1.0 / (1.0 + x)]; model.mesh().triangles.len()];
            solver.solve(&c).unwrap().transfer_ohm(drive, sense)
        };
        let difference = (z(&mut solver, 1e-3) - z(&mut solver, -1e-3)) / 2e-3;
        assert!((sum / difference - 1.0).abs() < 1e-4, "{sum} {difference}");
    }

    #[test]
    fn clipping_keeps_the_area() {
        let p = [[0.0, 0.0], [4.0, 1.0], [1.0, 3.0]];
        let (mut a, mut b) = (Polygon::EMPTY, Polygon::EMPTY);
        clip(&p, 0, 1.3, 1.0, &mut a);
        clip(&p, 0, 1.3, -1.0, &mut b);
        let area = |q: &[Point]| (1..q.len() - 1).map(|k| cross(q[0], q[k], q[k + 1])).sum::<f64>();
        assert!((area(a.points()) + area(b.points()) - cross(p[0], p[1], p[2])).abs() < 1e-12);
    }
}
