//! Newtons over the sheet: what force a press of the usual strength has at every place.
//!
//! Presses of one force change the measurements more in the middle of a sheet than at its rim, and a sheet is not equally soft everywhere.
//! Of presses whose force is known the logarithm of force over strength is a smooth function of the place: a Gaussian process beside a
//! constant, whose length and size have the largest evidence (Rasmussen and Williams 2006, section 5.4). Few forces fit a function exactly, which
//! is no sign that there is no noise: a deviation is expected beforehand. What is told is that of presses left out.

use super::harmonics::{HIGHEST, Harmonics, SQUARE};
use nalgebra::{Cholesky, DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Fewest presses with a force.
const FEWEST_FORCES: usize = 5;
/// Lengths that are tried, over the reach of the presses, and sizes of the process over its noise, as variances.
const LENGTHS: [f64; 3] = [0.4, 0.8, 1.6];
const SIZES: [f64; 8] = [1e-9, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0, 1e3];
/// Below it the place tells nothing.
const FLAT: f64 = 1e-3;
/// Variance of the constant over the noise's: nothing is known of it.
const CONSTANT: f64 = 1e6;
/// Noise that is expected beforehand, over the force, as if so many forces had told it: an inverse gamma distribution of its variance.
const EXPECTED_NOISE: f64 = 0.15;
const EXPECTED_OF: f64 = 1.0;
/// Strengths below tell no force.
const LEAST_STRENGTH: f64 = 0.05;

/// Largest logarithm of a force over the usual one that weights may make: what is computed with it stays a number.
const LARGEST_LOG: f64 = 100.0;

/// Newtons for every strength, over the sheet.
#[derive(Clone, Debug, PartialEq)]
pub struct Gain {
    stored: StoredGain,
    harmonics: Harmonics,
}

/// It as numbers, for a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StoredGain {
    /// Presses with a force that it was learned from.
    pub presses: usize,
    /// Force of a press of the usual strength, N, where the place tells nothing.
    pub usual_n: f64,
    /// Largest over smallest force of a press of the usual strength among the presses' places.
    pub range: f64,
    /// Standard deviation over the force: root mean square of the presses, each by what the others tell.
    pub relative_sd: f64,
    /// Middle of the presses, mm.
    pub centre_mm: [f64; 2],
    /// Farthest press from it, mm.
    pub reach_mm: f64,
    /// Length over which the gain changes, over the reach.
    pub length: f64,
    /// Logarithm of `usual_n` over the place: weights of the harmonics.
    pub weights: Vec<f64>,
}

fn harmonics(centre_mm: [f64; 2], reach_mm: f64, length: f64) -> Harmonics {
    Harmonics::new(centre_mm, SQUARE * reach_mm, HIGHEST / (length * reach_mm))
}

fn features(harmonics: &Harmonics, place_mm: [f64; 2]) -> DVector<f64> {
    let mut out = DVector::zeros(harmonics.len());
    harmonics.values_at(place_mm, out.as_mut_slice());
    out
}

/// One way to explain the forces.
struct Fit {
    evidence: f64,
    length: f64,
    constant: f64,
    weights: DVector<f64>,
    /// Logarithms of the forces less those that the others tell.
    left_out: DVector<f64>,
}

