//! The accuracy asked for is the accuracy got: random touches against a converged reference.

use crate::theory::*;
use forward::field::conductivity_of_discs;
use forward::{DiscTouch, Drive, Model, ModelOptions, Pattern, Sheet, Solver, Work};
use rand::{Rng, SeedableRng};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Largest relative error of a voltage-driven frame.
fn frame_error(a: &Solver, b: &Solver) -> f64 {
    let pattern = Pattern::adjacent(16).unwrap();
    let frame = |s: &Solver| Drive::PAPER.frame_v(s.electrode_matrix(), &pattern);
    let (x, y) = (frame(a), frame(b));
    x.iter().zip(y).map(|(x, y)| (x / y - 1.0).abs()).fold(0.0, f64::max)
}

fn made_for(options: &ModelOptions, touches: &[DiscTouch]) -> Solver {
    let model = Arc::new(Model::new(&Sheet::paper(), options).unwrap());
    let mut solver = Solver::new(model.clone()).unwrap();
    solver.solve(&conductivity_of_discs(model.mesh(), touches)).unwrap();
    solver
}

/// The reference resolves the touch's edge by elements of 0.5 mm that follow it.
fn reference(touches: &[DiscTouch]) -> Solver {
    let options = ModelOptions {
        accuracy: 1e-4,
        circles: touches.iter().map(|t| (t.centre_mm, t.radius_mm, 0.5)).collect(),
        ..ModelOptions::default()
    };
    made_for(&options, touches)
}

#[test]
fn untouched() {
    let error = frame_error(&solved(&Sheet::paper(), 1e-3), &solved(&Sheet::paper(), 1e-5));
    println!("untouched disc: {error:.1e}");
    assert!(error < 1e-3, "{error}");
}

/// Discs of 25 mm, +20 % and +300 %, at random anywhere on the sheet, one and two at a time.
#[test]
fn random_touches() {
    let mut random = rand::rngs::StdRng::seed_from_u64(20);
    let mut fitted = solved(&Sheet::paper(), 1e-3);
    for rise in [0.2, 3.0] {
        let (mut fitted_worst, mut own_worst) = (0.0_f64, 0.0_f64);
        for case in 0..10 {
            let count = 1 + case % 2;
            let mut touches: Vec<DiscTouch> = Vec::new();
            while touches.len() < count {
                let r = random.random_range(0.0_f64..1.0).sqrt() * 85.0;
                let angle = random.random_range(0.0..TAU);
                let centre_mm = [r * angle.cos(), r * angle.sin()];
                let apart = |t: &DiscTouch| (t.centre_mm[0] - centre_mm[0]).hypot(t.centre_mm[1] - centre_mm[1]);
                if touches.iter().all(|t| apart(t) > 30.0) {
                    touches.push(DiscTouch {
                        centre_mm,
                        radius_mm: 12.5,
                        rise,
                    });
                }
            }
            let reference = reference(&touches);
            fitted.solve_touches(&touches).unwrap();
            fitted_worst = fitted_worst.max(frame_error(&fitted, &reference));
            let own = made_for(&ModelOptions::for_touches(&touches), &touches);
            own_worst = own_worst.max(frame_error(&own, &reference));
        }
        println!("random touches of {rise:+}: fitted {fitted_worst:.1e}, own mesh {own_worst:.1e}");
        assert!(fitted_worst < 1e-3, "{rise}: {fitted_worst}");
        assert!(own_worst < 1e-3, "{rise}: {own_worst}");
    }
}

/// Beside the rim vertices cannot always be moved onto a touch's edge; a strong touch then gets a mesh of its own.
#[test]
fn strong_touches_at_the_rim() {
    let mut solver = solved(&Sheet::paper(), 1e-3);
    let mut own_mesh = 0;
    for centre_mm in [[-51.9433, -65.7968], [82.7724, 15.2093], [84.903, 1.4755], [30.0, 0.0]] {
        let touches = [DiscTouch {
            centre_mm,
            radius_mm: 12.5,
            rise: 3.0,
        }];
        solver.solve_touches(&touches).unwrap();
        own_mesh += usize::from(solver.work() == Work::OwnMesh);
        assert_eq!(solver.conductivity().len(), solver.mesh().triangles.len());
        assert_eq!(solver.potentials_v().nrows(), solver.mesh().nodes.len());
        let error = frame_error(&solver, &reference(&touches));
        assert!(error < 1e-3, "{centre_mm:?}: {error}");
        solver.solve_touches(&touches).unwrap();
        assert_eq!(solver.work(), Work::Nothing);
    }
    assert!(own_mesh > 0);
    // Back on the model's mesh all is as before.
    let elements = solver.model().mesh().triangles.len();
    solver.solve(&vec![[1.0, 0.0, 1.0]; elements]).unwrap();
    assert_eq!(solver.mesh().triangles.len(), elements);
    assert!(frame_error(&solver, &solved(&Sheet::paper(), 1e-3)) < 1e-12);
}

/// Where discs overlap, cross the rim or coincide there is still an answer, and it is near the reference.
#[test]
fn awkward_touches() {
    let disc = |x: f64, y: f64, radius_mm: f64| DiscTouch {
        centre_mm: [x, y],
        radius_mm,
        rise: 0.2,
    };
    let strong = |t: DiscTouch| DiscTouch { rise: 3.0, ..t };
    let cases = [
        ("overlapping", vec![disc(20.0, 0.0, 12.5), disc(38.0, 4.0, 12.5)]),
        ("concentric", vec![disc(-30.0, 10.0, 12.5), disc(-30.0, 10.0, 6.0)]),
        ("the same twice", vec![disc(-30.0, 10.0, 12.5), disc(-30.0, 10.0, 12.5)]),
        ("over the rim", vec![disc(95.0, 8.0, 12.5)]),
        ("beside the rim", vec![disc(0.0, 84.9, 12.5)]),
        ("tiny", vec![disc(12.0, 17.0, 0.3)]),
        ("huge", vec![disc(10.0, 0.0, 70.0)]),
        ("all of the sheet", vec![disc(0.0, 0.0, 200.0)]),
        ("none of it", vec![disc(300.0, 0.0, 20.0)]),
        ("strong over the rim", vec![strong(disc(95.0, 8.0, 12.5))]),
        (
            "strong, overlapping",
            vec![strong(disc(20.0, 0.0, 12.5)), strong(disc(38.0, 4.0, 12.5))],
        ),
    ];
    for (name, touches) in cases {
        let reference = reference(&touches);
        let mut fitted = solved(&Sheet::paper(), 1e-3);
        fitted.solve_touches(&touches).unwrap();
        let own = made_for(&ModelOptions::for_touches(&touches), &touches);
        let errors = (frame_error(&fitted, &reference), frame_error(&own, &reference));
        println!("{name}: fitted {:.1e}, own mesh {:.1e}", errors.0, errors.1);
        assert!(errors.0 < 1e-3 && errors.1 < 1e-3, "{name}: {errors:?}");
    }
}
