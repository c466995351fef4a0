use super::*;
use proptest::prelude::*;

const FRAME_S: f64 = 1.0 / 115.0;

fn touch(id: u32, x_mm: f64, area_mm2: f64) -> Touch {
    Touch {
        id: Some(id),
        x_mm,
        rise: 0.2,
        area_mm2,
        total_mm2: 0.2 * area_mm2,
        x_sd_mm: Some(0.5),
        y_sd_mm: Some(0.5),
        force_n: Some(0.05 * area_mm2),
        frames: 3,
        ..Touch::default()
    }
}

/// A finger, seen from 0 s on and with its number two frames later, at a place for a time; none when it is not there.
fn events(seconds: f64, at: impl Fn(f64) -> Option<Touch>) -> Vec<TouchEvent> {
    let mut gestures = Gestures::new(GestureOptions::default());
    let mut out = Vec::new();
    for k in 0..(seconds / FRAME_S) as usize {
        let time_s = k as f64 * FRAME_S;
        let touches: Vec<Touch> = at(time_s).into_iter().collect();
        out.extend_from_slice(gestures.update(time_s, &touches));
    }
    out
}

/// Numbered with the third frame after `from_s`, gone at `to_s`.
fn finger(time_s: f64, from_s: f64, to_s: f64, x_mm: f64) -> Option<Touch> {
    let is_there = (from_s - 1e-9..to_s - 1e-9).contains(&time_s);
    let mut touch = is_there.then(|| touch(1, x_mm, 400.0))?;
    touch.id = touch.id.filter(|_| time_s > from_s + 1.5 * FRAME_S);
    Some(touch)
}

fn names(events: &[TouchEvent]) -> Vec<Gesture> {
    events.iter().map(|e| e.event).collect()
}

#[test]
fn a_contact_begins_with_its_first_frame_and_is_told_with_the_third() {
    let from_s = 10.0 * FRAME_S;
    let events = events(0.3, |t| finger(t, from_s, f64::INFINITY, 5.0));
    assert_eq!(names(&events), [Gesture::Contact]);
    assert!((events[0].time_s - from_s).abs() < 1e-9, "{events:?}");
    assert!((events[0].latency_s - 2.0 * FRAME_S).abs() < 1e-9);
    assert_eq!(
        (events[0].touch, events[0].x_mm, events[0].force_n),
        (1, 5.0, Some(20.0))
    );
}

#[test]
fn a_contact_of_a_touch_that_has_its_number_at_once_is_told_at_once() {
    let from_s = 10.0 * FRAME_S;
    let at_once = |t: f64| {
        (t > from_s - 1e-9).then(|| Touch {
            frames: ((t - from_s) / FRAME_S).round() as u32 + 1,
            ..touch(1, 5.0, 400.0)
        })
    };
    let events = events(0.3, at_once);
    assert_eq!(names(&events), [Gesture::Contact]);
    assert!((events[0].time_s - from_s).abs() < 1e-9, "{events:?}");
    assert_eq!(events[0].latency_s, 0.0);
}

#[test]
fn a_short_touch_is_a_tap_two_are_a_double_tap_and_three_are_one_and_a_tap() {
    use Gesture::{Contact, DoubleTap, Lift, Tap};
    // The tracker gives the number back at once.
    let taps = |n: usize, pause_s: f64| {
        events(3.0, |t| {
            let nth = (t / (0.1 + pause_s)) as usize;
            let since_s = t - nth as f64 * (0.1 + pause_s);
            (nth < n && since_s < 0.1).then(|| touch(1, 0.0, 400.0))
        })
    };
    let of = |n, pause_s| {
        names(&taps(n, pause_s))
            .into_iter()
            .filter(|g| ![Contact, Lift].contains(g))
            .collect::<Vec<_>>()
    };
    assert_eq!(of(1, 0.2), [Tap]);
    assert_eq!(of(2, 0.2), [Tap, Tap, DoubleTap]);
    assert_eq!(of(3, 0.2), [Tap, Tap, DoubleTap, Tap]);
    // Too slow for a pair.
    assert_eq!(of(2, 0.45), [Tap, Tap]);
    // Too soon for a lift: it flickers.
    assert_eq!(of(2, 0.03), [Tap]);
    let events = taps(1, 0.2);
    let lift = &events[1];
    assert!((lift.time_s - 0.1).abs() < 1.5 * FRAME_S, "{lift:?}");
    assert!((0.05..0.05 + 2.0 * FRAME_S).contains(&lift.latency_s), "{lift:?}");
}

