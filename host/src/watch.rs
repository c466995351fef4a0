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
use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Directions in which a cell of the expected rise gives less than this part of the noise are not looked at.
const LEAST_SIGNAL: f64 = 0.3;
const LEAST_DIRECTIONS: usize = 8;
/// Probability that a scene at rest is reconstructed again because of all directions together, and because of those
/// along the touches.
const ANEW_ANYWHERE: f64 = 0.01;
const ANEW_ALONG: f64 = 0.1;

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
#[derive(Clone, Debug)]
struct Last {
    reduced: Vec<f64>,
    /// Orthonormal directions along the touches' parameters, one after the other.
    along: Vec<Vec<f64>>,
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
    last: Option<Last>,
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
            last: None,
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
        let Some(last) = &self.last else {
            return Seen::New;
        };
        let mut change = 0.0;
        for (a, b) in reduced.iter().zip(&last.reduced) {
            change += (a - b) * (a - b);
        }
        let along: f64 = last
            .along
            .iter()
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
    /// the parameters of its touches move it.
    pub(crate) fn remember(&mut self, reduced: &DVector<f64>, slopes: Option<&DMatrix<f64>>) {
        let directions = self.projector.directions();
        self.last = slopes
            .filter(|s| s.nrows() >= directions && s.ncols() > 0)
            .and_then(|slopes| {
                let q = slopes.rows(0, directions).into_owned().qr().q();
                let limit = ChiSquared::new(q.ncols() as f64).ok()?.inverse_cdf(1.0 - ANEW_ALONG);
                Some(Last {
                    reduced: reduced.iter().take(directions).copied().collect(),
                    along: q.column_iter().map(|c| c.iter().copied().collect()).collect(),
                    limit_along: 2.0 * limit * self.sigma * self.sigma,
                })
            });
    }

    /// Forgets it: the next frame that is not nothing is new.
    pub(crate) fn forget(&mut self) {
        self.last = None;
    }
}

fn square(values: &[f64]) -> f64 {
    values.iter().map(|v| v * v).sum()
}