impl Gain {
    /// Learns from presses at places (mm) with their strengths and forces (N). `None` where fewer than five have both, or all are at one place.
    pub fn learn(presses: &[([f64; 2], f64, f64)]) -> Option<Self> {
        let sound = |p: &&([f64; 2], f64, f64)| p.1 > LEAST_STRENGTH && p.2 > 0.0 && p.1.is_finite() && p.2.is_finite();
        let presses: Vec<_> = presses.iter().filter(sound).copied().collect();
        if presses.len() < FEWEST_FORCES {
            return None;
        }
        let count = presses.len() as f64;
        let centre_mm = [0, 1].map(|k| presses.iter().map(|p| p.0[k]).sum::<f64>() / count);
        let distance = |p: &[f64; 2]| (p[0] - centre_mm[0]).hypot(p[1] - centre_mm[1]);
        let reach_mm = presses.iter().map(|p| distance(&p.0)).fold(0.0, f64::max);
        if reach_mm < 1.0 {
            return None;
        }
        let logs = DVector::from_iterator(presses.len(), presses.iter().map(|p| (p.2 / p.1).ln()));
        let (mut best, mut flat): (Option<Fit>, Option<Fit>) = (None, None);
        for length in LENGTHS {
            let harmonics = harmonics(centre_mm, reach_mm, length);
            let variances = harmonics.matern(length * reach_mm);
            let columns: Vec<_> = presses.iter().map(|p| features(&harmonics, p.0)).collect();
            let plain = DMatrix::from_columns(&columns);
            for size in SIZES {
                let Some(fit) = fit(&plain, &variances, size, length, &logs) else {
                    continue;
                };
                if size < FLAT {
                    flat = Some(fit);
                } else if best.as_ref().is_none_or(|b| fit.evidence > b.evidence) {
                    best = Some(fit);
                }
            }
        }
        // Evidence trusts its prior; a function that tells presses left out no better than one number does is none.
        let (flat, best) = (flat?, best?);
        let tells = best.evidence > flat.evidence && best.left_out.norm_squared() < flat.left_out.norm_squared();
        let fit = if tells { best } else { flat };
        let harmonics = harmonics(centre_mm, reach_mm, fit.length);
        let at: Vec<f64> = (presses.iter())
            .map(|p| features(&harmonics, p.0).dot(&fit.weights))
            .collect();
        let (low, high) = at.iter().fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
        let stored = StoredGain {
            presses: presses.len(),
            usual_n: fit.constant.exp(),
            range: (high - low).exp(),
            relative_sd: (fit.left_out.norm_squared() / count).sqrt(),
            centre_mm,
            reach_mm,
            length: fit.length,
            weights: fit.weights.iter().copied().collect(),
        };
        Self::restore(&stored)
    }

    /// What such numbers make; `None` where they do not fit one another.
    pub fn restore(stored: &StoredGain) -> Option<Self> {
        // No harmonic is larger than one over half the square's side.
        let logs = stored.weights.iter().map(|w| w.abs()).sum::<f64>() / (SQUARE * stored.reach_mm);
        let sound = (1e-9..=1e9).contains(&stored.usual_n)
            && (1e-3..=1e6).contains(&stored.reach_mm)
            && stored.centre_mm.iter().all(|v| v.abs() <= 1e6)
            && logs <= LARGEST_LOG
            && (0.05..=10.0).contains(&stored.length)
            && (0.0..=1e6).contains(&stored.relative_sd);
        let harmonics = sound.then(|| harmonics(stored.centre_mm, stored.reach_mm, stored.length))?;
        (harmonics.len() == stored.weights.len()).then(|| Self {
            stored: stored.clone(),
            harmonics,
        })
    }

    /// The numbers that make it.
    pub fn stored(&self) -> &StoredGain {
        &self.stored
    }

    /// Force of a press of this strength there, N.
    pub fn newtons(&self, place_mm: [f64; 2], strength: f64) -> f64 {
        // Beyond the presses that of the nearest one is used: nothing is known there.
        let [x, y] = [0, 1].map(|k| place_mm[k] - self.stored.centre_mm[k]);
        let over = (x.hypot(y) / self.stored.reach_mm).max(1.0);
        let place = [self.stored.centre_mm[0] + x / over, self.stored.centre_mm[1] + y / over];
        let mut values = vec![0.0; self.harmonics.len()];
        self.harmonics.values_at(place, &mut values);
        let log: f64 = values.iter().zip(&self.stored.weights).map(|(v, w)| v * w).sum();
        self.stored.usual_n * strength * log.exp()
    }
}

