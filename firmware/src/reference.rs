//! The lock-in's reference and the integers that it is made of.
//!
//! Sampled at 16 points a period, the harmonics 2f to 14f and DC have a correlation of exactly zero with the sine and the
//! cosine: their sums over the 16th roots of unity vanish. In integers this holds as follows:
//! - DC and the even harmonics are equal at k and k + 8, where the reference changes sign. The firmware subtracts these two
//!   samples first: DC and even harmonics cancel to the last bit, however they were rounded.
//! - The odd harmonics 3f to 13f cancel because sin(pi/8), sin(pi/4) and sin(3pi/8) have irrational ratios, which no table
//!   of integers has. With 30 bits of fraction the residual of a full-scale harmonic is less than a thousandth of a
//!   [`Value`](protocol::Value)'s unit, at any number of periods. A value is the exact correlation of the codes, rounded.

/// Samples in one period of the excitation. With 16, of all harmonics only 15f, 17f, 31f, ... look like the
/// fundamental; with 4 the third already would.
pub const SAMPLES_PER_PERIOD: usize = 16;

/// Half a period: the reference changes its sign, the even harmonics do not.
pub const HALF: usize = SAMPLES_PER_PERIOD / 2;

/// Bits of fraction of the tables.
pub const FRACTION: u32 = 30;

/// One in the tables' fixed point.
pub(crate) const ONE: i32 = 1 << FRACTION;

/// `sin(2 pi k / 16)` for the first half period, in 2^-30: what the excitation looks like. The second half is its negative.
pub const SINE: [i32; HALF] = table(0);

/// `cos(2 pi k / 16)` for the first half period, in 2^-30.
pub const COSINE: [i32; HALF] = table(SAMPLES_PER_PERIOD / 4);

// The two references do not see each other.
const _: () = assert!(sum_of_products(&SINE, &COSINE) == 0);

/// `sin(x)` for 0 <= x <= pi / 2 by its power series; 1e-15 after twelve terms.
#[expect(clippy::indexing_slicing, reason = "evaluated by the compiler only")]
const fn table(shift: usize) -> [i32; HALF] {
    const QUARTER: usize = SAMPLES_PER_PERIOD / 4;
    let mut out = [0; HALF];
    let mut k = 0;
    while k < HALF {
        // Every entry is one of the first quarter's, mirrored or negated: the symmetry makes the sums vanish.
        let phase = (k + shift) % SAMPLES_PER_PERIOD;
        let in_half = phase % HALF;
        let in_quarter = if in_half <= QUARTER { in_half } else { HALF - in_half };
        let x = core::f64::consts::TAU * in_quarter as f64 / SAMPLES_PER_PERIOD as f64;
        let (mut term, mut sin, mut n) = (x, x, 1);
        while n < 12 {
            term *= -x * x / ((2 * n) as f64 * (2 * n + 1) as f64);
            sin += term;
            n += 1;
        }
        let fixed = (sin * ONE as f64 + 0.5) as i32;
        out[k] = if phase < HALF { fixed } else { -fixed };
        k += 1;
    }
    out
}

#[expect(clippy::indexing_slicing, reason = "evaluated by the compiler only")]
const fn sum_of_products(a: &[i32; HALF], b: &[i32; HALF]) -> i64 {
    let (mut sum, mut k) = (0, 0);
    while k < HALF {
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
        for k in 0..HALF {
            let x = core::f64::consts::TAU * k as f64 / 16.0;
            assert_eq!(f64::from(SINE[k]), (x.sin() * f64::from(ONE)).round(), "sin {k}");
            assert_eq!(f64::from(COSINE[k]), (x.cos() * f64::from(ONE)).round(), "cos {k}");
        }
    }
}
