//! Amplifiers whose gain or offset a baseline shows: all values of a sense pair are off by one factor, or by one voltage.

use crate::reference::low_rank::LowRankInverse;
use forward::{Measurement, Pattern};
use nalgebra::DVector;

/// An amplifier that measures something else than the voltage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Amplifier {
    /// Its sense electrodes, plus and minus, from 0.
    pub pair: [usize; 2],
    /// What is wrong with it.
    pub error: AmplifierError,
}

impl Amplifier {
    /// Whether a value is one of its own.
    pub(crate) fn carries(&self, measurement: &Measurement) -> bool {
        [measurement.sense.plus, measurement.sense.minus] == self.pair
    }

    /// By what part of itself the value is off that is off most.
    pub(super) fn off(&self, baseline: &[f64], pattern: &Pattern) -> f64 {
        match self.error {
            AmplifierError::Gain(gain) => gain.ln().abs(),
            AmplifierError::Offset(offset) => {
                let own = pattern.measurements().iter().zip(baseline);
                let own = own.filter(|(m, v)| self.carries(m) && v.is_finite());
                own.fold(0.0, |most, (_, v)| most.max((offset / v).abs()))
            }
        }
    }
}

/// How an amplifier is wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AmplifierError {
    /// It gives so many times the voltage.
    Gain(f64),
    /// It adds a voltage, in the baseline's unit.
    Offset(f64),
}

/// The amplifier that stands out most, with by how many standard deviations. `weighted`: the residual of the logarithms times the
/// `inverse` of their covariance, for the values `used`.
pub(super) fn most(
    inverse: &LowRankInverse,
    weighted: &DVector<f64>,
    used: &[usize],
    baseline: &[f64],
    pattern: &Pattern,
) -> Option<(Amplifier, f64)> {
    let pair = |k: usize| {
        let sense = pattern.measurements()[used[k]].sense;
        [sense.plus, sense.minus]
    };
    let mut pairs: Vec<[usize; 2]> = (0..used.len()).map(pair).collect();
    pairs.sort_unstable();
    pairs.dedup();
    let of_pair = |pair_of: &[usize; 2]| -> Vec<usize> { (0..used.len()).filter(|k| pair(*k) == *pair_of).collect() };
    // One column of the linear model more: its size, and that over its standard deviation.
    let column = |of: &[usize], a: &dyn Fn(usize) -> f64| {
        let along: f64 = of.iter().map(|k| a(*k) * weighted[*k]).sum();
        let column: Vec<(usize, f64)> = of.iter().map(|k| (*k, a(*k))).collect();
        let information = inverse.square(&column).max(f64::MIN_POSITIVE);
        (along / information, along / information.sqrt())
    };
    let errors = pairs.iter().filter_map(|p| {
        let of = of_pair(p);
        // Of one value alone the value is to blame.
        (of.len() > 1).then(|| {
            let (gain, of_gain) = column(&of, &|_| 1.0);
            let (offset, of_offset) = column(&of, &|k| 1.0 / baseline[used[k]]);
            let (error, z) = if of_gain.abs() >= of_offset.abs() {
                (AmplifierError::Gain(gain.exp()), of_gain)
            } else {
                (AmplifierError::Offset(offset), of_offset)
            };
            (Amplifier { pair: *p, error }, z.abs())
        })
    });
    errors.max_by(|a, b| a.1.total_cmp(&b.1))
}
