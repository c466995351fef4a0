use super::*;
use proptest::prelude::*;

fn tracker() -> Tracker {
    Tracker::new(TrackerOptions::new(20.0, 0.5))
}

fn touch(x_mm: f64, y_mm: f64) -> Touch {
    Touch {
        x_mm,
        y_mm,
        rise: 0.2,
        area_mm2: 400.0,
        ..Touch::default()
    }
}

fn numbers(tracker: &mut Tracker, time_s: f64, at: &[[f64; 2]]) -> Vec<Option<u32>> {
    let mut touches: Vec<Touch> = at.iter().map(|[x, y]| touch(*x, *y)).collect();
    tracker.update(time_s, &mut touches, false);
    touches.iter().map(|t| t.id).collect()
}

fn ids(tracker: &mut Tracker, time_s: f64, at: &[[f64; 2]]) -> Vec<u32> {
    numbers(tracker, time_s, at).into_iter().map(Option::unwrap).collect()
}

/// What the frames of the last 0.3 s before 0 showed: touches at rest.
fn at_rest(tracker: &mut Tracker, at: &[[f64; 2]]) -> Vec<u32> {
    numbers(tracker, -0.2, at);
    numbers(tracker, -0.1, at);
    ids(tracker, 0.0, at)
}

#[test]
fn a_number_comes_with_the_third_frame_and_what_flickers_has_none() {
    let mut tracker = tracker();
    for k in 0..100 {
        // Two frames, and gone; elsewhere and elsewhere.
        let time_s = 0.01 * f64::from(k);
        let there = [[f64::from(k / 3 % 7) * 30.0, 0.0]];
        let seen = numbers(&mut tracker, time_s, if k % 3 == 2 { &[] } else { &there });
        assert!(seen.iter().all(Option::is_none));
    }
    assert_eq!(numbers(&mut tracker, 2.00, &[[5.0, 0.0]]), [None]);
    assert_eq!(numbers(&mut tracker, 2.01, &[[5.0, 0.0]]), [None]);
    assert_eq!(numbers(&mut tracker, 2.02, &[[5.0, 0.0]]), [Some(1)]);
}

/// What is far beyond its uncertainty, alone, in a frame that nobody doubts is no flicker.
#[test]
fn a_clear_touch_has_its_number_at_once() {
    let of = |sd_mm2: f64, beside: Option<f64>, doubted: bool| {
        let mut touches = vec![Touch {
            total_mm2: 80.0,
            total_sd_mm2: Some(sd_mm2),
            ..touch(0.0, 0.0)
        }];
        touches.extend(beside.map(|x_mm| touch(x_mm, 0.0)));
        tracker().update(0.0, &mut touches, doubted);
        (touches[0].id.is_some(), touches[0].frames)
    };
    assert_eq!(of(8.0, None, false), (true, 1));
    assert_eq!(of(8.0, Some(41.0), false), (true, 1));
    assert_eq!(of(8.1, None, false), (false, 1));
    assert_eq!(of(8.0, Some(39.0), false), (false, 1));
    assert_eq!(of(8.0, None, true), (false, 1));
}

/// One of which only the size is uncertain is there.
#[test]
fn a_touch_of_a_certain_place_has_its_number_at_once() {
    let of = |x_sd_mm: f64, y_sd_mm: f64, beside: Option<f64>, doubted: bool| {
        let mut touches = vec![Touch {
            total_mm2: 43.0,
            total_sd_mm2: Some(17.0),
            x_sd_mm: Some(x_sd_mm),
            y_sd_mm: Some(y_sd_mm),
            ..touch(0.0, 0.0)
        }];
        touches.extend(beside.map(|x_mm| touch(x_mm, 0.0)));
        tracker().update(0.0, &mut touches, doubted);
        touches[0].id.is_some()
    };
    assert!(of(1.0, 0.4, None, false) && of(0.4, 1.0, Some(41.0), false));
    assert!(!of(1.1, 0.4, None, false) && !of(0.4, 1.1, None, false));
    assert!(!of(0.4, 0.4, Some(39.0), false) && !of(0.4, 0.4, None, true));
}

