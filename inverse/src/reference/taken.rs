//! What frames are compared with, made once.

use crate::reference::baseline::Baseline;
use crate::reference::difference::{Difference, is_measured};
use crate::reference::imager::{Imager, ImagerError};
use crate::reference::noise::{FrameNoise, NoiseEstimate, NoiseSource};
use crate::reference::resolution::rounding;
use crate::stats::root_mean_square;
use std::sync::Arc;

/// A sheet, its model and its baseline. Immutable: another baseline is another reference.
#[derive(Clone, Debug)]
pub struct Reference {
    imager: Arc<Imager>,
    baseline: Vec<f64>,
    /// The baseline's difference to itself: which values take part, and how they scatter.
    unchanged: Difference,
    noise: Option<f64>,
    /// The same of every value of a frame, in the baseline's unit; empty where it is not known.
    value_noise: Vec<f64>,
    /// What the difference of two rounded values scatters by, V of the model: 0 where the baseline's values are on no steps.
    least_noise: f64,
    /// 0 for a baseline without noise.
    baseline_share: f64,
}

impl Reference {
    /// A baseline (any unit, in the pattern's order; not a number where a value is missing) on an imager's sheet.
    ///
    /// A noise that is not a positive number counts as unknown. It is no less than that of values that are rounded as the baseline's are.
    ///
    /// # Errors
    /// [`ImagerError::Baseline`] when its length does not match the pattern.
    pub fn new(imager: Arc<Imager>, baseline: Vec<f64>, noise: FrameNoise) -> Result<Self, ImagerError> {
        let unchanged = imager.difference(&baseline, &baseline)?;
        let rounding = rounding(&baseline).map_or(0.0, |sds| root_mean_square(&sds));
        let least_noise = std::f64::consts::SQRT_2 * rounding * imager.gain(&baseline);
        let (noise, value_noise, baseline_share) = match noise {
            FrameNoise::Known { sigma, baseline_frames } if sigma > 0.0 && sigma.is_finite() => {
                let share = baseline_frames.filter(|n| *n > 0).map_or(0.0, |n| 1.0 / n as f64);
                let sigma = sigma.max(rounding);
                let of_model = sigma * imager.gain(&baseline) * (1.0 + share).sqrt();
                let known = Some(of_model).filter(|s| *s > 0.0 && s.is_finite());
                let of_values = known.map(|_| vec![sigma; baseline.len()]);
                (known, of_values.unwrap_or_default(), share)
            }
            _ => (None, Vec::new(), 0.0),
        };
        Ok(Self {
            imager,
            baseline,
            unchanged,
            noise,
            value_noise,
            least_noise,
            baseline_share,
        })
    }

    /// Frames of the unpressed sheet as the baseline, with the noise that they show of every value.
    ///
    /// # Errors
    /// As for [`Reference::new`].
    pub fn of(imager: Arc<Imager>, baseline: &Baseline) -> Result<Self, ImagerError> {
        let noise = FrameNoise::Known {
            sigma: baseline.noise_v,
            baseline_frames: Some(baseline.frames),
        };
        let mut reference = Self::new(imager, baseline.values_v.clone(), noise)?;
        let own = baseline.own_noise();
        for of_values in [&mut reference.unchanged.spread, &mut reference.value_noise] {
            of_values.iter_mut().zip(&own).for_each(|(noise, own)| *noise *= own);
        }
        Ok(reference)
    }

    /// The model of the sheet.
    pub fn imager(&self) -> &Arc<Imager> {
        &self.imager
    }

    /// The baseline, in its own unit.
    pub fn baseline(&self) -> &[f64] {
        &self.baseline
    }

    /// Noise of one value of a frame's difference, where it is known: of one with a spread of 1.
    pub fn noise(&self) -> Option<NoiseEstimate> {
        self.noise.map(|sigma| NoiseEstimate {
            sigma,
            source: NoiseSource::Known,
        })
    }

