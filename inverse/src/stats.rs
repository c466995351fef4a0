//! Medians, and quantiles of the distributions that tests of the noise need.

use statrs::distribution::{ChiSquared, ContinuousCDF, FisherSnedecor, StudentsT};

/// The middle one of the values that are finite, the upper of two; 0 of none.
pub(crate) fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut sorted: Vec<f64> = values.filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

/// Root mean square of the values that are finite; 0 of none.
pub(crate) fn root_mean_square(values: &[f64]) -> f64 {
    let finite = values.iter().filter(|v| v.is_finite());
    let (sum, count) = finite.fold((0.0, 0.0_f64), |(sum, count), v| (sum + v * v, count + 1.0));
    (sum / count.max(1.0)).sqrt()
}

/// How far a mean square of noise may be off its expectation, in its standard deviations, to be one.
const NOISE: f64 = 5.0;

/// Whether a sum of squares, each over its variance, of `count` values is one of noise.
pub(crate) fn is_of_noise(square: f64, count: f64) -> bool {
    square < count + NOISE * (2.0 * count).sqrt()
}

/// The chance that the mean of some gains is so far above 0 where each is as often a loss, by Student's distribution, with that mean. None of
/// fewer than two.
pub(crate) fn chance_of_gain(gains: &[f64]) -> Option<(f64, f64)> {
    let count = gains.len() as f64;
    let mean = gains.iter().sum::<f64>() / count;
    let variance = gains.iter().map(|g| (g - mean).powi(2)).sum::<f64>() / (count - 1.0);
    let better = mean / (variance / count).sqrt().max(f64::MIN_POSITIVE);
    let student = StudentsT::new(0.0, 1.0, count - 1.0).ok()?;
    Some((student.sf(better), mean))
}

/// The value that Fisher's F exceeds with a probability of `1 - probability`.
///
/// F is the ratio of two independent mean squares of noise. The degrees of freedom are those of the `numerator` and of the
/// `denominator`, each above 0 and finite. With many in the denominator F is chi-square over its degrees of freedom.
///
/// `None` for degrees of freedom out of range, or a `probability` outside 0..=1.
pub(crate) fn fisher_quantile(numerator: f64, denominator: f64, probability: f64) -> Option<f64> {
    let distribution = FisherSnedecor::new(numerator, denominator).ok()?;
    is_probability(probability).then(|| fisher_tail(&distribution, 1.0 - probability))
}

/// Most halvings of [`fisher_tail`], and the relative width at which it is found.
const HALVINGS: usize = 200;
const WIDTH: f64 = 1e-12;

/// Where the upper tail has this probability, by regula falsi in the logarithms (the Illinois method): some ten values of the tail.
fn fisher_tail(distribution: &FisherSnedecor, tail: f64) -> f64 {
    if tail <= 0.0 {
        return f64::INFINITY;
    }
    if tail >= 1.0 {
        return 0.0;
    }
    let off = |x: f64| (distribution.sf(x.exp()) / tail).ln();
    let [mut low, mut high] = [-1.0, 1.0];
    while off(low) < 0.0 && low > -700.0 {
        low *= 2.0;
    }
    while off(high) > 0.0 && high < 700.0 {
        high *= 2.0;
    }
    let [mut at_low, mut at_high] = [off(low), off(high)];
    let mut last = 0.0;
    for _ in 0..HALVINGS {
        let part = at_low / (at_low - at_high);
        // A tail too small for a number has no logarithm.
        let part = if at_high.is_finite() && part.is_finite() {
            part
        } else {
            0.5
        };
        let middle = low + part * (high - low);
        let at = off(middle);
        if at == 0.0 || high - low < WIDTH || at.abs() < WIDTH {
            return middle.exp();
        }
        if at > 0.0 {
            (low, at_low) = (middle, at);
            at_high *= if last > 0.0 { 0.5 } else { 1.0 };
        } else {
            (high, at_high) = (middle, at);
            at_low *= if last < 0.0 { 0.5 } else { 1.0 };
        }
        last = at;
    }
    (0.5 * (low + high)).exp()
}

/// The value that chi-square exceeds with a probability of `1 - probability`.
///
/// Chi-square is the sum of the squares of `freedom` independent normal numbers of variance 1. `freedom` is above 0 and
/// finite.
///
/// `None` for a `freedom` out of range, or a `probability` outside 0..=1.
pub(crate) fn chi_square_quantile(freedom: f64, probability: f64) -> Option<f64> {
    let distribution = ChiSquared::new(freedom).ok()?;
    (freedom.is_finite() && is_probability(probability)).then(|| distribution.inverse_cdf(probability))
}

fn is_probability(p: f64) -> bool {
    (0.0..=1.0).contains(&p)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of published tables.
    #[test]
    fn quantiles_are_those_of_the_tables() {
        for (freedom, probability, value) in [
            (1.0, 0.95, 3.841_459),
            (2.0, 0.999, 13.815_511),
            (100.0, 0.95, 124.342_1),
        ] {
            let found = chi_square_quantile(freedom, probability).unwrap();
            assert!((found / value - 1.0).abs() < 1e-5, "{freedom} {probability}: {found}");
        }
        for (numerator, denominator, probability, value) in [(3.0, 60.0, 0.99, 4.126), (1.0, 10.0, 0.95, 4.965)] {
            let found = fisher_quantile(numerator, denominator, probability).unwrap();
            assert!((found / value - 1.0).abs() < 2e-4, "{numerator} {denominator}: {found}");
        }
    }

    /// F with many degrees of freedom in the denominator is chi-square over that of the numerator.
    #[test]
    fn a_known_noise_makes_fishers_chi_square() {
        for freedom in [1.0, 4.0, 118.0] {
            let fisher = fisher_quantile(freedom, 1e7, 0.99).unwrap();
            let chi_square = chi_square_quantile(freedom, 0.99).unwrap() / freedom;
            // The inverse of the beta function is good to three digits there.
            assert!(
                (fisher / chi_square - 1.0).abs() < 1e-3,
                "{freedom}: {fisher} {chi_square}"
            );
        }
    }

    #[test]
    fn what_no_distribution_has_is_none() {
        for freedom in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(chi_square_quantile(freedom, 0.5), None);
            assert_eq!(fisher_quantile(freedom, 1.0, 0.5), None);
            assert_eq!(fisher_quantile(1.0, freedom, 0.5), None);
        }
        for probability in [-0.1, 1.1, f64::NAN, f64::NEG_INFINITY] {
            assert_eq!(chi_square_quantile(3.0, probability), None);
            assert_eq!(fisher_quantile(3.0, 4.0, probability), None);
        }
    }
}
