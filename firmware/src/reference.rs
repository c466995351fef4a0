//! The lock-in's reference, exact by construction.

/// Samples in one period of the excitation. With 16, of all harmonics only 15f, 17f, 31f, ... look like the
/// fundamental; with 4 the third already would.
pub const SAMPLES_PER_PERIOD: usize = 16;

/// One in the tables' fixed point (Q14).
pub(crate) const ONE: i32 = 1 << 14;

/// `sin(2 pi k / 16)` in Q14: what the excitation looks like.
pub const SINE: [i16; SAMPLES_PER_PERIOD] = table(0);

/// `cos(2 pi k / 16)` in Q14.
pub const COSINE: [i16; SAMPLES_PER_PERIOD] = table(SAMPLES_PER_PERIOD / 4);

// Exact zeros make the rejection of DC, of even harmonics and of the other phase exact in integers.
const _: () = assert!(sum_of_products(&SINE, &[1; SAMPLES_PER_PERIOD]) == 0);
const _: () = assert!(sum_of_products(&COSINE, &[1; SAMPLES_PER_PERIOD]) == 0);
const _: () = assert!(sum_of_products(&SINE, &COSINE) == 0);

/// `sin(x)` for 0 <= x <= pi / 2 by its power series; 1e-15 after twelve terms.
#[expect(clippy::indexing_slicing, reason = "evaluated by the compiler only")]
const fn table(shift: usize) -> [i16; SAMPLES_PER_PERIOD] {
    const QUARTER: usize = SAMPLES_PER_PERIOD / 4;
    let mut out = [0; SAMPLES_PER_PERIOD];
    let mut k = 0;
    while k < SAMPLES_PER_PERIOD {
        // Every entry is one of the first quarter's, mirrored or negated: the symmetry makes the sums vanish.
        let phase = (k + shift) % SAMPLES_PER_PERIOD;
        let in_half = phase % (2 * QUARTER);
        let in_quarter = if in_half <= QUARTER {
            in_half
        } else {
            2 * QUARTER - in_half
        };
        let x = core::f64::consts::TAU * in_quarter as f64 / SAMPLES_PER_PERIOD as f64;
        let (mut term, mut sin, mut n) = (x, x, 1);
        while n < 12 {
            term *= -x * x / ((2 * n) as f64 * (2 * n + 1) as f64);
            sin += term;
            n += 1;
        }
        let q14 = (sin * ONE as f64 + 0.5) as i16;
        out[k] = if phase < 2 * QUARTER { q14 } else { -q14 };
        k += 1;
    }
    out
}

#[expect(clippy::indexing_slicing, reason = "evaluated by the compiler only")]
const fn sum_of_products(a: &[i16; SAMPLES_PER_PERIOD], b: &[i16; SAMPLES_PER_PERIOD]) -> i64 {
    let (mut sum, mut k) = (0, 0);
    while k < SAMPLES_PER_PERIOD {
        sum += a[k] as i64 * b[k] as i64;
        k += 1;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tables_are_the_nearest_integers() {
        for k in 0..SAMPLES_PER_PERIOD {
            let x = core::f64::consts::TAU * k as f64 / 16.0;
            assert_eq!(f64::from(SINE[k]), (x.sin() * 16384.0).round(), "sin {k}");
            assert_eq!(f64::from(COSINE[k]), (x.cos() * 16384.0).round(), "cos {k}");
        }
    }

    #[test]
    fn the_gain_error_of_rounding_the_table_is_under_2e_5() {
        let exact: f64 = (0..16)
            .map(|k| f64::from(SINE[k]) * (core::f64::consts::TAU * k as f64 / 16.0).sin())
            .sum();
        assert!((exact / (8.0 * 16384.0) - 1.0).abs() < 2e-5, "{exact}");
    }
}
