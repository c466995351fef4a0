//! What is known of touches before a measurement: how large, how strong and how many they are.

use crate::touches::fit::disc::Disc;

/// What is known of touches before the measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitOptions {
    /// Radius that a touch is expected to have, mm: the paper's 25 mm tip.
    pub radius_mm: f64,
    /// Standard deviation of a touch's radius, mm.
    pub radius_sd_mm: f64,
    /// Radius of a wide touch, mm: a palm. It is a second possibility beside the expected radius.
    pub wide_mm: f64,
    /// Standard deviation of a wide touch's radius, mm.
    pub wide_sd_mm: f64,
    /// How many wide touches there are for one of the expected radius.
    pub wide_odds: f64,
    /// Probability that noise adds a touch to a frame.
    pub false_touch: f64,
    /// Weakest touch, as a fraction of the strongest one's integrated rise.
    pub least_of_strongest: f64,
    /// Weakest touch, relative rise at its peak.
    pub least_rise: f64,
    /// Relative error of the linear disc model, as a standard deviation of one value: it widens the stated uncertainty.
    pub model_error: f64,
    /// Most touches in a frame.
    pub most_touches: usize,
    /// What the search in one frame of many may cost, in evaluations of the answer to a touch (3 to 5 us each): more is left to the
    /// next frame. Four touches take 50 to 300, a hand that lands 1,500. There is no limit where the noise has to be told from the
    /// frame: it may be the only one.
    pub most_work: usize,
}

impl FitOptions {
    /// Defaults for a sheet that reaches this far from its middle (mm): radii in proportion to the paper's 195 mm disc.
    pub fn for_extent(extent_mm: f64) -> Self {
        let scale = extent_mm / 97.5;
        Self {
            radius_mm: 12.5 * scale,
            radius_sd_mm: 2.5 * scale,
            wide_mm: 26.0 * scale,
            wide_sd_mm: 6.0 * scale,
            wide_odds: 0.01,
            false_touch: 1e-3,
            least_of_strongest: 0.02,
            least_rise: 0.005,
            model_error: 0.006,
            most_touches: 12,
            most_work: 600,
        }
    }

    /// A touch of the expected size to start from.
    pub fn seed(&self, at: [f64; 2]) -> Disc {
        Disc {
            at,
            radius: self.radius_mm,
            strength: 0.0,
        }
    }
}

/// What is known of a radius before the measurement, at one radius: minus twice the logarithm of its probability against that of the
/// expected radius, half its derivative (per mm), and half its second derivative without what would make it negative (per mm²).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RadiusPrior {
    pub(crate) penalty: f64,
    pub(crate) slope: f64,
    pub(crate) curvature: f64,
}

impl FitOptions {
    /// A mixture of two normal distributions, tips and palms. Near the expected radius the second does not matter.
    pub(crate) fn radius_prior(&self, radius_mm: f64) -> RadiusPrior {
        let tip = (radius_mm - self.radius_mm) / self.radius_sd_mm;
        let wide = (radius_mm - self.wide_mm) / self.wide_sd_mm;
        let odds = self.wide_odds * self.radius_sd_mm / self.wide_sd_mm;
        // Minus the logarithms of both parts; the smaller one is taken out of the sum, which may underflow.
        let (tip_log, wide_log) = (0.5 * tip * tip, 0.5 * wide * wide - odds.ln());
        let least = tip_log.min(wide_log);
        let parts = [(least - tip_log).exp(), (least - wide_log).exp()];
        let sum = parts[0] + parts[1];
        let [tips, wides] = parts.map(|p| p / sum);
        RadiusPrior {
            penalty: 2.0 * (least - sum.ln()),
            slope: tips * tip / self.radius_sd_mm + wides * wide / self.wide_sd_mm,
            curvature: tips * self.radius_sd_mm.powi(-2) + wides * self.wide_sd_mm.powi(-2),
        }
    }
}
#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_prior_is_that_of_a_tip_near_its_radius_and_of_a_palm_near_its_own() {
        let options = FitOptions::for_extent(97.5);
        for radius in [8.0, 12.5, 15.0] {
            let tip = (radius - options.radius_mm) / options.radius_sd_mm;
            assert!(
                (options.radius_prior(radius).penalty - tip * tip).abs() < 0.01,
                "{radius}"
            );
        }
        let palm = options.radius_prior(options.wide_mm);
        let odds = options.wide_odds * options.radius_sd_mm / options.wide_sd_mm;
        assert!((palm.penalty + 2.0 * odds.ln()).abs() < 1e-3 && palm.slope.abs() < 1e-3);
    }

    #[test]
    fn the_prior_is_as_steep_as_it_says() {
        let options = FitOptions::for_extent(97.5);
        for k in 1..80 {
            let radius = 0.5 * f64::from(k);
            let [up, down] = [1e-5, -1e-5].map(|d| options.radius_prior(radius + d).penalty);
            let prior = options.radius_prior(radius);
            assert!((0.5 * (up - down) / 2e-5 - prior.slope).abs() < 1e-5, "{radius}");
            assert!(prior.curvature > 0.0);
        }
    }
}