/// A lift while the frame is measured leaves at the rim what looks like a touch, whether the one that is lifted is still seen or not.
#[test]
fn a_touch_that_is_small_beside_another_waits_for_its_number() {
    let certain = |x_mm: f64, total_mm2: f64| Touch {
        total_mm2,
        total_sd_mm2: Some(0.01),
        x_sd_mm: Some(0.5),
        y_sd_mm: Some(0.5),
        ..touch(x_mm, 0.0)
    };
    let has = |tracker: &mut Tracker, time_s: f64, touches: &mut [Touch]| {
        tracker.update(time_s, touches, false);
        touches.iter().map(|t| t.id.is_some()).collect::<Vec<_>>()
    };
    for (small_mm2, at_once) in [(2.9, false), (3.1, true), (-2.9, false), (-3.1, true)] {
        let (small, large) = (certain(-60.0, small_mm2), certain(30.0, -60.0));
        assert_eq!(has(&mut tracker(), 0.0, &mut [small, large]), [at_once, true]);
        let mut tracker = tracker();
        assert_eq!(has(&mut tracker, 0.0, &mut [large]), [true]);
        assert_eq!(has(&mut tracker, 0.01, &mut [small]), [at_once]);
    }
}

/// It may be a part of the one that is there, or that is looked for.
#[test]
fn what_comes_beside_a_known_touch_waits_for_its_number() {
    let clear = |x_mm| Touch {
        total_mm2: 80.0,
        total_sd_mm2: Some(1.0),
        ..touch(x_mm, 0.0)
    };
    for gap in [false, true] {
        let mut tracker = tracker();
        at_rest(&mut tracker, &[[0.0, 0.0]]);
        let mut touches = vec![clear(38.0)];
        if !gap {
            touches.push(clear(0.0));
        }
        tracker.update(0.01, &mut touches, false);
        assert_eq!(touches[0].id, None);
    }
}

#[test]
fn numbers_follow_moving_touches_in_any_order() {
    let mut tracker = tracker();
    let first = at_rest(&mut tracker, &[[0.0, 0.0], [50.0, 0.0]]);
    assert_ne!(first[0], first[1]);
    let second = ids(&mut tracker, 0.1, &[[47.0, 3.0], [4.0, 1.0]]);
    assert_eq!((second[0], second[1]), (first[1], first[0]));
    // One is lifted for longer than the patience, another comes: a new number.
    for k in 2..9 {
        ids(&mut tracker, 0.1 * f64::from(k), &[[47.0, 3.0]]);
    }
    for time_s in [0.9, 1.0] {
        let last = numbers(&mut tracker, time_s, &[[4.0, 1.0], [47.0, 3.0]]);
        assert_eq!(last, [None, Some(first[1])]);
    }
    let last = ids(&mut tracker, 1.1, &[[4.0, 1.0], [47.0, 3.0]]);
    assert_eq!(last[1], first[1]);
    assert!(!first.contains(&last[0]));
}

/// Nearest first, the second would be taken for the first and a new one would be seen.
#[test]
fn a_row_that_moves_on_by_almost_its_spacing_keeps_its_numbers() {
    let mut tracker = tracker();
    let before = at_rest(&mut tracker, &[[0.0, 0.0], [12.0, 0.0], [24.0, 0.0]]);
    let after = ids(&mut tracker, 0.1, &[[11.0, 0.0], [23.0, 0.0], [35.0, 0.0]]);
    assert_eq!(before, after);
}

