//! Far ends of every range: right by theory or by a finer mesh, or a clear error; never a silent NaN.

use crate::theory::*;
use forward::field::conductivity_of_discs;
use forward::{
    DiscTouch, Drive, Electrode, ForwardError, Model, ModelOptions, Outline, Pair, Pattern, Place, Sheet, Solver,
};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Contacts from a millionth to a million times the default, against a mesh for a tenth of the error.
#[test]
fn contacts() {
    for exponent in -6..=6 {
        let sheet = Sheet::disc(195.0, 16, 10.0, 10.0_f64.powi(exponent), 1000.0);
        let (z, finer) = (solved(&sheet, 1e-3), solved(&sheet, 1e-4));
        let error = worst(z.electrode_matrix(), finer.electrode_matrix());
        println!("contact 1e{exponent} mm: {error:.1e}");
        assert!(error < 1e-3, "1e{exponent}: {error}");
    }
}

/// One electrode's contact far from the others': a broken wire and a short.
#[test]
fn one_contact_unlike_the_others() {
    for contact in [1e-6, 1e6] {
        for which in [0, 15] {
            let mut sheet = Sheet::paper();
            sheet.electrodes[which].contact_mm = contact;
            let (z, finer) = (solved(&sheet, 1e-3), solved(&sheet, 1e-4));
            let error = worst(z.electrode_matrix(), finer.electrode_matrix());
            println!("contact {contact:e} mm at electrode {which} alone: {error:.1e}");
            assert!(error < 1e-3, "{contact} {which}: {error}");
        }
    }
}

/// A touch away from the centre, resistivity and conductivity up a million times, against a finer mesh of its own.
#[test]
fn contrasts() {
    for exponent in [-6, -3, 3, 6] {
        let touch = [DiscTouch {
            centre_mm: [40.0, 25.0],
            radius_mm: 12.5,
            rise: 10.0_f64.powi(exponent) - 1.0,
        }];
        let reference = ModelOptions {
            accuracy: 1e-4,
            ..ModelOptions::for_touches(&touch)
        };
        let model = Arc::new(Model::new(&Sheet::paper(), &reference).unwrap());
        let mut finer = Solver::new(model.clone()).unwrap();
        finer.solve(&conductivity_of_discs(model.mesh(), &touch)).unwrap();
        let mut solver = solved(&Sheet::paper(), 1e-3);
        let error = worst(solver.solve_touches(&touch).unwrap(), finer.electrode_matrix());
        println!("resistivity of a touch x 1e{exponent}: {error:.1e}");
        assert!(error < 1e-3, "1e{exponent}: {error}");
    }
}

/// The same with the contact that is assumed of real sheets, against a finer mesh.
#[test]
fn electrodes_narrow_and_wide_with_usual_contacts() {
    for share in [0.001, 0.01, 0.5, 0.9, 0.99] {
        let half_angle = share * PI / 16.0;
        let sheet = disc(16, half_angle, 1.0);
        let (usual, finer) = (solved(&sheet, 1e-3), solved(&sheet, 1e-4));
        let error = worst(usual.electrode_matrix(), finer.electrode_matrix());
        println!("electrodes of {share} of the pitch, contact 1 mm: {error:.1e}");
        assert!(error < 1e-3, "{share}: {error}");
    }
}

/// Electrodes from a thousandth to 99 % of the pitch, 8 to 64 of them, against the series.
#[test]
fn electrodes_narrow_and_wide_few_and_many() {
    for count in [8, 16, 32, 64] {
        for share in [0.001, 0.01, 0.1, 0.5, 0.9, 0.99] {
            let half_angle = share * PI / count as f64;
            // Poor against the electrode's own size, so that the contact is even to 1e-5.
            let contact = 1e5 * 195.0 * half_angle;
            let solver = solved(&disc(count, half_angle, contact), 1e-3);
            let series = gap_matrix(count, half_angle, 0.0, 1.0, 1000.0);
            let error = worst(solver.electrode_matrix(), &series);
            println!("{count} electrodes of {share} of the pitch: {error:.1e}");
            assert!(error < 1e-3, "{count} {share}: {error}");
        }
    }
}

/// An insulating hole is an inclusion without conductance.
#[test]
fn a_hole() {
    for ratio in [0.05, 0.5, 0.9] {
        let half_angle = 10.0 / 195.0;
        let mut sheet = disc(16, half_angle, GAP_CONTACT_MM);
        sheet.holes.push(Outline::Disc {
            diameter_mm: 195.0 * ratio,
            centre_mm: [0.0, 0.0],
        });
        let series = gap_matrix(16, half_angle, ratio, 0.0, 1000.0);
        let error = worst(solved(&sheet, 1e-3).electrode_matrix(), &series);
        println!("hole of {ratio} R: {error:.1e}");
        assert!(error < 1e-3, "{ratio}: {error}");
    }
}

/// From a round electrode in the middle to all those of the rim together: `ln(R / a) / (2 pi)` of sheet and the contact
/// around. Differences between radii do not know the rim (to (a/R)^16).
#[test]
fn an_electrode_inside() {
    let contact = 1.0;
    let resistance = |radius_mm: f64| {
        let mut sheet = Sheet::paper();
        sheet.electrodes.push(Electrode {
            place: Place::Inside {
                centre_mm: [0.0, 0.0],
                radius_mm,
            },
            contact_mm: contact,
        });
        let solver = solved(&sheet, 1e-3);
        let r = solver.electrode_matrix().potentials_ohm();
        // A sixteenth of the current out of every rim electrode (the electrode inside is the last and ground).
        let rim: f64 = (0..16).map(|j| r[(0, j)]).sum();
        rim / 16.0 / 1000.0
    };
    let exact = |a: f64, b: f64| ((b / a).ln() + contact * (1.0 / a - 1.0 / b)) / TAU;
    for (a, b) in [(0.01, 0.1), (0.1, 1.0), (1.0, 10.0), (10.0, 40.0)] {
        let error = ((resistance(a) - resistance(b)) / exact(a, b) - 1.0).abs();
        println!("electrode inside, radius {a} and {b} mm: {error:.1e}");
        assert!(error < 1e-3, "{a} {b}: {error}");
    }
}

