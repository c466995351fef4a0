//! Whether the sheet changed while its baseline was taken: a baseline held against itself.
//!
//! Noise is another one in every value. What comes down on the sheet, lifts or slides meanwhile changes many values together, and so
//! does a contact that fails: of the frames' deviations, each over its value's own scatter, the largest principal component stands
//! out. Of noise alone its variance has Tracy and Widom's distribution (Johnstone, Ann. Statist. 29, 2001). The gain of a frame is
//! taken out before: a source may drift.

use crate::linalg::eigen::symmetric_eigen;
use crate::reference::difference::Difference;
use crate::reference::resolution::step_of;
use crate::stats::median;
use nalgebra::DMatrix;

/// Fewest frames whose scatter tells it.
pub(crate) const FEWEST_FRAMES: usize = 4;
/// Fewest values that scatter.
const FEWEST_VALUES: usize = 16;
/// The largest variance of noise is said to be more than noise from so many of its own standard deviations on: one of ten million
/// (Tracy and Widom's law of real values), and room for noise that is not Gaussian.
const CLEARLY: f64 = 8.0;

/// Less is no matter: a change without a touch is doubted from so many on, too.
pub(crate) const LEAST_MOVED: f64 = 20.0;
/// So many frames tell it, however many there are.
const MOST_FRAMES: usize = 256;

/// Noise of a value is no less than this part of it: the lightest touch changes more, and simulations have none.
const LEAST_NOISE: f64 = 1e-4;

/// How the sheet moved.
pub(crate) struct Moved {
    /// How far, between the two frames that differ most; at least [`LEAST_MOVED`].
    pub(crate) sd: f64,
    /// Where along that way each frame is, from the middle one.
    pub(crate) along: Vec<f64>,
}

/// How far the sheet moved between the two frames that differ most, in standard deviations of a frame's noise: the 2-norm of the
/// change, each value over its noise. None where noise explains the frames, where it is less than 20, and of fewer than four frames.
///
/// `rounding`: standard deviation of what every value was rounded by. While a source drifts, values that are rounded err in one way; a
/// change of less than a step is none.
///
/// A frame is what `frames` gives for its number, up to `count`.
pub(crate) fn moved(count: usize, frames: impl Fn(usize) -> Vec<f64>, rounding: Option<&[f64]>) -> Option<Moved> {
    let frames: Vec<Vec<f64>> = (0..count)
        .step_by(count.div_ceil(MOST_FRAMES).max(1))
        .map(frames)
        .collect();
    let count = frames.len();
    if count < FEWEST_FRAMES {
        return None;
    }
    let rounded = |k: usize| rounding.map_or(0.0, |sds| sds[k]);
    let centred: Vec<Centred> = (0..frames[0].len())
        .filter_map(|k| Centred::new(&frames, k, rounded(k)))
        .collect();
    if centred.len() < FEWEST_VALUES {
        return None;
    }
    let (values, freedom) = (centred.len() as f64, (count - 1) as f64);
    let scaled = DMatrix::from_fn(count, centred.len(), |j, k| centred[k].off[j] / centred[k].sd);
    let eigen = symmetric_eigen(&scaled * scaled.transpose())?;
    let (largest, variance) = eigen.eigenvalues.argmax();
    // Johnstone's centre and scale, with the roles of frames and values as they come.
    let roots = (values - 1.0).max(1.0).sqrt() + freedom.sqrt();
    let scale = roots * ((values - 1.0).max(1.0).sqrt().recip() + freedom.sqrt().recip()).cbrt();
    if variance <= roots * roots + CLEARLY * scale {
        return None;
    }
    let course = eigen.eigenvectors.column(largest);
    let along = |of: &[f64]| of.iter().zip(course.iter()).map(|(v, u)| v * u).sum::<f64>();
    let changes: Vec<(f64, f64)> = (centred.iter())
        .map(|value| {
            let change = along(&value.off);
            let noise = (value.sd * value.sd * freedom - change * change).max(0.0) / (freedom - 1.0);
            (change, noise)
        })
        .collect();
    // Of a few frames a value's own noise is badly known: it is no less than the usual one.
    let usual = median(changes.iter().map(|(_, noise)| *noise));
    let variance = |noise: f64, value: &Centred| noise.max(usual).max(value.least * value.least).max(f64::MIN_POSITIVE);
    // What is left of a gain, which rounded values tell badly.
    let [along_mean, mean_square] = (changes.iter().zip(&centred)).fold([0.0; 2], |sum, ((change, noise), value)| {
        let weighted = value.mean / variance(*noise, value);
        [sum[0] + weighted * change, sum[1] + weighted * value.mean]
    });
    let gain = if mean_square > 0.0 {
        along_mean / mean_square
    } else {
        0.0
    };
    let range = course.max() - course.min();
    // Noise has its share of every direction.
    let beyond = changes.iter().zip(&centred).map(|((change, noise), value)| {
        let change = (range * (change - gain * value.mean).abs() - step_of(value.rounded)).max(0.0);
        (change * change - range * range * noise) / variance(*noise, value)
    });
    let square = beyond.sum::<f64>();
    let clear = square > CLEARLY * (2.0 * values).sqrt() * range * range;
    let sd = square.min(f64::MAX).sqrt();
    let middle = median(course.iter().copied());
    (clear && sd >= LEAST_MOVED).then(|| Moved {
        sd,
        along: course.iter().map(|u| (u - middle) * sd / range).collect(),
    })
}

