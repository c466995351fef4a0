//! What every sheet obeys: currents, reciprocity, the maximum principle, scale, the theorem of van der Pauw.

use crate::theory::*;
use forward::field::conductivity_of_discs;
use forward::mesh::ContactEdge;
use forward::{DiscTouch, Mesh, Model, ModelOptions, Outline, Pair, Pattern, Sheet, Solver};
use std::sync::Arc;

const TOUCHES: [DiscTouch; 2] = [
    DiscTouch {
        centre_mm: [40.0, -20.0],
        radius_mm: 12.5,
        rise: 3.0,
    },
    DiscTouch {
        centre_mm: [-50.0, 45.0],
        radius_mm: 8.0,
        rise: 0.2,
    },
];

/// Length of a contact edge and the mean along it of what lives on its nodes, by Simpson's rule on 64 stretches.
fn along(mesh: &Mesh, edge: &ContactEdge, value: impl Fn(usize) -> f64) -> (f64, f64) {
    let [a, b] = edge.ends;
    let m = edge.middle.unwrap();
    let shape = |t: f64| [(1.0 - t) * (1.0 - 2.0 * t), 4.0 * t * (1.0 - t), t * (2.0 * t - 1.0)];
    let slope = |t: f64| [4.0 * t - 3.0, 4.0 - 8.0 * t, 4.0 * t - 1.0];
    let mix = |w: [f64; 3], f: &dyn Fn(usize) -> f64| w[0] * f(a) + w[1] * f(m) + w[2] * f(b);
    let (mut length, mut sum) = (0.0, 0.0);
    for k in 0..=128 {
        let t = f64::from(k) / 128.0;
        let w = if k == 0 || k == 128 {
            1.0
        } else {
            2.0 + 2.0 * f64::from(k % 2)
        } / 384.0;
        let speed = mix(slope(t), &|n| mesh.nodes[n][0]).hypot(mix(slope(t), &|n| mesh.nodes[n][1]));
        length += w * speed;
        sum += w * speed * mix(shape(t), &value);
    }
    (length, sum)
}

#[test]
fn all_currents_sum_to_zero_with_the_grounded_electrodes_own() {
    let sheet = Sheet::paper();
    let mut solver = solved(&sheet, 1e-3);
    for touches in [&TOUCHES[..0], &TOUCHES] {
        solver.solve_touches(touches).unwrap();
        let potentials = solver.potentials_v();
        let z = solver.electrode_matrix();
        for drive in 0..15 {
            let mut sum = 0.0;
            for l in 0..16 {
                let electrode_v = z.potentials_ohm()[(l, drive)];
                // Integral of (U - u) / z over the contact, z = contact_mm times the sheet resistance.
                let current: f64 = solver.mesh().contacts[l]
                    .iter()
                    .map(|edge| {
                        let (length, integral) = along(solver.mesh(), edge, |n| potentials[(n, drive)]);
                        (electrode_v * length - integral) / 1000.0
                    })
                    .sum();
                let expected = if l == drive { 1.0 } else { 0.0 } - if l == 15 { 1.0 } else { 0.0 };
                assert!((current - expected).abs() < 1e-7, "{drive} {l}: {current}");
                sum += current;
            }
            assert!(sum.abs() < 1e-7, "{drive}: {sum}");
        }
    }
}

#[test]
fn drive_and_sense_can_be_exchanged() {
    let mut solver = solved(&Sheet::paper(), 1e-3);
    let pattern = Pattern::adjacent(16).unwrap();
    for touches in [&TOUCHES[..0], &TOUCHES[..1], &TOUCHES] {
        let z = solver.solve_touches(touches).unwrap();
        for m in pattern.measurements() {
            let (a, b) = (z.transfer_ohm(m.drive, m.sense), z.transfer_ohm(m.sense, m.drive));
            assert!((a / b - 1.0).abs() < 1e-10, "{m:?}");
        }
    }
}

#[test]
fn no_potential_is_beyond_the_driven_electrodes() {
    let mut solver = solved(&Sheet::paper(), 1e-3);
    for touches in [&TOUCHES[..0], &TOUCHES] {
        solver.solve_touches(touches).unwrap();
        let (u, z) = (
            solver.potentials_v(),
            solver.electrode_matrix().potentials_ohm().clone(),
        );
        for (plus, minus) in [(0, 1), (3, 11), (7, 8)] {
            let electrode = |l: usize| z[(l, plus)] - z[(l, minus)];
            let (high, low) = (electrode(plus), electrode(minus));
            for node in 0..u.nrows() {
                let v = u[(node, plus)] - u[(node, minus)];
                assert!(v < high && v > low, "{node}: {v} not in {low} .. {high}");
            }
            for l in (0..16).filter(|l| *l != plus && *l != minus) {
                assert!(electrode(l) < high && electrode(l) > low);
            }
        }
    }
}

#[test]
fn more_resistivity_anywhere_raises_every_own_resistance() {
    let mut solver = solved(&Sheet::paper(), 1e-3);
    let before = solver.electrode_matrix().clone();
    let c = conductivity_of_discs(solver.model().mesh(), &TOUCHES);
    let after = solver.solve(&c).unwrap();
    for a in 0..16 {
        for b in 0..a {
            assert!(own(after, a, b) > own(&before, a, b));
        }
    }
}

