//! Numbers and events of touches on the simulated skin, from the firmware to the state machines.

use hil_sim::{Pace, SceneFile, SimPort};
use inverse::touches::gestures::{Gesture, GestureOptions, Gestures, TouchEvent};
use inverse::touches::touch::Touch;
use link::plans::live_plan;
use std::path::Path;
use tests::run_by;

/// Frames of 0.7 s.
const BASELINE: usize = 80;

fn pictures(name: &str, seed: u64) -> (SceneFile, Vec<(f64, Vec<Touch>)>) {
    let mut file = SceneFile::load(Path::new(name)).unwrap();
    file.config.electronics.seed = seed;
    let port = SimPort::new(file.board().unwrap(), Pace::Unpaced).unwrap();
    let run = run_by(Box::new(port), live_plan, BASELINE, file.duration_s).unwrap();
    (file, run.pictures)
}

/// Of every finger the number before and after it crossed another one. When the board starts within the scene depends on the machine.
/// Two that meet in the middle at the same moment are one touch for some frames.
#[test]
fn fingers_that_cross_keep_their_numbers() {
    for seed in [1, 2, 3] {
        let (file, pictures) = pictures("crossing", seed);
        for touch in &file.scene.touches {
            // Where it is when it is down, and the number of what is nearest to it then.
            let present = |t: f64| {
                let alone = hil_sim::Scene {
                    touches: vec![touch.clone()],
                    ..file.scene.clone()
                };
                alone
                    .truth(t)
                    .first()
                    .filter(|p| p.force_n > 10.0)
                    .map(|p| [p.x_mm, p.y_mm])
            };
            let number = |(t, touches): &(f64, Vec<Touch>)| {
                let [x, y] = present(*t + 0.004)?;
                let near = |f: &&Touch| (f.x_mm - x).hypot(f.y_mm - y) < 6.0;
                touches.iter().find(near).and_then(|f| f.id)
            };
            let numbers: Vec<u32> = pictures.iter().filter_map(number).collect();
            let (first, last) = (numbers[5], numbers[numbers.len() - 5]);
            assert_eq!(first, last, "seed {seed}: {numbers:?}");
        }
        let highest = pictures.iter().flat_map(|(_, t)| t).filter_map(|t| t.id).max();
        assert_eq!(highest, Some(6), "seed {seed}");
    }
}

/// What was done, in its order, at its time and place.
#[test]
fn what_touches_did_is_told_with_its_time_and_place() {
    use Gesture::{Contact, DoubleTap, Hold, Lift, Palm, Slip, Stroke, Tap};
    for seed in [1, 2, 3] {
        let (_, pictures) = pictures("gestures", seed);
        let mut gestures = Gestures::new(GestureOptions::default());
        let events: Vec<TouchEvent> = pictures
            .iter()
            .flat_map(|(t, touches)| gestures.update(*t, touches).to_vec())
            .collect();
        let of = |from_s: f64, to_s: f64| events.iter().filter(move |e| (from_s..to_s).contains(&e.time_s));
        let names = |from_s: f64, to_s: f64| of(from_s, to_s).map(|e| e.event).collect::<Vec<_>>();
        assert_eq!(names(0.0, 3.4), [Contact, Lift, Tap], "seed {seed}: {events:#?}");
        assert_eq!(
            names(3.4, 5.4),
            [Contact, Lift, Tap, Contact, Lift, Tap, DoubleTap],
            "seed {seed}: {events:#?}"
        );
        assert_eq!(names(5.4, 7.4), [Contact, Stroke, Lift], "seed {seed}: {events:#?}");
        assert_eq!(
            names(7.4, 10.5),
            [Contact, Hold, Slip, Lift],
            "seed {seed}: {events:#?}"
        );
        assert!(of(10.5, 14.0).any(|e| e.event == Palm), "seed {seed}: {events:#?}");
        for (event, at_s, off_s, place) in [
            (Contact, 2.0, 0.05, [40.0, 20.0]),
            (Lift, 2.1, 0.06, [40.0, 20.0]),
            (Slip, 8.85, 0.15, [3.0, 40.0]),
        ] {
            let told = of(at_s - off_s, at_s + off_s).find(|e| e.event == event);
            let told = told.unwrap_or_else(|| panic!("seed {seed}, {event:?} at {at_s}: {events:#?}"));
            assert!((told.x_mm - place[0]).hypot(told.y_mm - place[1]) < 6.0, "{told:?}");
            assert!((0.0..0.08).contains(&told.latency_s), "{told:?}");
        }
    }
}
