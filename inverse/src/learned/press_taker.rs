//! Presses in a stream of frames, without a model: when one begins, when it is at rest, and when it ends.
//!
//! The sheet at rest is the mean of the last frames in which nothing changed. A press begins where a frame differs from it by more than noise,
//! by a chi-square test over all values. It is at rest once the frames of a short while agree with those of the while before, by noise or by a
//! small part of the press: rubber creeps. Then its mean is taken, beside that of the sheet just before it began. It has ended once most
//! of it has gone.

use crate::reference::baseline::Baseline;
use crate::stats::chi_square_quantile;
use std::cell::Cell;
use std::collections::VecDeque;

/// How the stream is watched. The times were chosen by hand for people and for robots that hold a press for a second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TakerOptions {
    /// The mean of so long is the sheet before a press, and that of a press at rest, s.
    pub rest_s: f64,
    /// Frames so shortly before a press is seen are no part of the sheet before it: it may have begun, s.
    pub guard_s: f64,
    /// Probability that noise alone looks like the beginning of a press, of one frame.
    pub false_alarm: f64,
    /// Part of a press by which it may creep from one [`TakerOptions::rest_s`] to the next and still be at rest.
    pub creep: f64,
    /// Part of a press that has to go before it has ended.
    pub lifted: f64,
    /// Size of a press over the noise of one value, root mean square over all values, below which it is too light to learn from.
    pub least: f64,
}

impl Default for TakerOptions {
    fn default() -> Self {
        Self {
            rest_s: 0.3,
            guard_s: 0.1,
            false_alarm: 1e-6,
            creep: 0.03,
            lifted: 0.5,
            least: 1.0,
        }
    }
}

/// A press that was taken.
#[derive(Clone, Debug, PartialEq)]
pub struct TakenPress {
    /// When it was seen to begin, and when it was at rest, s of the stream.
    pub began_s: f64,
    /// When its mean was complete, s.
    pub taken_s: f64,
    /// The sheet just before it; not a number where no frame had a value.
    pub before: Vec<f64>,
    /// The sheet under it.
    pub pressed: Vec<f64>,
    /// Frames of the mean under it.
    pub frames: usize,
    /// Root mean square of the change over the noise of one value.
    pub size: f64,
}

impl TakenPress {
    /// The change, pressed less before.
    pub fn change(&self) -> Vec<f64> {
        self.pressed.iter().zip(&self.before).map(|(p, b)| p - b).collect()
    }
}

/// What a frame tells.
#[derive(Clone, Debug, PartialEq)]
pub enum Seen {
    /// Frames of the sheet at rest are still wanted.
    Settling,
    /// Nothing presses.
    Nothing,
    /// Something presses, and moves.
    Moving,
    /// A press is at rest; it is told once.
    Taken(TakenPress),
    /// It still presses.
    Held,
    /// It has ended, at this time, s; it is told once.
    Lifted(f64),
    /// Something pressed too lightly, and has gone.
    TooLight,
}

#[derive(Clone, Debug)]
enum State {
    /// The mean of so long at rest is wanted.
    Settling,
    Waiting,
    Moving {
        began_s: f64,
        before: Vec<f64>,
        largest: f64,
    },
    Held {
        before: Vec<f64>,
        size: f64,
    },
}

/// Looks for presses in frame after frame.
pub struct PressTaker {
    options: TakerOptions,
    /// Variance of every value in one frame.
    variance: Vec<f64>,
    recent: VecDeque<(f64, Vec<f64>)>,
    state: State,
    /// Size of the last press: rubber recovers from it.
    last: f64,
    /// A number of values and the limit of their mean square.
    limit: Cell<(usize, f64)>,
}

