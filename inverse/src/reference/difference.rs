//! What changed against a baseline, in volts of the model.

use nalgebra::DVector;

/// A normalised difference.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// `V_model (V / V_baseline - 1)`; 0 where the value is not used.
    pub y: DVector<f64>,
    /// Which values take part.
    pub used: Vec<bool>,
    /// Noise of every value relative to the others: `V_model / V_baseline` over its median.
    pub spread: Vec<f64>,
}

/// A baseline below this fraction of its median is too small to divide by.
const LEAST_BASELINE: f64 = 1e-3;

impl Difference {
    /// Of a frame (any unit) to its baseline (the same unit), all of one length.
    ///
    /// Values that are not finite, in either, and values whose baseline is too small to divide by are left out.
    pub(crate) fn new(model_v: &[f64], baseline: &[f64], frame: &[f64]) -> Self {
        let mut sizes: Vec<f64> = baseline.iter().map(|v| v.abs()).filter(|v| v.is_finite()).collect();
        sizes.sort_by(f64::total_cmp);
        let least = sizes.get(sizes.len() / 2).map_or(f64::INFINITY, |m| LEAST_BASELINE * m);
        let used: Vec<bool> = baseline
            .iter()
            .zip(frame)
            .map(|(b, v)| b.is_finite() && v.is_finite() && b.abs() > least)
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

    fn fill(&mut self, model_v: &[f64], baseline: &[f64], frame: &[f64]) {
        let volts = model_v.iter().zip(baseline).zip(frame);
        for ((y, used), ((m, b), v)) in self.y.iter_mut().zip(&self.used).zip(volts) {
            *y = if *used { m * (v / b - 1.0) } else { 0.0 };
        }
    }
}

/// Differences to one baseline after another: what only depends on the baseline is kept.
#[derive(Clone, Debug, Default)]
pub(crate) struct Differences {
    baseline: Vec<f64>,
    /// That of the baseline to itself.
    nothing: Option<Difference>,
    now: Option<Difference>,
    baselines: usize,
}

impl Differences {
    /// How many baselines there were.
    pub(crate) fn baselines(&self) -> usize {
        self.baselines
    }

    /// See [`Difference::new`]; nothing is allocated where the baseline is the last one and all values are finite that can be.
    pub(crate) fn to(&mut self, model_v: &[f64], baseline: &[f64], frame: &[f64]) -> &mut Difference {
        // Bit by bit: values that are no number are equal to themselves.
        let same = self.baseline.len() == baseline.len()
            && self
                .baseline
                .iter()
                .zip(baseline)
                .all(|(a, b)| a.to_bits() == b.to_bits());
        if !same {
            self.baseline = baseline.to_vec();
            self.nothing = None;
            self.baselines += 1;
        }
        let nothing = self
            .nothing
            .get_or_insert_with(|| Difference::new(model_v, baseline, baseline));
        let whole = nothing.used.iter().zip(frame).all(|(used, v)| !used || v.is_finite());
        if !whole {
            return self.now.insert(Difference::new(model_v, baseline, frame));
        }
        let now = self.now.get_or_insert_with(|| nothing.clone());
        now.used.clone_from(&nothing.used);
        now.spread.clone_from(&nothing.spread);
        now.fill(model_v, baseline, frame);
        now
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_after_the_other_is_as_each_by_itself() {
        let model = [1.0, 2.0, -3.0, 4.0, 0.5];
        let baselines = [
            [2.0, 4.0, -6.5, 8.0, 1e-9],
            [2.0, f64::NAN, 6.0, 8.0, 1.0],
            [2.0, 4.0, -6.5, 8.0, 1e-9],
        ];
        let frames = [
            [2.1, 4.2, -6.0, 7.0, 3.0],
            [2.1, f64::INFINITY, -6.0, 7.0, 3.0],
            [2.0, 4.0, 6.0, 8.5, f64::NAN],
        ];
        let mut differences = Differences::default();
        for baseline in &baselines {
            for frame in &frames {
                let alone = Difference::new(&model, baseline, frame);
                assert_eq!(
                    *differences.to(&model, baseline, frame),
                    alone,
                    "{baseline:?} {frame:?}"
                );
            }
        }
    }
}