#[test]
fn a_number_comes_back_at_its_place_only_and_nobody_takes_one_that_is_there() {
    let mut tracker = tracker();
    let [a, b] = at_rest(&mut tracker, &[[0.0, 0.0], [30.0, 0.0]])[..] else {
        panic!()
    };
    assert_eq!(ids(&mut tracker, 0.1, &[[30.0, 0.0]]), [b]);
    // Not where it vanished.
    assert_eq!(
        numbers(&mut tracker, 0.2, &[[30.0, 0.0], [-25.0, 0.0]]),
        [Some(b), None]
    );
    // b moves to where a vanished, and stays b; then a is there again beside it.
    assert_eq!(ids(&mut tracker, 0.3, &[[15.0, 0.0]]), [b]);
    assert_eq!(ids(&mut tracker, 0.4, &[[5.0, 0.0], [-3.0, 0.0]]), [b, a]);
    // A board that was reset: its time begins anew, its touches are the same.
    assert_eq!(ids(&mut tracker, 0.0, &[[5.0, 0.0], [-3.0, 0.0]]), [b, a]);
}

#[test]
fn what_was_there_before_a_gap_keeps_its_number_however_long_it_was() {
    let mut tracker = tracker();
    let [a, b] = at_rest(&mut tracker, &[[0.0, 0.0], [50.0, 0.0]])[..] else {
        panic!()
    };
    // Lifted before the gap, for less than the patience.
    assert_eq!(ids(&mut tracker, 0.1, &[[0.0, 0.0]]), [a]);
    tracker.gap();
    let after = numbers(&mut tracker, 100.0, &[[3.0, 1.0], [50.0, 0.0]]);
    assert_eq!(after, [Some(a), None]);
    assert_ne!(Some(b), after[1]);
}

/// Time from frame to frame, s.
const FRAME_S: f64 = 1.0 / 115.0;
/// Two touches nearer than this are seen as one somewhere between them, mm.
const RESOLVED_MM: f64 = 16.0;

/// What was lifted beside it does not hold a touch up that goes round and round, however slow the frames are.
#[test]
fn the_other_one_of_two_goes_where_it_likes() {
    for frame_s in [FRAME_S, 1.0 / 30.0, 0.1] {
        let mut tracker = tracker();
        let round = |time_s: f64| [10.0 + 30.0 * (5.0 * time_s).sin(), 30.0 - 30.0 * (5.0 * time_s).cos()];
        for k in 0..40 {
            numbers(&mut tracker, frame_s * f64::from(k - 40), &[[-10.0, 0.0], [10.0, 0.0]]);
        }
        for k in 0..100 {
            let time_s = frame_s * f64::from(k);
            assert_eq!(
                numbers(&mut tracker, time_s, &[round(time_s)]),
                [Some(2)],
                "{frame_s} s, {k}"
            );
        }
    }
}

