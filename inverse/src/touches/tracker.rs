//! Numbers that stay with a touch from frame to frame.
//!
//! A touch is expected where its motion takes it. Of all ways to say which touch is which one of before, the one with the least sum of
//! squared distances from where they were expected is taken (`assign`): two that cross keep their numbers. What was in the frame
//! before and is not said to be any one costs as much as the longest reach; so does a touch that is said to be new. What vanished a moment ago costs
//! nothing while it is away, so it never takes the place of one that is there.
//!
//! A touch gets its number once it was seen in several frames one after another, so that what flickers has none. What flickers is
//! noise, a touch that is taken for two, or a frame that is doubted. A touch that is none of these has its number at once. It is alone,
//! and its rise is far beyond its uncertainty or its place is certain. It is not small beside another, and nothing speaks against the
//! frame. One that vanished is waited for, and gets its number back at once.

use crate::touches::assignment::assign;
use crate::touches::touch::Touch;
use serde::{Deserialize, Serialize};

/// How far and how long a touch is followed. No experiment is on record; chosen by hand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackerOptions {
    /// Longest distance of a touch from where it was expected, mm. More follows touches that turn faster. Above the least distance at
    /// which two touches are resolved it takes one for the other.
    pub reach_mm: f64,
    /// How long a touch may be gone and keep its number, s. More takes a second tap at the same place for the same
    /// touch; less numbers flickering touches anew.
    pub patience_s: f64,
    /// A touch has its number from so many frames on, one after another; at least 1. More waits longer; less numbers what flickers.
    pub frames: u32,
    /// But a touch whose integrated rise is so many of its standard uncertainties, and that is farther than twice the reach from all
    /// others, has it from its first frame on. More waits oftener.
    pub clear_sd: f64,
    /// So has one whose place is as certain as this, one standard uncertainty in mm. A touch that comes down while its frame is measured
    /// may be of any size at a place that is known: its rise is uncertain, that it is there is not. Noise has no place to a tenth of a
    /// finger's radius. Less waits oftener.
    pub clear_mm: f64,
    /// One whose integrated rise is less than this part of another's waits all the same. Where that one comes down or is lifted while the
    /// frame is measured, what it leaves over may look like a touch at the rim, whose place is certain. More waits oftener.
    pub clear_part: f64,
    /// Speed of a touch when it is first seen, one direction's standard deviation, mm/s. Less follows later what comes down moving.
    pub speed_mm_s: f64,
    /// Change of the velocity in a second, one direction's standard deviation, mm/s. More follows turns sooner; less foretells better
    /// where a touch goes that is not seen.
    pub change_mm_s: f64,
    /// Standard deviation of the place of a touch that was not fitted, and the least of one that was, mm.
    pub place_sd_mm: [f64; 2],
}

impl TrackerOptions {
    /// For a reach (mm) and a patience (s), with the rest as `skin run` has it.
    pub fn new(reach_mm: f64, patience_s: f64) -> Self {
        Self {
            reach_mm,
            patience_s,
            frames: 3,
            clear_sd: 10.0,
            clear_mm: 1.0,
            clear_part: 0.05,
            speed_mm_s: 300.0,
            change_mm_s: 50.0,
            place_sd_mm: [3.0, 0.5],
        }
    }
}

/// Reaches from one touch to another within which their places are uncertain: shortly before they are seen as one they are not where they
/// are told.
const NEAR: f64 = 1.5;

/// Follows touches.
#[derive(Clone, Debug)]
pub struct Tracker {
    following: TrackerOptions,
    known: Vec<Known>,
    next: u32,
}

/// The touches that are followed, and the number that comes next: another tracker can go on with them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Numbered {
    known: Vec<Known>,
    next: u32,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Known {
    /// None before it was seen in enough frames.
    id: Option<u32>,
    motion: Motion,
    /// Where and when it was seen last.
    seen_mm: [f64; 2],
    seen_s: f64,
    /// Whether it was in the frame before.
    present: bool,
    /// Frames in which it was seen.
    frames: u32,
    /// Size of its integrated rise when it was seen last, mm².
    #[serde(default)]
    total_mm2: f64,
}

/// Place and velocity of a touch whose velocity changes at random: Kalman's filter, one for both directions.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Motion {
    at_mm: [f64; 2],
    velocity_mm_s: [f64; 2],
    /// Covariance in one direction: of the place, of place and velocity, of the velocity.
    covariance: [f64; 3],
}

