//! The prior: how large, how strong and how many touches are before a measurement.

use crate::touches::fit::disc::Disc;

/// What is known of touches before the measurement.
///
/// Lengths are for the paper's disc and in proportion on other sheets ([`FitOptions::for_extent`]). Where a field names
/// no experiment, none is on record: the value was chosen by hand. What all give together is in docs/results.md: `cargo
/// run --release -p studies --example touch_accuracy`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitOptions {
    /// Radius that a touch is expected to have, mm: the paper's 25 mm tip.
    pub radius_mm: f64,
    /// Standard deviation of a touch's radius, mm. Less makes the totals of strong touches more exact where the tip is
    /// known (docs/results.md, "The bound", column "bound with the prior"), and biases the radii of others.
    pub radius_sd_mm: f64,
    /// Radius of a wide touch, mm: a palm. A wide touch is a second possibility beside the expected radius.
    pub wide_mm: f64,
    /// Standard deviation of a wide touch's radius, mm.
    pub wide_sd_mm: f64,
    /// How many wide touches there are for one of the expected radius. Less takes a palm for several tips; more takes
    /// neighbouring tips for a palm.
    pub wide_odds: f64,
    /// Probability that noise adds a touch to a frame, 0 to 1. More finds weaker touches and adds more false ones.
    pub false_touch: f64,
    /// Weakest touch, as a fraction of the strongest one's integrated rise. Less shows weaker touches beside strong
    /// ones, and what the model leaves of the strong ones.
    pub least_of_strongest: f64,
    /// Weakest touch, relative rise at its peak.
    pub least_rise: f64,
    /// Relative error of the disc model, as a standard deviation of one value. More widens the stated uncertainty
    /// (`touch_accuracy`, column "within 2 sd") and the fall of chi-square that an additional touch must bring.
    pub model_error: f64,
    /// Most touches in a frame, at most [`MOST_TOUCHES`](crate::touches::fit::disc::MOST_TOUCHES).
    pub most_touches: usize,
    /// What the search in one frame of many may cost, in evaluations of the response to one touch (3 to 6 us each). The
    /// rest is left to the next frame. Four touches take 50 to 300, a hand that lands 1,500. More makes the longest
    /// frame longer (`skin bench cost`, column `p99`). There is no limit where the noise is estimated from the frame,
    /// which may be the only one.
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

/// The prior of the radius at one radius.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RadiusPrior {
    /// Minus twice the logarithm of the radius's probability density over that of the expected radius.
    pub(crate) penalty: f64,
    /// Half the penalty's derivative, per mm.
    pub(crate) slope: f64,
    /// Half the penalty's second derivative without its negative part, per mm².
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
