//! The cheap look at a frame: is there anything, and is there anything new?
//!
//! With the noise and the baseline known, most frames need no reconstruction. A frame of the untouched sheet has only noise in the
//! directions in which touches show; a frame of a scene at rest differs from the last one reconstructed by the noise of
//! both. Both are chi-square tests on the leading directions of the weighted sensitivity, one product with a small matrix.
//!
//! For the second test the sum over all directions would hide a slow move among the noise, so the part of the
//! difference along the touches' own parameters is tested by itself, at a quantile that noise often exceeds: a reconstruction
//! too many costs time, a touch that lags behind costs accuracy.

use crate::reconstruct::{Problem, Projector};
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Directions in which a cell of the expected rise gives less than this part of the noise are not looked at.
const LEAST_SIGNAL: f64 = 0.3;
const LEAST_DIRECTIONS: usize = 8;
/// Probability that a scene at rest is reconstructed again because of all directions together, and because of those
/// along the touches.
const ANEW_ANYWHERE: f64 = 0.01;
const ANEW_ALONG: f64 = 0.1;
/// A direction of which less than this part (of its square) is new lies in those before it.
const DEPENDENT: f64 = 1e-18;

/// What a frame turns out to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Seen {
    /// Nothing but noise against the baseline.
    Nothing,
    /// Nothing but noise against the frame reconstructed last.
    Same,
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
    limit_same: f64,
    last: Last,
    /// Whether `last` is meant.
    remembers: bool,
    /// Limits along so many directions, as far as they were needed.
    limits_along: Vec<f64>,
}

impl Watch {
    /// `gain` and `offset`: a frame v is weighted as `gain v - offset`, 0 where a value is left out. `signal` is the rise
    /// expected of a cell over the noise.
    pub(crate) fn new(
        problem: &Problem,
        baseline: &[f64],
        weights: (Vec<f64>, Vec<f64>),
        sigma: f64,
        signal: f64,
        false_alarm: f64,
    ) -> Option<Self> {
        let (gain, offset) = weights;
        let strong = problem
            .singular()
            .iter()
            .filter(|s| *s * signal >= LEAST_SIGNAL)
            .count();
        let projector = Projector::new(problem, strong.max(LEAST_DIRECTIONS));
        let chi_square = ChiSquared::new(projector.directions() as f64).ok()?;
        Some(Self {
            used: gain.iter().filter(|g| **g != 0.0).count(),
            limit: chi_square.inverse_cdf(1.0 - false_alarm) * sigma * sigma,
            limit_same: 2.0 * chi_square.inverse_cdf(1.0 - ANEW_ANYWHERE) * sigma * sigma,
            baseline: baseline.to_vec(),
            sigma,
            gain,
            offset,
            projector,
            last: Last::default(),
            remembers: false,
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
        let last = &self.last;
        let mut change = 0.0;
        for (a, b) in reduced.iter().zip(&last.reduced) {
            change += (a - b) * (a - b);
        }
        let along: f64 = last
            .along
            .chunks_exact(reduced.len())
            .map(|q| {
                let dot: f64 = q
                    .iter()
                    .zip(reduced)
                    .zip(&last.reduced)
                    .map(|((q, a), b)| q * (a - b))
                    .sum();
                dot * dot
            })
            .sum();
        if change <= self.limit_same && along <= last.limit_along {
            Seen::Same
        } else {
            Seen::New
        }
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
            let before = square(this);
            // Gram and Schmidt, twice: then they are orthogonal to rounding.
            for _ in 0..2 {
                for q in earlier.chunks_exact(directions) {
                    let part = dot(q, this);
                    this.iter_mut().zip(q).for_each(|(t, q)| *t -= part * q);
                }
            }
            let length = square(this);
            if length > DEPENDENT * before {
                let scale = 1.0 / length.sqrt();
                this.iter_mut().for_each(|t| *t *= scale);
            } else {
                last.along.truncate(start);
            }
        }
        let count = last.along.len() / directions.max(1);
        while self.limits_along.len() <= count {
            let freedom = self.limits_along.len().max(1) as f64;
            let limit = ChiSquared::new(freedom).map_or(0.0, |c| c.inverse_cdf(1.0 - ANEW_ALONG));
            self.limits_along.push(2.0 * limit * self.sigma * self.sigma);
        }
        last.limit_along = self.limits_along[count];
    }

    /// Forgets it: the next frame that is not nothing is new.
    pub(crate) fn forget(&mut self) {
        self.remembers = false;
    }
}

fn square(values: &[f64]) -> f64 {
    dot(values, values)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
