//! The change detector: does a frame show anything, and anything new?
//!
//! With the noise and the baseline known, most frames need no reconstruction. A frame of the untouched sheet has only noise in
//! the directions in which touches show. A frame of a scene at rest differs from the last one reconstructed by the noise of
//! both. Both are chi-square tests on the leading directions of the weighted sensitivity: one product with a small matrix.
//!
//! In the second test the sum over all directions would hide a slow move among the noise. The part of the difference along
//! the touches' own parameters is therefore tested by itself, at a quantile that noise often exceeds: a reconstruction too
//! many costs time, a touch that lags behind costs accuracy.
//!
//! Frames of a scene at rest that are measured one after another are averaged. When as many have come as the last result is
//! of, the mean of both is reconstructed. The mean of the most frames is followed by the mean of as many new ones. One
//! reconstruction too many then costs accuracy as well, so noise seldom exceeds those quantiles. The first frames are the
//! exception: they may be the last of a touch that comes down. A drift too slow to show in one frame shows in a mean: of 2,
//! 4, 8 frames and so on, those since the last result are compared with those before. Where they differ they alone count. Where
//! places change so twice, the same way, touches slide: every frame is new until they rest.

use crate::change::rest_mean::RestMean;
use crate::change::slide::Slide;
use crate::linalg::basis::orthogonalise;
use crate::linalg::vector::{dot, square};
use crate::solvers::{Problem, Projector};
use crate::stats::chi_square_quantile;
use crate::touches::fit::levenberg_marquardt::PARAMETERS;

/// Thresholds of the change detector.
///
/// The probabilities were chosen by hand on `cargo run --release -p studies --example rest` (errors of scenes at rest, last
/// columns) and `skin bench cost` (row "four fingers, still"). docs/results.md has the tables.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChangeOptions {
    /// Directions in which a cell of the expected rise gives less than this part of the noise are not tested. Less makes the
    /// test dearer, more blunts it for weak touches.
    pub least_signal: f64,
    /// Fewest directions tested.
    pub least_directions: usize,
    /// Probability that noise alone makes a frame of a scene at rest new, by all directions together, where frames are not
    /// averaged. One reconstruction too many then costs time only.
    pub anew_anywhere: f64,
    /// The same by the directions along the touches' parameters. More costs time, less makes slow touches lag.
    pub anew_along: f64,
    /// The same as `anew_anywhere` where frames are averaged: one reconstruction too many then costs accuracy as well.
    pub jump_anywhere: f64,
    /// The same as `anew_along` where frames are averaged.
    pub jump_along: f64,
    /// A mean of at most so many frames takes more in at the quantile of `anew_along`: they may be the last of a touch that
    /// comes down.
    pub first_frames: usize,
    /// Most frames of a mean, a power of two. The error falls with its root; a press creeps meanwhile.
    pub most_frames: usize,
    /// How often a mean is reconstructed once more, where its fit did not come to its end.
    pub most_rounds: usize,
}

impl Default for ChangeOptions {
    fn default() -> Self {
        Self {
            least_signal: 0.3,
            least_directions: 8,
            anew_anywhere: 0.01,
            anew_along: 0.1,
            jump_anywhere: 0.001,
            jump_along: 0.003,
            first_frames: 2,
            most_frames: 16,
            most_rounds: 2,
        }
    }
}

/// A direction of which less than this part (of its square) is new lies in those before it.
const DEPENDENT: f64 = 1e-18;
/// Parameters of a touch's place: the first of [`PARAMETERS`].
const PLACE: usize = 2;

/// What a frame turns out to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Change {
    /// Nothing but noise against the baseline.
    Nothing,
    /// Nothing but noise against the frame, or the mean, reconstructed last.
    Same,
    /// Nothing that shows in a frame, and [`ChangeDetector::rest`] is to be reconstructed.
    Mean,
    /// Something to reconstruct.
    New,
}

/// By how much the variance of a frame's own noise is larger where that of its difference to the baseline is `stretch` times as large.
pub(crate) fn own_stretch(stretch: f64, baseline_share: f64) -> f64 {
    stretch * (1.0 + baseline_share) - baseline_share
}

/// The frame reconstructed last.
#[derive(Clone, Debug, Default)]
struct Last {
    reduced: Vec<f64>,
    /// Orthonormal directions along the touches' parameters, one after the other: first along sizes and strengths. From this entry on they
    /// are along what places do besides.
    along: Vec<f64>,
    places_from: usize,
    limit_along: f64,
    limit_first: f64,
    limit_places: f64,
}

impl Last {
    /// Whether `share` times a reduced sum of frames differs by nothing but noise, in all directions and in those along the
    /// touches. `before` is the variance of this frame's noise, over that of one frame.
    fn is_same(&self, sum: &[f64], share: f64, before: f64, limit: f64, limit_along: f64) -> bool {
        let (mut change, mut along) = (0.0, 0.0);
        for (a, b) in sum.iter().zip(&self.reduced) {
            change += (share * a - b) * (share * a - b);
        }
        for q in self.along.chunks_exact(sum.len()) {
            let each = q.iter().zip(sum).zip(&self.reduced);
            let part: f64 = each.map(|((q, a), b)| q * (share * a - b)).sum();
            along += part * part;
        }
        let noise = share + before;
        change <= noise * limit && along <= noise * limit_along
    }

