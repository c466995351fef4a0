//! What changes all values of a baseline by a law: a leak between two wires, and amplifiers that saturate.
//!
//! Neither electrodes nor contacts nor an unevenness do what these do, but they take a part of it up. So each is taken out of the baseline
//! before the evidence of what is left is compared.

use super::linear::{Linear, Scales};
use crate::reference::diagnosis::{Diagnosis, LIMITS};
use crate::reference::golden_sections;
use crate::reference::imager::Imager;
use nalgebra::DVector;
use std::sync::Arc;

/// Resistances of leaks and gains of first stages that are tried.
const LEAKS_OHM: [f64; 5] = [1e3, 1e4, 1e5, 1e6, 1e7];
const GAINS: [f64; 3] = [1.0, 4.0, 12.0];
/// How much more probable the baseline has to be with it, as a logarithm.
const CLEAR: f64 = 50.0;
/// A size is looked for in so many times less and more than the best that was tried, in so many steps, and so many times.
const REACH: f64 = 4.0;
const STEPS: usize = 12;
const ROUNDS: usize = 2;

/// Something of the board that changes all values of a baseline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distortion {
    /// A resistor between the wires of two electrodes.
    Leak {
        /// Which ones, from 0.
        electrodes: [usize; 2],
        /// Its resistance, ohm.
        ohm: f64,
    },
    /// The first stage of all amplifiers ends before it should.
    Saturated {
        /// Gain of that stage.
        gain: f64,
        /// Where it ends, V of the model from the middle of the source.
        limit_v: f64,
        /// Whether on both sides.
        both: bool,
    },
}

impl Distortion {
    /// Its sizes.
    fn sizes(self) -> Vec<f64> {
        match self {
            Self::Leak { ohm, .. } => vec![ohm],
            Self::Saturated { gain, limit_v, .. } => vec![limit_v, gain],
        }
    }

    /// Whether it is the same, with sizes that are the same to 1 %.
    pub(super) fn is_near(self, other: Self) -> bool {
        let (sizes, others) = (self.sizes(), other.sizes());
        let near = sizes.iter().zip(&others).all(|(a, b)| (a / b).ln().abs() < 0.01);
        near && self.of_sizes(&others) == other
    }

    /// The same with other sizes.
    fn of_sizes(self, sizes: &[f64]) -> Self {
        match (self, sizes) {
            (Self::Leak { electrodes, .. }, [ohm]) => Self::Leak { electrodes, ohm: *ohm },
            (Self::Saturated { both, .. }, [limit_v, gain]) => Self::Saturated {
                gain: gain.max(1.0),
                limit_v: *limit_v,
                both,
            },
            _ => self,
        }
    }
}

/// What a board does to the logarithms of a sheet's values.
struct Laws<'a> {
    imager: &'a Arc<Imager>,
    diagnosis: Diagnosis,
}

impl Laws<'_> {
    /// By what it multiplies every value, as logarithms; not finite where it turns the sign.
    fn logarithms(&self, of: Distortion) -> DVector<f64> {
        let change = match of {
            Distortion::Leak { electrodes, ohm } => self.diagnosis.leaked(self.imager, electrodes, ohm),
            Distortion::Saturated { gain, limit_v, both } => self.diagnosis.saturated(gain, limit_v, both),
        };
        DVector::from_fn(change.len(), |k, _| (1.0 + change[k] / self.imager.model_v[k]).ln())
    }
}

