//! Frames that are each compared with the frame just before them.
//!
//! Rubber recovers after a press, slowly (creep recovery). The frame before has dents of the presses before it, and when its own press
//! is measured a part of them has gone. So the sheet without that press is between the frame before, b, and the sheet without dents, u:
//! `b + p (u - b)`. The part p is one number for frames that were taken alike. Often nobody has seen the sheet without dents. The mean of
//! the frames before, r, then has the mean of all dents, which is like the mean press, but shallower. Its depth m is one number, too. The
//! mean change from before to under a press, d, is the mean press less what of the mean dent has gone: `u = r - m d / (1 - p m)`. Where a
//! touch explains a frame, it tells both numbers: with the right ones it leaves least.

use super::{Batch, reconstructor};
use crate::pipeline::ReconstructorOptions;
use crate::reference::imager::ImagerError;
use crate::touches::fit::prior::FitOptions;

/// Fewest frames that tell it.
const FEWEST: usize = 8;
/// Frames that are tried, spread over the table.
const MOST_TRIED: usize = 30;
/// Numbers that are tried: 0 and so many equal steps to the largest. Between them the least is that of a parabola.
const STEPS: usize = 5;
/// Largest part that has gone.
const MOST_GONE: f64 = 1.0;
/// Largest depth of the mean of all dents, over that of the mean press: rubber that keeps half of a press until the next one.
const MOST_DENTED: f64 = 0.5;
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

/// What of the dents in the frames before has gone in the frames themselves.
#[derive(Clone, Debug, PartialEq)]
pub struct Recovery {
    /// The part that has gone, 0 to 1.
    pub part: f64,
    /// Depth of the mean of all dents, over that of the mean press, 0 to 0.5; 0 where the sheet was seen without dents.
    pub dented: f64,
    /// The sheet without dents, in the unit of the frames.
    undented: Vec<f64>,
}

impl Recovery {
    fn new(rest: &[f64], mean: &[f64], (part, dented): (f64, f64)) -> Self {
        Self {
            part,
            dented,
            undented: (rest.iter().zip(mean))
                .map(|(r, d)| r - dented * d / (1.0 - part * dented))
                .collect(),
        }
    }
}

impl OwnFrame<'_> {
    /// The frame in the unit of the sheet at rest, `r V / (b + p (u - b))`: it has the difference to that which it has to its own
    /// baseline, without the dents that have gone. Not a number where the baseline is missing or next to nothing, or where dents have gone
    /// and the sheet without them has the other sign.
    pub fn compared(&self, rest: &[f64], recovery: Option<&Recovery>) -> Vec<f64> {
        let own: Vec<f64> = match recovery {
            Some(recovery) => (recovery.undented.iter().zip(self.before))
                .map(|(u, b)| {
                    if u * b > 0.0 {
                        b + recovery.part * (u - b)
                    } else {
                        f64::NAN
                    }
                })
                .collect(),
            None => self.before.to_vec(),
        };
        let mut sizes: Vec<f64> = own.iter().map(|v| v.abs()).filter(|v| v.is_finite()).collect();
        sizes.sort_by(f64::total_cmp);
        let least = sizes.get(sizes.len() / 2).map_or(f64::INFINITY, |m| LEAST_BASELINE * m);
        let values = rest.iter().zip(&own).zip(self.values);
        values
            .map(|((r, own), v)| if own.abs() > least { r * v / own } else { f64::NAN })
            .collect()
    }
}

