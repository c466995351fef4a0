//! How much a frame speaks for presses, and from when on there is one.

use crate::learned::rest::FREEDOM;

/// Prior standard deviation of a strength over the usual one: a touch may be half or twice as strong.
const STRENGTH_SD: f64 = 0.5;
/// Its inverse square.
const PRIOR: f64 = 1.0 / (STRENGTH_SD * STRENGTH_SD);

/// What a frame and the decisions about it need.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::learned) struct Evidence {
    /// What squares of residuals are divided by, since they are not independent.
    pub(in crate::learned) tempering: f64,
    /// Rise of the logarithm of the evidence from which a first press counts.
    pub(in crate::learned) first: f64,
    /// The same for every press more.
    pub(in crate::learned) more: f64,
    /// Whether a press more is settled also where there is next to no evidence for it: what single presses gain by it has to be known.
    pub(in crate::learned) thorough: bool,
}

impl Evidence {
    /// For frames of which it is known that they hold one press.
    pub(in crate::learned) const fn of_one_press(tempering: f64) -> Self {
        Self {
            tempering,
            first: f64::NEG_INFINITY,
            more: f64::INFINITY,
            thorough: false,
        }
    }

    /// Logarithm of the likelihood of a weighted sum of squares of so many residuals with a common factor of their variances,
    /// by Student's distribution: in a frame that is worse than most, everything counts less.
    pub(super) fn of(self, square: f64, log_variance: f64, channels: f64) -> f64 {
        let independent = channels / self.tempering;
        let over = square / (self.tempering * FREEDOM);
        -0.5 * (independent * log_variance + (FREEDOM + independent) * (1.0 + over).ln())
    }

    /// The sum of squares of which the likelihood, with this logarithm of the variance, is this.
    pub(super) fn square_of(self, likelihood: f64, log_variance: f64, channels: f64) -> f64 {
        let independent = channels / self.tempering;
        let left = -2.0 * likelihood - independent * log_variance;
        self.tempering * FREEDOM * (left / (FREEDOM + independent)).exp_m1()
    }

    /// Inverse prior variance of a strength, in the units of squares of residuals.
    pub(super) fn prior(self) -> f64 {
        PRIOR * self.tempering
    }
}
