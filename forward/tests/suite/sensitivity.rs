//! The sensitivity by cell is the slope of the nonlinear model.

use crate::theory::*;
use forward::field::conductivity_of_discs;
use forward::{CellGrid, DiscTouch, Drive, Model, ModelOptions, Order, Pattern, Sensitivity, Sheet, Solver, Tensor};
use std::sync::Arc;

const DRIVES: [Drive; 2] = [Drive::PAPER, Drive::Current { amplitude_a: 1e-3 }];

/// Share of a triangle that lies in a square, by clipping.
fn share(triangle: [[f64; 2]; 3], low: [f64; 2], size: f64) -> f64 {
    let area = |p: &[[f64; 2]]| -> f64 {
        let next = p.iter().cycle().skip(1);
        p.iter().zip(next).map(|(a, b)| 0.5 * (a[0] * b[1] - b[0] * a[1])).sum()
    };
    let mut polygon = triangle.to_vec();
    for (axis, limit, sign) in [
        (0, low[0], 1.0),
        (0, low[0] + size, -1.0),
        (1, low[1], 1.0),
        (1, low[1] + size, -1.0),
    ] {
        let mut out: Vec<[f64; 2]> = Vec::new();
        for k in 0..polygon.len() {
            let (a, b) = (polygon[k], polygon[(k + 1) % polygon.len()]);
            let (x, y) = (sign * (a[axis] - limit), sign * (b[axis] - limit));
            if x >= 0.0 {
                out.push(a);
            }
            if x * y < 0.0 {
                let t = x / (x - y);
                out.push([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]);
            }
        }
        polygon = out;
    }
    area(&polygon) / area(&triangle)
}

/// Change of a frame for a small rise of some elements, per unit of rise, by central differences; with a background.
fn slope(solver: &mut Solver, background: &[Tensor], shares: &[f64], drive: Drive, pattern: &Pattern) -> Vec<f64> {
    const STEP: f64 = 1e-3;
    let mut frame = |x: f64| {
        let c: Vec<Tensor> = background
            .iter()
            .zip(shares)
            .map(|(c, s)| c.map(|v| v * (1.0 - s + s / (1.0 + x))))
            .collect();
        let z = solver.solve(&c).unwrap().clone();
        drive.frame_v(&z, pattern)
    };
    let (up, down) = (frame(STEP), frame(-STEP));
    up.iter().zip(&down).map(|(a, b)| (a - b) / (2.0 * STEP)).collect()
}

/// Linear elements have even gradients: a part of an element counts by its area, and the slope is exact but for the step.
#[test]
fn by_cell_is_the_slope() {
    let options = ModelOptions {
        accuracy: 1e-2,
        order: Order::Linear,
        ..ModelOptions::default()
    };
    let model = Arc::new(Model::new(&Sheet::paper(), &options).unwrap());
    let pattern = Pattern::adjacent(16).unwrap();
    let grid = CellGrid::new(model.geometry(), 5.0).unwrap();
    let touch = [DiscTouch {
        centre_mm: [30.0, 20.0],
        radius_mm: 12.5,
        rise: 1.0,
    }];
    for background in [
        vec![[1.0, 0.0, 1.0]; model.mesh().triangles.len()],
        conductivity_of_discs(model.mesh(), &touch),
    ] {
        let mut solver = Solver::new(model.clone()).unwrap();
        solver.solve(&background).unwrap();
        let z = solver.electrode_matrix().clone();
        let s = Sensitivity::by_cell(&solver, &grid);
        for drive in DRIVES {
            let matrix = s.matrix_v(drive, &z, &pattern);
            // The middle, under the touch, between, near the rim; cells whose square is all on the sheet.
            for place in [[2.5, 2.5], [32.5, 22.5], [-42.5, 57.5], [82.5, -32.5]] {
                let cell = (0..grid.len()).find(|c| grid.centre(*c) == place).unwrap();
                let low = place.map(|x| x - 2.5);
                let shares: Vec<f64> = (0..background.len())
                    .map(|e| share(model.mesh().corners(e), low, 5.0))
                    .collect();
                let expected = slope(&mut solver, &background, &shares, drive, &pattern);
                let scale = matrix.column(cell).amax();
                for (row, v) in expected.iter().enumerate() {
                    let off = (matrix[(row, cell)] - v).abs();
                    assert!(off < 1e-5 * scale, "{place:?} {row}: {off} of {scale}");
                }
            }
        }
    }
}

/// The cells' sum over a disc is the slope by the disc's rise, on a mesh fitted to it.
#[test]
fn cells_add_up_to_the_slope_by_a_touch() {
    let pattern = Pattern::adjacent(16).unwrap();
    let touch = |rise| {
        [DiscTouch {
            centre_mm: [25.0, -35.0],
            radius_mm: 30.0,
            rise,
        }]
    };
    let mut solver = solved(&Sheet::paper(), 1e-3);
    let grid = CellGrid::new(solver.model().geometry(), 1.0).unwrap();
    let s = Sensitivity::by_cell(&solver, &grid);
    for drive in DRIVES {
        let matrix = s.matrix_v(drive, solver.electrode_matrix(), &pattern);
        let inside: Vec<usize> = (0..grid.len())
            .filter(|c| {
                let p = grid.centre(*c);
                (p[0] - 25.0).hypot(p[1] + 35.0) < 30.0
            })
            .collect();
        let mut frame = |rise| {
            let z = solver.solve_touches(&touch(rise)).unwrap();
            drive.frame_v(z, &pattern)
        };
        let (up, down) = (frame(1e-3), frame(-1e-3));
        let mut scale: f64 = 0.0;
        let mut most: f64 = 0.0;
        for row in 0..pattern.len() {
            let expected = (up[row] - down[row]) / 2e-3;
            let sum: f64 = inside.iter().map(|c| matrix[(row, *c)]).sum();
            scale = scale.max(expected.abs());
            most = most.max((expected - sum).abs());
        }
        println!("cells of 1 mm over a touch of 60 mm: {:.1e}", most / scale);
        // A rim of cells is half in, half out: their areas cancel to about the root of their number, 1e-3 of the disc's.
        assert!(most < 3e-3 * scale, "{most} {scale}");
        solver.solve_touches(&[]).unwrap();
    }
}
