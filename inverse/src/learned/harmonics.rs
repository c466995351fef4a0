//! Smooth functions of a place: eigenfunctions of the Laplacian on a square, in which a Gaussian process is a list of
//! independent weights (Solin and Särkkä 2020, "Hilbert space methods for reduced-rank Gaussian process regression").

use std::f64::consts::PI;

/// Half side of the square, over the reach of the presses.
pub(super) const SQUARE: f64 = 1.5;
/// Highest wave number, over the inverse of the length.
pub(super) const HIGHEST: f64 = 4.2;
/// Exponent of a Matérn process that is twice differentiable.
const SMOOTHNESS: f64 = 2.5;

/// The eigenfunctions `sin(i u) sin(j v)` with `i² + j²` up to a limit, on a square around a place. They vanish at its
/// sides, so that it has to be larger than what they describe.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Harmonics {
    centre_mm: [f64; 2],
    half_mm: f64,
    orders: Vec<[usize; 2]>,
    most: usize,
}

impl Harmonics {
    /// All functions on a square of this half side up to a wave number, rad/mm; at least one.
    pub(super) fn new(centre_mm: [f64; 2], half_mm: f64, highest_per_mm: f64) -> Self {
        let most = ((highest_per_mm * 2.0 * half_mm / PI).round() as usize).max(2);
        let orders = (1..=most)
            .flat_map(|i| (1..=most).map(move |j| [i, j]))
            .filter(|[i, j]| i * i + j * j <= most * most + 1)
            .collect();
        Self {
            centre_mm,
            half_mm,
            orders,
            most,
        }
    }

    /// How many.
    pub(super) fn len(&self) -> usize {
        self.orders.len()
    }

    /// Their values at a place, into a list of [`Harmonics::len`].
    pub(super) fn values_at(&self, place_mm: [f64; 2], out: &mut [f64]) {
        // sin(k t) by Chebyshev's recursion.
        let sines = [0, 1].map(|axis| {
            let t = PI * (place_mm[axis] - self.centre_mm[axis] + self.half_mm) / (2.0 * self.half_mm);
            let (first, twice_cos) = (t.sin(), 2.0 * t.cos());
            let mut list = vec![0.0, first];
            for k in 2..=self.most {
                list.push(twice_cos * list[k - 1] - list[k - 2]);
            }
            list
        });
        for (value, [i, j]) in out.iter_mut().zip(&self.orders) {
            *value = sines[0][*i] * sines[1][*j] / self.half_mm;
        }
    }

    /// Variances of the weights of a Matérn process with this length, whose variance in the middle of the square is 1.
    pub(super) fn matern(&self, length_mm: f64) -> Vec<f64> {
        let step = PI / (2.0 * self.half_mm);
        let density = |[i, j]: &[usize; 2]| {
            let square = step * step * (i * i + j * j) as f64;
            (2.0 * SMOOTHNESS / (length_mm * length_mm) + square).powf(-SMOOTHNESS - 1.0)
        };
        let mut variances: Vec<f64> = self.orders.iter().map(density).collect();
        let mut middle = vec![0.0; self.len()];
        self.values_at(self.centre_mm, &mut middle);
        let whole: f64 = middle.iter().zip(&variances).map(|(f, v)| f * f * v).sum();
        variances.iter_mut().for_each(|v| *v /= whole);
        variances
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn covariance(h: &Harmonics, variances: &[f64], a: [f64; 2], b: [f64; 2]) -> f64 {
        let (mut at_a, mut at_b) = (vec![0.0; h.len()], vec![0.0; h.len()]);
        h.values_at(a, &mut at_a);
        h.values_at(b, &mut at_b);
        at_a.iter().zip(&at_b).zip(variances).map(|((p, q), v)| p * q * v).sum()
    }

    /// Matérn's covariance of smoothness 5/2 (Rasmussen and Williams 2006, equation 4.17).
    fn matern(distance: f64, length: f64) -> f64 {
        let r = 5.0_f64.sqrt() * distance / length;
        (1.0 + r + r * r / 3.0) * (-r).exp()
    }

    #[test]
    fn independent_weights_make_materns_covariance() {
        let (length, reach) = (18.0, 40.0);
        let h = Harmonics::new([3.0, -2.0], 1.5 * reach, 12.0 / length);
        let variances = h.matern(length);
        for (a, b) in [
            ([3.0, -2.0], [3.0, -2.0]),
            ([10.0, 5.0], [-4.0, 12.0]),
            ([20.0, -20.0], [25.0, -8.0]),
            ([-22.0, 10.0], [-5.0, 12.0]),
        ] {
            let wanted = matern(f64::hypot(a[0] - b[0], a[1] - b[1]), length);
            assert!((covariance(&h, &variances, a, b) - wanted).abs() < 0.02, "{a:?} {b:?}");
        }
    }
}