impl PressTaker {
    /// On a sheet that was at rest when its baseline was taken.
    pub fn new(baseline: &Baseline, options: TakerOptions) -> Self {
        let own = baseline.value_noise_v();
        // Values without noise, as those of files are, have that of all; without any noise every change counts.
        let pooled = baseline.noise_v;
        let variance = |k: usize| {
            let sd = own.get(k).copied().filter(|sd| sd.is_finite()).unwrap_or(pooled);
            let floor = 1e-9 * baseline.values_v[k].abs().max(f64::MIN_POSITIVE);
            sd.max(0.3 * pooled).max(floor).powi(2)
        };
        Self {
            options,
            variance: (0..baseline.values_v.len()).map(variance).collect(),
            recent: VecDeque::new(),
            state: State::Settling,
            last: 0.0,
            limit: Cell::default(),
        }
    }

    /// Mean square of the difference over the noise of one value, and how many values there are.
    fn square(&self, a: &[f64], b: &[f64]) -> (f64, usize) {
        let (mut sum, mut count) = (0.0, 0);
        for ((a, b), variance) in a.iter().zip(b).zip(&self.variance) {
            let d = (a - b) * (a - b) / variance;
            if d.is_finite() {
                sum += d;
                count += 1;
            }
        }
        (sum / count.max(1) as f64, count)
    }

    /// Means of the frames between two times: of each value, of the frames that have it; and how many frames.
    fn mean(&self, from_s: f64, to_s: f64) -> (Vec<f64>, usize) {
        let (mut sum, mut there) = (vec![0.0; self.variance.len()], vec![0_u32; self.variance.len()]);
        let mut frames = 0;
        for (_, values) in self.recent.iter().filter(|(t, _)| *t > from_s && *t <= to_s) {
            frames += 1;
            for ((s, n), v) in sum.iter_mut().zip(&mut there).zip(values) {
                if v.is_finite() {
                    *s += v;
                    *n += 1;
                }
            }
        }
        (sum.iter().zip(&there).map(|(s, n)| s / f64::from(*n)).collect(), frames)
    }

    /// The mean of the last while, where it agrees with that of the while before but for noise and a part of `size`.
    fn at_rest(&self, now_s: f64, size: f64) -> Option<(Vec<f64>, usize)> {
        let half_s = self.options.rest_s;
        let (late, of_late) = self.mean(now_s - half_s, now_s);
        let (early, of_early) = self.mean(now_s - 2.0 * half_s, now_s - half_s);
        let whole = self
            .recent
            .front()
            .is_some_and(|(t, _)| now_s - t >= 2.0 * half_s * 0.9);
        if !whole || of_late == 0 || of_early == 0 {
            return None;
        }
        let (square, count) = self.square(&late, &early);
        let noise = 1.0 / of_late as f64 + 1.0 / of_early as f64;
        let limit = noise * self.quantile(count) + (self.options.creep * size).powi(2);
        (square <= limit).then_some((late, of_late))
    }

    /// What the mean square of so many values of noise seldom exceeds.
    fn quantile(&self, count: usize) -> f64 {
        let (of, known) = self.limit.get();
        if of == count {
            return known;
        }
        let freedom = count.max(1) as f64;
        let limit = chi_square_quantile(freedom, 1.0 - self.options.false_alarm).map_or(f64::INFINITY, |q| q / freedom);
        self.limit.set((count, limit));
        limit
    }

    /// Takes a frame, measured at this time, s. One that is not later than the one before begins anew: the clock was reset.
    pub fn take(&mut self, time_s: f64, values: &[f64]) -> Seen {
        if values.len() != self.variance.len() {
            return Seen::Nothing;
        }
        if self.recent.back().is_some_and(|(t, _)| time_s <= *t) {
            self.recent.clear();
            self.state = State::Settling;
        }
        self.recent.push_back((time_s, values.to_vec()));
        let kept_s = 2.0 * self.options.rest_s + self.options.guard_s;
        // One frame older than that: it shows that the while is whole.
        while self.recent.len() > 2 && time_s - self.recent[1].0 > kept_s {
            self.recent.pop_front();
        }
        let state = std::mem::replace(&mut self.state, State::Settling);
        let (state, seen) = self.step(state, time_s, values);
        self.state = state;
        seen
    }

