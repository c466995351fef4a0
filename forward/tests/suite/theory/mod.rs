//! Closed solutions to hold the program against, and what several tests need.
#![allow(dead_code, unreachable_pub, reason = "each user its own part")]

pub mod polar;

use forward::{Electrode, ElectrodeMatrix, Model, ModelOptions, Outline, Pair, Pattern, Place, Sheet, Solver};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// A contact so poor that the current spreads evenly over an electrode: the complete electrode model is then the gap model
/// up to the sheet's resistance over the contact's, here below 1e-5.
pub const GAP_CONTACT_MM: f64 = 1e5;

/// The solved unpressed sheet.
pub fn solved(sheet: &Sheet, accuracy: f64) -> Solver {
    let options = ModelOptions {
        accuracy,
        ..ModelOptions::default()
    };
    Solver::new(Arc::new(Model::new(sheet, &options).unwrap())).unwrap()
}

/// Homogeneous disc, gap electrodes, evenly spaced: potential of electrode i over that of the mean rim for 1 A into
/// electrode j, per ohm of sheet resistance, `(1/pi) sum over n of (1/n) sinc^2(n alpha) cos n(theta_i - theta_j)`; with a
/// concentric inclusion of relative radius `ratio` whose conductance is `inside` times that of the rest.
pub fn gap_disc(angle: f64, half_angle: f64, ratio: f64, inside: f64) -> f64 {
    if inside == 1.0 && angle != 0.0 && half_angle < 0.01 * angle.sin().abs().max((0.5 * angle).sin().abs()) {
        // Narrow: the point electrodes' -ln(2 sin(angle / 2)), averaged over both electrodes to second order.
        let s = (0.5 * angle).sin();
        return (-(2.0 * s.abs()).ln() + half_angle * half_angle / (12.0 * s * s)) / PI;
    }
    let mu = (1.0 - inside) / (1.0 + inside);
    let mut sum = 0.0;
    // The terms fall off with n^-3 / alpha^2 and change sign with the angle: the rest is below 1e-8 (2e-6 at angle 0).
    let last = (500.0 / half_angle) as usize;
    for n in 1..=last {
        let n = n as f64;
        let x = n * half_angle;
        let sinc = x.sin() / x;
        let mu_n = mu * ratio.powf(2.0 * n);
        sum += sinc * sinc / n * (n * angle).cos() * (1.0 + mu_n) / (1.0 - mu_n);
    }
    sum / PI
}

/// The matrix of [`gap_disc`] for `count` electrodes, ohm.
pub fn gap_matrix(count: usize, half_angle: f64, ratio: f64, inside: f64, sheet_ohm: f64) -> ElectrodeMatrix {
    let row: Vec<f64> = (0..count)
        .map(|k| sheet_ohm * gap_disc(TAU * k as f64 / count as f64, half_angle, ratio, inside))
        .collect();
    let m = nalgebra::DMatrix::from_fn(count, count, |i, j| row[(i + count - j) % count]);
    ElectrodeMatrix::from_potentials(m)
}

/// A homogeneous disc, diameter 195 mm, 1 kilohm per square, with electrodes of this half angle.
pub fn disc(count: usize, half_angle: f64, contact_mm: f64) -> Sheet {
    Sheet::disc(195.0, count, 195.0 * half_angle, contact_mm, 1000.0)
}

/// Largest relative difference over the adjacent pattern's transfer impedances.
pub fn worst(a: &ElectrodeMatrix, b: &ElectrodeMatrix) -> f64 {
    let pattern = Pattern::adjacent(a.electrodes()).unwrap();
    pattern
        .measurements()
        .iter()
        .map(|m| (a.transfer_ohm(m.drive, m.sense) / b.transfer_ohm(m.drive, m.sense) - 1.0).abs())
        .fold(0.0, |x, y| if y.is_nan() { f64::NAN } else { x.max(y) })
}

/// Largest difference over the adjacent pattern's transfer impedances, over the largest of them.
pub fn worst_of_largest(a: &ElectrodeMatrix, b: &ElectrodeMatrix) -> f64 {
    let pattern = Pattern::adjacent(a.electrodes()).unwrap();
    let (mut most, mut largest) = (0.0_f64, 0.0_f64);
    for m in pattern.measurements() {
        let (x, y) = (a.transfer_ohm(m.drive, m.sense), b.transfer_ohm(m.drive, m.sense));
        most = most.max((x - y).abs());
        largest = largest.max(y.abs());
    }
    most / largest
}

/// Complete elliptic integral of the first kind by the arithmetic-geometric mean, from the complementary modulus.
pub fn elliptic_k(complementary: f64) -> f64 {
    let (mut a, mut b) = (1.0_f64, complementary);
    while (a - b).abs() > 1e-15 * a {
        (a, b) = (0.5 * (a + b), (a * b).sqrt());
    }
    PI / (2.0 * a)
}

/// Resistance per ohm of sheet resistance between two opposite perfectly conducting arcs of a disc.
pub fn opposite_arcs(half_angle: f64) -> f64 {
    let k = (0.5 * half_angle).tan().powi(2);
    elliptic_k(k) / (2.0 * elliptic_k((1.0 - k * k).sqrt()))
}

/// An electrode on the outline by arc length.
pub fn at_arc(arc_mm: f64, width_mm: f64, contact_mm: f64) -> Electrode {
    Electrode {
        place: Place::Arc { arc_mm, width_mm },
        contact_mm,
    }
}

/// A sheet of 1 kilohm per square without holes.
pub fn sheet(outline: Outline, electrodes: Vec<Electrode>) -> Sheet {
    Sheet {
        sheet_resistance_ohm: 1000.0,
        outline,
        holes: Vec::new(),
        electrodes,
    }
}

/// A pair's own resistance, ohm.
pub fn own(z: &ElectrodeMatrix, a: usize, b: usize) -> f64 {
    z.transfer_ohm(Pair::new(a, b), Pair::new(a, b))
}