proptest! {
    /// Two touches that cross at any angle and speed are one for a while, and keep their numbers, where that lasts no longer than
    /// the patience and they do not go side by side.
    #[test]
    fn touches_that_cross_keep_their_numbers(
        turn in 0.0..6.3f64, between in 1.0..5.2f64, speeds in [60.0..400.0f64, 60.0..400.0f64],
        noise in prop::collection::vec([-0.5..0.5f64, -0.5..0.5f64, -0.5..0.5f64, -0.5..0.5f64], 400),
        parts in prop::collection::vec(0.0..1.0f64, 100), kind in 0..4_usize, same in 0.0..1.0f64,
    ) {
        let way = |angle: f64, speed: f64| [speed * angle.cos(), speed * angle.sin()];
        let ways = [way(turn, speeds[0]), way(turn + between, speeds[1])];
        let apart = (ways[0][0] - ways[1][0]).hypot(ways[0][1] - ways[1][1]);
        prop_assume!(2.0 * RESOLVED_MM / apart < 0.43);
        let mut tracker = tracker();
        let mut first = None;
        // They meet at 0 s.
        let begin_s = -60.0 / apart.min(400.0);
        let frames = (2.0 * -begin_s / FRAME_S) as usize;
        for ((k, noise), part) in (0..frames).zip(noise.iter().cycle()).zip(parts.iter().cycle()) {
            let time_s = begin_s + k as f64 * FRAME_S;
            let at = |way: [f64; 2], noise: &[f64]| [way[0] * time_s + noise[0], way[1] * time_s + noise[1]];
            let [a, b] = [at(ways[0], &noise[..2]), at(ways[1], &noise[2..])];
            if time_s.abs() * apart < RESOLVED_MM {
                // In the middle, anywhere, at the same part of the way all along, or at one of the two, rather the same one.
                let part = [0.5, *part, same, f64::from(*part < same)][kind];
                numbers(&mut tracker, time_s, &[[0, 1].map(|k| part * a[k] + (1.0 - part) * b[k])]);
                continue;
            }
            let seen = numbers(&mut tracker, time_s, &[a, b]);
            if k >= 2 {
                let first = first.get_or_insert_with(|| seen.clone());
                prop_assert_eq!(&seen, first, "at {} s", time_s);
                prop_assert!(seen.iter().all(Option::is_some));
            }
        }
        prop_assert_eq!(tracker.next, 3);
    }

    /// What moves on while it is not seen for 0.5 s has its number back at once.
    #[test]
    fn a_moving_touch_keeps_its_number_over_a_gap(turn in 0.0..6.3f64, speed in 0.0..300.0f64, gap in 1..57usize) {
        let mut tracker = tracker();
        let at = |k: usize| {
            let way_mm = speed * k as f64 * FRAME_S;
            [way_mm * turn.cos(), way_mm * turn.sin()]
        };
        for k in 0..115 {
            numbers(&mut tracker, k as f64 * FRAME_S, &[at(k)]);
        }
        for k in 115..115 + gap {
            numbers(&mut tracker, k as f64 * FRAME_S, &[]);
        }
        prop_assert_eq!(numbers(&mut tracker, (115 + gap) as f64 * FRAME_S, &[at(115 + gap)]), [Some(1)]);
    }

    /// However touches flicker and tremble at their places, in any order: one number each, as long as none is gone
    /// for longer than the patience.
    #[test]
    fn flickering_touches_keep_their_numbers(
        frames in prop::collection::vec((any::<[bool; 5]>(), any::<[[i8; 2]; 5]>(), any::<bool>(), 0.001..0.25f64), 1..100)
    ) {
        let places = [[0.0, 0.0], [50.0, 0.0], [-50.0, 0.0], [0.0, 50.0], [0.0, -50.0]];
        let mut tracker = tracker();
        let numbers = at_rest(&mut tracker, &places);
        let mut seen_s = [0.0; 5];
        let mut time_s = 0.0;
        for (there, tremble, backwards, wait_s) in frames {
            time_s += wait_s;
            let mut now: Vec<usize> = (0..5).filter(|k| there[*k] || time_s - seen_s[*k] > 0.24).collect();
            if backwards {
                now.reverse();
            }
            let at: Vec<[f64; 2]> = now.iter().map(|k| {
                // 7 mm at most each way, so 20 mm between any two of them.
                let [x, y] = tremble[*k].map(|v| 7.0 * f64::from(v) / 128.0);
                [places[*k][0] + x, places[*k][1] + y]
            }).collect();
            for (k, id) in now.iter().zip(ids(&mut tracker, time_s, &at)) {
                seen_s[*k] = time_s;
                prop_assert_eq!(numbers[*k], id);
            }
        }
    }
}

/// A recording that begins among touches: they keep their numbers, and what is new gets the next one.
#[test]
fn one_that_goes_on_with_anothers_touches_numbers_them_alike() {
    // Two that cross, one that flickers, one that is gone for a while.
    let frame = |tracker: &mut Tracker, k: u32| {
        let at = f64::from(k) - 50.0;
        let mut there = vec![[at, at], [at, -at]];
        if k.is_multiple_of(3) {
            there.push([80.0, 80.0]);
        }
        if !(30..60).contains(&k) {
            there.push([-80.0, 20.0]);
        }
        numbers(tracker, 0.01 * f64::from(k), &there)
    };
    for cut in 0..100 {
        let (mut whole, mut first) = (tracker(), tracker());
        for k in 0..cut {
            assert_eq!(frame(&mut first, k), frame(&mut whole, k));
        }
        let mut second = tracker();
        second.go_on(first.numbered());
        for k in cut..110 {
            assert_eq!(frame(&mut second, k), frame(&mut whole, k), "cut at {cut}");
        }
    }
}