/// The distortion that is clearly more probable than none, with the logarithms of what it multiplies all values by. `linear` is about the
/// imager's electrodes.
pub(super) fn most_probable(
    imager: &Arc<Imager>,
    linear: &Linear,
    scales: Scales,
    reach: f64,
) -> Option<(Distortion, DVector<f64>)> {
    let laws = Laws {
        diagnosis: Diagnosis::new(imager)?,
        imager,
    };
    let y = &linear.residual + &linear.about;
    let inverse = linear.inverse(scales)?;
    // A few values whose sign would be another tell nothing of it.
    let left = |of: Distortion| -> DVector<f64> {
        let all = laws.logarithms(of);
        let of_used = linear.used().iter().map(|k| all[*k]);
        let left = y
            .iter()
            .zip(of_used)
            .map(|(y, of)| if of.is_finite() { y - of } else { *y });
        DVector::from_iterator(y.len(), left)
    };
    let cost = |of: Distortion| {
        let left = left(of);
        left.dot(&inverse.times(&left))
    };
    let tried = tried(imager, &laws.diagnosis).into_iter().map(|of| (cost(of), of));
    let (mut least, mut best) = tried.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let sizes = best.sizes().len();
    for which in (0..sizes).cycle().take(ROUNDS * sizes) {
        let of_size = |logarithm: f64| {
            let mut sizes = best.sizes();
            sizes[which] = logarithm.exp();
            best.of_sizes(&sizes)
        };
        let size = best.sizes()[which];
        let around = [size / REACH, size * REACH].map(f64::ln);
        let (logarithm, cost) = golden_sections::least(|at| cost(of_size(at)), (size.ln(), least), around, STEPS);
        (least, best) = (cost, of_size(logarithm));
    }
    let evidence = |y: &DVector<f64>| linear.best_of(y, reach).0;
    (evidence(&left(best)) - evidence(&y) > CLEAR).then(|| (best, laws.logarithms(best)))
}