/// The mean of what frames differ from those before them: 0 where no frame has a value.
fn mean_change(values: usize, frames: &[OwnFrame<'_>]) -> Vec<f64> {
    let mean = |c: usize| {
        let change = |f: &OwnFrame<'_>| Some(f.values.get(c)? - f.before.get(c)?).filter(|d| d.is_finite());
        let changes: Vec<f64> = frames.iter().filter_map(change).collect();
        changes.iter().sum::<f64>() / changes.len().max(1) as f64
    };
    (0..values).map(mean).collect()
}

/// Where on the steps frames leave least, by their sum over all frames and a parabola; and whether that is clearly less than on the first
/// step. `left` has a list for each step of what frames leave, as logarithms.
fn least(left: &[Vec<f64>], largest: f64) -> (f64, bool) {
    let count = left[0].len() as f64;
    let sums: Vec<f64> = left.iter().map(|of| of.iter().sum()).collect();
    let best = (0..sums.len())
        .min_by(|a, b| sums[*a].total_cmp(&sums[*b]))
        .unwrap_or(0);
    if best == 0 {
        return (0.0, false);
    }
    let mean = (sums[0] - sums[best]) / count;
    let square: f64 = (left[0].iter().zip(&left[best]))
        .map(|(first, best)| (first - best - mean).powi(2))
        .sum();
    let error = (square / (count * (count - 1.0))).sqrt();
    // Beside the ends.
    let off = match (sums.get(best - 1), sums.get(best + 1)) {
        (Some(before), Some(after)) => {
            0.5 * (before - after) / (before + after - 2.0 * sums[best]).max(f64::MIN_POSITIVE)
        }
        _ => 0.0,
    };
    let off = if off.is_finite() { off.clamp(-0.5, 0.5) } else { 0.0 };
    let at = largest * (best as f64 + off) / STEPS as f64;
    (at, mean > CLEAR * error)
}

impl Batch {
    /// What of the dents in the frames before has gone in the frames themselves. `rest` is the sheet without dents (`is_undented`), or the
    /// mean of the frames before. None where that cannot be told: of fewer than eight frames, and of those that follow one another.
    ///
    /// # Errors
    /// [`ImagerError::Baseline`] when a frame does not have the pattern's length.
    pub fn recovered(
        &self,
        rest: &[f64],
        is_undented: bool,
        frames: &[OwnFrame<'_>],
    ) -> Result<Option<Recovery>, ImagerError> {
        let is_told = self.how.fit.is_some() && self.inspection.fault.is_none() && self.interval_s.is_none();
        if !is_told || frames.len() < FEWEST {
            return Ok(None);
        }
        let count = frames.len().min(MOST_TRIED);
        let mut tried: Vec<&OwnFrame<'_>> = (0..count).map(|k| &frames[k * frames.len() / count]).collect();
        let mean = mean_change(rest.len(), frames);
        // What one touch leaves of each frame, however much that is: more touches look like dents.
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
        let mut leaves = |frame: &OwnFrame<'_>, numbers: (f64, f64)| -> Result<Option<f64>, ImagerError> {
            let recovery = (numbers.0 > 0.0).then(|| Recovery::new(rest, &mean, numbers));
            let result = reconstructor.frame(&frame.compared(rest, recovery.as_ref()))?;
            // What has not changed leaves its noise.
            let misfit = if result.changed { result.misfit } else { Some(1.0) };
            Ok(misfit.map(|misfit| misfit.max(f64::MIN_POSITIVE).ln()))
        };
        let mut found = (0.0, 0.0);
        // The part, then the mean dent, then the part beside it.
        let passes = if is_undented {
            &[false][..]
        } else {
            &[false, true, false]
        };
        for &of_dents in passes {
            let mut left: Vec<Vec<f64>> = vec![Vec::new(); STEPS + 1];
            let mut fitted = Vec::with_capacity(tried.len());
            for frame in &tried {
                let mut of = Vec::with_capacity(STEPS + 1);
                for step in 0..=STEPS {
                    let at = step as f64 / STEPS as f64;
                    let numbers = match of_dents {
                        true => (found.0, at * MOST_DENTED),
                        false => (at * MOST_GONE, found.1),
                    };
                    of.extend(leaves(frame, numbers)?);
                }
                // One that cannot be fitted says nothing.
                if of.len() > STEPS {
                    left.iter_mut().zip(of).for_each(|(list, value)| list.push(value));
                    fitted.push(*frame);
                }
            }
            if fitted.len() < FEWEST {
                break;
            }
            tried = fitted;
            if of_dents {
                // Where dents recover there are some.
                (found.1, _) = least(&left, MOST_DENTED);
                if found.1 == 0.0 {
                    break;
                }
            } else if let (part, true) = least(&left, MOST_GONE) {
                found.0 = part;
            } else {
                break;
            }
        }
        Ok((found.0 > 0.0).then(|| Recovery::new(rest, &mean, found)))
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
        let compared = own.compared(&rest, None);
        for k in 0..2 {
            assert!((compared[k] / rest[k] - own.values[k] / own.before[k]).abs() < 1e-15);
        }
        assert!(compared[2].is_nan() && compared[3].is_nan());
        // A frame that lacks values tells nothing of them.
        assert!((mean_change(5, &[own])[1] + 0.6).abs() < 1e-12 && mean_change(5, &[own])[3..] == [0.0; 2]);
        // Of a sheet that is at rest again the frame before says nothing, but where it has the other sign.
        let gone = |part: f64, rest: &[f64]| own.compared(rest, Some(&Recovery::new(rest, &[0.0; 4], (part, 0.0))));
        let again = gone(1.0, &rest);
        assert!((0..2).all(|k| (again[k] - own.values[k]).abs() < 1e-12), "{again:?}");
        let half = gone(0.5, &[-2.0, -3.0, 5.0, 1.0]);
        assert!(
            half[0].is_nan() && (half[1] + 3.0 * 6.6 / 4.5).abs() < 1e-12,
            "{half:?}"
        );
    }
}
