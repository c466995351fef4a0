//! Numbers that stay with a touch from frame to frame.

use crate::picture::Touch;

/// Follows touches: each is the nearest one of the frame before, within a reach, or new.
#[derive(Clone, Debug)]
pub struct Tracker {
    reach_mm: f64,
    /// Frames a touch may be gone and keep its number.
    patience: u32,
    known: Vec<Known>,
    next: u32,
}

#[derive(Clone, Debug)]
struct Known {
    id: u32,
    at: [f64; 2],
    missed: u32,
}

impl Tracker {
    /// Touches move at most `reach_mm` from frame to frame and may be missing for `patience` frames.
    pub fn new(reach_mm: f64, patience: u32) -> Self {
        Self {
            reach_mm,
            patience,
            known: Vec::new(),
            next: 1,
        }
    }

    /// Numbers the touches of a frame.
    pub fn update(&mut self, touches: &mut [Touch]) {
        // Nearest pairs first; a handful of touches, so every pair is looked at.
        let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
        for (t, touch) in touches.iter_mut().enumerate() {
            touch.id = None;
            for (k, known) in self.known.iter().enumerate() {
                let d = (touch.x_mm - known.at[0]).hypot(touch.y_mm - known.at[1]);
                if d <= self.reach_mm {
                    pairs.push((d, t, k));
                }
            }
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut seen = vec![false; self.known.len()];
        for (_, t, k) in pairs {
            if touches[t].id.is_none() && !seen[k] {
                touches[t].id = Some(self.known[k].id);
                self.known[k].at = [touches[t].x_mm, touches[t].y_mm];
                self.known[k].missed = 0;
                seen[k] = true;
            }
        }
        for (known, seen) in self.known.iter_mut().zip(&seen) {
            known.missed += u32::from(!seen);
        }
        self.known.retain(|k| k.missed <= self.patience);
        for touch in touches.iter_mut().filter(|t| t.id.is_none()) {
            touch.id = Some(self.next);
            self.known.push(Known {
                id: self.next,
                at: [touch.x_mm, touch.y_mm],
                missed: 0,
            });
            // Wrapping after four thousand million touches does no harm.
            self.next = self.next.wrapping_add(1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn touch(x_mm: f64, y_mm: f64) -> Touch {
        Touch {
            id: None,
            x_mm,
            y_mm,
            rise: 0.2,
            area_mm2: 400.0,
            ..Touch::default()
        }
    }

    #[test]
    fn numbers_follow_moving_touches_in_any_order() {
        let mut tracker = Tracker::new(20.0, 2);
        let mut first = [touch(0.0, 0.0), touch(50.0, 0.0)];
        tracker.update(&mut first);
        let (a, b) = (first[0].id, first[1].id);
        assert_ne!(a, b);
        let mut second = [touch(47.0, 3.0), touch(4.0, 1.0)];
        tracker.update(&mut second);
        assert_eq!((second[0].id, second[1].id), (b, a));
        // One is lifted for longer than the patience, another comes: a new number.
        for _ in 0..4 {
            tracker.update(&mut [touch(47.0, 3.0)]);
        }
        let mut last = [touch(4.0, 1.0), touch(47.0, 3.0)];
        tracker.update(&mut last);
        assert_eq!(last[1].id, b);
        assert!(last[0].id != a && last[0].id != b);
    }
}