    /// Noise of every value of a frame, in the baseline's unit, where it is known.
    pub(crate) fn value_noise(&self) -> Option<&[f64]> {
        (!self.value_noise.is_empty()).then_some(&self.value_noise)
    }

    /// Noise that one value of a difference has at least, V of the model: of a baseline and a frame that are rounded.
    pub(crate) fn least_noise(&self) -> f64 {
        self.least_noise
    }

    /// Variance of the baseline's noise over that of one frame's.
    pub fn baseline_share(&self) -> f64 {
        self.baseline_share
    }

    /// The baseline's difference to itself: 0, with the values that take part and their spread.
    pub(crate) fn unchanged(&self) -> &Difference {
        &self.unchanged
    }

    /// The normalised difference of a frame (the baseline's unit).
    ///
    /// # Errors
    /// [`ImagerError::Baseline`] when its length does not match the pattern.
    pub fn difference(&self, frame: &[f64]) -> Result<Difference, ImagerError> {
        let mut difference = self.unchanged.clone();
        self.difference_into(frame, &mut difference)?;
        Ok(difference)
    }

    /// The same into a difference that was this reference's before: nothing is allocated.
    pub(crate) fn difference_into(&self, frame: &[f64], difference: &mut Difference) -> Result<(), ImagerError> {
        self.imager.fits(&self.baseline, frame)?;
        let both = self.unchanged.used.iter().zip(&self.baseline).zip(frame);
        let used = difference.used.iter_mut().zip(both);
        used.for_each(|(used, ((known, b), v))| *used = *known && is_measured(*v, *b));
        difference.spread.clone_from(&self.unchanged.spread);
        difference.fill(&self.imager.model_v, &self.baseline, frame);
        Ok(())
    }

    /// Whether each value of a frame is missing that the baseline has.
    ///
    /// # Errors
    /// As for [`Reference::difference`].
    pub(crate) fn missing_into(&self, frame: &[f64], missing: &mut Vec<bool>) -> Result<(), ImagerError> {
        self.imager.fits(&self.baseline, frame)?;
        let both = self.unchanged.used.iter().zip(&self.baseline).zip(frame);
        missing.clear();
        missing.extend(both.map(|((known, b), v)| *known && !is_measured(*v, *b)));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::{Drive, Pattern, Sheet};

    fn imager() -> Arc<Imager> {
        Arc::new(Imager::new(&Sheet::paper(), Drive::PAPER, Pattern::adjacent(16).unwrap(), 20.0).unwrap())
    }

    #[test]
    fn one_after_the_other_is_as_each_by_itself() {
        let imager = imager();
        let mut baseline = imager.model_v.clone();
        baseline[3] = f64::NAN;
        baseline[4] = 1e-9 * baseline[5];
        let reference = Reference::new(Arc::clone(&imager), baseline.clone(), FrameNoise::Unknown).unwrap();
        let mut before = reference.difference(&baseline).unwrap();
        assert!(before.y.iter().all(|y| *y == 0.0));
        // What no converter gives is missing as well.
        for (missing, value) in [
            (None, 0.0),
            (Some(7), f64::INFINITY),
            (None, 0.0),
            (Some(9), -1e300),
            (Some(11), 1e18),
        ] {
            let mut frame: Vec<f64> = baseline.iter().map(|v| 1.1 * v).collect();
            if let Some(k) = missing {
                frame[k] = value;
            }
            reference.difference_into(&frame, &mut before).unwrap();
            assert_eq!(before, Difference::new(&imager.model_v, &baseline, &frame));
            assert!(missing.is_none_or(|k| !before.used[k]) && !before.used[3] && !before.used[4]);
        }
        assert!(reference.difference(&baseline[1..]).is_err());
    }

    /// Of values on steps the noise is known to be at least that of rounding.
    #[test]
    fn rounded_values_are_not_known_better_than_rounding_lets() {
        let imager = imager();
        let step = 1e-3 * imager.model_v[0];
        let baseline: Vec<f64> = imager.model_v.iter().map(|v| (v / step).round() * step).collect();
        let gain = imager.gain(&baseline);
        let rounding = step / 12.0_f64.sqrt();
        let of = |sigma| {
            let noise = FrameNoise::of_frames(sigma);
            Reference::new(Arc::clone(&imager), baseline.clone(), noise).unwrap()
        };
        for (sigma, known) in [(0.01 * step, rounding), (3.0 * step, 3.0 * step)] {
            let reference = of(sigma);
            assert!((reference.value_noise().unwrap()[5] / known - 1.0).abs() < 1e-6);
            assert!((reference.noise().unwrap().sigma / (gain * known) - 1.0).abs() < 1e-6);
            assert!((reference.least_noise() / (gain * rounding * 2.0_f64.sqrt()) - 1.0).abs() < 1e-6);
        }
    }

    /// The difference to a mean of n frames has 1 + 1/n times a frame's variance.
    #[test]
    fn the_baseline_adds_its_share_of_the_noise() {
        let imager = imager();
        let sigma = |baseline_frames| {
            let noise = FrameNoise::Known {
                sigma: 1e-3,
                baseline_frames,
            };
            let baseline = imager.model_v.iter().map(|v| 0.5 * v).collect();
            let reference = Reference::new(Arc::clone(&imager), baseline, noise).unwrap();
            reference.noise().unwrap().sigma
        };
        // A baseline of half the model's volts: the model has a gain of two.
        assert!((sigma(None) / 2e-3 - 1.0).abs() < 1e-12);
        assert!((sigma(Some(4)) / 2e-3 - 1.25_f64.sqrt()).abs() < 1e-12);
        for sigma in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let noise = FrameNoise::Known {
                sigma,
                baseline_frames: None,
            };
            let reference = Reference::new(Arc::clone(&imager), imager.model_v.clone(), noise).unwrap();
            assert_eq!(reference.noise(), None);
        }
    }

