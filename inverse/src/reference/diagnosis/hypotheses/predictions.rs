//! What a fault makes of the electrodes' matrix, and of a frame.

use super::Diagnosis;
use crate::reference::diagnosis::fault::Fault;
use crate::reference::imager::Imager;
use forward::{ElectrodeMatrix, Measurement, Pair};
use nalgebra::{DMatrix, DVector};

/// A leak is weak where it changes the values of other electrodes by no more than this part of them (2-norms): touches beside it are off by
/// half a millimetre then, in the median (docs/reliability.md).
const WEAK: f64 = 0.005;

impl Diagnosis {
    /// What measurements of these electrodes' matrix change, V.
    pub(super) fn change(&self, potentials: DMatrix<f64>, routed: impl Fn(Measurement) -> Measurement) -> DVector<f64> {
        change_of(&self.imager, potentials, routed)
    }

    pub(super) fn short(&self, pair: [usize; 2], ohm: f64) -> DVector<f64> {
        leaked(&self.imager, &self.potentials_ohm, pair, ohm)
    }

    /// What the sheet has between two wires, ohm.
    pub(super) fn across(&self, pair: [usize; 2]) -> f64 {
        across(&self.potentials_ohm, pair)
    }

    /// What a leak changes of a whole frame, V.
    pub(crate) fn leaked(&self, whole: &Imager, pair: [usize; 2], ohm: f64) -> DVector<f64> {
        leaked(whole, &self.potentials_ohm, pair, ohm)
    }

    /// A weak leak in place of a short.
    pub(super) fn of_its_size(&self, fault: Fault) -> Fault {
        match fault {
            Fault::Short { electrodes, ohm } if self.is_weak(electrodes, ohm) => Fault::Leak { electrodes, ohm },
            _ => fault,
        }
    }

    fn is_weak(&self, pair: [usize; 2], ohm: f64) -> bool {
        let mut change = self.short(pair, ohm);
        let mut all = DVector::from_column_slice(&self.imager.model_v);
        for k in self.values_of(&pair) {
            (change[k], all[k]) = (0.0, 0.0);
        }
        change.norm() < WEAK * all.norm()
    }

    pub(super) fn contacts(&self, worse: &[(usize, f64)]) -> DVector<f64> {
        let mut r = self.potentials_ohm.clone();
        for (l, ohm) in worse {
            r[(*l, *l)] += ohm;
        }
        self.change(r, |m| m)
    }

    pub(super) fn exchanged(&self, [a, b]: [usize; 2]) -> DVector<f64> {
        let mut r = self.potentials_ohm.clone();
        r.swap_rows(a, b);
        r.swap_columns(a, b);
        self.change(r, |m| m)
    }

    /// What amplifiers do whose first stage of this gain ends at `limit_v` from the middle of the source, on one side or on `both`. Its two
    /// outputs are the mean voltage of a pair and half of the amplified difference more, or less; of a sine the fundamental is measured.
    pub(crate) fn saturated(&self, gain: f64, limit_v: f64, both: bool) -> DVector<f64> {
        let r = &self.potentials_ohm;
        let changes = self.imager.pattern.measurements().iter().map(|m| {
            let (plus, minus) = (m.drive.plus, m.drive.minus);
            let across_ohm = self.across([plus, minus]);
            let current_a = self.imager.drive.current_a(across_ohm);
            let from_middle_v = |electrode: usize| {
                let from_minus_ohm =
                    r[(electrode, plus)] - r[(electrode, minus)] - r[(minus, plus)] + r[(minus, minus)];
                current_a * (from_minus_ohm - 0.5 * across_ohm)
            };
            let [a, b] = [m.sense.plus, m.sense.minus].map(from_middle_v);
            let (mean, half) = (0.5 * (a + b), 0.5 * gain * (a - b));
            let lost = |v: f64| clipped(v, limit_v, both) - v;
            (lost(mean + half) - lost(mean - half)) / gain
        });
        DVector::from_iterator(self.imager.pattern.len(), changes)
    }

