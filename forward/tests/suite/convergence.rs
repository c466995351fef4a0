//! How fast the error falls with the mesh, as theory has it.
//!
//! A voltage is a product of two fields, so its error is that of one times that of the other in the energy norm.
//!
//! Gap electrodes: the field of a drive is `r log r` at its own electrodes' ends and smooth elsewhere. A four-terminal
//! voltage never has both fields singular at one place; it converges with h^(2p), or N^-p in the number of nodes N.
//!
//! Perfect contacts: the field is the root of r at the ends, and a pair's own resistance has it squared: h, or N^(-1/2),
//! on a uniform mesh whatever the elements' degree p. A mesh graded towards the ends gets N^-p back.

use crate::theory::*;
use forward::{MeshSizes, Model, Order, Sheet, Solver};
use std::f64::consts::FRAC_PI_4;
use std::sync::Arc;

/// Order in the number of nodes, from the coarsest to the finest mesh.
fn order(name: &str, sheet: &Sheet, order: Order, meshes: &[MeshSizes], error: impl Fn(&Solver) -> f64) -> f64 {
    let points: Vec<(f64, f64)> = meshes
        .iter()
        .map(|sizes| {
            let model = Model::with_sizes(sheet, sizes, order).unwrap();
            let nodes = model.mesh().nodes.len() as f64;
            (nodes, error(&Solver::new(Arc::new(model)).unwrap()))
        })
        .collect();
    let (first, last) = (points[0], points[points.len() - 1]);
    let slope = -(last.1 / first.1).ln() / (last.0 / first.0).ln();
    let errors: Vec<String> = points.iter().map(|(n, e)| format!("{e:.1e} ({n} nodes)")).collect();
    println!("{name}, {order:?}: order {slope:.2} in N; {}", errors.join(", "));
    slope
}

fn uniform(h: f64) -> MeshSizes {
    MeshSizes {
        largest_mm: h,
        electrode_fraction: 1.0,
        electrode_most_mm: h,
        growth: 1.0,
        circles: Vec::new(),
    }
}

/// Halving the growth halves every edge but those at the ends, which become 2^(2p) times shorter: the error they leave is
/// in proportion to their length.
fn graded(k: i32, degree: i32) -> MeshSizes {
    let s = 0.5_f64.powi(k);
    MeshSizes {
        largest_mm: 24.0 * s,
        electrode_fraction: 0.02 * s.powi(2 * degree),
        electrode_most_mm: 10.0,
        growth: s,
        circles: Vec::new(),
    }
}

const DEGREES: [(Order, i32); 2] = [(Order::Linear, 1), (Order::Quadratic, 2)];

#[test]
fn transfer_impedances_have_the_order_of_the_elements() {
    let half_angle = 0.12;
    // The gap model to 1e-7.
    let sheet = disc(16, half_angle, 1e7);
    let series = gap_matrix(16, half_angle, 0.0, 1.0, 1000.0);
    for (elements, degree) in DEGREES {
        let meshes = [8.0, 4.0, 2.0].map(uniform);
        let slope = order("gap electrodes, uniform", &sheet, elements, &meshes, |s| {
            worst_of_largest(s.electrode_matrix(), &series)
        });
        assert!(slope > f64::from(degree) - 0.25, "{slope}");
    }
}

#[test]
fn perfect_contacts_limit_a_uniform_mesh_and_not_a_graded_one() {
    let contact = 1e-8 * 97.5;
    let sheet = disc(2, FRAC_PI_4, contact);
    let exact = 1000.0 * (1.0 + 2.0 * contact / (97.5 * 2.0 * FRAC_PI_4));
    let error = |s: &Solver| (own(s.electrode_matrix(), 0, 1) / exact - 1.0).abs();
    for (elements, degree) in DEGREES {
        let meshes = [12.0, 6.0, 3.0].map(uniform);
        let slope = order("perfect contacts, uniform", &sheet, elements, &meshes, error);
        assert!((slope - 0.5).abs() < 0.15, "{slope}");
        let meshes: Vec<MeshSizes> = (0..4).map(|k| graded(k, degree)).collect();
        let slope = order("perfect contacts, graded", &sheet, elements, &meshes, error);
        assert!(slope > f64::from(degree) - 0.3, "{slope}");
    }
}
