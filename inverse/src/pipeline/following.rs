//! A baseline that follows what drifts slowly while nothing touches the sheet.

/// Longest time between two frames that counts, s: what happened in a longer gap nobody saw.
const LONGEST_S: f64 = 1.0;

/// What the values are now of those of the baseline, value by value. Frames are divided by it.
///
/// An exponential mean over the frames in which nothing touches. It stands still otherwise. What drifts is followed with a
/// lag of [`ReconstructorOptions::follow_s`](crate::pipeline::ReconstructorOptions::follow_s) times its rate.
pub(crate) struct Following {
    time_s: f64,
    /// Of values that the baseline has; 1 for others.
    ratios: Vec<f64>,
    /// Mean of the ratios.
    gain: f64,
}

impl Following {
    pub(crate) fn new(values: usize, time_s: f64) -> Self {
        Self {
            time_s,
            ratios: vec![1.0; values],
            gain: 1.0,
        }
    }

    /// The gain that the ratios have in common.
    pub(crate) fn gain(&self) -> f64 {
        self.gain
    }

    /// Divides a frame by the ratios and by a gain, into `divided`.
    pub(crate) fn divide(&self, values: &[f64], gain: f64, divided: &mut Vec<f64>) {
        divided.clear();
        if values.len() == self.ratios.len() {
            divided.extend(values.iter().zip(&self.ratios).map(|(v, r)| v / (gain * r)));
        } else {
            // It is refused where it is used.
            divided.extend_from_slice(values);
        }
    }

    /// Follows a frame in which nothing touches, as [`Following::divide`] made it, measured so long after the one before.
    pub(crate) fn follow(&mut self, divided: &[f64], baseline: &[f64], used: &[bool], interval_s: f64) {
        let part = 1.0 - (-interval_s.clamp(0.0, LONGEST_S) / self.time_s).exp();
        let (mut sum, mut count) = (0.0, 0.0);
        for (((ratio, v), b), used) in self.ratios.iter_mut().zip(divided).zip(baseline).zip(used) {
            let now = v / b;
            if *used && now.is_finite() {
                *ratio *= 1.0 + part * (now - 1.0);
                sum += *ratio;
                count += 1.0;
            }
        }
        if count > 0.0 {
            self.gain = sum / count;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ramp is followed with a lag of its rate times the time constant; a step decays with it.
    #[test]
    fn a_ramp_is_followed_with_a_lag() {
        let (baseline, used) = ([2.0, -1.0, f64::NAN], [true, true, false]);
        let (time_s, dt, rate) = (20.0, 0.05, 1e-4);
        let mut following = Following::new(3, time_s);
        let (mut divided, mut t) = (Vec::new(), 0.0);
        while t < 200.0 {
            t += dt;
            let values: Vec<f64> = baseline.iter().map(|b| b * (1.0 + rate * t)).collect();
            following.divide(&values, 1.0, &mut divided);
            following.follow(&divided, &baseline, &used, dt);
        }
        let lag = divided[0] / 2.0 - 1.0;
        assert!((lag / (rate * time_s) - 1.0).abs() < 0.03, "{lag}");
        assert!((divided[1] / baseline[1] - 1.0 - lag).abs() < 1e-12 && divided[2].is_nan());
        assert!((following.gain() - 1.0 - rate * t + lag).abs() < 1e-4);
        // A frame after a long gap is one frame.
        following.divide(&[4.0, -2.0, 0.0], 1.0, &mut divided);
        let before = divided[0];
        following.follow(&divided, &baseline, &used, 3600.0);
        following.divide(&[4.0, -2.0, 0.0], 1.0, &mut divided);
        assert!((divided[0] / before - 1.0).abs() < 1.1 * before / 2.0 / time_s);
    }
}
