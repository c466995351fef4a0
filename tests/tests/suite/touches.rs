//! Bytes out of the simulated board, through the link, to touches where the fingers are.

use hil_sim::{Scene, SimConfig, Touch};
use link::plans::live_plan;
use rand::{Rng, SeedableRng};
use tests::{run, run_by, simulated};

/// Fingers come down after this time, s: before it the baseline is taken.
const DOWN_S: f64 = 0.9;
/// Frames of the baseline: 0.7 s at 33 frames/s.
const BASELINE: usize = 20;

/// Places at least 50 mm apart and 20 mm from the rim.
fn places(count: usize, rng: &mut impl Rng) -> Vec<[f64; 2]> {
    let mut out: Vec<[f64; 2]> = Vec::new();
    while out.len() < count {
        let p: [f64; 2] = [rng.random_range(-77.5..77.5), rng.random_range(-77.5..77.5)];
        let free = out.iter().all(|q| (p[0] - q[0]).hypot(p[1] - q[1]) >= 50.0);
        if p[0].hypot(p[1]) <= 77.5 && free {
            out.push(p);
        }
    }
    out
}

fn touches_are_found(count: usize) {
    let mut rng = rand::rngs::StdRng::seed_from_u64(40 + count as u64);
    for _ in 0..3 {
        let truth = places(count, &mut rng);
        let scene = Scene {
            touches: truth
                .iter()
                .map(|p| Touch::finger(&[(DOWN_S + 0.1, p[0], p[1]), (9.0, p[0], p[1])], 20.0, 0.1))
                .collect(),
            ..Scene::empty()
        };
        let port = simulated(scene, SimConfig::default()).unwrap();
        let run = run(Box::new(port), BASELINE, DOWN_S + 0.8).unwrap();
        assert_eq!((run.lost_frames, run.values_missing), (0, 0));

        let before: Vec<_> = run.pictures.iter().filter(|(t, _)| *t < DOWN_S - 0.1).collect();
        assert!(!before.is_empty());
        assert!(before.iter().all(|(_, touches)| touches.is_empty()), "{before:?}");
        let after: Vec<_> = run.pictures.iter().filter(|(t, _)| *t > DOWN_S + 0.2).collect();
        assert!(after.len() > 15);
        for (t, touches) in after {
            assert_eq!(touches.len(), count, "at {t} s, fingers at {truth:?}: {touches:?}");
            for p in &truth {
                let off = touches
                    .iter()
                    .map(|q| (q.x_mm - p[0]).hypot(q.y_mm - p[1]))
                    .fold(f64::INFINITY, f64::min);
                assert!(off < 3.0, "at {t} s: {off:.1} mm off {p:?}: {touches:?}");
            }
        }
    }
}

#[test]
fn one_finger_within_three_millimetres() {
    touches_are_found(1);
}

#[test]
fn two_fingers_within_three_millimetres() {
    touches_are_found(2);
}

#[test]
fn three_fingers_within_three_millimetres() {
    touches_are_found(3);
}

#[test]
fn four_fingers_within_three_millimetres() {
    touches_are_found(4);
}

#[test]
fn a_sheet_that_nobody_touches_shows_nothing() {
    let port = simulated(Scene::empty(), SimConfig::default()).unwrap();
    let run = run(Box::new(port), BASELINE, 8.0).unwrap();
    assert!(run.pictures.len() > 200);
    assert!(run.pictures.iter().all(|(_, touches)| touches.is_empty()));
}

#[test]
fn a_touch_keeps_its_number_while_it_moves() {
    let scene = Scene {
        touches: vec![Touch::finger(&[(1.0, -50.0, -10.0), (2.0, 40.0, 20.0)], 20.0, 0.1)],
        ..Scene::empty()
    };
    let truth = scene.clone();
    let port = simulated(scene, SimConfig::default()).unwrap();
    let run = run(Box::new(port), BASELINE, 1.95).unwrap();
    let moving: Vec<_> = run.pictures.iter().filter(|(t, _)| *t > 1.1).collect();
    let first = moving[0].1[0].id;
    assert!(first.is_some());
    for (t, touches) in moving {
        assert_eq!(touches.len(), 1, "{touches:?}");
        assert_eq!(touches[0].id, first);
        // A frame takes 30 ms and carries the time of its start; the finger moves 95 mm/s.
        let now = truth.truth(t + 0.015)[0];
        let off = (touches[0].x_mm - now.x_mm).hypot(touches[0].y_mm - now.y_mm);
        assert!(off < 4.0, "{off} mm at {t} s");
    }
}

/// By the plan of live pictures: 115 frames/s, one period for every value.
#[test]
fn at_the_rate_of_live_pictures_the_touches_are_as_right() {
    let truth = [[35.0, 20.0], [-40.0, -25.0]];
    let scene = Scene {
        touches: truth
            .iter()
            .map(|p| Touch::finger(&[(DOWN_S + 0.1, p[0], p[1]), (9.0, p[0], p[1])], 20.0, 0.1))
            .collect(),
        ..Scene::empty()
    };
    let port = simulated(scene, SimConfig::default()).unwrap();
    // The frames of 0.7 s make the baseline.
    let run = run_by(Box::new(port), live_plan, 80, DOWN_S + 0.8).unwrap();
    assert_eq!((run.lost_frames, run.values_missing), (0, 0));
    let before: Vec<_> = run.pictures.iter().filter(|(t, _)| *t < DOWN_S - 0.1).collect();
    assert!(
        !before.is_empty() && before.iter().all(|(_, touches)| touches.is_empty()),
        "{before:?}"
    );
    let after: Vec<_> = run.pictures.iter().filter(|(t, _)| *t > DOWN_S + 0.2).collect();
    assert!(after.len() > 60, "{}", after.len());
    for (t, touches) in after {
        assert_eq!(touches.len(), truth.len(), "at {t} s: {touches:?}");
        for p in &truth {
            let off = touches
                .iter()
                .map(|q| (q.x_mm - p[0]).hypot(q.y_mm - p[1]))
                .fold(f64::INFINITY, f64::min);
            assert!(off < 3.0, "at {t} s: {off:.1} mm off {p:?}: {touches:?}");
        }
    }
}
