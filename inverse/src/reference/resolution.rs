//! The step by which values differ: that of a converter, or of the digits that a table was written with.

/// Steps below this part of the largest value are no matter to anybody, and look like the rounding of a sum.
const LEAST: f64 = 1e-6;
/// What is left of a division by a step, over the largest value, that is rounding.
const ROUNDING: f64 = 1e-9;
/// Fewest values that tell: of two, anything is a multiple of something.
const FEWEST: usize = 16;

/// Most significant digits that count as few: more are no matter to anybody.
const MOST_DIGITS: i32 = 6;

/// Standard deviation of what every value was rounded by, in its unit: on steps that all share, or to so many significant digits. None
/// where they are not rounded, not a number for those that are none.
pub fn rounding(values: &[f64]) -> Option<Vec<f64>> {
    let (common, digits) = (step(values), digits(values));
    if common.is_none() && digits.is_none() {
        return None;
    }
    let own = |v: &f64| digits.map_or(0.0, |digits| last_place(*v, digits));
    let of = |v: &f64| {
        if v.is_finite() {
            rounding_sd(own(v).max(common.unwrap_or(0.0)))
        } else {
            f64::NAN
        }
    };
    Some(values.iter().map(of).collect())
}

/// What 1 in the last of so many significant digits of a value is.
fn last_place(value: f64, digits: i32) -> f64 {
    if value == 0.0 {
        return 0.0;
    }
    10.0_f64.powi(value.abs().log10().floor() as i32 + 1 - digits)
}

/// How many significant digits all values have at most; none where that is no few.
fn digits(values: &[f64]) -> Option<i32> {
    let finite = || values.iter().filter(|v| v.is_finite() && **v != 0.0);
    let has = |v: &f64, digits: i32| {
        let places = v / last_place(*v, digits);
        (places - places.round()).abs() <= ROUNDING * places.abs()
    };
    let enough = finite().count() >= FEWEST && finite().any(|v| Some(v) != finite().next());
    (1..=MOST_DIGITS).find(|digits| enough && finite().all(|v| has(v, *digits)))
}

/// The largest step of which all values are multiples; none where they are not on steps. Their greatest common divisor, by Euclid.
fn step(values: &[f64]) -> Option<f64> {
    let finite = || values.iter().map(|v| v.abs()).filter(|v| v.is_finite());
    let largest = finite().fold(0.0, f64::max);
    if finite().count() < FEWEST {
        return None;
    }
    let rounding = ROUNDING * largest;
    let (mut step, mut most) = (0.0, 0.0_f64);
    for value in finite().filter(|v| *v > 0.0) {
        let (mut a, mut b) = (value, step);
        while b > rounding {
            // As near to the next multiple as to this one.
            let left = a - b * (a / b).round();
            (a, b) = (b, left.abs());
        }
        if a < LEAST * largest {
            return None;
        }
        // The largest value tells it best: errors do not add up.
        most = value.max(most);
        step = most / (most / a).round();
    }
    // Where all are the same, no step shows.
    (step > 0.0 && step < 0.5 * largest).then_some(step)
}

/// Standard deviation of what is rounded to a step: it is anywhere within it.
pub(crate) fn rounding_sd(step: f64) -> f64 {
    step / 12.0_f64.sqrt()
}

/// The step that rounding to it has this standard deviation of.
pub(crate) fn step_of(rounding_sd: f64) -> f64 {
    rounding_sd * 12.0_f64.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};

    /// Numbers as `%.3e` writes them, and as `%.4f` does.
    #[test]
    fn what_a_value_was_rounded_by_is_found() {
        let mut rng = rand::rngs::StdRng::seed_from_u64(5);
        let values: Vec<f64> = (0..208).map(|_| 10.0_f64.powf(rng.random_range(-3.0..-1.0))).collect();
        assert_eq!(rounding(&values), None);
        let written =
            |write: fn(&f64) -> String| -> Vec<f64> { values.iter().map(|v| write(v).parse().unwrap()).collect() };
        for (rounded, decade) in [
            (written(|v| format!("{v:.3e}")), None),
            (written(|v| format!("{v:.1e}")), None),
            (written(|v| format!("{v:.4}")), Some(1e-4)),
        ] {
            let found = rounding(&rounded).unwrap();
            let mut errors: Vec<f64> = values
                .iter()
                .zip(&rounded)
                .zip(&found)
                .map(|((v, r), sd)| (v - r) / sd)
                .collect();
            assert!(errors.iter().all(|e| e.abs() < 1.74), "{decade:?}");
            errors.iter_mut().for_each(|e| *e *= *e);
            assert!((errors.iter().sum::<f64>() / 208.0 - 1.0).abs() < 0.3);
            assert!(decade.is_none_or(|step| found.iter().all(|sd| (sd / rounding_sd(step) - 1.0).abs() < 1e-4)));
        }
        assert_eq!(rounding(&[0.25; 40]), None);
    }

    #[test]
    fn the_step_of_rounded_values_is_found_and_no_other() {
        let mut rng = rand::rngs::StdRng::seed_from_u64(4);
        let values: Vec<f64> = (0..208).map(|_| rng.random_range(-0.1..0.1)).collect();
        assert_eq!(step(&values), None);
        for unit in [1e-4, 1e-3, 0.1 / 4096.0, 1e-5] {
            let rounded: Vec<f64> = values.iter().map(|v| (v / unit).round() * unit).collect();
            let found = step(&rounded).unwrap();
            assert!((found / unit - 1.0).abs() < 1e-4, "{unit}: {found}");
            let mut sd: f64 = values.iter().zip(&rounded).map(|(v, r)| (v - r).powi(2)).sum();
            sd = (sd / values.len() as f64).sqrt();
            assert!((sd / rounding_sd(found) - 1.0).abs() < 0.15, "{unit}: {sd}");
        }
        // Counts of a converter; values of which some are missing; values that are all the same; a few.
        let counts: Vec<f64> = (0..40).map(|k| f64::from(100 + 7 * k % 31)).collect();
        assert!((step(&counts).unwrap() - 1.0).abs() < 1e-9);
        let missing: Vec<f64> = counts.iter().copied().chain([f64::NAN, f64::INFINITY]).collect();
        assert!((step(&missing).unwrap() - 1.0).abs() < 1e-9);
        assert_eq!(step(&[0.25; 40]), None);
        assert_eq!(step(&[1.0, 2.0, 3.0]), None);
        assert_eq!(step(&[0.0; 40]), None);
    }
}
