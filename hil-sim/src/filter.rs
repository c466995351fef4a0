//! Frequency responses of the filters between source and converter.

use std::f64::consts::{PI, SQRT_2, TAU};

/// A complex number, as real and imaginary part.
pub(crate) type Complex = (f64, f64);

pub(crate) fn times(a: Complex, b: Complex) -> Complex {
    (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
}

fn inverse(a: Complex) -> Complex {
    let square = a.0 * a.0 + a.1 * a.1;
    (a.0 / square, -a.1 / square)
}

pub(crate) fn magnitude(a: Complex) -> f64 {
    (a.0 * a.0 + a.1 * a.1).sqrt()
}

/// Response of a channel's one-pole low-pass.
pub(crate) fn low_pass(frequency_hz: f64, settling_s: f64) -> Complex {
    inverse((1.0, TAU * frequency_hz * settling_s))
}

/// Response of a Butterworth low-pass of second order.
pub(crate) fn butterworth(frequency_hz: f64, corner_hz: f64) -> Complex {
    if corner_hz == 0.0 {
        return (1.0, 0.0);
    }
    let r = frequency_hz / corner_hz;
    inverse((1.0 - r * r, SQRT_2 * r))
}

/// Loss of a value that is held for a part of the period, at this harmonic.
pub(crate) fn hold(harmonic: f64, part: f64) -> f64 {
    let x = PI * harmonic * part;
    if x == 0.0 { 1.0 } else { libm::sin(x) / x }
}
