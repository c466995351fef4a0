//! The disc against its series solutions.

use crate::theory::*;
use forward::field::conductivity_of_discs;
use forward::{DiscTouch, ForwardError, Model, ModelOptions, Pair, Sheet, Solver};
use std::f64::consts::{FRAC_PI_4, PI};
use std::sync::Arc;

#[test]
fn homogeneous_disc_with_gap_electrodes() {
    for accuracy in [1e-3, 1e-4] {
        for (count, half_angle) in [(16, 10.0 / 195.0), (16, PI / 20.0), (8, 0.2), (32, 0.03)] {
            let solver = solved(&disc(count, half_angle, GAP_CONTACT_MM), accuracy);
            let series = gap_matrix(count, half_angle, 0.0, 1.0, 1000.0);
            let error = worst(solver.electrode_matrix(), &series);
            println!("gap electrodes, {count} of half angle {half_angle:.3}, accuracy {accuracy:e}: {error:.2e}");
            assert!(error < accuracy, "{count} {half_angle}: {error}");
        }
    }
}

/// Contrasts from 1e-6 to 1e6, inclusions from a tenth to nine tenths of the radius. (A good conductor near the rim shorts
/// even the nearest voltages; what is left of them wants a finer mesh.)
#[test]
fn concentric_inclusion() {
    let half_angle = 10.0 / 195.0;
    for ratio in [0.1, 0.5, 0.9] {
        for exponent in [-6, -3, -1, 1, 3, 6] {
            let inside = 10.0_f64.powi(exponent);
            let touch = [DiscTouch {
                centre_mm: [0.0, 0.0],
                radius_mm: 97.5 * ratio,
                rise: 1.0 / inside - 1.0,
            }];
            let series = gap_matrix(16, half_angle, ratio, inside, 1000.0);
            let sheet = disc(16, half_angle, GAP_CONTACT_MM);
            let shorted = ratio > 0.8 && exponent > 0;
            let options = ModelOptions {
                accuracy: if shorted { 1e-4 } else { 1e-3 },
                ..ModelOptions::for_touches(&touch)
            };
            let own = Arc::new(Model::new(&sheet, &options).unwrap());
            let mut solver = Solver::new(own.clone()).unwrap();
            let z = match solver.solve(&conductivity_of_discs(own.mesh(), &touch)) {
                Ok(z) => z,
                // Contacts worth 1e5 mm around a ring short-circuited a million times over: what is left of the voltages is
                // beyond double precision, and the solver says so.
                Err(ForwardError::Precision { .. }) if ratio > 0.8 && exponent == 6 => continue,
                Err(e) => panic!("{ratio} {inside}: {e}"),
            };
            let own_error = worst(z, &series);
            let mut solver = solved(&sheet, options.accuracy);
            let fitted_error = worst(solver.solve_touches(&touch).unwrap(), &series);
            println!(
                "inclusion {ratio} R, conductance x 1e{exponent}: own mesh {own_error:.2e}, fitted {fitted_error:.2e}"
            );
            assert!(own_error < 1e-3, "{ratio} {inside}: {own_error}");
            assert!(fitted_error < 1e-3, "{ratio} {inside}: {fitted_error}");
        }
    }
}

/// As the width goes to 0 the series becomes `-(1/pi) ln(2 sin(angle / 2))` for a disc of 1 ohm per square.
#[test]
fn narrow_electrodes_are_points() {
    let point = |k: usize| -1000.0 / PI * (2.0 * (PI * k as f64 / 16.0).sin()).ln();
    let expected = |m: usize, n: usize| {
        let r = |i: usize, j: usize| point((i + 16 - j) % 16);
        r(n, m) - r(n + 1, m) - r(n, m + 1) + r(n + 1, m + 1)
    };
    let mut last = f64::INFINITY;
    for width in [8.0, 2.0, 0.5, 0.125] {
        let solver = solved(&Sheet::disc(195.0, 16, width, 0.1 * width, 1000.0), 3e-4);
        let z = solver.electrode_matrix();
        let mut error: f64 = 0.0;
        for n in 3..13 {
            let pair = (Pair::new(0, 1), Pair::new(n, n + 1));
            error = error.max((z.transfer_ohm(pair.0, pair.1) / expected(0, n) - 1.0).abs());
        }
        println!("point electrodes, width {width} mm: {error:.2e}");
        // With the square of the width, down to the mesh's own error.
        assert!(error < (last / 8.0).max(3e-4), "{width}: {error} {last}");
        last = error;
    }
}

#[test]
fn the_formula_for_opposite_arcs_has_its_limits() {
    // Quarter arcs are their own complement: one square.
    assert!((opposite_arcs(FRAC_PI_4) - 1.0).abs() < 1e-12);
    // The complement's resistance is the inverse.
    for a in [0.1, 0.5, 0.7] {
        assert!(
            (opposite_arcs(a) * opposite_arcs(2.0 * FRAC_PI_4 - a) - 1.0).abs() < 1e-9,
            "{a}"
        );
    }
    // Narrow arcs: two half-plane contacts of width 2 a on a disc, (2/pi) ln(4 / a).
    let a = 1e-4_f64;
    assert!((opposite_arcs(a) / (2.0 / PI * (4.0 / a).ln()) - 1.0).abs() < 1e-6);
}

#[test]
fn perfect_contacts_are_the_conformal_solution() {
    for half_angle in [0.02, 0.2, FRAC_PI_4, 1.2] {
        // The little contact that is left, in series: 1e-6 of the radius over the arc's length, twice.
        let contact = 1e-6 * 97.5;
        let solver = solved(&disc(2, half_angle, contact), 1e-4);
        let left = 1000.0 * 2.0 * contact / (2.0 * half_angle * 97.5);
        let expected = 1000.0 * opposite_arcs(half_angle) + left;
        let error = (own(solver.electrode_matrix(), 0, 1) / expected - 1.0).abs();
        println!("opposite arcs, half angle {half_angle:.3}: {error:.2e}");
        assert!(error < 1e-3, "{half_angle}: {error}");
    }
}

#[test]
fn a_turned_disc_gives_the_same() {
    // Every rotation by one electrode is a symmetry of the disc, not of the mesh.
    let solver = solved(&Sheet::paper(), 1e-3);
    let z = solver.electrode_matrix();
    for n in 3..14 {
        let at = |m: usize| {
            let pair = |k: usize| Pair::new((k + m) % 16, (k + m + 1) % 16);
            z.transfer_ohm(pair(0), pair(n))
        };
        let mean = (0..16).map(at).sum::<f64>() / 16.0;
        for m in 0..16 {
            assert!((at(m) / mean - 1.0).abs() < 1e-3, "{m} {n}");
        }
    }
}
