//! Radii of touches that are followed, steadied from frame to frame.
//!
//! A fast frame tells the strength of a touch well and its radius badly, and with the radius its peak rise, which goes with the
//! inverse square of it. But a touch does not widen from one frame to the next by as much as noise says: a Kalman filter on the
//! radius, one for every touch, weighs what was known against what the frame says. What comes out lies between the radii that the frames
//! say, so it can be no further off than the worst of them. Slow frames are left as they are. What the mean of several frames says
//! takes the place of what those of them said that were there before.

use crate::touches::fit::Disc;
use crate::touches::touch::Touch;
use std::f64::consts::PI;

/// How fast a radius changes, of itself in a second: as a finger's does that comes down in a quarter of one.
const RATE_PER_S: f64 = 1.6;
/// What is further off than so many standard deviations is another touch.
const ANOTHER: f64 = 4.0;
/// A touch that is gone for longer is forgotten, s.
const PATIENCE_S: f64 = 0.5;
/// A touch with this rise or more has a radius that was fitted too small: its strength is not known from it.
const TOO_STRONG: f64 = 11.0;

/// Keeps radii by the touches' numbers.
#[derive(Clone, Debug, Default)]
pub struct Steadier {
    known: Vec<Known>,
}

#[derive(Clone, Copy, Debug)]
struct Known {
    id: u32,
    now: Radius,
    /// Before the frames whose mean was reconstructed last.
    before: Option<Radius>,
}

#[derive(Clone, Copy, Debug)]
struct Radius {
    seen_s: f64,
    mm: f64,
    variance: f64,
}

impl Steadier {
    /// Steadies the touches of a frame that was reconstructed anew, measured at the board's time, or of a mean of which it is
    /// the last (`grown` where the frames of the update before are among them): area, peak and integrated rise; strongest first again.
    /// Touches without a number or an uncertainty are left as they are.
    pub fn update(&mut self, time_s: f64, grown: bool, touches: &mut [Touch]) {
        self.known
            .retain(|k| (0.0..=PATIENCE_S).contains(&(time_s - k.now.seen_s)));
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
                    known.now = known.before.map_or(fitted, |before| before.then(fitted));
                    known.now.apply(touch);
                }
                None => self.known.push(Known {
                    id,
                    now: fitted,
                    before: None,
                }),
            }
        }
        touches.sort_by(|a, b| b.rise.total_cmp(&a.rise));
    }

    /// Keeps what is known of touches that are as they were.
    pub fn keep(&mut self, time_s: f64, touches: &[Touch]) {
        let present = |id: u32| touches.iter().any(|t| t.id == Some(id));
        for known in self.known.iter_mut().filter(|k| present(k.id)) {
            known.now.seen_s = time_s;
        }
    }
}

impl Radius {
    /// With what a later frame says.
    fn then(self, fitted: Self) -> Self {
        let step = RATE_PER_S * self.mm * (fitted.seen_s - self.seen_s);
        let expected = self.variance + step * step;
        let off = fitted.mm - self.mm;
        if off * off > ANOTHER * ANOTHER * (expected + fitted.variance) {
            return fitted;
        }
        let gain = expected / (expected + fitted.variance);
        Self {
            mm: self.mm + gain * off,
            variance: (1.0 - gain) * expected,
            ..fitted
        }
    }

    /// Gives a touch the radius; its strength in the linear model is what the frame says.
    fn apply(&self, touch: &mut Touch) {
        if touch.rise >= TOO_STRONG {
            return;
        }
        let disc = Disc {
            at: [touch.x_mm, touch.y_mm],
            radius: self.mm,
            strength: 2.0 * touch.rise / (2.0 + touch.rise) * touch.area_mm2,
        };
        touch.rise = disc.rise();
        touch.area_mm2 = disc.area_mm2();
        touch.total_mm2 = touch.rise * touch.area_mm2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_distr::StandardNormal;

    /// A touch of strength 100 mm² whose radius was told with this standard deviation.
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

    /// Radii that come out of noisy ones, and those that were measured, less the true one.
    fn steadied(frame_s: f64, sd: f64, radius: impl Fn(f64) -> f64) -> Vec<(f64, f64)> {
        let mut rng = rand::rngs::StdRng::seed_from_u64(3);
        let mut steadier = Steadier::default();
        let mut range = (f64::INFINITY, 0.0_f64);
        let times = (0..400).map(|k| frame_s * f64::from(k));
        let one = |t: f64| {
            let noise: f64 = rng.sample(StandardNormal);
            let measured = radius(t) + sd * noise;
            range = (range.0.min(measured), range.1.max(measured));
            let mut touches = [touch(7, measured, sd)];
            steadier.update(t, false, &mut touches);
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
    fn fast_frames_are_steadied_and_slow_ones_are_not() {
        let fast = rms(steadied(1.0 / 115.0, 2.0, |_| 12.0)[50..].iter().map(|f| f.0));
        assert!(fast < 0.4 * 2.0, "{fast}");
        let slow = rms(steadied(0.33, 0.5, |_| 12.0).iter().map(|f| f.0 - f.1));
        assert!(slow < 0.1 * 0.5, "{slow}");
    }

    #[test]
    fn a_touch_that_widens_is_followed() {
        let widens = |t: f64| 8.0 * (1.5_f64).powf((t / 0.25).min(1.0));
        let found = steadied(1.0 / 115.0, 1.5, widens);
        // While it widens it lags by less than the noise of a frame, and not at all afterwards.
        assert!(rms(found[3..29].iter().map(|f| f.0)) < 1.5);
        assert!(rms(found[80..].iter().map(|f| f.0)) < 0.6);
        // Another one with its number begins anew.
        let jumps = steadied(1.0 / 115.0, 0.3, |t| if t < 1.0 { 8.0 } else { 16.0 });
        assert!(jumps[118..].iter().all(|f| f.0.abs() < 1.5));
    }

    /// The mean of frames holds the first of them, which is not to count twice: what comes out is the mean's alone, or that with what was
    /// known before.
    #[test]
    fn a_mean_takes_the_place_of_its_first_frame() {
        let radius = |steadier: &mut Steadier, frames: usize, radius: f64, sd: f64| {
            let mut touches = [touch(7, radius, sd)];
            steadier.update(0.01, frames > 1, &mut touches);
            (touches[0].area_mm2 / PI).sqrt()
        };
        let mut alone = Steadier::default();
        radius(&mut alone, 1, 13.0, 1.0);
        assert!((radius(&mut alone, 4, 12.2, 0.5) - 12.2).abs() < 1e-9);
        assert!((radius(&mut alone, 16, 12.0, 0.25) - 12.0).abs() < 1e-9);
        // Known before as well as a frame tells it: 4 to 1 for the mean of four.
        let mut known = Steadier::default();
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
        let mut steadier = Steadier::default();
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
            steadier.update(0.1 * f64::from(k), false, &mut touches);
            assert_eq!(touches, [strange, plain]);
        }
    }
}
