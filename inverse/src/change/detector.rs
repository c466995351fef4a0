//! The cheap look at a frame: is there anything, and is there anything new?
//!
//! With the noise and the baseline known, most frames need no reconstruction. A frame of the untouched sheet has only noise in the
//! directions in which touches show; a frame of a scene at rest differs from the last one reconstructed by the noise of
//! both. Both are chi-square tests on the leading directions of the weighted sensitivity, one product with a small matrix.
//!
//! For the second test the sum over all directions would hide a slow move among the noise, so the part of the
//! difference along the touches' own parameters is tested by itself, at a quantile that noise often exceeds: a reconstruction
//! too many costs time, a touch that lags behind costs accuracy.
//!
//! Frames of a scene at rest that are measured one after another are averaged: when as many have come as the last result is
//! of, the mean of both is to be reconstructed; that of the most frames is followed by the mean of as many new ones. One reconstruction too many
//! then costs accuracy as well, and the quantiles are such that noise seldom exceeds them, but for the first frames, which may be the last of
//! a touch that comes down. A drift too slow to show in one frame shows in their mean: of 2, 4, 8 frames
//! and so on, those since the last result are compared with those before, and where they differ they alone count.

use crate::linalg::basis::orthogonalise;
use crate::linalg::vector::square;
use crate::solvers::{Problem, Projector};
use crate::stats::chi_square_quantile;

/// Directions in which a cell of the expected rise gives less than this part of the noise are not looked at.
const LEAST_SIGNAL: f64 = 0.3;
const LEAST_DIRECTIONS: usize = 8;
/// Probability that a scene at rest is reconstructed again because of all directions together, and because of those
/// along the touches.
const ANEW_ANYWHERE: f64 = 0.01;
const ANEW_ALONG: f64 = 0.1;
/// The same for frames that are averaged, where one too many costs accuracy as well.
const JUMP_ANYWHERE: f64 = 0.001;
const JUMP_ALONG: f64 = 0.003;
/// A mean of so many frames takes more in at the quantile of `ANEW_ALONG`.
const FIRST_FRAMES: usize = 2;
/// Most frames of a mean.
const MOST_FRAMES: usize = 16;
/// How often a mean is reconstructed once more.
const MOST_ROUNDS: usize = 2;
/// A direction of which less than this part (of its square) is new lies in those before it.
const DEPENDENT: f64 = 1e-18;

/// What a frame turns out to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Seen {
    /// Nothing but noise against the baseline.
    Nothing,
    /// Nothing but noise against the frame, or the mean, reconstructed last.
    Same,
    /// Nothing that shows in a frame, and [`Watch::mean`] is to be reconstructed.
    Mean,
    /// Something to reconstruct.
    New,
}

/// The frame reconstructed last.
#[derive(Clone, Debug, Default)]
struct Last {
    reduced: Vec<f64>,
    /// Orthonormal directions along the touches' parameters, one after the other.
    along: Vec<f64>,
    limit_along: f64,
    limit_first: f64,
}

/// Frames one after another in which nothing changed.
#[derive(Clone, Debug, Default)]
struct Rest {
    /// Mean of those that the result is of, and how many.
    mean: Vec<f64>,
    frames: usize,
    /// Sums of those since then, whole and reduced, and how many.
    sum: Vec<f64>,
    reduced: Vec<f64>,
    since: usize,
    /// Whether frames of the result before are among those of the mean.
    grown: bool,
    /// Whether the mean is to be reconstructed once more, and how often it was.
    again: bool,
    rounds: usize,
}

impl Rest {
    /// Begins with a frame.
    fn begin(&mut self, frame: &[f64]) {
        self.mean.clear();
        self.mean.extend_from_slice(frame);
        (self.frames, self.grown) = (1, false);
        self.clear();
    }

    /// Forgets the frames since the result.
    fn clear(&mut self) {
        self.sum.clear();
        self.sum.resize(self.mean.len(), 0.0);
        self.reduced.fill(0.0);
        self.since = 0;
        (self.again, self.rounds) = (false, 0);
    }