impl Motion {
    /// Variance of a place, mm².
    fn variance(touch: &Touch, following: &TrackerOptions) -> f64 {
        let [of_peak, least] = following.place_sd_mm;
        match (touch.x_sd_mm, touch.y_sd_mm) {
            (Some(x), Some(y)) if (x + y).is_finite() => (0.5 * (x * x + y * y)).max(least * least),
            _ => of_peak * of_peak,
        }
    }

    /// Seen for the first time.
    fn new(touch: &Touch, following: &TrackerOptions) -> Self {
        Self {
            at_mm: [touch.x_mm, touch.y_mm],
            velocity_mm_s: [0.0; 2],
            covariance: [Self::variance(touch, following), 0.0, following.speed_mm_s.powi(2)],
        }
    }

    /// After so long, unseen.
    fn after(&self, s: f64, following: &TrackerOptions) -> Self {
        let [place, both, velocity] = self.covariance;
        // Of white acceleration.
        let change = following.change_mm_s.powi(2);
        Self {
            at_mm: [0, 1].map(|k| self.at_mm[k] + s * self.velocity_mm_s[k]),
            velocity_mm_s: self.velocity_mm_s,
            covariance: [
                place + s * (2.0 * both + s * velocity) + change * s.powi(3) / 3.0,
                both + s * velocity + change * s * s / 2.0,
                velocity + change * s,
            ],
        }
    }

    /// Seen at a place, where it was expected here.
    fn seen(&mut self, touch: &Touch, variance: f64) {
        let [place, both, velocity] = self.covariance;
        let sum = place + variance;
        let gain = [place / sum, both / sum];
        for (k, at) in [touch.x_mm, touch.y_mm].into_iter().enumerate() {
            let off = at - self.at_mm[k];
            self.at_mm[k] += gain[0] * off;
            self.velocity_mm_s[k] += gain[1] * off;
        }
        self.covariance = [
            (1.0 - gain[0]) * place,
            (1.0 - gain[0]) * both,
            velocity - gain[1] * both,
        ];
    }
}

impl Tracker {
    /// Knows no touch yet.
    pub fn new(following: TrackerOptions) -> Self {
        Self {
            following,
            known: Vec::new(),
            next: 1,
        }
    }

    /// The touches that are followed now.
    pub fn numbered(&self) -> Numbered {
        Numbered {
            known: self.known.clone(),
            next: self.next,
        }
    }

    /// Goes on with the touches that another one followed, from its next frame on.
    pub fn go_on(&mut self, numbered: Numbered) {
        (self.known, self.next) = (numbered.known, numbered.next);
    }

    /// Frames are missing here: what was there before counts as seen until the next one.
    pub fn gap(&mut self) {
        for known in self.known.iter_mut().filter(|k| k.present) {
            known.seen_s = f64::MAX;
            known.motion.velocity_mm_s = [0.0; 2];
        }
    }

    /// Numbers the touches of a frame, measured at the board's time; those that have no number yet have none. Whether something speaks
    /// against the frame.
    pub fn update(&mut self, time_s: f64, touches: &mut [Touch], doubted: bool) {
        let following = self.following;
        for known in &mut self.known {
            // After a reset the board's time begins anew; after a gap nobody knows when it was seen last.
            known.seen_s = known.seen_s.min(time_s);
        }
        self.known.retain(|k| time_s - k.seen_s <= following.patience_s);
        let expected = |k: &Known| k.motion.after(time_s - k.seen_s, &following);
        let expected: Vec<Motion> = self.known.iter().map(expected).collect();
        let whose = self.assign(&expected, touches);
        let crowd = self.crowd(&expected, &whose);
        // Before they are numbered: what is new is compared with what was known.
        let known_mm2 = self.known.iter().filter(|k| k.id.is_some()).map(|k| k.total_mm2);
        let largest_mm2 = touches
            .iter()
            .map(|t| t.total_mm2.abs())
            .chain(known_mm2)
            .fold(0.0, f64::max);
        let small_mm2 = following.clear_part * largest_mm2;
        let clear: Vec<bool> = (0..touches.len())
            .map(|k| !doubted && touches[k].total_mm2.abs() >= small_mm2 && self.is_clear(&expected, touches, k))
            .collect();
        self.known.iter_mut().for_each(|known| known.present = false);
        for ((touch, column), clear) in touches.iter_mut().zip(whose).zip(clear) {
            let k = if let Some(expected) = expected.get(column) {
                let own = Motion::variance(touch, &following);
                self.known[column].motion = *expected;
                self.known[column].motion.seen(touch, own + crowd[column]);
                column
            } else {
                self.known.push(Known {
                    id: None,
                    motion: Motion::new(touch, &following),
                    seen_mm: [touch.x_mm, touch.y_mm],
                    seen_s: time_s,
                    present: true,
                    frames: 0,
                    total_mm2: 0.0,
                });
                self.known.len() - 1
            };
            let known = &mut self.known[k];
            (known.seen_s, known.present) = (time_s, true);
            known.seen_mm = [touch.x_mm, touch.y_mm];
            known.total_mm2 = touch.total_mm2.abs();
            known.frames = known.frames.saturating_add(1);
            if known.id.is_none() && (clear || known.frames >= following.frames) {
                known.id = Some(self.next);
                // Wrapping after four thousand million touches does no harm.
                self.next = self.next.wrapping_add(1);
            }
            (touch.id, touch.frames) = (known.id, known.frames);
        }
        // What has no number is not waited for.
        self.known.retain(|k| k.present || k.id.is_some());
    }

