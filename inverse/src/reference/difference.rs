//! What changed against a baseline, in volts of the model.

use nalgebra::DVector;

/// A normalised difference.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// `V_model (V / V_baseline - 1)`; 0 where the value is not used.
    pub y: DVector<f64>,
    /// Which values take part.
    pub used: Vec<bool>,
    /// Noise of every value relative to the others: `V_model / V_baseline` over its median, times that of the value in the baseline
    /// over that of all ([`Baseline::own_noise`](crate::reference::baseline::Baseline::own_noise)) where that is known.
    pub spread: Vec<f64>,
}

/// A baseline below this fraction of its median is too small to divide by.
const LEAST_BASELINE: f64 = 1e-3;
/// A value of more than this many times the baseline is no measurement: no converter has such a range, and its rounding would hide others.
const LARGEST_CHANGE: f64 = 1e12;

/// Whether a frame's value can be compared with that of the baseline.
pub(super) fn is_measured(value: f64, baseline: f64) -> bool {
    // A comparison with what is no number is false.
    value.abs() <= LARGEST_CHANGE * baseline.abs() && baseline.is_finite()
}

impl Difference {
    /// Leaves values out.
    pub(crate) fn leave_out(&mut self, values: impl IntoIterator<Item = usize>) {
        for k in values {
            (self.used[k], self.y[k]) = (false, 0.0);
        }
    }

    /// Of a frame (any unit) to its baseline (the same unit), all of one length.
    ///
    /// Values are left out that are not finite in either, those beyond any converter's range, and those whose baseline is too small to
    /// divide by.
    pub(crate) fn new(model_v: &[f64], baseline: &[f64], frame: &[f64]) -> Self {
        let mut sizes: Vec<f64> = baseline.iter().map(|v| v.abs()).filter(|v| v.is_finite()).collect();
        sizes.sort_by(f64::total_cmp);
        let least = sizes.get(sizes.len() / 2).map_or(f64::INFINITY, |m| LEAST_BASELINE * m);
        let used: Vec<bool> = baseline
            .iter()
            .zip(frame)
            .map(|(b, v)| is_measured(*v, *b) && b.abs() > least)
            .collect();
        let mut spread: Vec<f64> = model_v
            .iter()
            .zip(baseline)
            .zip(&used)
            .map(|((m, b), used)| if *used { (m / b).abs() } else { 1.0 })
            .collect();
        let mut gains: Vec<f64> = spread.iter().zip(&used).filter(|(_, u)| **u).map(|(s, _)| *s).collect();
        gains.sort_by(f64::total_cmp);
        let median = gains.get(gains.len() / 2).copied().unwrap_or(1.0);
        for (s, used) in spread.iter_mut().zip(&used) {
            *s = if *used { *s / median } else { 1.0 };
        }
        let mut difference = Self {
            y: DVector::zeros(model_v.len()),
            used,
            spread,
        };
        difference.fill(model_v, baseline, frame);
        difference
    }

    /// What changed, over the unpressed values that take part: 2-norms.
    pub(crate) fn part_of(&self, model_v: &[f64]) -> f64 {
        let (mut change, mut all) = (0.0, 0.0);
        for ((y, v), _) in self.y.iter().zip(model_v).zip(&self.used).filter(|(_, used)| **used) {
            change += y * y;
            all += v * v;
        }
        (change / all).sqrt()
    }

    /// Makes it another, without allocation where that is no larger.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.y.copy_from(&other.y);
        self.used.clone_from(&other.used);
        self.spread.clone_from(&other.spread);
    }

    /// Gives it the values of another frame; which take part stays.
    pub(crate) fn fill(&mut self, model_v: &[f64], baseline: &[f64], frame: &[f64]) {
        let volts = model_v.iter().zip(baseline).zip(frame);
        for ((y, used), ((m, b), v)) in self.y.iter_mut().zip(&self.used).zip(volts) {
            *y = if *used { m * (v / b - 1.0) } else { 0.0 };
        }
    }
}
