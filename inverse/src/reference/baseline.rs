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
    /// Frames taken.
    pub frames: usize,
    /// Sum of the squared deviations of every value from its mean, V², and degrees of freedom of the sum; empty for a single frame.
    pub deviations: Vec<(f64, f64)>,
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
        let freedom = self.count.iter().map(|c| (c - 1.0).max(0.0));
        let deviations: Vec<(f64, f64)> = self.deviation.iter().copied().zip(freedom).collect();
        Some(Baseline {
            values_v: self
                .mean
                .iter()
                .zip(&self.count)
                .map(|(m, c)| if *c > 0.0 { *m } else { f64::NAN })
                .collect(),
            noise_v: pooled(deviations.iter()),
            frames: self.taken,
            deviations,
        })
    }

    /// Frames still wanted.
    pub fn left(&self) -> usize {
        self.wanted.saturating_sub(self.taken)
    }
}

impl Baseline {
    /// Whether both are the same to the last bit; values that neither has are the same.
    pub fn is_same(&self, other: &Self) -> bool {
        let bits = |of: &Self| {
            let deviations = of.deviations.iter().flat_map(|(sum, degrees)| [*sum, *degrees]);
            let all = of.values_v.iter().copied().chain([of.noise_v]).chain(deviations);
            all.map(f64::to_bits).collect::<Vec<_>>()
        };
        self.frames == other.frames && bits(self) == bits(other)
    }

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
            frames: frames.len(),
            deviations: taken.map_or_else(Vec::new, |b| b.deviations),
        }
    }

    /// Standard deviation of every value by itself in one frame, V; not a number where fewer than two frames had one.
    pub fn value_noise_v(&self) -> Vec<f64> {
        let of = |k: usize| match self.deviations.get(k) {
            Some((square, freedom)) if *freedom > 0.0 => (square / freedom).sqrt(),
            _ => f64::NAN,
        };
        (0..self.values_v.len()).map(of).collect()
    }

    /// Sums of squared deviations that so many frames with this standard deviation of every value have; what is no number
    /// stands for a value without any.
    pub fn deviations_of(value_noise_v: &[f64], frames: usize) -> Vec<(f64, f64)> {
        let freedom = frames.saturating_sub(1) as f64;
        let of = |sd: &f64| {
            if sd.is_finite() {
                (sd * sd * freedom, freedom)
            } else {
                (0.0, 0.0)
            }
        };
        value_noise_v.iter().map(of).collect()
    }

    /// The same without the values that are not `used`: they are missing, and their noise is not pooled with that of the others.
    pub fn without(mut self, used: &[bool]) -> Self {
        if used.iter().all(|u| *u) {
            return self;
        }
        for (v, _) in self.values_v.iter_mut().zip(used).filter(|(_, used)| !**used) {
            *v = f64::NAN;
        }
        for (d, _) in self.deviations.iter_mut().zip(used).filter(|(_, used)| !**used) {
            *d = (0.0, 0.0);
        }
        if !self.deviations.is_empty() {
            self.noise_v = pooled(self.deviations.iter());
        }
        self
    }

    /// Relative noise of the mean of one value, root mean square; 0 for a single frame.
    pub fn relative_noise(&self) -> f64 {
        let frames = self.frames.max(1) as f64;
        let squares: Vec<f64> = self
            .values_v
            .iter()
            .filter(|v| v.is_finite() && **v != 0.0)
            .map(|v| (self.noise_v / v).powi(2) / frames)
            .collect();
        (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
    }
}

/// Standard deviation from sums of squared deviations and their degrees of freedom.
fn pooled<'a>(deviations: impl Iterator<Item = &'a (f64, f64)> + Clone) -> f64 {
    let squares: f64 = deviations.clone().map(|d| d.0).sum();
    let freedom: f64 = deviations.map(|d| d.1).sum();
    (squares / freedom.max(1.0)).sqrt()
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
        assert!(b.value_noise_v()[7].is_nan());
        let noise = b.value_noise_v();
        let each = noise.iter().filter(|s| s.is_finite()).map(|s| s * s);
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
