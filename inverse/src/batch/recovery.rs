//! Frames that are each compared with the frame just before them.
//!
//! Rubber recovers after a press, slowly (creep recovery). The frame before has dents of the presses before it, and when its own press
//! is measured a part of them has gone. So the sheet without that press is between the frame before, b, and the sheet at rest, r:
//! `b + p (r - b)`. The part p is one number for frames that were taken alike. Where a touch explains a frame, it tells that part: with
//! the right one it leaves least.

use super::{Batch, reconstructor};
use crate::pipeline::ReconstructorOptions;
use crate::reference::imager::ImagerError;
use crate::touches::fit::prior::FitOptions;

/// Fewest frames that tell it.
const FEWEST: usize = 8;
/// Frames that are tried, spread over the table.
const MOST_TRIED: usize = 30;
/// Parts that are tried: 0 and so many equal steps to 1. Between them the least is that of a parabola.
const STEPS: usize = 5;
/// By how many standard errors frames have to leave less.
const CLEAR: f64 = 2.0;
/// A sheet's value below this part of the median is too small to divide by.
const LEAST_BASELINE: f64 = 1e-3;

/// A frame and the one just before it, in any unit.
#[derive(Clone, Copy, Debug)]
pub struct OwnFrame<'a> {
    /// The sheet before.
    pub before: &'a [f64],
    /// The frame.
    pub values: &'a [f64],
}

impl OwnFrame<'_> {
    /// The frame in the unit of the sheet at rest, `r V / (b + p (r - b))`: it has the difference to that which it has to its own
    /// baseline. `recovered` is the part p, 0 to 1. Not a number where the baseline is missing or next to nothing, or where p is not 0 and
    /// the sheet at rest has the other sign.
    pub fn compared(&self, rest: &[f64], recovered: f64) -> Vec<f64> {
        let own = |(r, b): (&f64, &f64)| match recovered > 0.0 {
            true if r * b > 0.0 => b + recovered * (r - b),
            true => f64::NAN,
            false => *b,
        };
        let own: Vec<f64> = rest.iter().zip(self.before).map(own).collect();
        let mut sizes: Vec<f64> = own.iter().map(|v| v.abs()).filter(|v| v.is_finite()).collect();
        sizes.sort_by(f64::total_cmp);
        let least = sizes.get(sizes.len() / 2).map_or(f64::INFINITY, |m| LEAST_BASELINE * m);
        let values = rest.iter().zip(&own).zip(self.values);
        values
            .map(|((r, own), v)| if own.abs() > least { r * v / own } else { f64::NAN })
            .collect()
    }
}

impl Batch {
    /// The part of what the frames before differ from the sheet at `rest` that has gone in the frames themselves, 0 to 1; 0 where that
    /// cannot be told: of fewer than eight frames, and of those that follow one another.
    ///
    /// # Errors
    /// [`ImagerError::Baseline`] when a frame does not have the pattern's length.
    pub fn recovered(&self, rest: &[f64], frames: &[OwnFrame<'_>]) -> Result<f64, ImagerError> {
        let is_told = self.how.fit.is_some() && self.inspection.fault.is_none() && self.interval_s.is_none();
        if !is_told || frames.len() < FEWEST {
            return Ok(0.0);
        }
        let tried: Vec<&OwnFrame<'_>> = frames.iter().step_by(frames.len().div_ceil(MOST_TRIED)).collect();
        let at = |step: usize| step as f64 / STEPS as f64;
        // What one touch leaves of each frame with each part, however much that is: more touches look like dents.
        let single = |fit| FitOptions { most_touches: 1, ..fit };
        let mut reconstructor = reconstructor(
            &self.inspection,
            ReconstructorOptions {
                fit: self.how.fit.map(single),
                most_misfit: f64::INFINITY,
                ..self.how
            },
            self.tells_noise,
        )?;
        // By frame, then by part, as logarithms.
        let mut left: Vec<Vec<f64>> = Vec::with_capacity(tried.len());
        for frame in &tried {
            let mut of = Vec::with_capacity(STEPS + 1);
            for step in 0..=STEPS {
                let result = reconstructor.frame(&frame.compared(rest, at(step)))?;
                // What has not changed leaves its noise.
                let misfit = if result.changed { result.misfit } else { Some(1.0) };
                of.extend(misfit.map(|misfit| misfit.max(f64::MIN_POSITIVE).ln()));
            }
            // One that cannot be fitted says nothing.
            if of.len() > STEPS {
                left.push(of);
            }
        }
        if left.len() < FEWEST {
            return Ok(0.0);
        }
        let count = left.len() as f64;
        let sums: Vec<f64> = (0..=STEPS).map(|k| left.iter().map(|of| of[k]).sum()).collect();
        let best = (0..=STEPS).min_by(|a, b| sums[*a].total_cmp(&sums[*b])).unwrap_or(0);
        let mean = (sums[0] - sums[best]) / count;
        let square: f64 = left.iter().map(|of| (of[0] - of[best] - mean).powi(2)).sum();
        let error = (square / (count * (count - 1.0))).sqrt();
        if best == 0 || mean <= CLEAR * error {
            return Ok(0.0);
        }
        // Beside the ends.
        let off = match (sums.get(best - 1), sums.get(best + 1)) {
            (Some(before), Some(after)) => {
                0.5 * (before - after) / (before + after - 2.0 * sums[best]).max(f64::MIN_POSITIVE)
            }
            _ => 0.0,
        };
        Ok(at(best) + off.clamp(-0.5, 0.5) / STEPS as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_has_the_difference_to_its_own_baseline() {
        let rest = [2.0, -3.0, 5.0, 1.0];
        let own = OwnFrame {
            before: &[1.0, -6.0, 0.0, f64::NAN],
            values: &[1.1, -6.6, 1.0, 1.0],
        };
        let compared = own.compared(&rest, 0.0);
        for k in 0..2 {
            assert!((compared[k] / rest[k] - own.values[k] / own.before[k]).abs() < 1e-15);
        }
        assert!(compared[2].is_nan() && compared[3].is_nan());
        // Of a sheet that is at rest again the frame before says nothing, but where it has the other sign.
        let again = own.compared(&rest, 1.0);
        assert!((0..2).all(|k| (again[k] - own.values[k]).abs() < 1e-12), "{again:?}");
        let half = own.compared(&[-2.0, -3.0, 5.0, 1.0], 0.5);
        assert!(
            half[0].is_nan() && (half[1] + 3.0 * 6.6 / 4.5).abs() < 1e-12,
            "{half:?}"
        );
    }
}
