//! Radius filter: a Kalman filter on the radius of every followed touch.
//!
//! A fast frame determines the strength of a touch well and its radius badly. The peak rise goes with the inverse
//! square of the radius. A touch does not widen from one frame to the next by as much as the noise of its radius. The
//! filter therefore weighs the radius known before against the frame's. The outcome lies between the radii of the
//! frames: it is no further off than the worst of them. Slow frames are hardly changed. The mean of several frames
//! takes the place of those of them that were filtered before.

use crate::touches::fit::disc::Disc;
use crate::touches::touch::Touch;
use std::f64::consts::PI;

/// How radii change.
///
/// What the filter does is in docs/results.md, "Radius filter": the scatter of peak rises in the demo, with it and
/// without. No experiment is on record that chose a single field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RadiusFilterOptions {
    /// Relative change of a radius in a second, as a standard deviation: that of a finger that comes down in a quarter
    /// of a second. More follows faster, and filters less.
    pub rate_per_s: f64,
    /// A radius further off than so many standard deviations is another touch's: the filter begins anew. Less begins
    /// anew more often by chance.
    pub outlier_sd: f64,
    /// A touch that is gone for longer is forgotten, s.
    pub patience_s: f64,
}

impl Default for RadiusFilterOptions {
    fn default() -> Self {
        Self {
            rate_per_s: 1.6,
            outlier_sd: 4.0,
            patience_s: 0.5,
        }
    }
}

/// Filters radii, by the touches' numbers.
#[derive(Clone, Debug, Default)]
pub struct RadiusFilter {
    options: RadiusFilterOptions,
    known: Vec<Known>,
}

#[derive(Clone, Copy, Debug)]
struct Known {
    id: u32,
    now: Radius,
    /// Before the frames whose mean was reconstructed last; none if those were the first.
    before: Option<Radius>,
}

#[derive(Clone, Copy, Debug)]
struct Radius {
    seen_s: f64,
    mm: f64,
    variance: f64,
}

impl RadiusFilter {
    /// Knows no touch yet.
    pub fn new(options: RadiusFilterOptions) -> Self {
        Self {
            options,
            known: Vec::new(),
        }
    }

    /// Filters the touches of a frame that was reconstructed anew, or of a mean of which it is the last: area, peak and
    /// integrated rise. Sorts them strongest first again.
    ///
    /// `time_s` is the board's time of the frame. `grown` says that the frames of the update before are among the
    /// mean's. Touches without a number or an uncertainty are left as they are.
    pub fn update(&mut self, time_s: f64, grown: bool, touches: &mut [Touch]) {
        let options = self.options;
        self.known
            .retain(|k| (0.0..=options.patience_s).contains(&(time_s - k.now.seen_s)));
        for touch in &mut *touches {
            let (Some(id), Some(sd)) = (touch.id, touch.area_sd_mm2) else {
                continue;
            };
            let mm = (touch.area_mm2 / PI).sqrt();
            let fitted = Radius {
                seen_s: time_s,
                mm,
                variance: (0.5 * sd / (PI * mm)).powi(2),
            };
            if !(fitted.mm > 0.0 && fitted.variance > 0.0 && fitted.variance.is_finite()) {
                continue;
            }
            match self.known.iter_mut().find(|k| k.id == id) {
                Some(known) => {
                    if !grown {
                        known.before = Some(known.now);
                    }
                    known.now = known.before.map_or(fitted, |before| before.then(fitted, &options));
                    // The radius of one at the limit was fitted too small, so that its strength does not follow from its rise.
                    if !touch.at_limit {
                        known.now.apply(touch);
                    }
                }
                None => self.known.push(Known {
                    id,
                    now: fitted,
                    before: None,
                }),
            }
        }
        touches.sort_by(|a, b| b.rise.abs().total_cmp(&a.rise.abs()));
    }