#[test]
fn a_touch_that_moves_at_once_strokes_and_one_that_rested_slips() {
    use Gesture::{Contact, Hold, Lift, Slip, Stroke};
    let moving = |rest_s: f64| events(2.0, move |t| finger(t, 0.0, 1.5, 60.0 * (t - rest_s).max(0.0)));
    let stroke = moving(0.1);
    assert_eq!(names(&stroke), [Contact, Stroke, Lift]);
    // After 6 mm at 60 mm/s.
    assert!((stroke[1].time_s - 0.2).abs() < 2.0 * FRAME_S, "{stroke:?}");
    assert!((stroke[2].distance_mm - 60.0 * 1.4).abs() < 1.0, "{stroke:?}");
    assert!((stroke[1].latency_s - FRAME_S).abs() < 1e-9, "{stroke:?}");
    let slip = moving(0.8);
    assert_eq!(names(&slip), [Contact, Hold, Slip, Lift]);
    assert!(
        (slip[1].time_s - 0.5).abs() < 1e-9 && slip[1].latency_s < FRAME_S,
        "{slip:?}"
    );
}

/// A finger that lets go while a frame is measured seems to be elsewhere in that one.
#[test]
fn one_frame_elsewhere_is_no_move() {
    use Gesture::{Contact, Lift, Tap};
    let tap = events(1.0, |t| {
        let mut touch = finger(t, 0.0, 0.1, 0.0)?;
        if t > 0.1 - 1.5 * FRAME_S {
            (touch.x_mm, touch.total_mm2) = (12.0, 0.5 * touch.total_mm2);
        }
        Some(touch)
    });
    assert_eq!(names(&tap), [Contact, Lift, Tap]);
    assert_eq!((tap[2].x_mm, tap[2].distance_mm), (0.0, 0.0));
}

/// 4 mm of standard uncertainty to a side and a noise of as much: it stands still.
#[test]
fn what_trembles_by_its_uncertainty_does_not_move() {
    let events = events(2.0, |t| {
        let k = (t / FRAME_S).round() as usize;
        let mut touch = finger(t, 0.0, f64::INFINITY, [-4.0, 3.0, 4.0, -2.0][k % 4])?;
        (touch.x_sd_mm, touch.y_sd_mm) = (Some(4.0), Some(4.0));
        Some(touch)
    });
    assert_eq!(names(&events), [Gesture::Contact, Gesture::Hold]);
}

#[test]
fn a_palm_is_told_once_and_never_taps() {
    let events = events(1.0, |t| {
        (t < 0.2).then(|| touch(1, 0.0, if t < 0.1 { 900.0 } else { 3800.0 }))
    });
    assert_eq!(names(&events), [Gesture::Contact, Gesture::Palm, Gesture::Lift]);
}

/// What is left of a finger on rubber that creeps is seen for seconds, and is no touch.
#[test]
fn a_dent_is_lifted_and_pressed_anew() {
    use Gesture::{Contact, Hold, Lift, Tap};
    let events = events(4.0, |t| {
        // Pressed for 1 s, a dent of a quarter that recovers, pressed on the dent for 0.2 s, and a dent again.
        let strength = match t {
            _ if t < 1.0 => 1.0,
            _ if (2.0..2.2).contains(&t) => 0.8,
            _ => 0.25 * (-t / 5.0).exp(),
        };
        let mut touch = finger(t, 0.0, f64::INFINITY, 0.0)?;
        touch.total_mm2 *= strength;
        Some(touch)
    });
    assert_eq!(names(&events), [Contact, Hold, Lift, Contact, Lift, Tap]);
    assert!((events[2].time_s - 1.0).abs() < 1.5 * FRAME_S, "{events:?}");
    assert!((events[3].time_s - 2.0).abs() < 1.5 * FRAME_S, "{events:?}");
}