    /// Frames of which every other value is noisier, on a sheet with other voltages than the model's: each value has its own noise, in the
    /// baseline's unit and in the model's. A missing value changes nothing of the others.
    #[test]
    fn a_value_has_the_noise_that_the_baseline_tells_of_it() {
        let imager = imager();
        let noise = |k: usize| if k.is_multiple_of(2) { 1e-5 } else { 2e-5 };
        let sheet: Vec<f64> = imager
            .model_v
            .iter()
            .enumerate()
            .map(|(k, v)| v * (0.4 + 0.01 * (k % 7) as f64))
            .collect();
        // As often above as below: the variance is exact.
        let frame = |n: usize| -> Vec<f64> {
            let off = |k: usize| {
                if (n >> (k % 4)).is_multiple_of(2) {
                    noise(k)
                } else {
                    -noise(k)
                }
            };
            sheet.iter().enumerate().map(|(k, v)| v + off(k)).collect()
        };
        let frames: Vec<Vec<f64>> = (0..512).map(frame).collect();
        let list: Vec<&[f64]> = frames.iter().map(Vec::as_slice).collect();
        let reference = Reference::of(Arc::clone(&imager), &Baseline::plain(sheet.len(), &list)).unwrap();
        let (own, sigma) = (reference.value_noise().unwrap(), reference.noise().unwrap().sigma);
        let mut missing = sheet.clone();
        missing[9] = f64::NAN;
        for frame in [&sheet, &missing] {
            let d = reference.difference(frame).unwrap();
            assert_eq!(
                d.used.iter().filter(|used| !**used).count(),
                usize::from(frame[9].is_nan())
            );
            for k in (0..sheet.len()).filter(|k| d.used[*k]) {
                let expected = noise(k) * (1.0 + 1.0 / 512.0_f64).sqrt() * (imager.model_v[k] / sheet[k]).abs();
                assert!((sigma * d.spread[k] / expected - 1.0).abs() < 0.05, "{k}");
                assert!((own[k] / noise(k) - 1.0).abs() < 0.05, "{k}");
            }
        }
    }
}
