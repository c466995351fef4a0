//! What a measurement from the rim of a disc can feel of a place in it.
//!
//! A small change at z alters a measurement by `∇u·∇v`, u and v being the potentials that the drive and the sense pair make (Geselowitz
//! 1971). On a disc these are real parts of analytic functions F and G, so that it is `Re F'(z) conj(G'(z))`. Currents of small
//! electrodes at the rim have no preferred order around it, which gives F' the covariance `1 / (1 - z conj(w))` of Szegő, z and w over the
//! disc's radius. The response then is a Gaussian process with the covariance `1 / |1 - z conj(w)|²`. It is smooth in the middle, and the
//! stronger and finer the nearer to the rim. Its terms `z^m conj(z)^n` have independent weights of variance one.
//!
//! A sheet with a grain conducts better along it than across. Lengths over the roots of the conductivities make of such a disc an even
//! sheet with an elliptic rim. There `z = ζ + Q conj(ζ)`, ζ being the place on the disc. `|Q|` is the difference of the half axes over
//! their sum, and half the argument of Q is the direction of the longer one, across the grain. Fields are analytic in z again. Currents
//! around the rim that change as n + 1 times the angle make Chebyshev's polynomials of the second kind, `U_0 = 1`, `U_1 = z` and
//! `U_(n + 1) = z U_n - Q U_(n - 1)`. On the rim `z = ζ + Q / ζ`, and they are `(ζ^(n + 1) - (Q / ζ)^(n + 1)) / (ζ - Q / ζ)`. So the terms
//! are `U_m conj(U_n)`. With Q = 0 they are those of an even disc.

use nalgebra::Complex;
use std::f64::consts::SQRT_2;

/// Highest degree m + n. What is beyond is four hundredths of the variance at 0.8 of the radius on a sheet without a grain. On one that
/// conducts five times as well along its grain it is a third there, at the ends of the grain, and nothing across.
const DEGREE: usize = 10;
/// How many there are.
const COUNT: usize = (DEGREE + 1) * (DEGREE + 2) / 2;

/// The terms up to a degree, on a disc around a place with a stretch Q. Their values grow beyond the disc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sensitivities {
    centre_mm: [f64; 2],
    radius_mm: f64,
    stretch: Complex<f64>,
}

/// The terms of two fields: real and imaginary part of their product, the second one conjugated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Pair {
    /// Degree of the first field.
    pub(super) high: usize,
    /// Degree of the second, which is not higher.
    pub(super) low: usize,
    /// Number of their first term.
    pub(super) first: usize,
}

impl Pair {
    /// How many terms; the product of a field with itself is real.
    pub(super) const fn len(self) -> usize {
        if self.high == self.low { 1 } else { 2 }
    }
}

impl Sensitivities {
    pub(super) const fn new(centre_mm: [f64; 2], radius_mm: f64, stretch: Complex<f64>) -> Self {
        Self {
            centre_mm,
            radius_mm,
            stretch,
        }
    }

    /// How many.
    pub(super) const fn len() -> usize {
        COUNT
    }

    /// The pairs of fields, in the order of their terms.
    pub(super) fn pairs() -> impl Iterator<Item = Pair> {
        let mut first = 0;
        let pairs = (0..=DEGREE).flat_map(|order| (0..=(DEGREE - order) / 2).map(move |low| (low + order, low)));
        pairs.map(move |(high, low)| {
            let pair = Pair { high, low, first };
            first += pair.len();
            pair
        })
    }

    /// Their values at a place, into a list of [`Sensitivities::len`].
    pub(super) fn values_at(&self, place_mm: [f64; 2], out: &mut [f64]) {
        let [x, y] = [0, 1].map(|k| (place_mm[k] - self.centre_mm[k]) / self.radius_mm);
        let place = Complex::new(x, y);
        let z = place + self.stretch * place.conj();
        let mut fields = [Complex::ONE; DEGREE + 1];
        fields[1] = z;
        for k in 1..DEGREE {
            fields[k + 1] = z * fields[k] - self.stretch * fields[k - 1];
        }
        for pair in Self::pairs() {
            let value = fields[pair.high] * fields[pair.low].conj();
            if pair.len() == 1 {
                out[pair.first] = value.re;
            } else {
                out[pair.first] = SQRT_2 * value.re;
                out[pair.first + 1] = SQRT_2 * value.im;
            }
        }
    }

    /// Adds to weights of the terms those of electrodes that are turned by an angle, times a gain. On a sheet without a grain that turns
    /// the map around the centre, `gain f(R(-angle) p)`. On another it turns the currents around the rim, but for what the grain changes
    /// of their fields: `U_(n - 1)` has `1 / (1 - |Q|^n)` of a current along one axis, `1 / (1 + |Q|^n)` of one along the other. That is
    /// left to the maps that change with twice the angle.
    pub(super) fn add_turned(map: &[f64], angle: f64, gain: f64, out: &mut [f64]) {
        for pair in Self::pairs() {
            let (sin, cos) = ((pair.high - pair.low) as f64 * angle).sin_cos();
            let k = pair.first;
            if pair.len() == 1 {
                out[k] += gain * map[k];
            } else {
                let (re, im) = (map[k], map[k + 1]);
                out[k] += gain * (re * cos - im * sin);
                out[k + 1] += gain * (re * sin + im * cos);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turned_map_has_the_values_of_the_map_at_places_turned_back() {
        let basis = Sensitivities::new([0.0; 2], 40.0, Complex::ZERO);
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
    fn terms_of_a_stretched_sheet_are_products_of_chebyshev_polynomials() {
        let stretch = Complex::from_polar(0.4, 1.1);
        let basis = Sensitivities::new([3.0, -2.0], 50.0, stretch);
        for w in [Complex::from_polar(0.9, 0.3), Complex::from_polar(0.7, -2.0)] {
            let z = w + stretch / w;
            let place = (z - stretch * z.conj()) / (1.0 - stretch.norm_sqr());
            let mut found = vec![0.0; Sensitivities::len()];
            basis.values_at([3.0 + 50.0 * place.re, -2.0 + 50.0 * place.im], &mut found);
            let field = |n: usize| -> Complex<f64> {
                let power = |base: Complex<f64>| (0..n).fold(base, |product, _| product * base);
                (power(w) - power(stretch / w)) / (w - stretch / w)
            };
            let wanted = Sensitivities::pairs().flat_map(|pair| {
                let product = field(pair.high) * field(pair.low).conj();
                let size = if pair.len() == 1 { 1.0 } else { SQRT_2 };
                [size * product.re, size * product.im].into_iter().take(pair.len())
            });
            for (k, (found, wanted)) in found.iter().zip(wanted).enumerate() {
                assert!((found - wanted).abs() < 1e-9, "{w} {k}: {found} {wanted}");
            }
        }
    }

    #[test]
    fn independent_weights_make_the_covariance_of_what_the_rim_can_feel() {
        let basis = Sensitivities::new([3.0, -2.0], 50.0, Complex::ZERO);
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
