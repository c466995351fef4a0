//! What moves an electrode or changes its contact moves the voltages as the formula says.

use forward::field::conductivity_of_discs;
use forward::{DiscTouch, Drive, Model, ModelOptions, Pattern, Sensitivity, Sheet, Solver};
use std::sync::Arc;

const TOUCH: DiscTouch = DiscTouch {
    centre_mm: [60.0, 30.0],
    radius_mm: 15.0,
    rise: 1.0,
};

fn solve(sheet: &Sheet) -> Solver {
    let options = ModelOptions {
        accuracy: 1e-4,
        ..ModelOptions::for_touches(&[TOUCH])
    };
    let model = Arc::new(Model::new(sheet, &options).unwrap());
    let mut solver = Solver::new(model.clone()).unwrap();
    solver.solve(&conductivity_of_discs(model.mesh(), &[TOUCH])).unwrap();
    solver
}

/// Central differences, against the formula, on a sheet with a touch, for either drive. Contacts change on the same mesh,
/// places over other meshes.
#[test]
fn contacts_and_places_are_slopes() {
    let sheet = Sheet::paper();
    let solver = solve(&sheet);
    let pattern = Pattern::adjacent(16).unwrap();
    let slopes = Sensitivity::by_electrode(&solver);
    let with_contact = |l: usize, factor: f64| {
        let mut contacts = vec![1.0; 16];
        contacts[l] *= factor;
        let model = Arc::new(solver.model().with_contacts(&contacts).unwrap());
        Solver::new(model)
            .unwrap()
            .solve(solver.conductivity())
            .unwrap()
            .clone()
    };
    let moved = |l: usize, along_mm: f64| {
        let mut sheet = sheet.clone();
        sheet.electrodes[l].place = solver.model().geometry().moved(&sheet, l, along_mm).unwrap();
        solve(&sheet).electrode_matrix().clone()
    };
    for drive in [Drive::PAPER, Drive::Current { amplitude_a: 1e-3 }] {
        let matrix = slopes.matrix_v(drive, solver.electrode_matrix(), &pattern);
        for l in [0, 1, 15] {
            for (region, ends, span, tolerance) in [
                (l, [with_contact(l, 1.001), with_contact(l, 0.999)], 0.002, 1e-5),
                (16 + l, [moved(l, 0.2), moved(l, -0.2)], 0.4, 0.015),
            ] {
                let [up, down] = ends.map(|z| drive.frame_v(&z, &pattern));
                let slope: Vec<f64> = up.iter().zip(&down).map(|(a, b)| (a - b) / span).collect();
                let largest = slope.iter().fold(0.0_f64, |m, s| m.max(s.abs()));
                for (row, s) in slope.iter().enumerate() {
                    let off = (s - matrix[(row, region)]).abs();
                    assert!(
                        off < tolerance * largest,
                        "{region} {row}: {s} {}",
                        matrix[(row, region)]
                    );
                }
            }
        }
    }
}

/// All electrodes turned together are the same sheet.
#[test]
fn turning_the_sheet_changes_nothing() {
    let solver = crate::theory::solved(&Sheet::paper(), 1e-4);
    let pattern = Pattern::adjacent(16).unwrap();
    let matrix = Sensitivity::by_electrode(&solver).matrix_v(Drive::PAPER, solver.electrode_matrix(), &pattern);
    for row in matrix.row_iter() {
        let turned: f64 = row.columns(16, 16).sum();
        assert!(
            turned.abs() < 1e-2 * row.columns(16, 16).amax(),
            "{turned} {}",
            row.columns(16, 16).amax()
        );
    }
}

/// Other contacts on the same mesh: near the model made for them, and exactly itself with its own.
#[test]
fn other_contacts_on_the_same_mesh() {
    let contacts: Vec<f64> = (0..16).map(|l| 0.5 + 0.3 * f64::from(l % 5)).collect();
    let base = Model::new(&Sheet::paper(), &ModelOptions::default()).unwrap();
    let mut sheet = Sheet::paper();
    for (e, c) in sheet.electrodes.iter_mut().zip(&contacts) {
        e.contact_mm = *c;
    }
    let z = |model: Model| Solver::new(Arc::new(model)).unwrap().electrode_matrix().clone();
    let here = z(base.with_contacts(&contacts).unwrap());
    let own = z(Model::new(&sheet, &ModelOptions::default()).unwrap());
    let error = crate::theory::worst(&here, &own);
    assert!(error < 1e-3, "{error:.1e}");
    assert_eq!(z(base.with_contacts(&[1.0; 16]).unwrap()), z(base));
    let base = Model::new(&Sheet::paper(), &ModelOptions::default()).unwrap();
    assert!(matches!(
        base.with_contacts(&[1.0; 3]),
        Err(forward::ForwardError::Contacts {
            given: 3,
            electrodes: 16
        })
    ));
    assert!(base.with_contacts(&[-1.0; 16]).is_err());
}
