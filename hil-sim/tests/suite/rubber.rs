//! The rubber's electrode matrix against solutions on other meshes that know the truth at every point.

use forward::field::{conductivity_of, conductivity_of_discs};
use forward::{DiscTouch, Drive, ElectrodeMatrix, Model, ModelOptions, Pattern, Sheet, Solver};
use hil_sim::{Ageing, Key, Material, Rubber, Scene, Shape, SheetModel, Stretch, StretchField, Touch, Variation};
use std::sync::Arc;

fn frame(z: &ElectrodeMatrix) -> Vec<f64> {
    Drive::PAPER.frame_v(z, &Pattern::adjacent(16).unwrap())
}

/// Largest relative difference of a frame of 208 voltages.
fn difference(a: &ElectrodeMatrix, b: &ElectrodeMatrix) -> f64 {
    let [a, b] = [a, b].map(frame);
    a.iter().zip(b).map(|(x, y)| (x / y - 1.0).abs()).fold(0.0, f64::max)
}

/// A finer solution of discs, by a mesh that follows their edges.
fn reference(discs: &[DiscTouch]) -> ElectrodeMatrix {
    let options = ModelOptions {
        accuracy: 2e-4,
        touches: discs.to_vec(),
        ..ModelOptions::default()
    };
    let model = Arc::new(Model::new(&Sheet::paper(), &options).unwrap());
    let conductivity = conductivity_of_discs(model.mesh(), discs);
    Solver::new(model).unwrap().solve(&conductivity).unwrap().clone()
}

/// A finer solution of a smooth field.
fn reference_field(rise: impl Fn([f64; 2]) -> f64) -> ElectrodeMatrix {
    let options = ModelOptions {
        accuracy: 3e-4,
        ..ModelOptions::default()
    };
    let model = Arc::new(Model::new(&Sheet::paper(), &options).unwrap());
    let conductivity = conductivity_of(model.mesh(), rise);
    Solver::new(model).unwrap().solve(&conductivity).unwrap().clone()
}

fn creeping(touches: Vec<Touch>) -> Scene {
    Scene {
        material: Material::viscoelastic(),
        ..Scene::still(touches)
    }
}

/// Presses, creeps, lifts, keeps an imprint, is pressed again beside it: sharp edges all the time.
#[test]
fn a_tip_that_presses_again_and_again_leaves_discs() {
    let forces = [
        (0.0, 25.0),
        (4.0, 25.0),
        (4.1, 0.0),
        (6.0, 0.0),
        (6.1, 40.0),
        (8.0, 40.0),
    ];
    let scene = creeping(vec![
        Touch::pressed(Shape::Disc, 12.5, 20.0, -30.0, &forces),
        Touch::pressed(Shape::Disc, 8.0, 31.0, -25.0, &[(5.0, 10.0), (9.0, 10.0)]),
    ]);
    let mut rubber = Rubber::new(&Sheet::paper(), scene.clone()).unwrap();
    let mut probes = [scene.probe(12.0, -33.0), scene.probe(36.0, -23.0)];
    for t in [0.0, 1.0, 4.0, 5.5, 7.0, 8.5, 12.0, 30.0] {
        let z = rubber.electrode_matrix(t).unwrap();
        let rises = [0, 1].map(|k| {
            probes[k].advance(t);
            probes[k].rise()
        });
        let disc = |x, y, radius_mm, rise| DiscTouch {
            centre_mm: [x, y],
            radius_mm,
            rise,
        };
        let error = difference(
            z,
            &reference(&[disc(20.0, -30.0, 12.5, rises[0]), disc(31.0, -25.0, 8.0, rises[1])]),
        );
        println!("{t:4} s: rises {rises:.4?}, error {error:.1e}");
        assert!(error < 1e-3, "{t} s: {error:.1e}");
    }
}

