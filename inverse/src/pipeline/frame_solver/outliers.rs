//! Values of a frame that stand out of what its touches leave.
//!
//! Reciprocal pairs tell values that are wild beyond all others. Of many that are off by some standard deviations, each is no more than
//! the noise that the others make. But touches and drift explain a part of every value, and the median of what they leave hardly knows of
//! a few. Values far above it are left out, a few times over: a fit with weights that are 1 or 0 (reweighted least squares; Rousseeuw and
//! Leroy 1987, chapter 3).

use super::{FrameSolver, Task};
use crate::pipeline::result::FrameResult;
use crate::quality::faults::{MOST_WILD, leave_out, limit};
use crate::reference::Difference;
use crate::reference::drift::Drifting;
use crate::reference::noise::NoiseEstimate;
use crate::touches::fit::levenberg_marquardt::PARAMETERS;

/// Rounds: what was left out in one makes the next see more.
const ROUNDS: usize = 4;
/// Median magnitude of a normal variable of variance 1.
const MEDIAN: f64 = 0.674_489_75;
/// Chance that a sound value of a frame stands out. It is left out then, which costs little.
const FALSE_ALARM: f64 = 0.01;

/// What is left of each value over its spread, V; and how much that is of most of them, by the median.
struct Left {
    values: Vec<f64>,
    scale: f64,
    freedom: usize,
}

impl FrameSolver {
    /// Values of a frame that stand out of what touches leave beside a common drift; none where touches leave more than noise of most
    /// values, or where these are more than a quarter: then something else is wrong. `noise` is that of a sound value.
    pub(crate) fn outliers(&mut self, task: Task, noise: NoiseEstimate) -> Vec<usize> {
        let mut difference = task.difference.clone();
        let mut result = FrameResult::nothing(&self.imager);
        let most = difference.used.iter().filter(|used| **used).count() / MOST_WILD;
        let mut outliers = Vec::new();
        for _ in 0..ROUNDS {
            let mut solve = |solver: &mut Self, sigma: f64| {
                solver.forget_touches();
                let task = Task {
                    difference: &difference,
                    noise: Some(NoiseEstimate { sigma, ..noise }),
                    drifting: Drifting::Common,
                    changed: &[],
                    seen: false,
                    ..task
                };
                solver.solve(task, None, &mut result);
                result.changed
            };
            let mut changed = solve(self, noise.sigma);
            let misfit = self.fitter.as_ref().map_or(1.0, |f| f.last().misfit);
            if changed && misfit.is_finite() && misfit > 1.0 {
                // With the noise that they leave, touches are no more than they have to be.
                changed = solve(self, noise.sigma * misfit.sqrt());
            }
            let Some(left) = self.left(&difference, changed) else {
                break;
            };
            if !self.explains((left.scale / noise.sigma).powi(2), 1.0) {
                break;
            }
            let tries = difference.used.len();
            let largest = left.scale.max(noise.sigma) * limit(1, left.freedom, tries, FALSE_ALARM).sqrt();
            let mut used = difference.used.clone();
            let before = outliers.len();
            for (k, value) in left.values.iter().enumerate() {
                if used[k] && value.abs() > largest {
                    used[k] = false;
                    outliers.push(k);
                }
            }
            if outliers.len() == before {
                break;
            }
            leave_out(&mut difference, used);
        }
        outliers.truncate(if outliers.len() > most { 0 } else { outliers.len() });
        outliers
    }

    /// What the touches fitted last leave of a difference, or all of it where it shows none.
    fn left(&self, difference: &Difference, touched: bool) -> Option<Left> {
        let mut values = difference.y.as_slice().to_vec();
        let fitter = self.fitter.as_ref()?;
        if touched {
            fitter.take_touches_off(&mut values);
        }
        let weighted = self.weightings.current()?;
        weighted.outside(&mut values);
        let used = (0..values.len()).filter(|k| difference.used[*k]);
        let mut sizes: Vec<f64> = used.map(|k| values[k].abs()).collect();
        let discs = if touched { fitter.last().discs.len() } else { 0 };
        let explained = weighted.directions() + PARAMETERS * discs;
        let freedom = sizes.len().checked_sub(explained).filter(|freedom| *freedom > 0)?;
        let (count, middle) = (sizes.len(), sizes.len() / 2);
        let (_, median, _) = sizes.select_nth_unstable_by(middle, f64::total_cmp);
        Some(Left {
            scale: *median / MEDIAN * (count as f64 / freedom as f64).sqrt(),
            values,
            freedom,
        })
    }
}