/// Only ratios of lengths matter.
#[test]
fn a_sheet_of_any_size_behaves_the_same() {
    let paper = solved(&Sheet::paper(), 1e-3);
    for diameter in [1.0, 12.0, 10_000.0] {
        let s = diameter / 195.0;
        let solver = solved(&Sheet::disc(diameter, 16, 10.0 * s, s, 1000.0), 1e-3);
        let error = worst(solver.electrode_matrix(), paper.electrode_matrix());
        println!("disc of {diameter} mm against 195 mm: {error:.2e}");
        assert!(error < 1e-3, "{diameter}: {error}");
    }
    let doubled = solved(&Sheet::disc(195.0, 16, 10.0, 1.0, 2000.0), 1e-3);
    for (a, b) in [(0, 1), (2, 9)] {
        let ratio = own(doubled.electrode_matrix(), a, b) / own(paper.electrode_matrix(), a, b);
        assert!((ratio - 2.0).abs() < 1e-12);
    }
}

/// van der Pauw (1958): four point contacts on the rim of any sheet without holes, `exp(-pi A) + exp(-pi B) = 1` with A and
/// B the transfer impedances of neighbouring pairs over the sheet resistance.
fn van_der_pauw(name: &str, outline: Outline, perimeter: f64, at: [f64; 4]) -> f64 {
    let width = 2e-4 * perimeter;
    let electrodes = at.map(|a| at_arc(a * perimeter, width, 0.1 * width)).to_vec();
    let solver: Solver = solved(&sheet(outline, electrodes), 1e-4);
    let z = solver.electrode_matrix();
    let r = |a, b, c, d| z.transfer_ohm(Pair::new(a, b), Pair::new(d, c)) / 1000.0;
    let sum = |x: f64, y: f64| (-std::f64::consts::PI * x).exp() + (-std::f64::consts::PI * y).exp();
    let error = (sum(r(0, 1, 2, 3), r(1, 2, 3, 0)) - 1.0).abs();
    println!("van der Pauw, {name}: {error:.2e}");
    error
}

#[test]
fn outlines_of_any_shape_obey_van_der_pauw() {
    let rectangle = Outline::Rectangle {
        width_mm: 120.0,
        height_mm: 40.0,
        centre_mm: [3.0, -7.0],
    };
    assert!(van_der_pauw("rectangle", rectangle, 320.0, [0.1, 0.3, 0.63, 0.9]) < 1e-3);
    let l_shape = Outline::Polygon {
        points_mm: vec![
            [0.0, 0.0],
            [200.0, 0.0],
            [200.0, 100.0],
            [100.0, 100.0],
            [100.0, 200.0],
            [0.0, 200.0],
        ],
    };
    assert!(van_der_pauw("L", l_shape, 800.0, [0.06, 0.31, 0.45, 0.8]) < 1e-3);
    let sharp = Outline::Polygon {
        points_mm: vec![[0.0, 0.0], [100.0, 10.0], [0.0, 60.0]],
    };
    let perimeter = 100.0_f64.hypot(10.0) + 100.0_f64.hypot(50.0) + 60.0;
    assert!(van_der_pauw("triangle", sharp, perimeter, [0.1, 0.37, 0.5, 0.9]) < 1e-3);
    let smooth = Outline::Smooth {
        points_mm: vec![[0.0, 0.0], [90.0, -10.0], [110.0, 40.0], [60.0, 35.0], [10.0, 50.0]],
    };
    assert!(van_der_pauw("smooth", smooth, 300.0, [0.02, 0.3, 0.55, 0.8]) < 1e-3);
    let disc = Outline::Disc {
        diameter_mm: 50.0,
        centre_mm: [100.0, 0.0],
    };
    assert!(van_der_pauw("disc", disc, 50.0 * std::f64::consts::PI, [0.0, 0.1, 0.45, 0.7]) < 1e-3);
}

/// The untouched sheet on the mesh that touches moved differs from that on the mesh before by the meshes' own error, and the
/// change that touches make is the same on both to that error's part of it.
#[test]
fn the_untouched_sheet_is_the_same_on_a_mesh_that_touches_moved() {
    let model = Arc::new(Model::new(&Sheet::paper(), &ModelOptions::default()).unwrap());
    let mut solver = Solver::new(model).unwrap();
    let before = solver.electrode_matrix().potentials_ohm().clone();
    let mut touch = DiscTouch {
        centre_mm: [31.0, -17.0],
        radius_mm: 12.5,
        rise: 3.0,
    };
    // The second needs a mesh of its own.
    for centre in [[31.0, -17.0], [91.3, 3.1]] {
        touch.centre_mm = centre;
        let touched = solver.solve_touches(&[touch]).unwrap().potentials_ohm().clone();
        let untouched = solver.solve_untouched_there().unwrap().potentials_ohm().clone();
        let scale = before.amax();
        assert!((&untouched - &before).amax() < 1e-3 * scale);
        assert!((&touched - &untouched).amax() > 1e-2 * scale);
        assert!(solver.conductivity().iter().all(|c| *c == forward::field::UNPRESSED));
        // The touches are forgotten: the same again is solved again.
        let again = solver.solve_touches(&[touch]).unwrap().potentials_ohm().clone();
        assert!((&again - &touched).amax() < 1e-12 * scale);
    }
}
