//! What makes one sheet another than the next: unevenness and ageing.

use crate::noise::Noise;
use std::f64::consts::SQRT_2;

/// How one sheet differs from an even one. The default does not.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Variation {
    /// Standard deviation of the logarithm of the resistivity over sheets, and nearly over one: 0.05 is 5 %. 0 or more.
    pub resistivity_sd: f64,
    /// Distance (mm) at which the correlation of the resistivity has fallen to exp(-1/2): it is `exp(-(d/l)^2 / 2)`. Greater
    /// than 0 where there is a deviation.
    pub correlation_mm: f64,
    /// Standard deviation of the logarithms of the contact impedances, each electrode's its own. 0 or more.
    pub contact_sd: f64,
    /// Which sheet.
    pub seed: u64,
}

/// Waves that an uneven sheet is made of. Fewer make the field's distribution differ visibly from a normal one; more cost
/// time when a sheet is made.
const WAVES: u64 = 256;

/// The sheet's own draws of the generator.
const FIELD: u64 = 0x51;
const CONTACT: u64 = 0x52;
const RATE: u64 = 0x53;

impl Variation {
    /// The resistivity at any place over that of an even sheet: the exponential of a smooth random field of mean 0, a sum of
    /// plane waves with normally distributed wave vectors (Shinozuka and Jan 1972).
    pub fn resistivity(&self) -> impl Fn([f64; 2]) -> f64 + use<> {
        let noise = Noise::new(self.seed ^ FIELD);
        let waves: Vec<[f64; 3]> = (0..if self.resistivity_sd > 0.0 { WAVES } else { 0 })
            .map(|k| {
                let mut draw = [0.0; 4];
                noise.fill(k, &mut draw);
                // Two normal draws make a uniform angle.
                [
                    draw[0] / self.correlation_mm,
                    draw[1] / self.correlation_mm,
                    libm::atan2(draw[2], draw[3]),
                ]
            })
            .collect();
        let scale = self.resistivity_sd * SQRT_2 / (WAVES as f64).sqrt();
        move |[x, y]| {
            let sum: f64 = waves.iter().map(|[a, b, phase]| libm::cos(a * x + b * y + phase)).sum();
            libm::exp(scale * sum)
        }
    }

    /// Factors of the contact impedances of so many electrodes.
    pub fn contacts(&self, electrodes: usize) -> Vec<f64> {
        let draws = normal(self.seed ^ CONTACT, electrodes);
        draws.iter().map(|n| libm::exp(self.contact_sd * n)).collect()
    }
}

fn normal(seed: u64, count: usize) -> Vec<f64> {
    let mut draws = vec![0.0; count];
    Noise::new(seed).fill(0, &mut draws);
    draws
}

/// How a sheet changes with the hours, whether it is touched or not. The default does not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ageing {
    /// Relative rise in the sheet's resistivity in an hour, each on top of the last: 0.01 is 1 %. Greater than -1.
    pub resistivity_per_hour: f64,
    /// The same of the contact impedances.
    pub contact_per_hour: f64,
    /// Standard deviation of what each electrode's own contact rises in an hour, in addition. 0 or more.
    pub contact_spread_per_hour: f64,
    /// How many hours pass for the sheet in one. 0 or more.
    pub acceleration: f64,
}

impl Default for Ageing {
    fn default() -> Self {
        Self {
            resistivity_per_hour: 0.0,
            contact_per_hour: 0.0,
            contact_spread_per_hour: 0.0,
            acceleration: 1.0,
        }
    }
}

impl Ageing {
    /// Hours of age at a time.
    fn hours(&self, t_s: f64) -> f64 {
        self.acceleration * t_s / 3600.0
    }

    /// The resistivity at a time over that of the new sheet.
    pub fn resistivity(&self, t_s: f64) -> f64 {
        libm::exp(libm::log1p(self.resistivity_per_hour) * self.hours(t_s))
    }

    /// The contact impedances at a time over those of the new sheet, whose electrodes' spread is drawn by this seed.
    pub fn contacts(&self, electrodes: usize, seed: u64, t_s: f64) -> Vec<f64> {
        let rate = libm::log1p(self.contact_per_hour);
        let own = normal(seed ^ RATE, electrodes);
        own.iter()
            .map(|n| libm::exp((rate + self.contact_spread_per_hour * n) * self.hours(t_s)))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Over many sheets the field's logarithm has the mean, the deviation and the correlation asked for. 4,000 independent
    /// sheets: standard errors 1.6 % of the deviation and 0.016 of the correlation.
    #[test]
    fn the_field_has_the_statistics_asked_for() {
        let (mut mean, mut square, mut product) = (0.0, 0.0, 0.0);
        let n = 4000;
        for seed in 0..n {
            let variation = Variation {
                resistivity_sd: 0.1,
                correlation_mm: 30.0,
                contact_sd: 0.0,
                seed,
            };
            let field = variation.resistivity();
            let (a, b) = (field([10.0, -20.0]).ln(), field([31.0, 1.0]).ln());
            mean += a / n as f64;
            square += a * a / n as f64;
            product += a * b / n as f64;
        }
        // Two places 29.7 mm from each other.
        let expected = (-(2.0 * 21.0_f64.powi(2)) / (2.0 * 900.0)).exp();
        assert!(mean.abs() < 5.0 * 0.1 / (n as f64).sqrt(), "{mean}");
        assert!((square.sqrt() / 0.1 - 1.0).abs() < 0.06, "{square}");
        assert!((product / square - expected).abs() < 0.08, "{product} {square}");
    }

    #[test]
    fn an_even_sheet_is_even_and_does_not_age() {
        let even = Variation::default();
        assert_eq!(even.resistivity()([3.0, 4.0]), 1.0);
        assert_eq!(even.contacts(3), [1.0; 3]);
        assert_eq!(Ageing::default().resistivity(1e6), 1.0);
        assert_eq!(Ageing::default().contacts(2, 5, 1e6), [1.0; 2]);
    }

    #[test]
    fn an_hour_ages_by_what_is_said_and_two_by_its_square() {
        let ageing = Ageing {
            resistivity_per_hour: 0.02,
            contact_per_hour: -0.1,
            contact_spread_per_hour: 0.0,
            acceleration: 60.0,
        };
        assert!((ageing.resistivity(60.0) - 1.02).abs() < 1e-12);
        assert!((ageing.resistivity(120.0) - 1.02 * 1.02).abs() < 1e-12);
        assert!((ageing.contacts(1, 0, 60.0)[0] - 0.9).abs() < 1e-12);
    }

    #[test]
    fn the_seed_says_which_sheet() {
        let of = |seed| Variation {
            resistivity_sd: 0.1,
            correlation_mm: 30.0,
            contact_sd: 0.2,
            seed,
        };
        assert_eq!(of(1).contacts(16), of(1).contacts(16));
        assert_ne!(of(1).contacts(16), of(2).contacts(16));
        assert_ne!(of(1).resistivity()([0.0; 2]), of(2).resistivity()([0.0; 2]));
    }
}
