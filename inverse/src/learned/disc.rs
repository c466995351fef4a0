//! Smooth functions of a place that turn with a sheet: eigenfunctions of the Laplacian on a disc, in which a Gaussian process is a list
//! of independent weights (Solin and Särkkä 2020, "Hilbert space methods for reduced-rank Gaussian process regression"). A turn of the
//! sheet changes the phase of each, and nothing else.

use std::f64::consts::SQRT_2;

/// Exponent of a Matérn process that is twice differentiable.
const SMOOTHNESS: f64 = 2.5;
/// Step between places where a Bessel function is looked at for a change of its sign; its zeros are about 3 apart.
const STEP: f64 = 0.1;
/// Halvings that find a zero.
const HALVINGS: usize = 50;

/// One eigenfunction `J(k r) cos(n φ)`, or the sine of the same order, which stands beside it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mode {
    /// Its order n: positive of a cosine, negative of a sine.
    pub(super) order: i32,
    /// Wave number over the inverse of the disc's radius.
    wave: f64,
    /// What makes its mean square one over the disc's area.
    size: f64,
}

/// The eigenfunctions up to a wave number. They vanish at the rim of the disc, which has to be larger than what they describe.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Disc {
    centre_mm: [f64; 2],
    radius_mm: f64,
    /// A sine stands behind its cosine.
    modes: Vec<Mode>,
}

/// Zeros of a Bessel function up to a limit, without that at nought.
fn zeros(order: i32, limit: f64) -> Vec<f64> {
    let f = |x: f64| libm::jn(order, x);
    let steps = (limit / STEP) as usize;
    let crossing = |k: usize| {
        let (mut low, mut high) = (k as f64 * STEP, (k + 1) as f64 * STEP);
        let sign = f(low);
        (sign * f(high) < 0.0).then(|| {
            for _ in 0..HALVINGS {
                let middle = 0.5 * (low + high);
                if sign * f(middle) > 0.0 {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            0.5 * (low + high)
        })
    };
    (1..steps).filter_map(crossing).collect()
}

impl Disc {
    /// All functions on a disc up to a wave number over the inverse of its radius.
    pub(super) fn new(centre_mm: [f64; 2], radius_mm: f64, highest: f64) -> Self {
        let mut modes = Vec::new();
        for order in 0.. {
            let waves = zeros(order, highest);
            if waves.is_empty() {
                break;
            }
            for wave in waves {
                let size = 1.0 / libm::jn(order + 1, wave).abs();
                let both = [order, -order].map(|order| Mode { order, wave, size });
                modes.extend(&both[..if order == 0 { 1 } else { 2 }]);
            }
        }
        Self {
            centre_mm,
            radius_mm,
            modes,
        }
    }

    /// How many.
    pub(super) fn len(&self) -> usize {
        self.modes.len()
    }

    /// Them.
    pub(super) fn modes(&self) -> &[Mode] {
        &self.modes
    }

    /// Their values at a place, into a list of [`Disc::len`]. The angle is counted clockwise where electrodes are.
    pub(super) fn values_at(&self, place_mm: [f64; 2], clockwise: bool, out: &mut [f64]) {
        let [x, y] = [0, 1].map(|k| (place_mm[k] - self.centre_mm[k]) / self.radius_mm);
        let (radius, angle) = (x.hypot(y).min(1.0), if clockwise { -y.atan2(x) } else { y.atan2(x) });
        let mut place = 0;
        while place < self.modes.len() {
            let Mode { order, wave, size } = self.modes[place];
            let along = size * libm::jn(order, wave * radius);
            if order == 0 {
                out[place] = along;
                place += 1;
            } else {
                let (sin, cos) = (f64::from(order) * angle).sin_cos();
                out[place] = SQRT_2 * along * cos;
                out[place + 1] = SQRT_2 * along * sin;
                place += 2;
            }
        }
    }

    /// Variances of the weights of a Matérn process with this length, whose variance in the middle of the disc is 1.
    pub(super) fn matern(&self, length_mm: f64) -> Vec<f64> {
        let length = length_mm / self.radius_mm;
        let density = |m: &Mode| (2.0 * SMOOTHNESS / (length * length) + m.wave * m.wave).powf(-SMOOTHNESS - 1.0);
        let mut variances: Vec<f64> = self.modes.iter().map(density).collect();
        let mut middle = vec![0.0; self.len()];
        self.values_at(self.centre_mm, false, &mut middle);
        let whole: f64 = middle.iter().zip(&variances).map(|(f, v)| f * f * v).sum();
        variances.iter_mut().for_each(|v| *v /= whole);
        variances
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn covariance(disc: &Disc, variances: &[f64], a: [f64; 2], b: [f64; 2]) -> f64 {
        let (mut at_a, mut at_b) = (vec![0.0; disc.len()], vec![0.0; disc.len()]);
        disc.values_at(a, false, &mut at_a);
        disc.values_at(b, true, &mut at_b);
        // Against one of the other sense: mirrored.
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
        let disc = Disc::new([3.0, -2.0], 1.75 * reach, 40.0);
        let variances = disc.matern(length);
        for (a, b) in [
            ([3.0, -2.0], [3.0, -2.0]),
            ([10.0, 5.0], [-4.0, 12.0]),
            ([20.0, -20.0], [25.0, -8.0]),
            ([-22.0, 10.0], [-5.0, 12.0]),
        ] {
            let mirrored = [b[0], -4.0 - b[1]];
            let wanted = matern(f64::hypot(a[0] - b[0], a[1] - b[1]), length);
            assert!(
                (covariance(&disc, &variances, a, mirrored) - wanted).abs() < 0.02,
                "{a:?} {b:?}"
            );
        }
    }

    #[test]
    fn zeros_of_bessels_functions_are_the_tabulated_ones() {
        for (order, wanted) in [
            (0, [2.404_825_557_7, 5.520_078_110_3]),
            (1, [3.831_705_970_2, 7.015_586_669_8]),
        ] {
            let found = zeros(order, 8.0);
            assert!(found.iter().zip(wanted).all(|(f, w)| (f - w).abs() < 1e-9), "{found:?}");
            assert_eq!(found.len(), 2);
        }
    }
}