    /// Whether a touch cannot be noise, nor a part of another one.
    fn is_clear(&self, expected: &[Motion], touches: &[Touch], k: usize) -> bool {
        let touch = &touches[k];
        let stands_out = touch
            .total_sd_mm2
            .is_some_and(|sd| touch.total_mm2.abs() >= self.following.clear_sd * sd);
        let uncertain_mm = touch.x_sd_mm.zip(touch.y_sd_mm).map(|(x, y)| x.max(y));
        let has_place = uncertain_mm.is_some_and(|sd| sd <= self.following.clear_mm);
        let here = [touch.x_mm, touch.y_mm];
        let far = 4.0 * self.following.reach_mm * self.following.reach_mm;
        let others = touches
            .iter()
            .enumerate()
            .filter(|(j, _)| *j != k)
            .map(|(_, t)| [t.x_mm, t.y_mm]);
        let known = expected.iter().zip(&self.known).filter(|(_, known)| known.id.is_some());
        let mut all = others.chain(known.map(|(motion, _)| motion.at_mm));
        (stands_out || has_place) && all.all(|there| squared(here, there) > far)
    }

    /// By how much the places of known ones are more uncertain than they say, mm²: two that are near each other may be seen elsewhere.
    /// Where one of the two is not seen, the other may be anywhere between them, and on the same side for many frames. Each then goes on
    /// rather as it went.
    fn crowd(&self, expected: &[Motion], whose: &[usize]) -> Vec<f64> {
        let reach_mm2 = self.following.reach_mm * self.following.reach_mm;
        let between = |k: usize, j: usize| {
            let is_near = squared(expected[j].at_mm, expected[k].at_mm) <= NEAR * NEAR * reach_mm2;
            match (is_near, whose.contains(&j)) {
                (true, true) => 0.25 * reach_mm2,
                (true, false) if self.known[j].id.is_some() => reach_mm2,
                _ => 0.0,
            }
        };
        let of = |k: usize| {
            let others = (0..expected.len()).filter(|j| *j != k);
            others.map(|j| between(k, j)).fold(0.0, f64::max)
        };
        (0..expected.len()).map(of).collect()
    }

    /// Which known one every touch is; a number beyond them for a new one.
    fn assign(&self, expected: &[Motion], touches: &[Touch]) -> Vec<usize> {
        let alone = self.following.reach_mm * self.following.reach_mm;
        assign(touches.len(), expected.len() + touches.len(), |touch, column| {
            let Some(Motion { at_mm, .. }) = expected.get(column) else {
                return alone;
            };
            let there = [touches[touch].x_mm, touches[touch].y_mm];
            // What stopped, or only trembles, is where it was.
            let squared = [squared(*at_mm, there), squared(self.known[column].seen_mm, there)]
                .into_iter()
                .find(|s| *s <= alone);
            let Some(squared) = squared else {
                // More than any sum of costs: never taken, since all can be new.
                return (touches.len() + 1) as f64 * 4.0 * alone;
            };
            // That it is not left alone is gained where it was in the frame before.
            squared - if self.known[column].present { alone } else { 0.0 }
        })
    }
}

fn squared(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)
}

#[cfg(test)]
mod tests;
