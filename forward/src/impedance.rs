//! What the electrodes see of a sheet: transfer impedances, and the voltages of a real drive.

use crate::pattern::{Measurement, Pair, Pattern};
use nalgebra::DMatrix;

/// Potential of every electrode for a unit current into every other: `R[i, j]`, ohm, symmetric, each column up to a
/// common constant. It holds every four-terminal measurement of the sheet.
#[derive(Clone, Debug, PartialEq)]
pub struct ElectrodeMatrix {
    resistance_ohm: DMatrix<f64>,
}

impl ElectrodeMatrix {
    /// That of a ring of equal resistors (ohm) between neighbouring electrodes: `R k (N - k) / N` between electrodes `k`
    /// apart.
    pub fn ring(electrodes: usize, ohm: f64) -> Self {
        let n = electrodes as f64;
        Self::from_potentials(DMatrix::from_fn(electrodes, electrodes, |i, j| {
            let k = i.abs_diff(j) as f64;
            -0.5 * ohm * k * (n - k) / n
        }))
    }

    /// From the square matrix of potentials in ohm. Only differences over two rows and two columns are used, so any
    /// choice of ground will do.
    pub fn from_potentials(resistance_ohm: DMatrix<f64>) -> Self {
        debug_assert!(resistance_ohm.is_square());
        Self { resistance_ohm }
    }

    /// How many electrodes.
    pub fn electrodes(&self) -> usize {
        self.resistance_ohm.nrows()
    }

    /// The potentials, `[i, j]`: of electrode i for 1 A into electrode j, ohm.
    pub fn potentials_ohm(&self) -> &DMatrix<f64> {
        &self.resistance_ohm
    }

    /// Transfer impedance in ohm: the voltage over the sense pair while 1 A flows from `drive.plus` to `drive.minus`
    /// through the sheet. With both pairs equal it is the drive pair's own resistance, contacts included.
    pub fn transfer_ohm(&self, drive: Pair, sense: Pair) -> f64 {
        let r = &self.resistance_ohm;
        (r[(sense.plus, drive.plus)] - r[(sense.minus, drive.plus)])
            - (r[(sense.plus, drive.minus)] - r[(sense.minus, drive.minus)])
    }
}

/// How the sheet is driven.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Drive {
    /// A source of this amplitude (V) behind two closed switches of this resistance each (ohm): the paper's board.
    Voltage {
        /// Amplitude of the source, V.
        amplitude_v: f64,
        /// Resistance of one closed switch, ohm; the current passes two.
        switch_ohm: f64,
    },
    /// A constant current of this amplitude, A. With 1 A a measurement in volt is the transfer impedance in ohm.
    Current {
        /// Amplitude, A.
        amplitude_a: f64,
    },
}

impl Drive {
    /// The paper's drive: 4.5 V peak to peak through two switches of 70 ohm. The paper does not say which switches it has; the
    /// board of docs/board.md has 100 ohm.
    pub const PAPER: Self = Self::Voltage {
        amplitude_v: 2.25,
        switch_ohm: 70.0,
    };

    /// The amplitude of the drive current (A) through a pair whose own resistance is `own_ohm`.
    pub fn current_a(self, own_ohm: f64) -> f64 {
        match self {
            Self::Voltage {
                amplitude_v,
                switch_ohm,
            } => amplitude_v / (own_ohm + 2.0 * switch_ohm),
            Self::Current { amplitude_a } => amplitude_a,
        }
    }

    /// One measured amplitude, V: `U0 Z[m,n] / (Z[m,m] + 2 R_on)` for a voltage drive, `I Z[m,n]` for a current drive.
    pub fn voltage_v(self, sheet: &ElectrodeMatrix, m: Measurement) -> f64 {
        self.current_a(sheet.transfer_ohm(m.drive, m.drive)) * sheet.transfer_ohm(m.drive, m.sense)
    }

    /// A whole frame in the pattern's order, V.
    pub fn frame_v(self, sheet: &ElectrodeMatrix, pattern: &Pattern) -> Vec<f64> {
        pattern
            .measurements()
            .iter()
            .map(|m| self.voltage_v(sheet, *m))
            .collect()
    }
}
