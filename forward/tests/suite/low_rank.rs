//! A low-rank correction gives what a new factorisation gives.

use forward::{DiscTouch, Model, ModelOptions, Sensitivity, Sheet, Solver, Tensor, Work};
use proptest::prelude::*;
use std::sync::{Arc, OnceLock};

fn model() -> Arc<Model> {
    static MODEL: OnceLock<Arc<Model>> = OnceLock::new();
    let make = || {
        let options = ModelOptions {
            accuracy: 1e-2,
            ..ModelOptions::default()
        };
        Arc::new(Model::new(&Sheet::paper(), &options).unwrap())
    };
    MODEL.get_or_init(make).clone()
}

/// Largest difference of two solvers' matrices and potentials, over the largest value.
fn difference(a: &Solver, b: &Solver) -> f64 {
    let (x, y) = (
        a.electrode_matrix().potentials_ohm(),
        b.electrode_matrix().potentials_ohm(),
    );
    let (u, v) = (a.potentials_v(), b.potentials_v());
    ((x - y).amax() / y.amax()).max((&u - &v).amax() / v.amax())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn equals_a_new_factorisation(
        changes in prop::collection::vec((0.0_f64..1.0, -2.0_f64..2.0, -2.0_f64..2.0, -0.9_f64..0.9), 1..6),
        steps in 1_usize..4,
    ) {
        let model = model();
        let elements = model.mesh().triangles.len();
        let mut conductivity = vec![[1.0, 0.0, 1.0]; elements];
        let mut updated = Solver::new(model.clone()).unwrap();
        let mut low_rank = false;
        for step in 0..steps {
            for (place, xx, yy, shear) in &changes {
                let element = ((place + 0.37 * step as f64).fract() * elements as f64) as usize;
                let (xx, yy) = (10.0_f64.powf(*xx), 10.0_f64.powf(*yy));
                let tensor: Tensor = [xx, shear * (xx * yy).sqrt(), yy];
                conductivity[element] = tensor;
            }
            updated.solve(&conductivity).unwrap();
            low_rank |= matches!(updated.work(), Work::LowRank { .. });
        }
        let mut fresh = factorised_at(&model, &conductivity);
        prop_assert!(low_rank);
        let error = difference(&updated, &fresh);
        prop_assert!(error < 1e-9, "{}", error);
        // And back, from another factorisation.
        fresh.solve(&vec![[1.0, 0.0, 1.0]; elements]).unwrap();
        let plain = Solver::new(model).unwrap();
        prop_assert!(difference(&fresh, &plain) < 1e-9);
    }
}

/// A solver whose factorisation is of these very conductivities: from a state in which every element differs.
fn factorised_at(model: &Arc<Model>, conductivity: &[Tensor]) -> Solver {
    let mut solver = Solver::new(model.clone()).unwrap();
    solver.solve(&vec![[1.7, 0.0, 1.7]; conductivity.len()]).unwrap();
    assert_eq!(solver.work(), Work::Factorisation);
    solver.solve(conductivity).unwrap();
    assert_eq!(solver.work(), Work::Factorisation);
    solver
}

#[test]
fn an_unchanged_scene_costs_nothing() {
    let model = model();
    let mut solver = Solver::new(model.clone()).unwrap();
    solver
        .solve(&vec![[1.0, 0.0, 1.0]; model.mesh().triangles.len()])
        .unwrap();
    assert_eq!(solver.work(), Work::Nothing);
    let touch = [DiscTouch {
        centre_mm: [10.0, 20.0],
        radius_mm: 12.5,
        rise: 0.2,
    }];
    solver.solve_touches(&touch).unwrap();
    assert_ne!(solver.work(), Work::Nothing);
    solver.solve_touches(&touch).unwrap();
    assert_eq!(solver.work(), Work::Nothing);
}

#[test]
fn a_small_touch_is_a_low_rank_change_and_so_is_its_sensitivity() {
    let model = model();
    let touch = |rise| {
        [DiscTouch {
            centre_mm: [31.0, 12.0],
            radius_mm: 5.0,
            rise,
        }]
    };
    let mut solver = Solver::new(model.clone()).unwrap();
    solver.solve_touches(&touch(0.5)).unwrap();
    assert!(matches!(solver.work(), Work::LowRank { .. }), "{:?}", solver.work());
    let mut other = Solver::new(model.clone()).unwrap();
    other
        .solve(&vec![[1.7, 0.0, 1.7]; model.mesh().triangles.len()])
        .unwrap();
    other.solve_touches(&touch(0.5)).unwrap();
    assert_eq!(other.work(), Work::Factorisation);
    assert!(difference(&solver, &other) < 1e-9);
    let (a, b) = (Sensitivity::by_element(&solver), Sensitivity::by_element(&other));
    let (drive, sense) = (forward::Pair::new(0, 1), forward::Pair::new(6, 7));
    let scale = (0..a.regions())
        .map(|r| a.transfer_ohm(r, drive, sense).abs())
        .fold(0.0, f64::max);
    for region in 0..a.regions() {
        let (x, y) = (
            a.transfer_ohm(region, drive, sense),
            b.transfer_ohm(region, drive, sense),
        );
        assert!((x - y).abs() < 1e-9 * scale, "{region}");
    }
}

#[test]
fn a_refused_state_leaves_the_one_before() {
    let model = model();
    let mut solver = Solver::new(model.clone()).unwrap();
    let before = solver.electrode_matrix().clone();
    let mut bad = vec![[1.0, 0.0, 1.0]; model.mesh().triangles.len()];
    bad[5] = [1.0, 2.0, 1.0];
    assert!(solver.solve(&bad).is_err());
    assert!(solver.solve(&bad[1..]).is_err());
    let nowhere = DiscTouch {
        centre_mm: [f64::NAN, 0.0],
        radius_mm: 3.0,
        rise: 0.2,
    };
    assert!(solver.solve_touches(&[nowhere]).is_err());
    assert_eq!(solver.electrode_matrix(), &before);
}

/// After [`Solver::forget`] a solution is the same to the last bit, whatever was solved before.
#[test]
fn what_is_forgotten_leaves_nothing_behind() {
    let touch = |x: f64, radius_mm: f64| DiscTouch {
        centre_mm: [x, 10.0],
        radius_mm,
        rise: 0.4,
    };
    let small = [touch(20.0, 5.0)];
    let mut first = Solver::new(model()).unwrap();
    first.forget();
    let alone = first.solve_touches_here(&small).unwrap().potentials_ohm().clone();
    let mut kept = Solver::new(model()).unwrap();
    let low_rank = kept.solve_touches_here(&small).unwrap().potentials_ohm().clone();
    assert!(matches!(kept.work(), Work::LowRank { .. }));
    assert!(low_rank != alone && (low_rank - &alone).amax() < 1e-9 * alone.amax());
    for before in [vec![touch(-30.0, 15.0), touch(40.0, 9.0)], small.to_vec(), Vec::new()] {
        let mut solver = Solver::new(model()).unwrap();
        solver.solve_touches_here(&before).unwrap();
        solver.solve_untouched_there().unwrap();
        solver.forget();
        assert_eq!(*solver.solve_touches_here(&small).unwrap().potentials_ohm(), alone);
    }
}