    /// Adds the part of a direction that is new.
    fn add_along(&mut self, direction: &[f64]) {
        let start = self.along.len();
        self.along.extend_from_slice(direction);
        let (earlier, this) = self.along.split_at_mut(start);
        if let Some(length) = orthogonalise(earlier, this, DEPENDENT) {
            let scale = 1.0 / length.sqrt();
            this.iter_mut().for_each(|t| *t *= scale);
        } else {
            self.along.truncate(start);
        }
    }

    /// Product of the parts of two differences along the touches' places. What sizes and strengths do as well is no part of them.
    fn along_places(&self, a: &[f64], b: &[f64]) -> f64 {
        let places = self.along.get(self.places_from..).unwrap_or_default();
        places.chunks_exact(a.len()).map(|q| dot(q, a) * dot(q, b)).sum()
    }
}

/// Looks at frames against one baseline at one noise.
#[derive(Clone, Debug)]
pub(crate) struct ChangeDetector {
    options: ChangeOptions,
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
    rest: RestMean,
    slide: Slide,
    /// Variance of one frame's noise, and the baseline's over it.
    variance: f64,
    baseline_share: f64,
    /// Limits along so many directions (often, seldom exceeded by noise), as far as they were needed.
    limits_along: Vec<[f64; 2]>,
}

impl ChangeDetector {
    /// `weights` are gain and offset: a frame v is weighted as `gain v - offset`, 0 where a value is left out. `sigma` is the
    /// noise of one value of the difference, `baseline_share` the variance of the baseline's noise over that of one frame's,
    /// `signal` the rise expected of a cell over the noise, `false_alarm` the probability that noise alone is a change.
    pub(crate) fn new(
        problem: &Problem,
        weights: (Vec<f64>, Vec<f64>),
        sigma: f64,
        baseline_share: f64,
        signal: f64,
        false_alarm: f64,
        options: ChangeOptions,
    ) -> Option<Self> {
        let (gain, offset) = weights;
        let strong = problem
            .singular()
            .iter()
            .filter(|s| *s * signal >= options.least_signal)
            .count();
        let projector = Projector::new(problem, strong.max(options.least_directions));
        let quantile = |probability: f64| chi_square_quantile(projector.directions() as f64, 1.0 - probability);
        let variance = 1.0 / (1.0 + baseline_share) * sigma * sigma;
        let [anew, jump] = [quantile(options.anew_anywhere)?, quantile(options.jump_anywhere)?];
        Some(Self {
            options,
            used: gain.iter().filter(|g| **g != 0.0).count(),
            limit: quantile(false_alarm)? * sigma * sigma,
            limits_same: [anew * variance, jump * variance],
            gain,
            offset,
            projector,
            last: Last::default(),
            remembers: false,
            most: 1,
            rest: RestMean::default(),
            slide: Slide::default(),
            variance,
            baseline_share,
            limits_along: Vec::new(),
        })
    }

    /// How many values take part.
    pub(crate) fn used(&self) -> usize {
        self.used
    }

    /// Tests a frame. At most so many frames at rest are averaged; fewer than two average nothing. A frame with a value that
    /// is no number where there should be one is new. `stretch`: the variance of the difference's noise over the usual one.
    pub(crate) fn test(&mut self, frame: &[f64], most_averaged: usize, stretch: f64) -> Change {
        self.most = most_averaged.min(self.options.most_frames);
        let change = self.look(frame, stretch);
        match change {
            Change::Nothing => self.forget(),
            Change::New => {
                self.remembers = false;
                self.rest.begin(frame);
            }
            Change::Mean => self.remembers = false,
            Change::Same => {}
        }
        change
    }