/// What is tried, coarsely.
fn tried(imager: &Imager, diagnosis: &Diagnosis) -> Vec<Distortion> {
    let n = imager.pattern.electrodes();
    let pairs = (0..n).flat_map(|a| (a + 1..n).map(move |b| [a, b]));
    let leaks = pairs.flat_map(|electrodes| LEAKS_OHM.map(|ohm| Distortion::Leak { electrodes, ohm }));
    // Nothing tells the middle of a source of current.
    let largest_v = match imager.drive {
        forward::Drive::Voltage { .. } => diagnosis.largest_from_middle_v(),
        forward::Drive::Current { .. } => return leaks.collect(),
    };
    let limits = LIMITS
        .iter()
        .flat_map(|part| GAINS.map(|gain| (gain, part * largest_v)));
    let saturated =
        limits.flat_map(|(gain, limit_v)| [false, true].map(|both| Distortion::Saturated { gain, limit_v, both }));
    leaks.chain(saturated).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::electrode_fit::{ElectrodeFitOptions, OFF, find_with};
    use forward::{Drive, Pattern, Sheet};
    use rand::{SeedableRng, rngs::StdRng};
    use rand_distr::{Distribution, Normal};

    /// A sheet whose electrodes are not where they were said to be, with the imager that takes them to be there.
    fn sheet(seed: u64) -> (Arc<Imager>, Arc<Imager>) {
        let pattern = Pattern::adjacent(16).unwrap();
        let (sheet, mut rng) = (Sheet::paper(), StdRng::seed_from_u64(seed));
        let said = Imager::new(&sheet, Drive::PAPER, pattern.clone(), 10.0).unwrap();
        let normal = |sd: f64, rng: &mut StdRng| Normal::new(0.0, sd).unwrap().sample(rng);
        let contacts = (0..16).map(|_| normal(0.1, &mut rng)).collect::<Vec<_>>();
        let places = (0..16).map(|_| normal(0.4, &mut rng)).collect::<Vec<_>>();
        let displaced = said
            .model
            .geometry()
            .displaced(&sheet, &[contacts, places].concat())
            .unwrap();
        let is = Imager::new(&displaced, Drive::PAPER, pattern, 8.0).unwrap();
        (Arc::new(is), Arc::new(said))
    }

    /// A frame of the sheet times these logarithms' exponentials, with noise.
    fn measured(is: &Imager, logarithms: &DVector<f64>, rng: &mut StdRng) -> Vec<f64> {
        let noise = Normal::new(0.0, 3e-4).unwrap();
        let values = is.model_v.iter().zip(logarithms);
        values.map(|(v, of)| v * of.exp() * (1.0 + noise.sample(rng))).collect()
    }

    #[test]
    fn leaks_are_found_beside_electrodes_that_are_elsewhere() {
        let (is, said) = sheet(3);
        let laws = Laws {
            diagnosis: Diagnosis::new(&is).unwrap(),
            imager: &is,
        };
        let mut rng = StdRng::seed_from_u64(4);
        for electrodes in [[2, 3], [0, 15], [2, 9], [5, 8]] {
            for ohm in [1e4, 3e4, 1e5, 3e5] {
                let leak = Distortion::Leak { electrodes, ohm };
                let baseline = measured(&is, &laws.logarithms(leak), &mut rng);
                let fit = find_with(&said, &baseline, &ElectrodeFitOptions::default()).unwrap();
                let Some(Distortion::Leak {
                    electrodes: pair,
                    ohm: told,
                }) = fit.distortion
                else {
                    panic!("{electrodes:?} over {ohm} ohm: {:?}", fit.distortion);
                };
                assert_eq!(pair, electrodes, "{ohm} ohm");
                if ohm > 1e4 {
                    assert!((told / ohm).ln().abs() < 0.1, "{electrodes:?} over {ohm} ohm: {told}");
                    assert!(fit.misfit < OFF, "{electrodes:?} over {ohm} ohm: {}", fit.misfit);
                }
            }
        }
    }

    #[test]
    fn saturation_is_found_beside_electrodes_that_are_elsewhere() {
        let (is, said) = sheet(5);
        let laws = Laws {
            diagnosis: Diagnosis::new(&is).unwrap(),
            imager: &is,
        };
        let mut rng = StdRng::seed_from_u64(6);
        let largest_v = laws.diagnosis.largest_from_middle_v();
        for (gain, part, both) in [(4.0, 0.1, true), (12.0, 0.1, true), (12.0, 0.25, false)] {
            let saturated = Distortion::Saturated {
                gain,
                limit_v: part * largest_v,
                both,
            };
            let baseline = measured(&is, &laws.logarithms(saturated), &mut rng);
            let fit = find_with(&said, &baseline, &ElectrodeFitOptions::default()).unwrap();
            let Some(Distortion::Saturated {
                limit_v, both: told, ..
            }) = fit.distortion
            else {
                panic!("{gain} {part} {both}: {:?}", fit.distortion);
            };
            let off = (limit_v / (part * largest_v)).ln().abs();
            assert!(told == both && off < 0.2, "{gain} {part} {both}: {:?}", fit.distortion);
        }
    }

    /// A sheet that is not like its model, an odd pair and wild values are no distortion of the board.
    #[test]
    fn what_is_wrong_in_other_ways_is_no_distortion() {
        let (is, said) = sheet(7);
        let mut rng = StdRng::seed_from_u64(8);
        let value = |k: usize, factor: f64| {
            DVector::from_fn(is.pattern.len(), |i, _| if i == k { f64::ln(factor) } else { 0.0 })
        };
        let pair = |pair: usize, gain: f64| {
            let of = is.pattern.measurements()[pair].sense;
            let own = is.pattern.measurements().iter();
            DVector::from_iterator(
                is.pattern.len(),
                own.map(|m| if m.sense == of { gain.ln() } else { 0.0 }),
            )
        };
        // A bump of so much more resistivity, this wide.
        let bump = |[x, y]: [f64; 2], width_mm: f64, rise: f64| {
            let cells = DVector::from_fn(is.grid.len(), |cell, _| {
                let [a, b] = is.grid.centre(cell);
                rise * (-0.5 * ((a - x).hypot(b - y) / width_mm).powi(2)).exp()
            });
            let changed = &is.sensitivity * cells;
            DVector::from_fn(is.pattern.len(), |k, _| (1.0 + changed[k] / is.model_v[k]).ln())
        };
        let nothing = DVector::zeros(is.pattern.len());
        let all = [
            nothing,
            value(17, 10.0),
            value(40, 0.5) + value(101, 3.0),
            pair(5, 1.05),
            pair(11, 0.8) + value(30, 2.0),
            bump([20.0, -30.0], 40.0, 0.3),
            bump([-40.0, 10.0], 12.0, 0.8),
            bump([60.0, 30.0], 8.0, 1.0) + bump([-10.0, 0.0], 20.0, -0.2),
            // Fingers that rest at the rim, beside electrodes.
            bump([85.0, 5.0], 8.0, 0.5),
            bump([-88.0, -5.0], 7.0, 0.6) + bump([-60.0, -62.0], 7.0, 0.6),
        ];
        for (which, logarithms) in all.iter().enumerate() {
            let baseline = measured(&is, logarithms, &mut rng);
            let fit = find_with(&said, &baseline, &ElectrodeFitOptions::default()).unwrap();
            assert_eq!(fit.distortion, None, "{which}");
        }
    }
}
