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

    /// A resistor between two wires: the current through it is what drives their voltage through the rest.
    pub(super) fn short(&self, pair: [usize; 2], ohm: f64) -> DVector<f64> {
        self.change(self.shorted(pair, ohm), |m| m)
    }

    fn shorted(&self, [a, b]: [usize; 2], ohm: f64) -> DMatrix<f64> {
        let r = &self.potentials_ohm;
        let column = r.column(a) - r.column(b);
        let row = r.row(a) - r.row(b);
        r - &column * row / (ohm + self.across([a, b]))
    }

    /// What the sheet has between two wires, ohm.
    pub(super) fn across(&self, [a, b]: [usize; 2]) -> f64 {
        let r = &self.potentials_ohm;
        r[(a, a)] - r[(a, b)] - r[(b, a)] + r[(b, b)]
    }

    /// What a leak changes of a whole frame, V.
    pub(crate) fn leaked(&self, whole: &Imager, pair: [usize; 2], ohm: f64) -> DVector<f64> {
        change_of(whole, self.shorted(pair, ohm), |m| m)
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

    pub(super) fn stuck(&self, drive: bool, plus: bool, electrode: usize) -> DVector<f64> {
        let routed = |mut m: Measurement| {
            let pair = if drive { &mut m.drive } else { &mut m.sense };
            *pair = if plus {
                Pair::new(electrode, pair.minus)
            } else {
                Pair::new(pair.plus, electrode)
            };
            m
        };
        self.change(self.potentials_ohm.clone(), routed)
    }
}

/// What measurements of an electrodes' matrix change of an imager's frame, V.
fn change_of(imager: &Imager, potentials: DMatrix<f64>, routed: impl Fn(Measurement) -> Measurement) -> DVector<f64> {
    let matrix = ElectrodeMatrix::from_potentials(potentials);
    let measurements = imager.pattern.measurements().iter().zip(&imager.model_v);
    // Values of the same drive follow one another: its current is that of the value before.
    let mut driven: Option<(Pair, f64)> = None;
    let value = |(m, v): (&Measurement, &f64)| {
        let Measurement { drive, sense } = routed(*m);
        // Both ends of the source on one electrode drive nothing.
        if drive.plus == drive.minus || sense.plus == sense.minus {
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
