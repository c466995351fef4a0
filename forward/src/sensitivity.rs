//! How every measurement answers to a small rise in resistivity: the adjoint formula, by element or by cell.
//!
//! With u_m the potential of drive pair m for a unit current, the relative rise x of a region changes the transfer
//! impedance by `dZ[m,n]/dx = + integral over the region of sigma grad u_m . grad u_n` (Geselowitz 1971; the paper's
//! eq. 3 signed for resistivity). For a voltage drive the current changes as well:
//! `dV[m,n] = U0 (dZ[m,n] / D_m - Z[m,n] dZ[m,m] / D_m^2)`, `D_m = Z[m,m] + 2 R_on`.

use crate::cells::CellGrid;
use crate::curve::{Point, cross};
use crate::element::{DEGREE_2, DEGREE_4, gradients, position};
use crate::impedance::{Drive, ElectrodeMatrix};
use crate::mesh::{Mesh, Order};
use crate::model::Solver;
use crate::pattern::{Pair, Pattern};
use nalgebra::DMatrix;

/// For every region the matrix of `integral of sigma grad phi_l . grad phi_k`, ohm per unit of relative rise, with phi_l
/// the potential for 1 A into electrode l. All sensitivities are differences of its entries.
#[derive(Clone, Debug)]
pub struct Sensitivity {
    electrodes: usize,
    regions: usize,
    /// Row-major electrode by electrode matrices, one after the other; symmetric.
    gram: Vec<f64>,
}

/// Weighted gradients of all electrodes' potentials at one point.
struct Sampler<'a> {
    mesh: &'a Mesh,
    electrodes: usize,
    /// Node by node the potentials of all electrodes, V.
    potentials: Vec<f64>,
    gradient_x: Vec<f64>,
    gradient_y: Vec<f64>,
}

impl Sampler<'_> {
    /// Adds `weight * sigma * grad . grad` at barycentric `l`; `weight` is the share of the straight triangle's area.
    fn add(&mut self, element: usize, l: [f64; 3], share: f64, sigma: [f64; 3], gram: &mut [f64]) {
        let n = self.electrodes;
        let (g, _, det) = gradients(self.mesh, element, l);
        let w = share * 0.5 * det;
        self.gradient_x.fill(0.0);
        self.gradient_y.fill(0.0);
        for (node, g) in self.mesh.element_nodes(element).zip(&g) {
            let u = &self.potentials[node * n..(node + 1) * n];
            for (x, v) in self.gradient_x.iter_mut().zip(u) {
                *x += g[0] * v;
            }
            for (y, v) in self.gradient_y.iter_mut().zip(u) {
                *y += g[1] * v;
            }
        }
        let [xx, xy, yy] = sigma.map(|s| s * w);
        for i in 0..n {
            let (gx, gy) = (self.gradient_x[i], self.gradient_y[i]);
            let (jx, jy) = (xx * gx + xy * gy, xy * gx + yy * gy);
            let row = &mut gram[i * n..i * n + n];
            for ((out, x), y) in row
                .iter_mut()
                .zip(&self.gradient_x)
                .zip(&self.gradient_y)
                .take(i + 1)
            {
                *out += jx * x + jy * y;
            }
        }
    }
}

impl Sensitivity {
    /// One region for every element of the mesh.
    pub fn by_element(solver: &Solver) -> Self {
        let elements = solver.model().mesh().triangles.len();
        Self::integrate(solver, elements, |element, add| {
            // The gradients' product is of degree 2 on straight elements.
            let rule: &[_] = if solver.model().mesh().curved[element] {
                &DEGREE_4
            } else {
                &DEGREE_2
            };
            for (l, w) in rule {
                add(element, *l, *w);
            }
        })
    }

    /// One region for every cell of a grid.
    pub fn by_cell(solver: &Solver, grid: &CellGrid) -> Self {
        let mesh = solver.model().mesh();
        Self::integrate(solver, grid.len(), |element, add| {
            fragments(mesh, element, grid, |cell, l, share| add(cell, l, share));
        })
    }

