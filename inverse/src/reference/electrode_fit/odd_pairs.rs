//! Pairs that a baseline shows to be off: all values of a sense pair by one factor, or by one voltage; those of a drive pair by one factor.

use crate::reference::low_rank::LowRankInverse;
use forward::{Measurement, Pattern};
use nalgebra::DVector;

/// An amplifier that measures something else than the voltage, or a pair that is driven otherwise than the others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OddPair {
    /// Whether it is driven; else it is sensed.
    pub is_driven: bool,
    /// Its electrodes, plus and minus, from 0.
    pub pair: [usize; 2],
    /// What is wrong with it.
    pub error: PairError,
}

impl OddPair {
    /// Whether a value is one of its own.
    pub(crate) fn carries(&self, measurement: &Measurement) -> bool {
        pair_of(measurement, self.is_driven) == self.pair
    }

    /// By what part of itself the value is off that is off most.
    pub(super) fn off(&self, baseline: &[f64], pattern: &Pattern) -> f64 {
        match self.error {
            PairError::Gain(gain) => gain.ln().abs(),
            PairError::Offset(offset) => {
                let own = pattern.measurements().iter().zip(baseline);
                let own = own.filter(|(m, v)| self.carries(m) && v.is_finite());
                own.fold(0.0, |most, (_, v)| most.max((offset / v).abs()))
            }
        }
    }
}

/// By how much more the square of its standard deviations has to be for a driven pair: on a sheet that is reciprocal a gain of what drives a
/// pair is like the inverse gain of its amplifier, and amplifiers are wrong more often.
const DRIVEN: f64 = 20.0;

/// How the values of a pair are wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PairError {
    /// They are so many times the voltage.
    Gain(f64),
    /// A voltage is added to them, in the baseline's unit.
    Offset(f64),
}

fn pair_of(measurement: &Measurement, is_driven: bool) -> [usize; 2] {
    let pair = if is_driven {
        measurement.drive
    } else {
        measurement.sense
    };
    [pair.plus, pair.minus]
}

/// The pair that stands out most, with by how many standard deviations. `weighted`: the residual of the logarithms times the
/// `inverse` of their covariance, for the values `used`.
pub(super) fn most(
    inverse: &LowRankInverse,
    weighted: &DVector<f64>,
    used: &[usize],
    baseline: &[f64],
    pattern: &Pattern,
) -> Option<(OddPair, f64)> {
    let pair = |k: usize, is_driven: bool| pair_of(&pattern.measurements()[used[k]], is_driven);
    let mut pairs: Vec<(bool, [usize; 2])> = [false, true]
        .into_iter()
        .flat_map(|is_driven| (0..used.len()).map(move |k| (is_driven, pair(k, is_driven))))
        .collect();
    pairs.sort_unstable();
    pairs.dedup();
    // One column of the linear model more: its size, and that over its standard deviation.
    let column = |of: &[usize], a: &dyn Fn(usize) -> f64| {
        let along: f64 = of.iter().map(|k| a(*k) * weighted[*k]).sum();
        let column: Vec<(usize, f64)> = of.iter().map(|k| (*k, a(*k))).collect();
        let information = inverse.square(&column).max(f64::MIN_POSITIVE);
        (along / information, along / information.sqrt())
    };
    let errors = pairs.iter().filter_map(|(is_driven, p)| {
        let of: Vec<usize> = (0..used.len()).filter(|k| pair(*k, *is_driven) == *p).collect();
        // Of one value alone the value is to blame.
        if of.len() < 2 {
            return None;
        }
        let (gain, of_gain) = column(&of, &|_| 1.0);
        let (mut error, mut z) = (PairError::Gain(gain.exp()), of_gain);
        if !is_driven {
            let (offset, of_offset) = column(&of, &|k| 1.0 / baseline[used[k]]);
            if of_offset.abs() > of_gain.abs() {
                (error, z) = (PairError::Offset(offset), of_offset);
            }
        }
        let odd = OddPair {
            is_driven: *is_driven,
            pair: *p,
            error,
        };
        let square = z * z - if *is_driven { DRIVEN } else { 0.0 };
        Some((odd, square.max(0.0).sqrt()))
    });
    errors.max_by(|a, b| a.1.total_cmp(&b.1))
}
