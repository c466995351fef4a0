use super::*;
use inverse::touches::tracker::{Tracker, TrackerOptions};

/// To the last bit: a replay that begins with what was there goes on as that did.
#[test]
fn touches_that_a_recording_begins_with_go_on_as_they_did() {
    let options = TrackerOptions::new(20.0, 0.5);
    let mut tracker = Tracker::new(options);
    let mut gestures = Gestures::default();
    let at = |k: i32| {
        [10.0 / 3.0, 50.0].map(|x_mm| Touch {
            x_mm: x_mm + 0.01 * f64::from(k) / 7.0,
            rise: 0.2,
            total_mm2: 90.0,
            ..Touch::default()
        })
    };
    for k in 0..40 {
        let time_s = 0.01 * f64::from(k);
        let mut touches = at(k);
        tracker.update(time_s, &mut touches, false);
        gestures.update(time_s, &touches[..2 - (k / 20) as usize]);
        // Frames may be missing just before.
        if k == 39 {
            tracker.gap();
        }
    }
    let touching = Touching {
        numbered: tracker.numbered(),
        gestures: gestures.clone(),
    };
    let text = serde_json::to_string(&touching).unwrap();
    let read: Touching = serde_json::from_str(&text).unwrap();
    let mut other = Tracker::new(options);
    other.go_on(read.numbered);
    let mut told = read.gestures.with(GestureOptions::default());
    for k in 40..100 {
        let mut touches = at(k);
        let mut same = touches;
        tracker.update(0.01 * f64::from(k), &mut touches, false);
        other.update(0.01 * f64::from(k), &mut same, false);
        assert_eq!(same, touches, "frame {k}");
        let there = if k < 60 { 1 } else { 2 };
        let events = gestures.update(0.01 * f64::from(k), &touches[..there]);
        assert_eq!(told.update(0.01 * f64::from(k), &same[..there]), events, "frame {k}");
    }
}