    /// Takes a frame.
    fn add(&mut self, frame: &[f64], reduced: &[f64]) {
        self.sum.iter_mut().zip(frame).for_each(|(s, v)| *s += v);
        self.reduced.resize(reduced.len(), 0.0);
        self.reduced.iter_mut().zip(reduced).for_each(|(s, v)| *s += v);
        self.since += 1;
    }

    /// Makes the mean that of the frames since the result, and where `all` of those before as well.
    fn renew(&mut self, all: bool) {
        let before = if all { self.frames } else { 0 };
        let count = before + self.since;
        for (mean, sum) in self.mean.iter_mut().zip(&self.sum) {
            *mean = (*mean * before as f64 + sum) / count as f64;
        }
        (self.frames, self.grown) = (count, all);
        self.clear();
    }
}

/// Looks at frames against one baseline at one noise.
#[derive(Clone, Debug)]
pub(crate) struct Watch {
    baseline: Vec<f64>,
    sigma: f64,
    /// Volts of the model for a volt of the frame, over the spread; and what that makes of the baseline.
    gain: Vec<f64>,
    offset: Vec<f64>,
    used: usize,
    projector: Projector,
    limit: f64,
    /// Often, seldom exceeded by noise.
    limits_same: [f64; 2],
    last: Last,
    /// Whether `last` is meant.
    remembers: bool,
    /// Most frames at rest of which the mean is taken.
    most: usize,
    rest: Rest,
    /// Variance of one frame's noise.
    variance: f64,
    /// Limits along so many directions (often, seldom exceeded by noise), as far as they were needed.
    limits_along: Vec<[f64; 2]>,
}

impl Watch {
    /// `gain` and `offset`: a frame v is weighted as `gain v - offset`, 0 where a value is left out. `signal` is the rise
    /// expected of a cell over the noise. `of_frame` is the part of the noise's variance that is in the frame, not in the baseline.
    pub(crate) fn new(
        problem: &Problem,
        baseline: &[f64],
        weights: (Vec<f64>, Vec<f64>),
        sigma: f64,
        signal: f64,
        false_alarm: f64,
        of_frame: f64,
    ) -> Option<Self> {
        let (gain, offset) = weights;
        let strong = problem
            .singular()
            .iter()
            .filter(|s| *s * signal >= LEAST_SIGNAL)
            .count();
        let projector = Projector::new(problem, strong.max(LEAST_DIRECTIONS));
        let quantile = |probability: f64| chi_square_quantile(projector.directions() as f64, 1.0 - probability);
        let variance = of_frame * sigma * sigma;
        let [anew, jump] = [quantile(ANEW_ANYWHERE)?, quantile(JUMP_ANYWHERE)?];
        Some(Self {
            used: gain.iter().filter(|g| **g != 0.0).count(),
            limit: quantile(false_alarm)? * sigma * sigma,
            limits_same: [anew * variance, jump * variance],
            baseline: baseline.to_vec(),
            sigma,
            gain,
            offset,
            projector,
            last: Last::default(),
            remembers: false,
            most: 1,
            rest: Rest::default(),
            variance,
            limits_along: Vec::new(),
        })
    }

    /// Whether it was made for this baseline and noise.
    pub(crate) fn is_for(&self, baseline: &[f64], sigma: f64) -> bool {
        // Bit by bit: values that are no number are equal to themselves.
        let same = |(a, b): (&f64, &f64)| a.to_bits() == b.to_bits();
        self.sigma == sigma && self.baseline.len() == baseline.len() && self.baseline.iter().zip(baseline).all(same)
    }

    /// How many values take part.
    pub(crate) fn used(&self) -> usize {
        self.used
    }