/// Paper-like electrodes on a sheet ten metres wide and on one of a millimetre.
#[test]
fn electrodes_that_do_not_scale_with_the_sheet() {
    for (diameter, width) in [(10_000.0, 10.0), (10_000.0, 1900.0), (1.0, 0.001), (1.0, 0.19)] {
        let half_angle = width / diameter;
        let sheet = Sheet::disc(diameter, 16, width, 1e5 * width, 1000.0);
        let series = gap_matrix(16, half_angle, 0.0, 1.0, 1000.0);
        let error = worst(solved(&sheet, 1e-3).electrode_matrix(), &series);
        println!("disc of {diameter} mm, electrodes of {width} mm: {error:.1e}");
        assert!(error < 1e-3, "{diameter} {width}: {error}");
    }
}

/// Other outlines, with touches and holes, against a mesh for a tenth of the error.
#[test]
fn outlines() {
    let ring = |perimeter: f64, count: usize| -> Vec<Electrode> {
        (0..count)
            .map(|k| at_arc(perimeter * (k as f64 + 0.3) / count as f64, 8.0, 1.0))
            .collect()
    };
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
    let rectangle = Outline::Rectangle {
        width_mm: 300.0,
        height_mm: 60.0,
        centre_mm: [0.0, 0.0],
    };
    let bean = Outline::Smooth {
        points_mm: vec![[0.0, 0.0], [90.0, -10.0], [110.0, 40.0], [60.0, 35.0], [10.0, 70.0]],
    };
    for (name, outline, perimeter, touch, hole) in [
        ("L", l_shape, 800.0, [50.0, 60.0], [150.0, 50.0]),
        ("rectangle", rectangle, 720.0, [60.0, 5.0], [-80.0, 0.0]),
        ("bean", bean, 300.0, [35.0, 25.0], [85.0, 20.0]),
    ] {
        let mut sheet = sheet(outline, ring(perimeter, 12));
        sheet.holes.push(Outline::Disc {
            diameter_mm: 14.0,
            centre_mm: hole,
        });
        let touch = [DiscTouch {
            centre_mm: touch,
            radius_mm: 12.5,
            rise: 3.0,
        }];
        let mut finer = solved(&sheet, 1e-4);
        finer.solve_touches(&touch).unwrap();
        let mut solver = solved(&sheet, 1e-3);
        let drive = Drive::Current { amplitude_a: 1e-3 };
        let pattern = Pattern::adjacent(12).unwrap();
        let error = worst_of_largest(solver.solve_touches(&touch).unwrap(), finer.electrode_matrix());
        assert!(
            drive
                .frame_v(solver.electrode_matrix(), &pattern)
                .iter()
                .all(|v| v.is_finite())
        );
        println!("{name} with a hole and a touch: {error:.1e}");
        assert!(error < 1e-3, "{name}: {error}");
    }
}

/// Beyond what a sheet can be, or double precision hold, the answer is an error.
#[test]
fn what_cannot_be_right_is_refused() {
    let mut refused = 0;
    for exponent in [3, 6, 9, 12, 15, 18, 30, 100, 300] {
        for sign in [-1, 1] {
            let mut sheet = Sheet::paper();
            for (l, e) in sheet.electrodes.iter_mut().enumerate() {
                e.contact_mm = 10.0_f64.powi(if l % 2 == 0 { sign * exponent } else { -sign * exponent });
            }
            let result = Model::new(&sheet, &ModelOptions::default()).and_then(|m| Solver::new(Arc::new(m)));
            match result {
                Ok(solver) => {
                    let r = solver.electrode_matrix().potentials_ohm();
                    assert!(r.iter().all(|v| v.is_finite()));
                }
                Err(ForwardError::Precision { .. } | ForwardError::Cholesky(_)) => refused += 1,
                Err(ForwardError::Geometry(_)) if exponent > 9 => refused += 1,
                Err(e) => panic!("{e}"),
            }
        }
    }
    // Contacts have bounds of their own.
    assert!(refused >= 8);
    let model = Arc::new(Model::new(&Sheet::paper(), &ModelOptions::default()).unwrap());
    let mut solver = Solver::new(model.clone()).unwrap();
    let before = solver.electrode_matrix().clone();
    for exponent in [12, 15, 20, 100, 300] {
        let mut c = vec![[1.0, 0.0, 1.0]; model.mesh().triangles.len()];
        for (k, s) in c.iter_mut().enumerate() {
            let v = 10.0_f64.powi(if k % 2 == 0 { exponent } else { -exponent });
            *s = [v, 0.0, v];
        }
        match solver.solve(&c) {
            Ok(z) => assert!(z.potentials_ohm().iter().all(|v| v.is_finite())),
            Err(ForwardError::Precision { .. } | ForwardError::Cholesky(_)) => {}
            Err(e) => panic!("{e}"),
        }
    }
    let z = solver
        .solve(&vec![[1.0, 0.0, 1.0]; model.mesh().triangles.len()])
        .unwrap();
    let pair = Pair::new(0, 1);
    assert!((z.transfer_ohm(pair, pair) / before.transfer_ohm(pair, pair) - 1.0).abs() < 1e-12);
}
