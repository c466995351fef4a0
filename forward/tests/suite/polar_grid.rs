//! Against a second discretisation that shares nothing with the first.

use crate::theory::polar::{COUNT, RADIUS_MM, polar};
use crate::theory::*;
use forward::{DiscTouch, ElectrodeMatrix, Sheet};
use std::f64::consts::TAU;

/// Limit of three grids, each twice as fine as the one before, assuming nothing about the order, and its uncertainty.
fn compare(name: &str, contact_mm: f64, inner: f64, inside: f64) {
    let grids = [32, 64, 128].map(|cells| polar(cells, contact_mm, inner, inside));
    // Electrodes are a quarter of the pitch.
    let sheet = Sheet::disc(2.0 * RADIUS_MM, COUNT, TAU * RADIUS_MM / 64.0, contact_mm, 1000.0);
    let mut solver = solved(&sheet, 1e-4);
    let z = if inner > 0.0 {
        let touch = DiscTouch {
            centre_mm: [0.0, 0.0],
            radius_mm: inner * RADIUS_MM,
            rise: 1.0 / inside - 1.0,
        };
        solver.solve_touches(&[touch]).unwrap()
    } else {
        solver.electrode_matrix()
    };
    let mut most = (0.0_f64, 0.0_f64);
    for sense in 2..15 {
        let at = |m: &ElectrodeMatrix| {
            let (a, b) = (m.potentials_ohm(), (sense + 1) % COUNT);
            a[(sense, 0)] - a[(sense, 1)] - a[(b, 0)] + a[(b, 1)]
        };
        let [coarse, middle, fine] = grids.each_ref().map(at);
        let (first, second) = (middle - coarse, fine - middle);
        // Aitken's extrapolation; what it adds is its uncertainty.
        let limit = fine - second * second / (second - first);
        let uncertainty = (limit - fine).abs() / limit.abs();
        let error = (at(z) / limit - 1.0).abs();
        assert!(uncertainty < 0.02, "{sense}: {uncertainty}");
        assert!(error < uncertainty + 1e-5, "{sense}: {error} of {uncertainty}");
        most = (most.0.max(error), most.1.max(uncertainty));
    }
    println!(
        "polar grid, {name}: difference {:.1e}, finest grid to its limit {:.1e}",
        most.0, most.1
    );
}

#[test]
fn a_polar_grid_agrees() {
    for contact_mm in [0.1, 1.0, 10.0] {
        compare(&format!("contact {contact_mm} mm"), contact_mm, 0.0, 1.0);
    }
}

#[test]
fn a_polar_grid_agrees_on_an_inclusion() {
    for inside in [0.1, 5.0] {
        compare(&format!("inclusion of conductance {inside}"), 1.0, 0.5, inside);
    }
}
