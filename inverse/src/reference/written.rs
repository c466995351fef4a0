//! Numbers as a person reads them.

/// `30 ohm`, `9.9 kilohm`.
pub(super) fn resistance(ohm: f64) -> String {
    if ohm < 1000.0 {
        format!("{ohm:.0} ohm")
    } else {
        format!("{} kilohm", two_digits(ohm / 1000.0))
    }
}

/// A factor as a person reads it: two digits.
pub(super) fn two_digits(factor: f64) -> String {
    let place = factor.abs().log10().floor() as i32;
    match place {
        -3..=0 => format!("{factor:.*}", (1 - place) as usize),
        1..=5 => {
            let unit = 10_f64.powi(place - 1);
            format!("{:.0}", (factor / unit).round() * unit)
        }
        _ => format!("{factor:.1e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_are_read_with_two_digits() {
        for (factor, text) in [
            (-1.0, "-1.0"),
            (-1.004, "-1.0"),
            (-1000.0, "-1000"),
            (-1049.0, "-1000"),
            (-37.2, "-37"),
            (0.1, "0.10"),
            (0.0999, "0.100"),
            (0.15, "0.15"),
            (-2.5e9, "-2.5e9"),
        ] {
            assert_eq!(two_digits(factor), text);
        }
    }
}