    fn integrate(
        solver: &Solver,
        regions: usize,
        mut points: impl FnMut(usize, &mut dyn FnMut(usize, [f64; 3], f64)),
    ) -> Self {
        let model = solver.model();
        let n = model.electrodes();
        let potentials = solver.potentials_v();
        let mut sampler = Sampler {
            mesh: model.mesh(),
            electrodes: n,
            potentials: potentials.transpose().as_slice().to_vec(),
            gradient_x: vec![0.0; n],
            gradient_y: vec![0.0; n],
        };
        let conductance = 1.0 / model.sheet().sheet_resistance_ohm;
        let mut gram = vec![0.0; regions * n * n];
        for (element, tensor) in solver.conductivity().iter().enumerate() {
            let sigma = tensor.map(|s| s * conductance);
            points(element, &mut |region, l, share| {
                let out = &mut gram[region * n * n..(region + 1) * n * n];
                sampler.add(element, l, share, sigma, out);
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
    pub fn matrix_v(
        &self,
        drive: Drive,
        sheet: &ElectrodeMatrix,
        pattern: &Pattern,
    ) -> DMatrix<f64> {
        let mut out = DMatrix::zeros(pattern.len(), self.regions);
        for (row, m) in pattern.measurements().iter().enumerate() {
            let z = sheet.transfer_ohm(m.drive, m.sense);
            let own = sheet.transfer_ohm(m.drive, m.drive);
            let current = drive.current_a(own);
            // d current / d own resistance, over the current.
            let slope = match drive {
                Drive::Voltage { switch_ohm, .. } => -1.0 / (own + 2.0 * switch_ohm),
                Drive::Current { .. } => 0.0,
            };
            for region in 0..self.regions {
                let mut dv = self.transfer_ohm(region, m.drive, m.sense);
                if slope != 0.0 {
                    dv += z * slope * self.transfer_ohm(region, m.drive, m.drive);
                }
                out[(row, region)] = current * dv;
            }
        }
        out
    }
}

/// Quadrature points of an element, each with the cell it lies in: calls `add(cell, barycentric, share of the area)`.
fn fragments(
    mesh: &Mesh,
    element: usize,
    grid: &CellGrid,
    mut add: impl FnMut(usize, [f64; 3], f64),
) {
    let corners = mesh.corners(element);
    let low = grid.low_mm();
    let h = grid.cell_mm();
    let square = |p: Point| {
        (
            ((p[0] - low[0]) / h).floor() as i64,
            ((p[1] - low[1]) / h).floor() as i64,
        )
    };
    let squares = corners.map(square);
    let range = |f: fn(&(i64, i64)) -> i64| {
        let values = squares.iter().map(f);
        (
            values.clone().min().unwrap_or_default(),
            values.max().unwrap_or_default(),
        )
    };
    let (c0, c1) = range(|s| s.0);
    let (r0, r1) = range(|s| s.1);
    if c0 == c1 && r0 == r1 {
        let cell = grid.owner(c0, r0);
        let rule: &[_] = match (mesh.order, mesh.curved[element]) {
            (_, true) => &DEGREE_4,
            (Order::Quadratic, false) => &DEGREE_2,
            (Order::Linear, false) => &[([1.0 / 3.0; 3], 1.0)],
        };
        for (l, w) in rule {
            add(cell, *l, *w);
        }
        return;
    }
    let whole = cross(corners[0], corners[1], corners[2]);
    let barycentric = |p: Point| {
        let l1 = cross(corners[0], p, corners[2]) / whole;
        let l2 = cross(corners[0], corners[1], p) / whole;
        [1.0 - l1 - l2, l1, l2]
    };
    let mut strip = Vec::with_capacity(8);
    let mut piece = Vec::with_capacity(8);
    let mut spare = Vec::with_capacity(8);
    for row in r0..=r1 {
        let bottom = low[1] + row as f64 * h;
        clip(&corners, 1, bottom, 1.0, &mut spare);
        clip(&spare, 1, bottom + h, -1.0, &mut strip);
        for column in c0..=c1 {
            let left = low[0] + column as f64 * h;
            clip(&strip, 0, left, 1.0, &mut spare);
            clip(&spare, 0, left + h, -1.0, &mut piece);
            if piece.len() < 3 {
                continue;
            }
            let cell = grid.owner(column, row);
            for k in 1..piece.len() - 1 {
                let fan = [piece[0], piece[k], piece[k + 1]];
                let share = cross(fan[0], fan[1], fan[2]) / whole;
                if share <= 1e-14 {
                    continue;
                }
                for (l, w) in &DEGREE_2 {
                    add(cell, barycentric(position(fan, *l)), w * share);
                }
            }
        }
    }
}

/// The part of a convex polygon where `sign * (p[axis] - limit) >= 0` (Sutherland and Hodgman 1974).
fn clip(polygon: &[Point], axis: usize, limit: f64, sign: f64, out: &mut Vec<Point>) {
    out.clear();
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
    use crate::model::{Model, ModelOptions};
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
            let sum = |s: &Sensitivity| {
                (0..s.regions())
                    .map(|r| s.transfer_ohm(r, drive, sense))
                    .sum::<f64>()
            };
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
        let sum: f64 = (0..s.regions())
            .map(|r| s.transfer_ohm(r, drive, sense))
            .sum();
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
        let (mut a, mut b) = (Vec::new(), Vec::new());
        clip(&p, 0, 1.3, 1.0, &mut a);
        clip(&p, 0, 1.3, -1.0, &mut b);
        let area = |q: &[Point]| {
            (1..q.len() - 1)
                .map(|k| cross(q[0], q[k], q[k + 1]))
                .sum::<f64>()
        };
        assert!((area(&a) + area(&b) - cross(p[0], p[1], p[2])).abs() < 1e-12);
    }
}
