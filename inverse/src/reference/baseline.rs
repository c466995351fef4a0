//! The unpressed sheet, as measured: the mean of a number of frames, and their noise.

/// Collects frames of the unpressed sheet.
#[derive(Clone, Debug)]
pub struct BaselineTaker {
    wanted: usize,
    count: Vec<f64>,
    mean: Vec<f64>,
    /// Sum of squared deviations (Welford 1962).
    deviation: Vec<f64>,
    taken: usize,
}

/// What the unpressed sheet gives.
#[derive(Clone, Debug, PartialEq)]
pub struct Baseline {
    /// Mean of every value, V; not a number where no frame had one.
    pub values_v: Vec<f64>,
    /// Standard deviation of one value in one frame, V, pooled over all values.
    pub noise_v: f64,
    /// The same of every value by itself, V; not a number where fewer than two frames had one.
    pub value_noise_v: Vec<f64>,
    /// Frames taken.
    pub frames: usize,
}

impl BaselineTaker {
    /// Waits for `wanted` frames (2 at least) of `values` values.
    pub fn new(values: usize, wanted: usize) -> Self {
        Self {
            wanted: wanted.max(2),
            count: vec![0.0; values],
            mean: vec![0.0; values],
            deviation: vec![0.0; values],
            taken: 0,
        }
    }

    /// Takes a frame; the baseline once there are enough. Values that are not finite are left out. Frames of another
    /// length are ignored.
    pub fn take(&mut self, frame_v: &[f64]) -> Option<Baseline> {
        if frame_v.len() != self.mean.len() {
            return None;
        }
        for (k, v) in frame_v.iter().enumerate().filter(|(_, v)| v.is_finite()) {
            self.count[k] += 1.0;
            let step = v - self.mean[k];
            self.mean[k] += step / self.count[k];
            self.deviation[k] += step * (v - self.mean[k]);
        }
        self.taken += 1;
        if self.taken < self.wanted {
            return None;
        }
        let freedom: f64 = self.count.iter().map(|c| (c - 1.0).max(0.0)).sum();
        Some(Baseline {
            values_v: self
                .mean
                .iter()
                .zip(&self.count)
                .map(|(m, c)| if *c > 0.0 { *m } else { f64::NAN })
                .collect(),
            noise_v: (self.deviation.iter().sum::<f64>() / freedom.max(1.0)).sqrt(),
            value_noise_v: self
                .deviation
                .iter()
                .zip(&self.count)
                .map(|(d, c)| if *c > 1.0 { (d / (c - 1.0)).sqrt() } else { f64::NAN })
                .collect(),
            frames: self.taken,
        })
    }

    /// Frames still wanted.
    pub fn left(&self) -> usize {
        self.wanted.saturating_sub(self.taken)
    }
}

impl Baseline {
    /// Of given frames of so many values (any unit): the plain mean of every value over the frames that have it. Frames of
    /// another length are ignored.
    pub fn of_frames(values: usize, frames: &[&[f64]]) -> Self {
        let mut taker = BaselineTaker::new(values, frames.len());
        let taken = frames.iter().filter_map(|frame| taker.take(frame)).last();
        let mean = |k: usize| {
            let (mut sum, mut count) = (0.0, 0.0);
            for v in frames.iter().filter_map(|f| f.get(k)).filter(|v| v.is_finite()) {
                sum += v;
                count += 1.0;
            }
            sum / count
        };
        Self {
            values_v: (0..values).map(mean).collect(),
            noise_v: taken.as_ref().map_or(0.0, |b| b.noise_v),
            value_noise_v: taken.map_or_else(|| vec![f64::NAN; values], |b| b.value_noise_v),
            frames: frames.len(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_distr::StandardNormal;

    #[test]
    fn mean_and_noise_are_those_of_the_frames() {
        let mut rng = rand::rngs::StdRng::seed_from_u64(5);
        let mut taker = BaselineTaker::new(208, 40);
        let mut baseline = None;
        for frame in 0..40 {
            assert!(baseline.is_none());
            let values: Vec<f64> = (0..208)
                .map(|k| {
                    let noise: f64 = rng.sample(StandardNormal);
                    if k == 7 || (k == 9 && frame < 20) {
                        f64::NAN
                    } else {
                        k as f64 + 0.01 * noise
                    }
                })
                .collect();
            baseline = taker.take(&values);
        }
        let b = baseline.unwrap();
        assert!(b.values_v[7].is_nan());
        assert!((b.noise_v / 0.01 - 1.0).abs() < 0.03, "{}", b.noise_v);
        assert!(b.value_noise_v[7].is_nan());
        let each = b.value_noise_v.iter().filter(|s| s.is_finite()).map(|s| s * s);
        let mean = each.sum::<f64>() / 207.0;
        assert!((mean.sqrt() / 0.01 - 1.0).abs() < 0.03, "{mean}");
        assert!((b.values_v[9] - 9.0).abs() < 0.01 && (b.values_v[200] - 200.0).abs() < 0.01);
        assert_eq!(taker.left(), 0);
    }

    #[test]
    fn given_frames_make_the_baseline_that_taken_ones_do() {
        let frames = [[1.0, 2.0, f64::NAN], [1.5, f64::NAN, f64::NAN], [2.0, 4.0, f64::NAN]];
        let list: Vec<&[f64]> = frames.iter().map(|f| f.as_slice()).collect();
        let given = Baseline::of_frames(3, &list);
        let mut taker = BaselineTaker::new(3, 3);
        let taken = frames.iter().filter_map(|f| taker.take(f)).next().unwrap();
        assert_eq!(given.values_v[..2], [1.5, 3.0]);
        assert!(given.values_v[2].is_nan());
        assert_eq!((given.noise_v, given.frames), (taken.noise_v, 3));
    }
}