/// What a frame differs from another by beside a common gain, each value over its spread: 2-norm, V of the model.
pub(crate) fn beyond_gain(d: &Difference, model_v: &[f64]) -> f64 {
    let values = || {
        let all = d.y.iter().zip(model_v).zip(&d.spread).zip(&d.used);
        all.filter(|(_, used)| **used)
            .map(|(((y, m), spread), _)| (y / spread, m / spread))
    };
    let [own, all] = values().fold([0.0; 2], |sum, (y, m)| [sum[0] + y * m, sum[1] + m * m]);
    let gain = if all > 0.0 { own / all } else { 0.0 };
    values().map(|(y, m)| (y - gain * m).powi(2)).sum::<f64>().sqrt()
}

/// A value in all frames.
struct Centred {
    /// Its mean, its deviations from that, and their standard deviation.
    mean: f64,
    off: Vec<f64>,
    sd: f64,
    /// Standard deviation of what it was rounded by, and of the noise that it has at least.
    rounded: f64,
    least: f64,
}

impl Centred {
    /// None where a frame lacks it, or it never changes.
    fn new(frames: &[Vec<f64>], k: usize, rounded: f64) -> Option<Self> {
        let count = frames.len() as f64;
        let mean = frames.iter().map(|f| f[k]).sum::<f64>() / count;
        let off: Vec<f64> = frames.iter().map(|f| f[k] - mean).collect();
        let sd = (off.iter().map(|v| v * v).sum::<f64>() / (count - 1.0)).sqrt();
        // What the sum of the same values rounds to is no change.
        let changes = sd.is_finite() && sd > 1e-12 * mean.abs();
        changes.then_some(Self {
            mean,
            off,
            sd,
            rounded,
            least: rounded.max(LEAST_NOISE * mean.abs()),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::LEAST_MOVED;
    use crate::batch::{Batch, BatchOptions};
    use crate::reference::baseline::{Baseline, BaselineTaker};
    use crate::reference::imager::Imager;
    use crate::solvers::Method;
    use forward::{DiscTouch, Drive, Model, ModelOptions, Pattern, Sheet, Solver};
    use rand::{Rng, SeedableRng};
    use rand_distr::StandardNormal;
    use std::sync::Arc;

    /// The untouched sheet, and what a light finger of +10 % changes.
    fn sheet() -> [Vec<f64>; 2] {
        let pattern = Pattern::adjacent(16).unwrap();
        let finger = DiscTouch {
            centre_mm: [-35.0, 20.0],
            radius_mm: 8.0,
            rise: 0.1,
        };
        let model = Model::new(&Sheet::paper(), &ModelOptions::for_touches(&[finger])).unwrap();
        let mut solver = Solver::new(model.into()).unwrap();
        let untouched = Drive::PAPER.frame_v(solver.electrode_matrix(), &pattern);
        let touched = Drive::PAPER.frame_v(solver.solve_touches(&[finger]).unwrap(), &pattern);
        let change = touched.iter().zip(&untouched).map(|(t, u)| t - u).collect();
        [untouched, change]
    }

    fn baseline(frames: &[Vec<f64>]) -> Baseline {
        let frames: Vec<&[f64]> = frames.iter().map(Vec::as_slice).collect();
        Baseline::of_frames(frames[0].len(), &frames)
    }

    /// Of noise, of a source that drifts, of noisy amplifiers, of a coarse converter and of few digits nothing is said, however few the
    /// frames.
    #[test]
    fn noise_does_not_move() {
        let [sheet, _] = sheet();
        let mut rng = rand::rngs::StdRng::seed_from_u64(4);
        for trial in 0..400 {
            let count = [4, 8, 24, 80][trial % 4];
            let noise_v = [1e-5, 1e-4, 1e-3][trial % 3];
            let rounds: [fn(f64) -> f64; 4] = [
                |v| v,
                |v| (v / 2e-4).round() * 2e-4,
                |v| format!("{v:.3e}").parse().unwrap(),
                |v| format!("{v:.2e}").parse().unwrap(),
            ];
            let round = rounds[trial / 2 % 4];
            let drift = [0.0, 0.01][trial / 5 % 2];
            let frame = |j: usize, rng: &mut rand::rngs::StdRng| -> Vec<f64> {
                let gain = 1.0 + drift * j as f64 / count as f64;
                let value = |(k, v): (usize, &f64)| {
                    let own = if k % 13 == 5 { 30.0 } else { 1.0 };
                    round(gain * v + own * noise_v * rng.sample::<f64, _>(StandardNormal))
                };
                sheet.iter().enumerate().map(value).collect()
            };
            let frames: Vec<Vec<f64>> = (0..count).map(|j| frame(j, &mut rng)).collect();
            let found = baseline(&frames);
            assert_eq!(found.moved, 0.0, "{trial}: {count} frames, {noise_v} V");
        }
    }

    /// Of two or three frames, too, which are held against each other one by one: a batch has what tells their noise.
    #[test]
    fn noise_of_a_few_frames_does_not_move() {
        let [sheet, change] = sheet();
        let pattern = Pattern::adjacent(16).unwrap();
        let imager = Arc::new(Imager::new(&Sheet::paper(), Drive::PAPER, pattern, 10.0).unwrap());
        let mut rng = rand::rngs::StdRng::seed_from_u64(8);
        for trial in 0..12 {
            let count = 2 + trial % 2;
            let noise_v = [3e-6, 3e-5, 1e-3][trial / 2 % 3];
            let digits = [9, 3][trial / 6];
            let mut moved = |pressed: usize| {
                let mut frame = |j: usize| -> Vec<f64> {
                    let part = f64::from(u8::from(j == pressed));
                    let value = |(v, c): (&f64, &f64)| {
                        let v = (1.0 + 0.01 * j as f64) * v + part * c + noise_v * rng.sample::<f64, _>(StandardNormal);
                        format!("{v:.digits$e}").parse().unwrap()
                    };
                    sheet.iter().zip(&change).map(value).collect()
                };
                let frames: Vec<Vec<f64>> = (0..count).map(&mut frame).collect();
                let frames: Vec<&[f64]> = frames.iter().map(Vec::as_slice).collect();
                let batch = Batch::new(Arc::clone(&imager), &frames, BatchOptions::of(Method::Nnls)).unwrap();
                batch.inspection().baseline.moved
            };
            assert_eq!(moved(count), 0.0, "{trial}");
            let found = moved(trial % count);
            assert!(noise_v > 1e-5 || digits < 9 || found > LEAST_MOVED, "{trial}: {found}");
        }
    }

    /// A finger that is there in half of the frames, or comes down ever more, is found, and as large as it is.
    #[test]
    fn what_comes_down_meanwhile_is_found() {
        let [sheet, change] = sheet();
        let mut rng = rand::rngs::StdRng::seed_from_u64(5);
        let size = change.iter().map(|v| v * v).sum::<f64>().sqrt();
        for (count, sd) in [(4, 100.0), (8, 60.0), (24, 40.0), (80, 40.0)] {
            let noise_v = size / sd;
            for ramps in [false, true] {
                let part = |j: usize| {
                    if ramps {
                        j as f64 / (count - 1) as f64
                    } else {
                        f64::from(u8::from(2 * j >= count))
                    }
                };
                let frame = |j: usize| -> Vec<f64> {
                    let noise: Vec<f64> = sheet
                        .iter()
                        .map(|_| noise_v * rng.sample::<f64, _>(StandardNormal))
                        .collect();
                    (sheet.iter().zip(&change).zip(noise))
                        .map(|((v, c), n)| v + part(j) * c + n)
                        .collect()
                };
                let found = baseline(&(0..count).map(frame).collect::<Vec<_>>());
                assert!(
                    found.moved > 0.6 * sd && found.moved < 1.7 * sd,
                    "{count} {sd} {ramps}: {}",
                    found.moved
                );
            }
        }
    }

    /// A finger far above the noise that is there in half of the frames is found, too, though no most of them are alike. Where most are, those
    /// are the baseline: a finger that comes down after them is a touch, and one that lifts has gone.
    #[test]
    fn half_of_the_frames_are_no_bad_ones_however_strong_the_finger() {
        let [sheet, change] = sheet();
        let mut rng = rand::rngs::StdRng::seed_from_u64(7);
        for sd in [50.0, 300.0, 3000.0] {
            let noise_v = change.iter().map(|v| v * v).sum::<f64>().sqrt() / sd;
            let mut of = |is_pressed: &dyn Fn(usize) -> bool| {
                let frame = |j: usize| -> Vec<f64> {
                    let part = f64::from(u8::from(is_pressed(j)));
                    let of = sheet.iter().zip(&change);
                    of.map(|(v, c)| v + part * c + noise_v * rng.sample::<f64, _>(StandardNormal))
                        .collect()
                };
                baseline(&(0..24).map(frame).collect::<Vec<_>>())
            };
            for at_first in [true, false] {
                let found = of(&|j| (j < 12) == at_first).moved;
                // Noise counts as a ten-thousandth of each value at least.
                assert!(found > (0.5 * sd).min(100.0), "{sd} sd: {found}");
            }
            for few in [of(&|j| j >= 18), of(&|j| j < 6), of(&|j| j == 7 || j == 15)] {
                assert!(sd < 100.0 || (few.moved == 0.0 && few.unlike > 0), "{sd}: {few:?}");
            }
        }
    }

    /// A baseline that waits until nothing moves is as one that was begun after it; what never rests is taken in the end.
    #[test]
    fn a_baseline_is_taken_again_until_nothing_moves() {
        let [sheet, change] = sheet();
        let mut rng = rand::rngs::StdRng::seed_from_u64(6);
        let noise_v = change.iter().map(|v| v * v).sum::<f64>().sqrt() / 50.0;
        let mut frame = |part: f64| -> Vec<f64> {
            let of = sheet.iter().zip(&change);
            of.map(|(v, c)| v + part * c + noise_v * rng.sample::<f64, _>(StandardNormal))
                .collect()
        };
        let mut taker = BaselineTaker::new(sheet.len(), 24).until_still(3);
        for j in 0..24 {
            assert_eq!(taker.take(&frame(if j < 12 { 1.0 } else { 0.0 })), None);
        }
        assert!(taker.is_empty() && taker.left() == 24);
        let still: Vec<Vec<f64>> = (0..24).map(|_| frame(0.0)).collect();
        let taken = still.iter().filter_map(|f| taker.take(f)).next().unwrap();
        assert!(taken.is_same(&baseline(&still)) && taken.moved == 0.0);

        let mut taker = BaselineTaker::new(sheet.len(), 24).until_still(3);
        let moving = (0..96).map(|j| taker.take(&frame(f64::from(u8::from(j % 24 >= 12)))));
        let taken: Vec<Option<Baseline>> = moving.collect();
        assert!(taken[..95].iter().all(Option::is_none) && taken[95].as_ref().unwrap().moved > 20.0);
    }
}
