//! Numbers: those on the command line, of which what cannot be is refused before anything is done, and medians.

/// A parser for the finite numbers that are allowed; `wanted` says which, such as "a time in seconds above 0".
pub(crate) fn allowed(
    wanted: &'static str,
    allowed: impl Fn(f64) -> bool + Clone,
) -> impl Fn(&str) -> Result<f64, String> + Clone {
    move |text| match text.parse::<f64>() {
        Ok(v) if v.is_finite() && allowed(v) => Ok(v),
        _ => Err(format!("give {wanted}")),
    }
}

/// A parser for positive numbers.
pub(crate) fn positive(wanted: &'static str) -> impl Fn(&str) -> Result<f64, String> + Clone {
    allowed(wanted, |v| v > 0.0)
}

/// The median of those that are finite, the upper one of two; not a number where there is none.
pub(crate) fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut sorted: Vec<f64> = values.filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Root mean square of the values that are finite; 0 of none.
pub(crate) fn root_mean_square(values: &[f64]) -> f64 {
    let finite = values.iter().filter(|v| v.is_finite());
    let (sum, count) = finite.fold((0.0, 0.0_f64), |(sum, count), v| (sum + v * v, count + 1.0));
    (sum / count.max(1.0)).sqrt()
}
