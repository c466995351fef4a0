//! What presses at known places told of a sheet, beside what a baseline showed of its electrodes.

use crate::reference::electrode_fit::UnevenSheet;
use crate::reference::imager::Imager;
use forward::{CellGrid, Sensitivity};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Numbers beyond are none of a sheet: lengths in mm, logarithms.
const FARTHEST: f64 = 1e4;
/// Most nodes along a side, and most unknowns.
const MOST: usize = 1000;
/// Largest logarithm of a contact's or a resistivity's factor: 7 times as much, or as little.
const LARGEST_LOG: f64 = 2.0;
/// Bumps nearer than this part of the sheet's reach would be too many.
const NEAREST: f64 = 0.1;

/// A sheet that differs from the one whose electrodes a baseline shows, and what is uncertain of touches on it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ToldSheet {
    /// Distance of the bumps that the logarithm of the resistivity is the sum of, over the sheet's reach.
    pub bumps: f64,
    /// Logarithms of the factors of the contact impedances, then moves of the electrodes along the rim, mm, then heights of the bumps.
    /// None where the sheet is the one that the baseline shows.
    pub unknowns: Vec<f64>,
    /// The first node of a square lattice over the sheet, mm.
    pub first_mm: [f64; 2],
    /// From one node to the next, mm.
    pub step_mm: f64,
    /// Nodes of a row. Rows follow one another upwards.
    pub columns: usize,
    /// What is uncertain of a touch at a node beside the noise: standard deviations of x and y, mm.
    pub sd_mm: Vec<[f64; 2]>,
}

impl ToldSheet {
    /// The sheet that the baseline shows, beyond doubt.
    pub fn trusted() -> Self {
        Self {
            bumps: 1.0,
            unknowns: Vec::new(),
            first_mm: [0.0; 2],
            step_mm: 1.0,
            columns: 1,
            sd_mm: vec![[0.0; 2]],
        }
    }

    /// Whether its numbers fit one another.
    pub fn is_sound(&self) -> bool {
        let count = self.sd_mm.len();
        (1..=MOST).contains(&self.columns)
            && (1..=MOST * MOST).contains(&count)
            && count.is_multiple_of(self.columns)
            && self.unknowns.len() <= MOST
            && self.unknowns.iter().chain(&self.first_mm).all(|v| v.abs() <= FARTHEST)
            && self.sd_mm.iter().flatten().all(|v| (0.0..=FARTHEST).contains(v))
            && (1e-3..=FARTHEST).contains(&self.step_mm)
            && (NEAREST..=1.0).contains(&self.bumps)
    }

    /// Standard deviations of x and y at a place, mm.
    pub fn sd_at(&self, place_mm: [f64; 2]) -> [f64; 2] {
        let nodes = self.around(place_mm);
        [0, 1].map(|axis| nodes.iter().map(|(k, w)| w * self.sd_mm[*k][axis]).sum())
    }

    /// The four nodes around a place with their weights; at the edge of the lattice beyond it.
    pub(crate) fn around(&self, place_mm: [f64; 2]) -> [(usize, f64); 4] {
        let rows = self.sd_mm.len() / self.columns;
        let along = |axis: usize, count: usize| {
            let last = count.saturating_sub(1);
            let at = ((place_mm[axis] - self.first_mm[axis]) / self.step_mm).clamp(0.0, last as f64);
            let low = (at as usize).min(last.saturating_sub(1));
            (low, (low + 1).min(last), at - low as f64)
        };
        let (left, right, across) = along(0, self.columns);
        let (low, high, up) = along(1, rows);
        [
            (low * self.columns + left, (1.0 - across) * (1.0 - up)),
            (low * self.columns + right, across * (1.0 - up)),
            (high * self.columns + left, (1.0 - across) * up),
            (high * self.columns + right, across * up),
        ]
    }

    /// How the sheet answers to the cells of a grid, in volts of the imager's model: a row for each value. `None` where it is the
    /// imager's, of another number of electrodes, or cannot be solved.
    pub(crate) fn responses(&self, imager: &Imager, grid: &CellGrid) -> Option<DMatrix<f64>> {
        let sheet = UnevenSheet::known(imager, self.bumps);
        let (n, count) = (2 * imager.model.electrodes(), sheet.count());
        let logs = self.unknowns.iter().take(n / 2).chain(self.unknowns.iter().skip(n));
        let fits = self.unknowns.len() == count && logs.clone().all(|v| v.abs() < LARGEST_LOG);
        fits.then(|| sheet.responses(imager, &DVector::from_column_slice(&self.unknowns), grid))?
    }

    /// An imager of this sheet: differences stay those to the imager's own model.
    pub(crate) fn seen_by(self: &std::sync::Arc<Self>, mut imager: Imager) -> Imager {
        if !self.unknowns.is_empty() {
            match self.responses(&imager, &imager.grid) {
                Some(sensitivity) => imager.sensitivity = sensitivity,
                None => return imager,
            }
        }
        imager.told = Some(std::sync::Arc::clone(self));
        imager
    }
}

/// How a solved sheet answers to the cells of a grid, in volts of an imager's model.
pub(crate) fn normalised(imager: &Imager, solver: &forward::Solver, grid: &CellGrid) -> DMatrix<f64> {
    let matrix = solver.electrode_matrix();
    let mut responses = Sensitivity::by_cell(solver, grid).matrix_v(imager.drive, matrix, &imager.pattern);
    let volts = imager.drive.frame_v(matrix, &imager.pattern);
    for ((mut row, v), own) in responses.row_iter_mut().zip(volts).zip(&imager.model_v) {
        row *= own / v;
    }
    responses
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_nodes_the_deviation_is_that_of_the_plane_through_them() {
        let (columns, rows) = (4, 3);
        let node = |k: usize| [-10.0 + 5.0 * (k % columns) as f64, 20.0 + 5.0 * (k / columns) as f64];
        let plane = |p: [f64; 2]| [4.0 + 0.2 * p[0] - 0.05 * p[1], 0.3 * p[1]];
        let told = ToldSheet {
            first_mm: node(0),
            step_mm: 5.0,
            columns,
            sd_mm: (0..columns * rows).map(|k| plane(node(k))).collect(),
            ..ToldSheet::trusted()
        };
        assert!(told.is_sound());
        for p in [[-5.0, 20.0], [-3.2, 21.7], [4.9, 29.9], [5.0, 30.0]] {
            let sd = told.sd_at(p);
            assert!((0..2).all(|k| (sd[k] - plane(p)[k]).abs() < 1e-12), "{p:?} {sd:?}");
        }
        // Beyond the lattice it is that at its edge.
        assert_eq!(told.sd_at([90.0, 30.0]), told.sd_at([5.0, 30.0]));
        assert_eq!(ToldSheet::trusted().sd_at([3.0, 4.0]), [0.0; 2]);
        let cut = ToldSheet {
            columns: 5,
            ..told.clone()
        };
        assert!(!cut.is_sound());
    }
}