/// The posterior and its evidence over all variances of the noise. `plain`: harmonics x presses.
fn fit(plain: &DMatrix<f64>, variances: &[f64], size: f64, length: f64, logs: &DVector<f64>) -> Option<Fit> {
    let (m, n) = plain.shape();
    // Weights over the root of their prior, and the constant last.
    let roots: Vec<f64> = variances.iter().map(|v| (v * size).sqrt()).collect();
    let scaled = DMatrix::from_fn(m + 1, n, |k, j| {
        if k < m {
            roots[k] * plain[(k, j)]
        } else {
            CONSTANT.sqrt()
        }
    });
    let factor = Cholesky::new(DMatrix::identity(m + 1, m + 1) + &scaled * scaled.transpose())?;
    let weights = factor.solve(&(&scaled * logs));
    // K^-1 y with K = I + ST S, by Woodbury; so is the diagonal of K^-1.
    let left = logs - scaled.tr_mul(&weights);
    let halves = factor.l_dirty().solve_lower_triangular(&scaled)?;
    let own = DVector::from_fn(n, |k, _| (1.0 - halves.column(k).norm_squared()).max(1e-9));
    let square = EXPECTED_OF * EXPECTED_NOISE * EXPECTED_NOISE + logs.dot(&left).max(0.0);
    let determinant: f64 = factor.l_dirty().diagonal().iter().map(|d| 2.0 * d.ln()).sum();
    Some(Fit {
        evidence: -0.5 * ((EXPECTED_OF + n as f64) * square.ln() + determinant),
        length,
        constant: weights[m] * CONSTANT.sqrt(),
        weights: DVector::from_fn(m, |k, _| weights[k] * roots[k]),
        // Rasmussen and Williams 2006, equation 5.12.
        left_out: left.component_div(&own),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Presses spread over a disc, with a strength of 1 +- a half; what a newton does falls towards the rim.
    fn presses(count: usize, noise: f64) -> Vec<([f64; 2], f64, f64)> {
        (0..count)
            .map(|k| {
                let (angle, radius) = (2.4 * k as f64, 80.0 * ((k as f64 + 0.5) / count as f64).sqrt());
                let place = [radius * angle.cos(), radius * angle.sin()];
                let strength = 1.0 + 0.5 * (k as f64 * 1.7).sin();
                let wobble = 1.0 + noise * (k as f64 * 12.9898).sin();
                (place, strength, strength * law(place) * wobble)
            })
            .collect()
    }

    /// Newtons of the usual strength.
    fn law([x, y]: [f64; 2]) -> f64 {
        6.0 * (1.0 + (x * x + y * y) / 6400.0) * (1.0 + 0.002 * x)
    }

    #[test]
    fn a_newton_is_a_newton_at_the_rim_and_in_the_middle() {
        for (known, noise, within) in [(12, 0.0, 0.12), (40, 0.0, 0.05), (40, 0.05, 0.08)] {
            let gain = Gain::learn(&presses(known, noise)).unwrap();
            for (place, strength, _) in presses(97, 0.0) {
                let off = gain.newtons(place, strength) / (strength * law(place)) - 1.0;
                assert!(off.abs() < within, "{known} {noise} {place:?}: {off}");
            }
            assert!(gain.stored().range > 1.5, "{:?}", gain.stored());
            let restored = Gain::restore(gain.stored()).unwrap();
            assert_eq!(restored, gain);
        }
    }

    #[test]
    fn where_the_place_tells_nothing_one_number_is_left() {
        let flat: Vec<_> = presses(30, 0.0)
            .into_iter()
            .enumerate()
            .map(|(k, (place, strength, _))| {
                (
                    place,
                    strength,
                    5.0 * strength * (1.0 + 0.1 * (k as f64 * 78.233).sin()),
                )
            })
            .collect();
        let gain = Gain::learn(&flat).unwrap();
        assert!(gain.stored().range < 1.05, "{:?}", gain.stored());
        assert!((gain.newtons([0.0; 2], 1.0) / 5.0 - 1.0).abs() < 0.05);
        // A wave of 0.1 has a standard deviation of 0.07.
        assert!((0.05..0.1).contains(&gain.stored().relative_sd), "{:?}", gain.stored());
    }

    /// The closed form and a fit of the others.
    #[test]
    fn what_is_told_of_a_press_left_out_is_what_the_others_tell() {
        let presses = presses(9, 0.2);
        let harmonics = harmonics([0.0; 2], 80.0, 0.8);
        let variances = harmonics.matern(64.0);
        let columns: Vec<_> = presses.iter().map(|p| features(&harmonics, p.0)).collect();
        let logs: Vec<f64> = presses.iter().map(|p| (p.2 / p.1).ln()).collect();
        let of = |kept: &[usize]| {
            let some: Vec<_> = kept.iter().map(|k| columns[*k].clone()).collect();
            let logs = DVector::from_iterator(kept.len(), kept.iter().map(|k| logs[*k]));
            fit(&DMatrix::from_columns(&some), &variances, 3.0, 0.8, &logs).unwrap()
        };
        let all = of(&(0..9).collect::<Vec<_>>());
        for out in 0..9 {
            let others = of(&(0..9).filter(|k| *k != out).collect::<Vec<_>>());
            let off = logs[out] - others.constant - others.weights.dot(&columns[out]);
            assert!(
                (off - all.left_out[out]).abs() < 1e-5,
                "{out}: {off} {}",
                all.left_out[out]
            );
        }
    }

    /// Five forces that nothing tells are fitted exactly by some function. Neither that function nor its fit may be told.
    #[test]
    fn five_forces_of_chance_do_not_promise_what_others_do_not_keep() {
        let mut state = 1_u64;
        let mut chance = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        let (mut told, mut held_out, mut worse) = (0.0, 0.0, 0);
        const DRAWS: usize = 200;
        for _ in 0..DRAWS {
            let mut press = || {
                let (angle, radius) = (std::f64::consts::TAU * chance(), 80.0 * chance().sqrt());
                ([radius * angle.cos(), radius * angle.sin()], 1.0, 5.0 + 10.0 * chance())
            };
            let five: Vec<_> = (0..5).map(|_| press()).collect();
            let gain = Gain::learn(&five).unwrap();
            let sd = gain.stored().relative_sd;
            told += sd * sd / DRAWS as f64;
            let off = |_| {
                let (place, strength, force) = press();
                (force / gain.newtons(place, strength)).ln().powi(2)
            };
            let square = (0..20).map(off).sum::<f64>() / 20.0;
            held_out += square / DRAWS as f64;
            worse += usize::from(square.sqrt() > 3.0 * sd);
            assert!(gain.stored().range < 4.0 && sd > 0.03, "{:?}", gain.stored());
        }
        let (told, held_out) = (f64::sqrt(told), f64::sqrt(held_out));
        assert!(told > 0.8 * held_out, "{told} {held_out}");
        assert!(worse < DRAWS / 10, "{worse}");
    }

    #[test]
    fn few_forces_and_damaged_numbers_give_none() {
        assert!(Gain::learn(&presses(4, 0.0)).is_none());
        let stored = Gain::learn(&presses(20, 0.0)).unwrap().stored().clone();
        let changed = |change: fn(&mut StoredGain)| {
            let mut other = stored.clone();
            change(&mut other);
            Gain::restore(&other)
        };
        assert!(changed(|_| {}).is_some());
        let damage: [fn(&mut StoredGain); 6] = [
            |s| s.weights.truncate(3),
            |s| s.weights[3] = f64::NAN,
            |s| s.weights[3] = 1e6,
            |s| s.usual_n = 1e308,
            |s| s.reach_mm = 1e300,
            |s| s.centre_mm[1] = 1e300,
        ];
        for (k, change) in damage.into_iter().enumerate() {
            assert!(changed(change).is_none(), "{k}");
        }
    }
}