    fn look(&mut self, frame: &[f64], stretch: f64) -> Change {
        if frame.len() != self.gain.len() {
            return Change::New;
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
        let square = square(reduced);
        if square <= stretch * self.limit {
            return Change::Nothing;
        }
        if !square.is_finite() {
            return Change::New;
        }
        let (last, rest) = (&self.last, &mut self.rest);
        // Two frames have the same baseline.
        let own = own_stretch(stretch, self.baseline_share);
        let along_places = |a: &[f64], b: &[f64]| last.along_places(a, b);
        self.slide.take(reduced, own * last.limit_places, along_places);
        if !self.remembers || (self.most > 1 && self.slide.is_on()) {
            return Change::New;
        }
        let limit = self.limits_same[usize::from(self.most > 1)];
        let same = |sum: &[f64], share: f64, before: f64, along: f64| {
            last.is_same(sum, share, before, own * limit, own * along)
        };
        let before = 1.0 / rest.frames().max(1) as f64;
        let note_move = |slide: &mut Slide, sum: &[f64], share: f64| {
            let by = sum.iter().zip(&last.reduced).map(|(a, b)| share * a - b);
            let limit = own * (share + before) * last.limit_places;
            slide.note(self.most, by, limit, along_places);
        };
        if !same(reduced, 1.0, before, last.limit_along) {
            if self.most > 1 {
                note_move(&mut self.slide, reduced, 1.0);
            }
            return Change::New;
        }
        if self.most < 2 {
            return Change::Same;
        }
        if rest.take_again() {
            return Change::Mean;
        }
        rest.add(frame, reduced);
        let (since, frames) = (rest.since(), rest.frames());
        let all = since >= frames;
        let is_first = all && frames <= self.options.first_frames;
        let limit_along = if is_first { last.limit_first } else { last.limit_along };
        let share = 1.0 / since as f64;
        let drifts = since.is_power_of_two() && !same(rest.reduced_sum(), share, before, limit_along);
        if !drifts && !all {
            return Change::Same;
        }
        // The end of a touch that comes down is no slide, and noise often looks like it.
        if drifts && !is_first {
            note_move(&mut self.slide, rest.reduced_sum(), share);
            if self.slide.is_on() {
                return Change::New;
            }
        }
        rest.renew(!drifts && 2 * frames <= self.most);
        Change::Mean
    }

    /// The frames at rest.
    pub(crate) fn rest(&self) -> &RestMean {
        &self.rest
    }

    /// The mean is to be reconstructed once more, with the next frame that is the same.
    pub(crate) fn once_more(&mut self) {
        self.rest.once_more(self.options.most_rounds);
    }

    /// Remembers the frame looked at last as reconstructed, with the directions (in the problem's reduced space) in which
    /// the parameters of its touches move it: columns of `stride` entries.
    pub(crate) fn remember(&mut self, reduced: &[f64], slopes: &[f64], stride: usize) {
        let directions = self.projector.directions();
        // What it has not looked at it cannot take the mean of.
        let has_seen = self.rest.frames() > 0;
        self.remembers = has_seen && stride >= directions && reduced.len() >= directions && !slopes.is_empty();
        if !self.remembers {
            return;
        }
        let last = &mut self.last;
        last.reduced.clear();
        last.reduced.extend_from_slice(&reduced[..directions]);
        last.along.clear();
        let columns = || slopes.chunks_exact(stride).enumerate();
        let is_place = |k: usize| k % PARAMETERS < PLACE;
        for (_, column) in columns().filter(|(k, _)| !is_place(*k)) {
            last.add_along(&column[..directions]);
        }
        last.places_from = last.along.len();
        for (_, column) in columns().filter(|(k, _)| is_place(*k)) {
            last.add_along(&column[..directions]);
        }
        let count = last.along.len() / directions.max(1);
        while self.limits_along.len() <= count {
            let freedom = self.limits_along.len().max(1) as f64;
            let limit =
                |probability: f64| chi_square_quantile(freedom, 1.0 - probability).unwrap_or(0.0) * self.variance;
            self.limits_along
                .push([self.options.anew_along, self.options.jump_along].map(limit));
        }
        let limits = self.limits_along[count];
        last.limit_places = self.limits_along[(last.along.len() - last.places_from) / directions.max(1)][0];
        last.limit_first = limits[0];
        last.limit_along = limits[usize::from(self.most > 1)];
    }

    /// Forgets it, and the frames at rest: the next frame that is not nothing is new.
    pub(crate) fn forget(&mut self) {
        self.remembers = false;
        self.rest.end();
        self.slide.end();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

    /// The mean of no frame is none: what a detector is told of a frame that it has not looked at, or has forgotten, makes it take none.
    #[test]
    fn a_frame_that_was_not_looked_at_is_no_mean() {
        let values = 12;
        let sensitivity = DMatrix::from_fn(values, 30, |i, j| ((1.0 + i as f64) * (0.3 + j as f64)).sin());
        let problem = Problem::new(&sensitivity, 0.0);
        let weights = (vec![1.0; values], vec![1.0; values]);
        let options = ChangeOptions::default();
        let mut detector = ChangeDetector::new(&problem, weights, 1e-3, 0.0, 1e3, 1e-6, options).unwrap();
        let frame: Vec<f64> = (0..values).map(|k| 1.0 + (k as f64).cos()).collect();
        let reduced = detector
            .projector
            .project(|out| out.iter_mut().zip(&frame).for_each(|(out, v)| *out = v - 1.0))
            .to_vec();
        let told = |detector: &mut ChangeDetector| {
            detector.remember(&reduced, &reduced, reduced.len());
            detector.once_more();
        };
        told(&mut detector);
        assert_eq!(detector.test(&frame, 16, 1.0), Change::New);
        told(&mut detector);
        assert_eq!(detector.test(&frame, 16, 1.0), Change::Mean);
        assert_eq!(detector.rest().mean(), frame);
        detector.forget();
        told(&mut detector);
        assert_eq!(detector.test(&frame, 16, 1.0), Change::New);
        // A frame with nothing in it is not averaged either.
        told(&mut detector);
        assert_eq!(detector.test(&vec![1.0; values], 16, 1.0), Change::Nothing);
        told(&mut detector);
        assert_eq!(detector.test(&frame, 16, 1.0), Change::New);
    }
}