    /// Largest voltage of an electrode from the middle of the source.
    pub(crate) fn largest_from_middle_v(&self) -> f64 {
        let halves = self.imager.pattern.drives().iter().map(|d| {
            let across_ohm = self.across([d.plus, d.minus]);
            0.5 * self.imager.drive.current_a(across_ohm) * across_ohm
        });
        halves.fold(0.0, f64::max)
    }

    /// What a multiplexer does that connects another electrode than the one it is told to.
    pub(super) fn misrouted(&self, (drive, plus): (bool, bool), to: impl Fn(usize) -> usize) -> DVector<f64> {
        let routed = |mut m: Measurement| {
            let pair = if drive { &mut m.drive } else { &mut m.sense };
            *pair = if plus {
                Pair::new(to(pair.plus), pair.minus)
            } else {
                Pair::new(pair.plus, to(pair.minus))
            };
            m
        };
        self.change(self.potentials_ohm.clone(), routed)
    }
}

/// The fundamental of a sine of amplitude `v` that ends at `limit_v`, on one side or on both (Fourier's first coefficient).
fn clipped(v: f64, limit_v: f64, both: bool) -> f64 {
    let part = limit_v / v.abs();
    if part >= 1.0 {
        return v;
    }
    let left = std::f64::consts::FRAC_2_PI * (part.asin() + part * (1.0 - part * part).sqrt());
    if both { left * v } else { 0.5 * (1.0 + left) * v }
}

/// What the sheet has between two wires, ohm.
pub(crate) fn across(r: &DMatrix<f64>, [a, b]: [usize; 2]) -> f64 {
    r[(a, a)] - r[(a, b)] - r[(b, a)] + r[(b, b)]
}

/// What a resistor between two wires changes of an imager's frame, V: the current through it is what drives their voltage through the rest.
/// `r`: the electrodes' matrix of the sheet, ohm.
pub(crate) fn leaked(imager: &Imager, r: &DMatrix<f64>, [a, b]: [usize; 2], ohm: f64) -> DVector<f64> {
    let column = r.column(a) - r.column(b);
    let row = r.row(a) - r.row(b);
    change_of(imager, r - &column * row / (ohm + across(r, [a, b])), |m| m)
}

/// What measurements of an electrodes' matrix change of an imager's frame, V.
fn change_of(imager: &Imager, potentials: DMatrix<f64>, routed: impl Fn(Measurement) -> Measurement) -> DVector<f64> {
    let matrix = ElectrodeMatrix::from_potentials(potentials);
    let measurements = imager.pattern.measurements().iter().zip(&imager.model_v);
    // Values of the same drive follow one another: its current is that of the value before.
    let mut driven: Option<(Pair, f64)> = None;
    let value = |(m, v): (&Measurement, &f64)| {
        let Measurement { drive, sense } = routed(*m);
        // Both ends of the source on one electrode, or one on none, drive nothing.
        let connects = |pair: Pair| pair.plus != pair.minus && pair.plus.max(pair.minus) < matrix.electrodes();
        if !connects(drive) || !connects(sense) {
            return -v;
        }
        let current_a = match driven {
            Some((pair, current_a)) if pair == drive => current_a,
            _ => imager.drive.current_a(matrix.transfer_ohm(drive, drive)),
        };
        driven = Some((drive, current_a));
        current_a * matrix.transfer_ohm(drive, sense) - v
    };
    DVector::from_iterator(imager.pattern.len(), measurements.map(value))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The fundamental of a sine that is cut, by its integral.
    #[test]
    fn a_cut_sine_has_the_fundamental_of_its_integral() {
        const STEPS: usize = 20_000;
        for limit in [0.0, 0.3, 1.0, 2.5, 4.0] {
            for both in [false, true] {
                let integral: f64 = (0..STEPS)
                    .map(|k| {
                        let sine = (std::f64::consts::TAU * k as f64 / STEPS as f64).sin();
                        let v: f64 = 3.0 * sine;
                        let cut = if both { v.clamp(-limit, limit) } else { v.min(limit) };
                        2.0 * cut * sine / STEPS as f64
                    })
                    .sum();
                assert!((clipped(3.0, limit, both) - integral).abs() < 1e-3, "{limit} {both}");
                assert_eq!(clipped(-3.0, limit, both), -clipped(3.0, limit, both));
            }
        }
    }
}
