//! Multiple scattering against elements, and against laws that hold for any sheet.

use forward::scattering::Scattering;
use forward::{DiscTouch, Electrode, Model, ModelOptions, Outline, Place, Sheet, Solver};
use nalgebra::DMatrix;
use std::sync::Arc;

fn solver(sheet: &Sheet, accuracy: f64) -> Solver {
    let options = ModelOptions {
        accuracy,
        ..ModelOptions::default()
    };
    Solver::new(Arc::new(Model::new(sheet, &options).unwrap())).unwrap()
}

fn disc(x: f64, y: f64, radius_mm: f64, rise: f64) -> DiscTouch {
    DiscTouch {
        centre_mm: [x, y],
        radius_mm,
        rise,
    }
}

/// A rectangle of 200 by 120 mm with electrodes on two sides, and a round hole.
fn plate() -> Sheet {
    let at = |x: f64, y: f64| Electrode {
        place: Place::Point {
            point_mm: [x, y],
            width_mm: 10.0,
        },
        contact_mm: 1.0,
    };
    Sheet {
        sheet_resistance_ohm: 700.0,
        outline: Outline::Rectangle {
            width_mm: 200.0,
            height_mm: 120.0,
            centre_mm: [0.0, 0.0],
        },
        holes: vec![Outline::Disc {
            diameter_mm: 30.0,
            centre_mm: [40.0, 0.0],
        }],
        electrodes: [-75.0, -25.0, 25.0, 75.0]
            .iter()
            .flat_map(|x| [at(*x, -60.0), at(*x, 60.0)])
            .collect(),
    }
}

fn off(a: &DMatrix<f64>, b: &DMatrix<f64>) -> f64 {
    (a - b).norm() / b.norm()
}

/// What touches change by elements on one mesh, ohm.
fn by_elements(solver: &mut Solver, touches: &[DiscTouch]) -> DMatrix<f64> {
    let touched = solver.solve_touches(touches).unwrap().potentials_ohm().clone();
    touched - solver.solve_untouched_there().unwrap().potentials_ohm()
}

/// The difference of both is that of the elements, which their finer meshes lessen.
#[test]
fn discs_change_what_elements_say() {
    let scenes = [
        vec![disc(20.0, 5.0, 12.5, 0.2)],
        vec![disc(-40.0, 30.0, 12.0, 1.0), disc(-12.0, 30.0, 14.0, 3.0)],
        vec![
            disc(0.0, -60.0, 12.5, 0.5),
            disc(50.0, 40.0, 10.0, -0.5),
            disc(-50.0, -20.0, 15.0, 2.0),
            disc(-20.0, -20.0, 11.0, 0.3),
        ],
    ];
    let mut elements = solver(&Sheet::paper(), 1e-4);
    let scattering = Scattering::new(&elements).unwrap();
    for scene in &scenes {
        let change = scattering.discs(scene).unwrap().change_ohm;
        let off = off(&change, &by_elements(&mut elements, scene));
        assert!(off < 0.002, "{scene:?}: {off}");
    }
}

#[test]
fn a_rectangle_with_a_hole_is_a_sheet_like_any_other() {
    let mut elements = solver(&plate(), 1e-4);
    let scattering = Scattering::new(&elements).unwrap();
    for scene in [
        vec![disc(-60.0, 10.0, 12.5, 0.5)],
        // Beside the hole, and beside each other.
        vec![
            disc(5.0, 0.0, 12.5, 1.0),
            disc(-25.0, 5.0, 12.5, 1.0),
            disc(75.0, 10.0, 10.0, 2.0),
        ],
    ] {
        let change = scattering.discs(&scene).unwrap().change_ohm;
        let off = off(&change, &by_elements(&mut elements, &scene));
        assert!(off < 0.01, "{scene:?}: {off}");
    }
}

/// Reciprocity; more resistance everywhere is more resistance between any electrodes; and a tenth of a thousandth of a rise
/// changes what the first order says.
#[test]
fn the_change_is_symmetric_definite_and_linear_where_it_is_small() {
    let solver = solver(&Sheet::paper(), 1e-3);
    let scattering = Scattering::new(&solver).unwrap();
    let scene = |rise: f64| [disc(30.0, 20.0, 12.5, rise), disc(-5.0, 25.0, 14.0, rise)];
    let scattered = scattering.discs(&scene(1.0)).unwrap();
    let change = &scattered.change_ohm;
    assert!(off(change, &change.transpose()) < 1e-3);
    let least = (0.5 * (change + change.transpose())).symmetric_eigenvalues().min();
    assert!(least > -1e-6 * change.norm(), "{least}");

    let small = scattering.discs(&scene(1e-4)).unwrap();
    let pair = |a, b| forward::Pair { plus: a, minus: b };
    let linear = small.first_order.transfer_ohm(0, pair(1, 2), pair(3, 4));
    let of = |c: &DMatrix<f64>| (c[(3, 1)] - c[(3, 2)]) - (c[(4, 1)] - c[(4, 2)]);
    assert!((of(&small.change_ohm) / linear - 1.0).abs() < 1e-4);
    let nonlinear = of(change) / scattered.first_order.transfer_ohm(0, pair(1, 2), pair(3, 4));
    assert!((nonlinear - 1.0).abs() > 1e-3, "{nonlinear}");
}

#[test]
fn discs_that_reach_a_rim_or_each_other_are_not_described() {
    let scattering = Scattering::new(&solver(&plate(), 1e-3)).unwrap();
    assert!(scattering.discs(&[disc(0.0, 50.0, 12.5, 0.2)]).is_none(), "the outline");
    assert!(scattering.discs(&[disc(65.0, 0.0, 12.5, 0.2)]).is_none(), "the hole");
    assert!(
        scattering.discs(&[disc(40.0, 0.0, 5.0, 0.2)]).is_none(),
        "inside the hole"
    );
    let two = [disc(-60.0, 0.0, 12.5, 0.2), disc(-36.0, 0.0, 12.5, 0.2)];
    assert!(scattering.discs(&two).is_none(), "each other");
    let none = scattering.discs(&[]).unwrap();
    assert_eq!(none.change_ohm.amax(), 0.0);
}
