//! What a measurement from the rim of a disc can feel of a place in it.
//!
//! A small change at z alters a measurement by `∇u·∇v`, u and v being the potentials that the drive and the sense pair make (Geselowitz
//! 1971). On a disc these are real parts of analytic functions F and G, so that it is `Re F'(z) conj(G'(z))`. Currents of small
//! electrodes at the rim have no preferred order around it, which gives F' the covariance `1 / (1 - z conj(w))` of Szegő, z and w over the
//! disc's radius. The response then is a Gaussian process with the covariance `1 / |1 - z conj(w)|²`. It is smooth in the middle, and the
//! stronger and finer the nearer to the rim. Its terms `z^m conj(z)^n` have independent weights of variance one.

use std::f64::consts::SQRT_2;

/// Highest degree m + n. What is beyond is four hundredths of the variance at 0.8 of the radius.
const DEGREE: usize = 10;
/// How many there are.
const COUNT: usize = (DEGREE + 1) * (DEGREE + 2) / 2;

/// The terms up to a degree, on a disc around a place. Their values grow beyond the disc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sensitivities {
    centre_mm: [f64; 2],
    radius_mm: f64,
}

impl Sensitivities {
    pub(super) const fn new(centre_mm: [f64; 2], radius_mm: f64) -> Self {
        Self { centre_mm, radius_mm }
    }

    /// How many.
    pub(super) const fn len() -> usize {
        COUNT
    }

    /// Their values at a place, into a list of [`Sensitivities::len`]: `r^2n` times real and imaginary part of `z^(m - n)`.
    pub(super) fn values_at(&self, place_mm: [f64; 2], out: &mut [f64]) {
        let [x, y] = [0, 1].map(|k| (place_mm[k] - self.centre_mm[k]) / self.radius_mm);
        let square = x * x + y * y;
        let (mut re, mut im) = (1.0, 0.0);
        let mut next = out.iter_mut();
        let mut put = |value: f64| {
            if let Some(out) = next.next() {
                *out = value;
            }
        };
        for order in 0..=DEGREE {
            let mut size = if order == 0 { 1.0 } else { SQRT_2 };
            for _ in 0..=(DEGREE - order) / 2 {
                put(size * re);
                if order > 0 {
                    put(size * im);
                }
                size *= square;
            }
            (re, im) = (x * re - y * im, x * im + y * re);
        }
    }

    /// Adds to weights of the terms those of a map that is turned around the centre, times a gain: `gain f(R(-angle) p)`.
    pub(super) fn add_turned(map: &[f64], angle: f64, gain: f64, out: &mut [f64]) {
        let mut next = 0;
        for order in 0..=DEGREE {
            let (sin, cos) = (order as f64 * angle).sin_cos();
            for _ in 0..=(DEGREE - order) / 2 {
                if order == 0 {
                    out[next] += gain * map[next];
                    next += 1;
                } else {
                    let (re, im) = (map[next], map[next + 1]);
                    out[next] += gain * (re * cos - im * sin);
                    out[next + 1] += gain * (re * sin + im * cos);
                    next += 2;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turned_map_has_the_values_of_the_map_at_places_turned_back() {
        let basis = Sensitivities::new([0.0; 2], 40.0);
        let map: Vec<f64> = (0..Sensitivities::len()).map(|k| (k as f64 * 1.7).sin()).collect();
        let value = |weights: &[f64], p: [f64; 2]| -> f64 {
            let mut out = vec![0.0; Sensitivities::len()];
            basis.values_at(p, &mut out);
            out.iter().zip(weights).map(|(a, b)| a * b).sum()
        };
        let angle: f64 = 0.9;
        let (sin, cos) = angle.sin_cos();
        let mut turned = vec![0.0; Sensitivities::len()];
        Sensitivities::add_turned(&map, angle, 2.0, &mut turned);
        for [x, y] in [[0.0, 0.0], [20.0, -5.0], [-3.0, 31.0]] {
            let back = [cos * x + sin * y, cos * y - sin * x];
            let (found, wanted) = (value(&turned, [x, y]), 2.0 * value(&map, back));
            assert!((found - wanted).abs() < 1e-9, "{found} {wanted}");
        }
    }

    #[test]
    fn independent_weights_make_the_covariance_of_what_the_rim_can_feel() {
        let basis = Sensitivities::new([3.0, -2.0], 50.0);
        let at = |p: [f64; 2]| {
            let mut out = vec![0.0; Sensitivities::len()];
            basis.values_at(p, &mut out);
            out
        };
        for (a, b) in [
            ([3.0, -2.0], [3.0, -2.0]),
            ([10.0, 5.0], [-4.0, 12.0]),
            ([20.0, -20.0], [25.0, -8.0]),
            ([3.0, 38.0], [3.0, 38.0]),
        ] {
            let found: f64 = at(a).iter().zip(at(b)).map(|(p, q)| p * q).sum();
            let [z, w] = [a, b].map(|p| [(p[0] - 3.0) / 50.0, (p[1] + 2.0) / 50.0]);
            let re = 1.0 - z[0] * w[0] - z[1] * w[1];
            let im = z[1] * w[0] - z[0] * w[1];
            let wanted = 1.0 / (re * re + im * im);
            assert!((found / wanted - 1.0).abs() < 0.04, "{a:?} {b:?}: {found} {wanted}");
        }
    }
}