/// What moving shapes leave behind is smooth: against a finer mesh that asks a probe at every point.
#[test]
fn trails_of_moving_shapes_are_there() {
    let way = |shape, radius_mm, y: f64| {
        let mut keys = vec![Key::new(0.0, -30.0, y, 200.0), Key::new(0.3, 30.0, y, 200.0)];
        keys[1].angle_deg = 90.0;
        Touch::new(shape, radius_mm, keys)
    };
    let scene = creeping(vec![
        way(Shape::Disc, 12.5, 40.0),
        way(Shape::Pad { aspect: 0.5 }, 14.0, -40.0),
    ]);
    // When all has lifted only the trails are there.
    let mut rubber = Rubber::new(&Sheet::paper(), scene.clone()).unwrap();
    for k in 1..35 {
        rubber.electrode_matrix(0.01 * f64::from(k)).unwrap();
    }
    let z = rubber.electrode_matrix(0.35).unwrap().clone();
    let truth = reference_field(|[x, y]| {
        let mut probe = scene.probe(x, y);
        probe.advance(0.35);
        probe.rise()
    });
    // What the meshes differ by without a touch, and then each one's change.
    let empty = Rubber::new(&Sheet::paper(), Scene::empty())
        .unwrap()
        .electrode_matrix(0.0)
        .unwrap()
        .clone();
    let even = reference_field(|_| 0.0);
    let [here, there, a, b] = [&z, &truth, &empty, &even].map(frame);
    let changes: Vec<[f64; 2]> = (0..208)
        .map(|k| [here[k] / a[k] - 1.0, there[k] / b[k] - 1.0])
        .collect();
    let largest = |f: &dyn Fn(&[f64; 2]) -> f64| changes.iter().map(|c| f(c).abs()).fold(0.0, f64::max);
    let (effect, error) = (largest(&|c| c[1]), largest(&|c| c[0] - c[1]));
    println!(
        "effect {effect:.1e}, error {error:.1e}, of the meshes {:.1e}",
        difference(&empty, &even)
    );
    assert!(effect > 2e-3 && error < 0.01 * effect, "{effect:.1e} {error:.1e}");
}

/// Looking seldom or often, the same history.
#[test]
fn when_it_is_looked_at_does_not_matter() {
    let scene = creeping(vec![
        Touch::finger(&[(0.1, -30.0, 0.0), (0.6, 30.0, 10.0)], 20.0, 0.1),
        Touch::pressed(Shape::Disc, 10.0, 0.0, -40.0, &[(0.2, 0.0), (0.4, 30.0), (0.9, 0.0)]),
    ]);
    let model = Arc::new(Model::new(&Sheet::paper(), &ModelOptions::default()).unwrap());
    let after = |looks: &[f64]| {
        let mut rubber = Rubber::on_model(Arc::clone(&model), scene.clone()).unwrap();
        for t in looks {
            rubber.electrode_matrix(*t).unwrap();
        }
        rubber.electrode_matrix(1.5).unwrap().clone()
    };
    let often: Vec<f64> = (0..210).map(|k| 0.0071 * f64::from(k)).collect();
    let error = difference(&after(&[]), &after(&often));
    println!("{error:.1e}");
    assert!(error < 1e-5, "{error:.1e}");
}

/// Stretching raises the resistivity as pressing does, and where both are they are against each other.
#[test]
fn stretching_is_strain_of_the_other_sign() {
    let field = |x: f64, y: f64| Stretch {
        field: StretchField::Bump {
            centre_mm: [x, y],
            radius_mm: 45.0,
        },
        keys: vec![(0.0, 0.0), (1.0, 0.05)],
    };
    let scene = Scene {
        stretches: vec![field(10.0, 20.0)],
        ..Scene::still(vec![Touch::still(Shape::Finger, 10.0, 20.0, 10.0, 20.0)])
    };
    let mut rubber = Rubber::new(&Sheet::paper(), scene.clone()).unwrap();
    for t in [0.5, 1.0, 2.0] {
        let z = rubber.electrode_matrix(t).unwrap();
        let truth = reference_field(|[x, y]| scene.rise(x, y, t));
        let error = difference(z, &truth);
        println!("{t} s: {error:.1e}");
        assert!(error < 1e-3, "{error:.1e}");
    }
    // All over alike: the sheet is one of higher resistance, less the contacts.
    let even = Scene {
        stretches: vec![Stretch {
            field: StretchField::Uniform,
            keys: vec![(0.0, 0.03)],
        }],
        ..Scene::empty()
    };
    let rise = even.material.rise_of_strain(0.03);
    let z = Rubber::new(&Sheet::paper(), even)
        .unwrap()
        .electrode_matrix(0.0)
        .unwrap()
        .clone();
    let mut thinner = Sheet::paper();
    thinner.sheet_resistance_ohm *= 1.0 + rise;
    thinner.electrodes.iter_mut().for_each(|e| e.contact_mm /= 1.0 + rise);
    let same = Rubber::new(&thinner, Scene::empty())
        .unwrap()
        .electrode_matrix(0.0)
        .unwrap()
        .clone();
    assert!(difference(&z, &same) < 1e-3);
}

