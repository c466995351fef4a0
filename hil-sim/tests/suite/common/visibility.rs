//! How well measurements show touches anywhere on the paper's sheet, by the forward model. For tests and for
//! `examples/watch.rs`.
#![allow(dead_code, reason = "each user its own part")]
#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

use forward::{CellGrid, Drive, Geometry, Measurement, Model, ModelOptions, Pattern, Sensitivity, Sheet, Solver};
use hil_sim::Electronics;
use protocol::{Pair, Recipe, Value};
use std::sync::Arc;

/// The paper's touch: 25 N on 25 mm raise the resistivity by a fifth.
pub(crate) const RISE: f64 = 0.2;
pub(crate) const RADIUS_MM: f64 = 12.5;

/// Noise of one value of one period, codes: 16 samples with white noise and rounding, and the rounding of the value.
fn noise_codes(electronics: &Electronics) -> f64 {
    let least = 2f64.powi(12 - i32::from(electronics.code_bits()));
    let sample = electronics.noise_codes.powi(2) + least * least / 12.0;
    let step = 1.0 / f64::from(Value::PER_CODE);
    (sample * 2.0 / 16.0 + step * step / 12.0).sqrt()
}

pub(crate) struct Bench {
    sensitivity: Sensitivity,
    pub(crate) solver: Solver,
    centres: Vec<[f64; 2]>,
    pub(crate) codes_per_volt: f64,
    noise: f64,
    drive: Drive,
}

impl Bench {
    /// A board with this electronics at the paper's sheet.
    pub(crate) fn new(electronics: &Electronics) -> Self {
        let sheet = Sheet::paper();
        let model = Arc::new(Model::new(&sheet, &ModelOptions::default()).unwrap());
        let solver = Solver::new(model).unwrap();
        let grid = CellGrid::new(&Geometry::new(&sheet).unwrap(), 5.0).unwrap();
        let gain = f64::from(electronics.gains_milli[0]) / 1000.0;
        Self {
            sensitivity: Sensitivity::by_cell(&solver, &grid),
            centres: (0..grid.len()).map(|k| grid.centre(k)).collect(),
            solver,
            codes_per_volt: gain / electronics.adc_span_v * 4095.0,
            noise: noise_codes(electronics),
            drive: Drive::Voltage {
                amplitude_v: electronics.excitation_v,
                switch_ohm: electronics.switch_ohm,
            },
        }
    }

    pub(crate) fn pattern(list: impl Iterator<Item = (Pair, Pair)>) -> Pattern {
        let pair = |p: Pair| forward::Pair::new(p.plus.into(), p.minus.into());
        let measurement = |(drive, sense)| Measurement {
            drive: pair(drive),
            sense: pair(sense),
        };
        Pattern::from_list(16, list.map(measurement).collect()).unwrap()
    }

    /// Places of the middle of a touch that lies on the sheet whole.
    pub(crate) fn places(&self) -> Vec<[f64; 2]> {
        let inside = |p: &&[f64; 2]| p[0].hypot(p[1]) <= 97.5 - RADIUS_MM;
        self.centres.iter().filter(inside).copied().collect()
    }

    /// The change of every value (row) over its noise, for the paper's touch at every place (column).
    pub(crate) fn changes(&self, pattern: &Pattern) -> nalgebra::DMatrix<f64> {
        let z = self.solver.electrode_matrix();
        let matrix = self.sensitivity.matrix_v(self.drive, z, pattern) * (self.codes_per_volt / self.noise);
        let column = |p: &[f64; 2]| {
            let mut sum = nalgebra::DVector::zeros(pattern.len());
            for (k, c) in self.centres.iter().enumerate() {
                if (c[0] - p[0]).hypot(c[1] - p[1]) < RADIUS_MM {
                    sum += matrix.column(k) * RISE;
                }
            }
            sum
        };
        nalgebra::DMatrix::from_columns(&self.places().iter().map(column).collect::<Vec<_>>())
    }

    /// Norm of the change of all values over their noise, for the paper's touch wherever it lies on the sheet whole.
    pub(crate) fn visibility(&self, recipe: Recipe<'_>) -> Vec<f64> {
        let changes = self.changes(&Self::pattern(recipe.measurements(16)));
        changes.column_iter().map(|c| c.norm()).collect()
    }

    /// The resting value of every measurement, codes of amplitude.
    pub(crate) fn resting_codes(&self, pattern: &Pattern) -> Vec<f64> {
        let frame = self.drive.frame_v(self.solver.electrode_matrix(), pattern);
        frame.iter().map(|v| v * self.codes_per_volt).collect()
    }
}

pub(crate) fn least(list: &[f64]) -> f64 {
    list.iter().copied().fold(f64::INFINITY, f64::min)
}
