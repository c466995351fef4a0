//! The same frame again and again: a buffer that nobody fills any more.

use crate::quality::doubt::Doubt;
use crate::reference::baseline::Baseline;

/// So many frames one after another that are the same to the last bit are no measurement.
const MOST: usize = 8;

/// A value has noise of its own from this part of that of all on: what is less may be the gain of frames.
const OWN: f64 = 0.5;

/// Counts frames that are the same.
#[derive(Clone, Debug, Default)]
pub(crate) struct Repeats {
    /// Whether noise would have made them different.
    differ: bool,
    last: Vec<u64>,
    count: usize,
    /// What was doubted of the last frame beside this.
    covered: Option<Option<Doubt>>,
}

impl Repeats {
    /// For frames after this baseline. Where most of its values had next to no noise, it is less than a step of the converter, and frames at
    /// rest may be the same.
    pub(crate) fn after(baseline: &Baseline) -> Self {
        let least = OWN * baseline.noise_v;
        let noise = baseline.value_noise_v();
        let differ = noise.iter().filter(|noise| **noise > least).count();
        Self {
            differ: 2 * differ > baseline.values_v.len(),
            ..Self::default()
        }
    }

    /// What is doubted of a last frame without this.
    pub(crate) fn uncover(&mut self, doubt: &mut Option<Doubt>) {
        if let Some(covered) = self.covered.take() {
            *doubt = covered;
        }
    }

    /// Takes a frame, and doubts it where it is one of many that are the same.
    pub(crate) fn take(&mut self, values_v: &[f64], doubt: &mut Option<Doubt>) {
        let same = self.last.iter().copied().eq(values_v.iter().map(|v| v.to_bits()));
        if !same {
            self.last.clear();
            self.last.extend(values_v.iter().map(|v| v.to_bits()));
        }
        self.count = if same { self.count + 1 } else { 0 };
        if self.differ && self.count >= MOST {
            self.covered = Some(doubt.replace(Doubt::Repeated));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_distr::StandardNormal;

    /// Of 40 values so many of which have noise.
    fn baseline(noisy: usize) -> Baseline {
        let mut rng = rand::rngs::StdRng::seed_from_u64(4);
        let mut noise = |k: usize| {
            if k < noisy {
                0.01 * rng.sample::<f64, _>(StandardNormal)
            } else {
                0.0
            }
        };
        let frames: Vec<Vec<f64>> = (0..24)
            .map(|_| (0..40).map(|k| 1.0 + (k % 7) as f64 + noise(k)).collect())
            .collect();
        Baseline::of_frames(40, &frames.iter().map(Vec::as_slice).collect::<Vec<_>>())
    }

    /// After which of frames that are all the same the doubt is there.
    fn doubted_after(repeats: &mut Repeats, frame: [f64; 4]) -> Option<usize> {
        (0..40).find(|_| {
            let mut doubt = None;
            repeats.take(&frame, &mut doubt);
            doubt == Some(Doubt::Repeated)
        })
    }

    #[test]
    fn the_same_frame_again_and_again_is_doubted_until_another_comes() {
        let mut repeats = Repeats::after(&baseline(40));
        assert_eq!(doubted_after(&mut repeats, [1.0, 2.0, f64::NAN, 4.0]), Some(MOST));
        let mut doubt = Some(Doubt::Repeated);
        repeats.uncover(&mut doubt);
        assert_eq!(doubt, None);
        let mut doubt = Some(Doubt::NotTouches);
        repeats.take(&[1.0, 2.0, f64::NAN, 4.1], &mut doubt);
        assert_eq!(doubt, Some(Doubt::NotTouches));
        repeats.uncover(&mut doubt);
        assert_eq!(doubt, Some(Doubt::NotTouches));
    }

    /// Noise of less than a step: most values never changed in the baseline.
    #[test]
    fn frames_may_be_the_same_where_those_of_the_baseline_were() {
        let mut repeats = Repeats::after(&baseline(15));
        assert_eq!(doubted_after(&mut repeats, [1.0; 4]), None);
    }
}