    fn step(&mut self, state: State, time_s: f64, values: &[f64]) -> (State, Seen) {
        match state {
            State::Settling => match self.at_rest(time_s, self.last) {
                Some(_) => (State::Waiting, Seen::Nothing),
                None => (State::Settling, Seen::Settling),
            },
            State::Waiting => {
                let until_s = time_s - self.options.guard_s;
                let (before, frames) = self.mean(until_s - self.options.rest_s, until_s);
                if frames == 0 {
                    return (State::Settling, Seen::Settling);
                }
                let (square, count) = self.square(values, &before);
                let recovering = (self.options.creep * self.last).powi(2);
                if square <= (1.0 + 1.0 / frames as f64) * self.quantile(count) + recovering {
                    return (State::Waiting, Seen::Nothing);
                }
                let moving = State::Moving {
                    began_s: time_s,
                    before,
                    largest: square.sqrt(),
                };
                (moving, Seen::Moving)
            }
            State::Moving {
                began_s,
                before,
                largest,
            } => {
                let (square, count) = self.square(values, &before);
                let largest = largest.max(square.sqrt());
                let gone = square <= 2.0 * self.quantile(count) + (self.options.creep * largest).powi(2);
                // All frames of both whiles are from after the beginning.
                let since_s = time_s - began_s;
                let rest = (since_s > 2.0 * self.options.rest_s).then(|| self.at_rest(time_s, square.sqrt()));
                match rest.flatten() {
                    Some((pressed, frames)) => {
                        let (square, _) = self.square(&pressed, &before);
                        let size = square.sqrt();
                        if size < self.options.least {
                            self.last = 0.0;
                            return (State::Waiting, Seen::TooLight);
                        }
                        self.last = size;
                        let taken = TakenPress {
                            began_s,
                            taken_s: time_s,
                            before: before.clone(),
                            pressed,
                            frames,
                            size,
                        };
                        (State::Held { before, size }, Seen::Taken(taken))
                    }
                    None if gone && since_s > self.options.rest_s => (State::Settling, Seen::TooLight),
                    None => (
                        State::Moving {
                            began_s,
                            before,
                            largest,
                        },
                        Seen::Moving,
                    ),
                }
            }
            State::Held { before, size } => {
                let (square, _) = self.square(values, &before);
                if (square - 1.0).max(0.0).sqrt() < self.options.lifted * size {
                    // What follows is compared with itself only.
                    self.recent.clear();
                    return (State::Settling, Seen::Lifted(time_s));
                }
                (State::Held { before, size }, Seen::Held)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const VALUES: usize = 40;
    const FRAME_S: f64 = 0.02;

    /// A stream of frames with presses: times of beginning and end, s, with their heights; each has a way of its own over the values, creeps, and
    /// leaves a tenth that goes within seconds. Noise of a fixed pattern with standard deviation 1.
    struct Stream(Vec<(f64, f64, f64)>);

    impl Stream {
        fn noise(seed: u64) -> f64 {
            let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x1234_5678;
            let mut sum = 0.0;
            for _ in 0..12 {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                sum += (state >> 11) as f64 / (1_u64 << 53) as f64;
            }
            sum - 6.0
        }

        fn frame(&self, k: usize) -> (f64, Vec<f64>) {
            let time_s = k as f64 * FRAME_S;
            let value = |c: usize| {
                let presses = self.0.iter().enumerate().map(|(n, (on, off, height))| {
                    let way = ((c * 7 + n * 13) as f64).sin();
                    let ramp = ((time_s - on) / 0.15).clamp(0.0, 1.0) - ((time_s - off) / 0.15).clamp(0.0, 1.0);
                    let creep = 1.0 + 0.1 * (1.0 - (-(time_s - on).max(0.0) / 3.0).exp());
                    let after = if time_s > *off {
                        0.1 * (-(time_s - off) / 3.0).exp()
                    } else {
                        0.0
                    };
                    height * way * (ramp * creep + after)
                });
                100.0 + c as f64 + presses.sum::<f64>() + Self::noise((k * VALUES + c) as u64 + 7)
            };
            (time_s, (0..VALUES).map(value).collect())
        }

        /// What a taker sees of so many seconds.
        fn seen(&self, until_s: f64) -> Vec<Seen> {
            let frames: Vec<_> = (0..(until_s / FRAME_S) as usize).map(|k| self.frame(k)).collect();
            let baseline: Vec<&[f64]> = frames.iter().take(30).map(|(_, v)| v.as_slice()).collect();
            let mut taker = PressTaker::new(&Baseline::of_frames(VALUES, &baseline), TakerOptions::default());
            frames.iter().skip(30).map(|(t, v)| taker.take(*t, v)).collect()
        }
    }

    fn taken(seen: &[Seen]) -> Vec<TakenPress> {
        let of = |s: &Seen| {
            if let Seen::Taken(press) = s {
                Some(press.clone())
            } else {
                None
            }
        };
        seen.iter().filter_map(of).collect()
    }

    #[test]
    fn every_press_is_taken_once_with_the_sheet_just_before_it() {
        let stream = Stream(vec![(2.0, 3.5, 30.0), (5.0, 6.5, 12.0), (8.0, 9.2, 60.0)]);
        let seen = stream.seen(12.0);
        let presses = taken(&seen);
        assert_eq!(presses.len(), 3, "{presses:?}");
        let lifted: Vec<f64> = seen
            .iter()
            .filter_map(|s| if let Seen::Lifted(t) = s { Some(*t) } else { None })
            .collect();
        assert_eq!(lifted.len(), 3);
        for (n, ((on, off, height), press)) in stream.0.iter().zip(&presses).enumerate() {
            assert!((*on..on + 0.1).contains(&press.began_s), "{press:?}");
            assert!(
                press.taken_s < *off && (*off..off + 0.2).contains(&lifted[n]),
                "{press:?} {lifted:?}"
            );
            // The change is that of the press but for noise of the means, and for the hundredth that creeps meanwhile.
            let change = press.change();
            let way = |c: usize| ((c * 7 + n * 13) as f64).sin();
            let along: f64 =
                (0..VALUES).map(|c| change[c] * way(c)).sum::<f64>() / (0..VALUES).map(|c| way(c).powi(2)).sum::<f64>();
            assert!((along / height - 1.0).abs() < 0.08, "{along} {height}");
            let left: f64 = (0..VALUES).map(|c| (change[c] - along * way(c)).powi(2)).sum::<f64>() / VALUES as f64;
            assert!(left.sqrt() < 0.7 + 0.01 * height, "{left} {height}");
        }
    }

    #[test]
    fn noise_and_what_is_too_light_and_what_moves_is_no_press() {
        assert!(taken(&Stream(vec![]).seen(20.0)).is_empty());
        // A sixth of the noise.
        assert!(taken(&Stream(vec![(2.0, 6.0, 0.15)]).seen(8.0)).is_empty());
        // Taps that are over before they are at rest.
        let taps = (0..5).map(|k| (2.0 + f64::from(k), 2.3 + f64::from(k), 30.0)).collect();
        assert!(taken(&Stream(taps).seen(9.0)).is_empty());
    }

    #[test]
    fn a_value_that_is_missing_and_a_clock_that_is_reset_do_no_harm() {
        let stream = Stream(vec![(2.0, 3.5, 30.0)]);
        let frames: Vec<_> = (0..250).map(|k| stream.frame(k)).collect();
        let baseline: Vec<&[f64]> = frames.iter().take(30).map(|(_, v)| v.as_slice()).collect();
        let mut taker = PressTaker::new(&Baseline::of_frames(VALUES, &baseline), TakerOptions::default());
        let mut presses = 0;
        for (shift, dead) in [(1000.0, None), (0.0, Some(3))] {
            for (t, v) in &frames {
                let mut v = v.clone();
                if let Some(dead) = dead {
                    v[dead] = f64::NAN;
                }
                if let Seen::Taken(press) = taker.take(t + shift, &v) {
                    presses += 1;
                    assert_eq!(press.change()[3].is_nan(), dead.is_some());
                }
            }
        }
        assert_eq!(presses, 2);
    }
}