    /// Keeps the radii of touches that are as they were, in a frame at this time.
    pub fn keep(&mut self, time_s: f64, touches: &[Touch]) {
        let present = |id: u32| touches.iter().any(|t| t.id == Some(id));
        for known in self.known.iter_mut().filter(|k| present(k.id)) {
            known.now.seen_s = time_s;
        }
    }
}

impl Radius {
    /// The Kalman filter's step: this radius with that of a later frame.
    fn then(self, fitted: Self, options: &RadiusFilterOptions) -> Self {
        let step = options.rate_per_s * self.mm * (fitted.seen_s - self.seen_s);
        let expected = self.variance + step * step;
        let off = fitted.mm - self.mm;
        if off * off > options.outlier_sd * options.outlier_sd * (expected + fitted.variance) {
            return fitted;
        }
        let gain = expected / (expected + fitted.variance);
        Self {
            mm: self.mm + gain * off,
            variance: (1.0 - gain) * expected,
            ..fitted
        }
    }

    /// Gives a touch this radius. Its strength in the linear model stays.
    fn apply(&self, touch: &mut Touch) {
        let disc = Disc {
            at: [touch.x_mm, touch.y_mm],
            radius: self.mm,
            strength: 2.0 * touch.rise / (2.0 + touch.rise) * touch.area_mm2,
        };
        (touch.rise, touch.at_limit) = (disc.rise(), disc.is_at_limit());
        touch.area_mm2 = disc.area_mm2();
        touch.total_mm2 = touch.rise * touch.area_mm2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_distr::StandardNormal;

    /// A touch of strength 100 mm² whose radius was estimated with this standard deviation.
    fn touch(id: u32, radius: f64, sd: f64) -> Touch {
        let disc = Disc {
            at: [1.0, 2.0],
            radius,
            strength: 100.0,
        };
        Touch {
            id: Some(id),
            x_mm: 1.0,
            y_mm: 2.0,
            rise: disc.rise(),
            area_mm2: disc.area_mm2(),
            total_mm2: disc.rise() * disc.area_mm2(),
            area_sd_mm2: Some(2.0 * PI * radius * sd),
            ..Touch::default()
        }
    }

    /// A rise or a fall at the limit says nothing of the strength: it stays as it was fitted.
    #[test]
    fn what_is_at_the_limit_stays() {
        for sign in [1.0, -1.0] {
            let mut radius_filter = RadiusFilter::default();
            for (frame, radius) in [5.0, 4.0, 6.0].into_iter().enumerate() {
                let disc = Disc {
                    at: [1.0, 2.0],
                    radius,
                    strength: sign * 1000.0,
                };
                let fitted = Touch {
                    rise: disc.rise(),
                    area_mm2: disc.area_mm2(),
                    at_limit: disc.is_at_limit(),
                    ..touch(7, radius, 1.0)
                };
                assert!(fitted.at_limit);
                let mut touches = [fitted];
                radius_filter.update(0.01 * frame as f64, false, &mut touches);
                assert_eq!(touches, [fitted]);
            }
        }
    }

    /// Radii that come out of noisy ones, and those that were measured, less the true one.
    fn filtered(frame_s: f64, sd: f64, radius: impl Fn(f64) -> f64) -> Vec<(f64, f64)> {
        let mut rng = rand::rngs::StdRng::seed_from_u64(3);
        let mut radius_filter = RadiusFilter::default();
        let mut range = (f64::INFINITY, 0.0_f64);
        let times = (0..400).map(|k| frame_s * f64::from(k));
        let one = |t: f64| {
            let noise: f64 = rng.sample(StandardNormal);
            let measured = radius(t) + sd * noise;
            range = (range.0.min(measured), range.1.max(measured));
            let mut touches = [touch(7, measured, sd)];
            radius_filter.update(t, false, &mut touches);
            let [found] = touches;
            let strength = 2.0 * found.rise / (2.0 + found.rise) * found.area_mm2;
            assert!((strength - 100.0).abs() < 1e-9, "{strength}");
            let r = (found.area_mm2 / PI).sqrt();
            // Never outside of what was measured.
            assert!(r > range.0 - 1e-9 && r < range.1 + 1e-9, "{r}: {range:?}");
            (r - radius(t), measured - radius(t))
        };
        times.map(one).collect()
    }

    fn rms(values: impl Iterator<Item = f64> + Clone) -> f64 {
        (values.clone().map(|v| v * v).sum::<f64>() / values.count() as f64).sqrt()
    }

    #[test]
    fn fast_frames_are_filtered_and_slow_ones_are_not() {
        let fast = rms(filtered(1.0 / 115.0, 2.0, |_| 12.0)[50..].iter().map(|f| f.0));
        assert!(fast < 0.4 * 2.0, "{fast}");
        let slow = rms(filtered(0.33, 0.5, |_| 12.0).iter().map(|f| f.0 - f.1));
        assert!(slow < 0.1 * 0.5, "{slow}");
    }

    #[test]
    fn a_touch_that_widens_is_followed() {
        let widens = |t: f64| 8.0 * (1.5_f64).powf((t / 0.25).min(1.0));
        let found = filtered(1.0 / 115.0, 1.5, widens);
        // While it widens it lags by less than the noise of a frame, and not at all afterwards.
        assert!(rms(found[3..29].iter().map(|f| f.0)) < 1.5);
        assert!(rms(found[80..].iter().map(|f| f.0)) < 0.6);
        // Another one with its number begins anew.
        let jumps = filtered(1.0 / 115.0, 0.3, |t| if t < 1.0 { 8.0 } else { 16.0 });
        assert!(jumps[118..].iter().all(|f| f.0.abs() < 1.5));
    }

    /// The mean of frames holds the first of them, which must not count twice. The outcome is the mean's alone, or that
    /// with the radius known before.
    #[test]
    fn a_mean_takes_the_place_of_its_first_frame() {
        let radius = |radius_filter: &mut RadiusFilter, frames: usize, radius: f64, sd: f64| {
            let mut touches = [touch(7, radius, sd)];
            radius_filter.update(0.01, frames > 1, &mut touches);
            (touches[0].area_mm2 / PI).sqrt()
        };
        let mut alone = RadiusFilter::default();
        radius(&mut alone, 1, 13.0, 1.0);
        assert!((radius(&mut alone, 4, 12.2, 0.5) - 12.2).abs() < 1e-9);
        assert!((radius(&mut alone, 16, 12.0, 0.25) - 12.0).abs() < 1e-9);
        // Known before as well as from one frame: 4 to 1 for the mean of four.
        let mut known = RadiusFilter::default();
        radius(&mut known, 1, 11.0, 1.0);
        radius(&mut known, 1, 13.0, 1.0);
        assert!((radius(&mut known, 4, 12.0, 0.5) - (0.2 * 11.0 + 0.8 * 12.0)).abs() < 1e-9);
        // Kept through a long rest, it counts as much as if it had been the frame before.
        for k in 1..300 {
            known.keep(0.01 * f64::from(k), &[touch(7, 12.0, 0.5)]);
        }
        let (before, sd) = (known.known[0].now.mm, known.known[0].now.variance.sqrt());
        let mut touches = [touch(7, 14.0, 1.0)];
        known.update(3.0, false, &mut touches);
        let expected = before + (14.0 - before) * sd * sd / (sd * sd + 1.0);
        assert!(((touches[0].area_mm2 / PI).sqrt() - expected).abs() < 0.1);
    }

    #[test]
    fn what_is_not_fitted_or_has_no_number_is_left_as_it_is() {
        let mut radius_filter = RadiusFilter::default();
        let plain = Touch {
            rise: 0.1,
            area_mm2: 300.0,
            ..Touch::default()
        };
        let strange = Touch {
            area_mm2: 0.0,
            ..touch(4, 10.0, 1.0)
        };
        for k in 0..3 {
            let mut touches = [strange, plain];
            radius_filter.update(0.1 * f64::from(k), false, &mut touches);
            assert_eq!(touches, [strange, plain]);
        }
    }
}
