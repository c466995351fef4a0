//! One press more beside some at their nodes: how well it explains a frame at every node.

use super::{Evidence, Locator, Reduced};
use crate::learned::rest::variance;
use crate::linalg::aligned::Aligned;
use nalgebra::{Cholesky, DMatrix, DVector};

/// A press at a node beside others: the sum of squares that is left, its strength, and the square of its map beside the others'.
pub(super) struct Fit {
    pub(super) square: f64,
    strength: f64,
    whole: f64,
}

/// A frame, and presses at some nodes beside which one more is looked for.
pub(super) struct Beside {
    pub(super) frame: Aligned,
    maps: Vec<Aligned>,
    /// Inverse of the normal equations of the others' strengths, times their right side; and the inverse.
    strengths: DVector<f64>,
    inverse: DMatrix<f64>,
    /// What is left of the frame by the others alone.
    square: f64,
    /// Variance of what they and the electronics leave.
    pub(super) variance: f64,
    pub(super) prior: f64,
}

impl Beside {
    pub(super) fn new(locator: &Locator, frame: &Reduced, others: &[usize], evidence: Evidence) -> Option<Self> {
        let (n, prior) = (others.len(), evidence.prior());
        let map = |k: usize| DVector::from_column_slice(locator.map(others[k]));
        let normal = DMatrix::from_fn(n, n, |i, j| map(i).dot(&map(j)) + if i == j { prior } else { 0.0 });
        let right = DVector::from_fn(n, |i, _| map(i).dot(&frame.along) + prior);
        let inverse = Cholesky::new(normal)?.inverse();
        let strengths = &inverse * &right;
        // With a prior of 1 for every strength, that of the press looked for included.
        let square = frame.along.norm_squared() + frame.outside + prior * (n + 1) as f64 - strengths.dot(&right);
        let presses: Vec<_> = (others.iter().zip(&strengths))
            .map(|(k, a)| (*a, locator.uncertainty[*k]))
            .collect();
        Some(Self {
            frame: locator.padded(frame.along.as_slice()),
            maps: others.iter().map(|k| locator.padded(locator.map(*k))).collect(),
            strengths,
            inverse,
            square,
            variance: variance(locator.proportional, &presses),
            prior,
        })
    }

    /// Variance of what is left beside a press there. It grows with the press.
    fn variance_with(&self, locator: &Locator, node: usize, fit: &Fit) -> f64 {
        self.variance + fit.strength * fit.strength * (locator.proportional + locator.uncertainty[node])
    }

    /// What presses at some nodes leave, in variances.
    pub(super) fn squares(&self, locator: &Locator, nodes: &[usize], fits: &[Fit]) -> Vec<f64> {
        (nodes.iter().zip(fits))
            .map(|(k, fit)| fit.square / self.variance_with(locator, *k, fit))
            .collect()
    }

    /// Logarithm of the evidence for a press at a node.
    pub(super) fn score(&self, locator: &Locator, node: usize, fit: &Fit, evidence: Evidence) -> f64 {
        let variance = self.variance_with(locator, node, fit);
        // What speaks against its strength does not shrink with the rest's growth.
        let unusual = self.prior * (fit.strength - 1.0).powi(2);
        let square = (fit.square - unusual) / variance + unusual;
        evidence.of(square, variance.ln(), locator.channels()) - 0.5 * (fit.whole / self.prior).ln()
    }

    /// A press at each of some nodes, with the best strengths of all.
    pub(super) fn fits(&self, locator: &Locator, nodes: &[usize]) -> Vec<Fit> {
        let along = locator.products(nodes, &self.frame);
        let crossings: Vec<Vec<f64>> = self.maps.iter().map(|m| locator.products(nodes, m)).collect();
        let fit = |(place, (k, product)): (usize, (&usize, &f64))| {
            let (mut right, mut whole) = (*product + self.prior, locator.squares[*k] + self.prior);
            for (o, crossing) in crossings.iter().enumerate() {
                right -= crossing[place] * self.strengths[o];
                for (p, other) in crossings.iter().enumerate() {
                    whole -= crossing[place] * self.inverse[(o, p)] * other[place];
                }
            }
            let whole = whole.max(self.prior);
            Fit {
                square: self.square - right * right / whole,
                strength: right / whole,
                whole,
            }
        };
        nodes.iter().zip(&along).enumerate().map(fit).collect()
    }
}
