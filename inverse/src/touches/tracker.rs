//! Numbers that stay with a touch from frame to frame.
//!
//! A touch is the nearest one of the frame before, within a reach. One that is new where another vanished a moment ago is that one
//! again: on a hand, weak touches come and go with the noise. Every other touch gets a number that none had before.

use crate::touches::touch::Touch;

/// How far and how long a touch is followed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Following {
    /// The most that a touch moves from frame to frame, and between where it vanishes and where it is seen again, mm.
    pub reach_mm: f64,
    /// How long it may be gone, s.
    pub patience_s: f64,
}

/// Follows touches.
#[derive(Clone, Debug)]
pub struct Tracker {
    following: Following,
    known: Vec<Known>,
    next: u32,
}

#[derive(Clone, Debug)]
struct Known {
    id: u32,
    at: [f64; 2],
    seen_s: f64,
    /// Whether it was in the frame before.
    present: bool,
}

impl Tracker {
    /// Knows no touch yet.
    pub fn new(following: Following) -> Self {
        Self {
            following,
            known: Vec::new(),
            next: 1,
        }
    }

    /// Numbers the touches of a frame, measured at the board's time.
    pub fn update(&mut self, time_s: f64, touches: &mut [Touch]) {
        let Following { reach_mm, patience_s } = self.following;
        for touch in &mut *touches {
            touch.id = None;
        }
        for known in &mut self.known {
            // After a reset the board's time begins anew.
            known.seen_s = known.seen_s.min(time_s);
        }
        self.known.retain(|k| time_s - k.seen_s <= patience_s);
        // What was there is followed first: nobody who vanished takes its place.
        let mut seen = vec![false; self.known.len()];
        for present in [true, false] {
            // Nearest pairs first; a handful of touches, so every pair is looked at.
            let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
            for (t, touch) in touches.iter().enumerate().filter(|(_, t)| t.id.is_none()) {
                for (k, known) in self.known.iter().enumerate().filter(|(_, k)| k.present == present) {
                    let d = (touch.x_mm - known.at[0]).hypot(touch.y_mm - known.at[1]);
                    if d <= reach_mm {
                        pairs.push((d, t, k));
                    }
                }
            }
            pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
            for (_, t, k) in pairs {
                if touches[t].id.is_none() && !seen[k] {
                    touches[t].id = Some(self.known[k].id);
                    self.known[k].at = [touches[t].x_mm, touches[t].y_mm];
                    self.known[k].seen_s = time_s;
                    seen[k] = true;
                }
            }
        }
        for (known, seen) in self.known.iter_mut().zip(&seen) {
            known.present = *seen;
        }
        for touch in touches.iter_mut().filter(|t| t.id.is_none()) {
            touch.id = Some(self.next);
            self.known.push(Known {
                id: self.next,
                at: [touch.x_mm, touch.y_mm],
                seen_s: time_s,
                present: true,
            });
            // Wrapping after four thousand million touches does no harm.
            self.next = self.next.wrapping_add(1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FOLLOWING: Following = Following {
        reach_mm: 20.0,
        patience_s: 0.5,
    };

    fn touch(x_mm: f64, y_mm: f64) -> Touch {
        Touch {
            x_mm,
            y_mm,
            rise: 0.2,
            area_mm2: 400.0,
            ..Touch::default()
        }
    }

    fn ids(tracker: &mut Tracker, time_s: f64, at: &[[f64; 2]]) -> Vec<u32> {
        let mut touches: Vec<Touch> = at.iter().map(|[x, y]| touch(*x, *y)).collect();
        tracker.update(time_s, &mut touches);
        touches.iter().map(|t| t.id.unwrap()).collect()
    }

    #[test]
    fn numbers_follow_moving_touches_in_any_order() {
        let mut tracker = Tracker::new(FOLLOWING);
        let first = ids(&mut tracker, 0.0, &[[0.0, 0.0], [50.0, 0.0]]);
        assert_ne!(first[0], first[1]);
        let second = ids(&mut tracker, 0.1, &[[47.0, 3.0], [4.0, 1.0]]);
        assert_eq!((second[0], second[1]), (first[1], first[0]));
        // One is lifted for longer than the patience, another comes: a new number.
        for k in 2..9 {
            ids(&mut tracker, 0.1 * f64::from(k), &[[47.0, 3.0]]);
        }
        let last = ids(&mut tracker, 0.9, &[[4.0, 1.0], [47.0, 3.0]]);
        assert_eq!(last[1], first[1]);
        assert!(!first.contains(&last[0]));
    }

    #[test]
    fn a_number_comes_back_at_its_place_only_and_nobody_takes_one_that_is_there() {
        let mut tracker = Tracker::new(FOLLOWING);
        let [a, b] = ids(&mut tracker, 0.0, &[[0.0, 0.0], [30.0, 0.0]])[..] else {
            panic!()
        };
        assert_eq!(ids(&mut tracker, 0.1, &[[30.0, 0.0]]), [b]);
        // Not where it vanished.
        let c = ids(&mut tracker, 0.2, &[[30.0, 0.0], [-25.0, 0.0]])[1];
        assert!(c != a && c != b);
        // b moves to where a vanished, and stays b; then a is there again beside it.
        assert_eq!(ids(&mut tracker, 0.3, &[[15.0, 0.0]]), [b]);
        assert_eq!(ids(&mut tracker, 0.4, &[[5.0, 0.0], [-3.0, 0.0]]), [b, a]);
        // A board that was reset: its time begins anew, its touches are the same.
        assert_eq!(ids(&mut tracker, 0.0, &[[5.0, 0.0], [-3.0, 0.0]]), [b, a]);
    }

    proptest! {
        /// However touches flicker and tremble at their places, in any order: one number each, as long as none is gone for longer than
        /// the patience.
        #[test]
        fn flickering_touches_keep_their_numbers(
            frames in prop::collection::vec((any::<[bool; 5]>(), any::<[[i8; 2]; 5]>(), any::<bool>(), 0.001..0.25f64), 1..100)
        ) {
            let places = [[0.0, 0.0], [50.0, 0.0], [-50.0, 0.0], [0.0, 50.0], [0.0, -50.0]];
            let mut tracker = Tracker::new(FOLLOWING);
            let mut numbers = [None; 5];
            let mut seen_s = [f64::NEG_INFINITY; 5];
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
                    prop_assert_eq!(*numbers[*k].get_or_insert(id), id);
                }
            }
        }
    }
}