    /// Looks at a frame. One with a value that is no number where there should be one is new.
    pub(crate) fn look(&mut self, frame: &[f64]) -> Seen {
        if frame.len() != self.gain.len() {
            return Seen::New;
        }
        let (gain, offset) = (&self.gain, &self.offset);
        let reduced = self.projector.project(|values| {
            for (k, value) in values.iter_mut().take(frame.len()).enumerate() {
                *value = if gain[k] == 0.0 {
                    0.0
                } else {
                    gain[k] * frame[k] - offset[k]
                };
            }
        });
        // A comparison with what is no number is false: such a frame is new.
        if square(reduced) <= self.limit {
            return Seen::Nothing;
        }
        if !self.remembers {
            return Seen::New;
        }
        let (last, rest) = (&self.last, &mut self.rest);
        let limit = self.limits_same[usize::from(self.most > 1)];
        let before = 1.0 / rest.frames.max(1) as f64;
        let same = |now: &[f64], share: f64, limit_along: f64| {
            let (mut change, mut along) = (0.0, 0.0);
            for (a, b) in now.iter().zip(&last.reduced) {
                change += (share * a - b) * (share * a - b);
            }
            for q in last.along.chunks_exact(now.len()) {
                let each = q.iter().zip(now).zip(&last.reduced);
                let part: f64 = each.map(|((q, a), b)| q * (share * a - b)).sum();
                along += part * part;
            }
            let noise = share + before;
            change <= noise * limit && along <= noise * limit_along
        };
        if !same(reduced, 1.0, last.limit_along) {
            return Seen::New;
        }
        if self.most < 2 {
            return Seen::Same;
        }
        if std::mem::take(&mut rest.again) {
            self.remembers = false;
            return Seen::Mean;
        }
        rest.add(frame, reduced);
        let all = rest.since >= rest.frames;
        let limit_along = if all && rest.frames <= FIRST_FRAMES {
            last.limit_first
        } else {
            last.limit_along
        };
        let drifts = rest.since.is_power_of_two() && !same(&rest.reduced, 1.0 / rest.since as f64, limit_along);
        if !drifts && !all {
            return Seen::Same;
        }
        rest.renew(!drifts && 2 * rest.frames <= self.most);
        self.remembers = false;
        Seen::Mean
    }

    /// Takes the mean of at most so many frames at rest; fewer than two average nothing.
    pub(crate) fn set_most(&mut self, frames: usize) {
        self.most = frames.min(MOST_FRAMES);
    }

    /// The mean of the frames at rest, how many there were, and whether frames of the result before are among them.
    pub(crate) fn mean(&self) -> (&[f64], usize, bool) {
        (&self.rest.mean, self.rest.frames, self.rest.grown)
    }

    /// A new frame is reconstructed.
    pub(crate) fn begin(&mut self, frame: &[f64]) {
        self.remembers = false;
        self.rest.begin(frame);
    }

    /// The mean is to be reconstructed once more, with the next frame that is the same.
    pub(crate) fn once_more(&mut self) {
        let rest = &mut self.rest;
        rest.again = rest.rounds < MOST_ROUNDS;
        rest.rounds += 1;
        rest.grown = true;
    }

    /// Remembers the frame looked at last as reconstructed, with the directions (in the problem's reduced space) in which
    /// the parameters of its touches move it: columns of `stride` entries.
    pub(crate) fn remember(&mut self, reduced: &[f64], slopes: &[f64], stride: usize) {
        let directions = self.projector.directions();
        self.remembers = stride >= directions && reduced.len() >= directions && !slopes.is_empty();
        if !self.remembers {
            return;
        }
        let last = &mut self.last;
        last.reduced.clear();
        last.reduced.extend_from_slice(&reduced[..directions]);
        last.along.clear();
        for column in slopes.chunks_exact(stride) {
            let start = last.along.len();
            last.along.extend_from_slice(&column[..directions]);
            let (earlier, this) = last.along.split_at_mut(start);
            if let Some(length) = orthogonalise(earlier, this, DEPENDENT) {
                let scale = 1.0 / length.sqrt();
                this.iter_mut().for_each(|t| *t *= scale);
            } else {
                last.along.truncate(start);
            }
        }
        let count = last.along.len() / directions.max(1);
        while self.limits_along.len() <= count {
            let freedom = self.limits_along.len().max(1) as f64;
            let limit =
                |probability: f64| chi_square_quantile(freedom, 1.0 - probability).unwrap_or(0.0) * self.variance;
            self.limits_along.push([ANEW_ALONG, JUMP_ALONG].map(limit));
        }
        let limits = self.limits_along[count];
        last.limit_first = limits[0];
        last.limit_along = limits[usize::from(self.most > 1)];
    }

    /// Forgets it: the next frame that is not nothing is new.
    pub(crate) fn forget(&mut self) {
        self.remembers = false;
    }
}