/// An old sheet against a new one made with its resistance and contacts.
#[test]
fn an_aged_sheet_is_one_of_other_resistance_and_contacts() {
    let scene = Scene {
        ageing: Ageing {
            resistivity_per_hour: 0.02,
            contact_per_hour: 0.5,
            contact_spread_per_hour: 0.2,
            acceleration: 3600.0,
        },
        variation: Variation {
            contact_sd: 0.3,
            seed: 5,
            ..Variation::default()
        },
        ..Scene::still(vec![Touch::tip(30.0, 0.0, 25.0)])
    };
    let mut rubber = Rubber::new(&Sheet::paper(), scene.clone()).unwrap();
    let new = rubber.electrode_matrix(0.0).unwrap().clone();
    for t in [0.01, 0.5, 2.0] {
        let old = rubber.electrode_matrix(t).unwrap().clone();
        let mut sheet = Sheet::paper();
        let aged = scene.ageing.resistivity(t);
        sheet.sheet_resistance_ohm *= aged;
        let factors = scene.variation.contacts(16);
        let ages = scene.ageing.contacts(16, 5, t);
        for ((e, factor), age) in sheet.electrodes.iter_mut().zip(factors).zip(ages) {
            e.contact_mm *= factor * age / aged;
        }
        let made = Rubber::new(&sheet, Scene::still(scene.touches.clone()))
            .unwrap()
            .electrode_matrix(0.0)
            .unwrap()
            .clone();
        let error = difference(&old, &made);
        println!("{t} s: {error:.1e}, aged by {:.1e}", difference(&old, &new));
        assert!(error < 1e-3, "{error:.1e}");
    }
    assert!(difference(rubber.electrode_matrix(2.0).unwrap(), &new) > 0.01);
}

/// Unevenness against a finer mesh with the same field, and a touch on top of it.
#[test]
fn an_uneven_sheet_is_what_its_field_says() {
    let scene = Scene {
        variation: Variation {
            resistivity_sd: 0.1,
            correlation_mm: 30.0,
            contact_sd: 0.0,
            seed: 3,
        },
        ..Scene::still(vec![Touch::still(Shape::Finger, 8.0, -20.0, 30.0, 20.0)])
    };
    let mut rubber = Rubber::new(&Sheet::paper(), scene.clone()).unwrap();
    let field = scene.variation.resistivity();
    let truth = reference_field(|[x, y]| field([x, y]) * (1.0 + scene.rise(x, y, 0.0)) - 1.0);
    let z = rubber.electrode_matrix(0.0).unwrap();
    let even = Rubber::new(&Sheet::paper(), Scene::still(scene.touches.clone()))
        .unwrap()
        .electrode_matrix(0.0)
        .unwrap()
        .clone();
    let (error, effect) = (difference(z, &truth), difference(z, &even));
    println!("error {error:.1e} of an effect of {effect:.1e}");
    assert!(error < 1e-3 && effect > 0.02, "{error:.1e} {effect:.1e}");
}

/// What creeps so little that it is not solved for again shows nowhere: against a sheet that is looked at for the first time.
#[test]
fn creep_that_is_not_worth_solving_for_moves_no_voltage() {
    let scene = creeping(vec![
        Touch::tip(20.0, 30.0, 25.0),
        Touch::pressed(Shape::Finger, 8.0, -75.0, 5.0, &[(0.0, 20.0), (1.0, 20.0)]),
    ]);
    let model = Arc::new(Model::new(&Sheet::paper(), &ModelOptions::default()).unwrap());
    let mut watched = Rubber::on_model(Arc::clone(&model), scene.clone()).unwrap();
    let mut worst = 0.0_f64;
    let mut solved = 0;
    let mut last = watched.electrode_matrix(0.0).unwrap().clone();
    for k in 1..=2000 {
        let t = 0.0174 * f64::from(k);
        let now = watched.electrode_matrix(t).unwrap().clone();
        solved += usize::from(now != last);
        if k % 100 == 37 {
            let fresh = Rubber::on_model(Arc::clone(&model), scene.clone())
                .unwrap()
                .electrode_matrix(t)
                .unwrap()
                .clone();
            worst = worst.max(difference(&now, &fresh));
        }
        last = now;
    }
    println!("solved at {solved} of 2000 looks, largest error {worst:.1e}");
    assert!(worst < 2e-6 && solved < 1900, "{solved} {worst:.1e}");
}
