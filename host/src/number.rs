//! Numbers on the command line: what cannot be is refused before anything is done.

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