/// A dent that was not seen for a while is a dent, with another number or its old one; elsewhere the same is a touch.
#[test]
fn a_dent_that_is_seen_again_is_no_contact() {
    use Gesture::{Contact, Hold, Lift};
    let seen = |id: u32, from_s: f64, x_mm: f64| {
        events(5.0, move |t| match t {
            _ if t < 1.0 => finger(t, 0.0, 1.0, 0.0),
            _ if t > from_s => {
                let mut dent = touch(id, x_mm, 400.0);
                dent.total_mm2 *= 0.15;
                Some(dent)
            }
            _ => None,
        })
    };
    assert_eq!(names(&seen(2, 3.0, 3.0)), [Contact, Hold, Lift]);
    assert_eq!(names(&seen(1, 1.2, 3.0)), [Contact, Hold, Lift]);
    assert_eq!(names(&seen(2, 3.0, 40.0)), [Contact, Hold, Lift, Contact, Hold]);
}

/// Dents where a touch rested, and where it slipped to, are felt as one between them, with the sum of both. A touch that never slipped
/// left half as much: the same is a contact then.
#[test]
fn two_dents_of_a_slip_may_be_felt_as_one() {
    use Gesture::{Contact, Hold, Lift, Slip};
    let seen = |to_mm: f64| {
        events(4.0, move |t| match t {
            _ if t < 1.0 => finger(t, 0.0, 2.0, 0.0),
            _ if t < 1.2 => finger(t, 0.0, 2.0, to_mm * (t - 1.0) / 0.2),
            _ if t < 1.5 => finger(t, 0.0, 2.0, to_mm),
            _ if t > 3.0 => {
                let mut dents = touch(1, 0.5 * to_mm, 400.0);
                dents.total_mm2 *= 0.35;
                Some(dents)
            }
            _ => None,
        })
    };
    assert_eq!(names(&seen(18.0)), [Contact, Hold, Slip, Lift]);
    assert_eq!(names(&seen(0.0)), [Contact, Hold, Lift, Contact, Hold]);
}

/// A reset of the board is no time, however long its clock had run.
#[test]
fn a_clock_that_begins_anew_changes_nothing() {
    let mut gestures = Gestures::new(GestureOptions::default());
    let resting = [touch(1, 0.0, 400.0)];
    let mut seen = Vec::new();
    for k in 0..90 {
        let time_s = if k < 30 { 1000.0 } else { -1.0 } + f64::from(k) * FRAME_S;
        seen.extend_from_slice(gestures.update(time_s, &resting));
    }
    assert_eq!(names(&seen), [Gesture::Contact, Gesture::Hold]);
}

proptest! {
    /// Whatever touches do: contact and lift take turns, nothing is told of what is lifted, and no time lies in the future.
    #[test]
    fn contacts_and_lifts_take_turns(
        frames in prop::collection::vec(([any::<bool>(), any::<bool>(), any::<bool>()], -30.0..30.0f64, 0.0..1.0f64, 1..30u32), 1..200)
    ) {
        let mut gestures = Gestures::new(GestureOptions::default());
        let mut down = [false; 3];
        let mut time_s = 0.0;
        for (there, x_mm, strength, wait) in frames {
            time_s += f64::from(wait) * FRAME_S;
            let touches: Vec<Touch> = (0..3).filter(|k| there[*k]).map(|k| Touch {
                total_mm2: 80.0 * strength,
                ..touch(k as u32, x_mm, 400.0)
            }).collect();
            for event in gestures.update(time_s, &touches) {
                let down = &mut down[event.touch as usize];
                match event.event {
                    Gesture::Contact => prop_assert!(!std::mem::replace(down, true)),
                    Gesture::Lift => prop_assert!(std::mem::replace(down, false)),
                    Gesture::Tap | Gesture::DoubleTap => prop_assert!(!*down),
                    _ => prop_assert!(*down),
                }
                prop_assert!(event.latency_s >= 0.0 && event.duration_s >= 0.0);
                prop_assert!((event.time_s + event.latency_s - time_s).abs() < 1e-9);
            }
        }
    }
}
