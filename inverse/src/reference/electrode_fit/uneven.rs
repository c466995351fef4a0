//! The sheet as a baseline tells it, uneven as it is: contacts, places of the electrodes and a smooth unevenness at once.

use super::linear::{Bumps, Linear, Scales};
use super::{ElectrodeFit, ElectrodeFitOptions, reach};
use crate::reference::imager::Imager;
use crate::reference::normalised;
use forward::field::conductivity_of;
use forward::{CellGrid, Model, ModelOptions, Sensitivity, Solver};
use nalgebra::{DMatrix, DVector};
use std::sync::Arc;

/// Distances of bumps that are tried, over the sheet's reach: the evidence of the baseline tells how fine an unevenness is.
const DISTANCES: [f64; 2] = [0.6, 0.3];
/// Steps of Gauss and Newton.
const ROUNDS: usize = 3;

/// What is unknown of a sheet beside the one of an imager, after its baseline: the logarithms of the contact impedances, the places of
/// the electrodes along the rim (mm), and heights of the bumps that the logarithm of the resistivity is the sum of.
pub(crate) struct UnevenSheet {
    bumps: Bumps,
    /// Their distance, over the sheet's reach.
    pub(crate) distance: f64,
    /// The unknowns.
    pub(crate) mean: DVector<f64>,
    /// Their covariance.
    pub(crate) covariance: DMatrix<f64>,
    /// Number of electrodes.
    pub(crate) electrodes: usize,
}

impl UnevenSheet {
    /// From the electrodes that were found in a baseline (any unit; not a number where a value takes no part), and the same baseline.
    /// `None` where what comes out makes no sense.
    pub(crate) fn of(fit: &ElectrodeFit, baseline: &[f64]) -> Option<Self> {
        let imager = &fit.imager;
        let n = fit.moved_mm.len();
        let contacts = fit.contact.iter().map(|c| c.ln());
        let found = DVector::from_iterator(2 * n, contacts.chain(fit.moved_mm.iter().copied()));
        let mut best: Option<(f64, ElectrodeFitOptions, Scales, Linear)> = None;
        for bumps in DISTANCES {
            let options = ElectrodeFitOptions {
                bumps,
                ..ElectrodeFitOptions::default()
            };
            let linear = Linear::new(imager, baseline, &options)?;
            let y = &linear.residual + linear.slopes() * &found;
            let (evidence, scales) = linear.best_of(&y, reach(imager));
            if best.as_ref().is_none_or(|(most, ..)| evidence > *most) {
                best = Some((evidence, options, scales, linear));
            }
        }
        let (_, options, scales, mut linear) = best?;
        let mut sheet = Self::known(imager, options.bumps);
        let mut from_said = DVector::zeros(2 * n + sheet.bumps.len());
        from_said.rows_mut(0, 2 * n).copy_from(&found);
        let found = from_said.clone();
        for round in 1..=ROUNDS {
            let y = &linear.residual + linear.by_uneven(&from_said);
            let (mean, covariance) = linear.solve_uneven(&y, scales)?;
            sheet.mean = &mean - &found;
            sheet.covariance = covariance;
            from_said = mean;
            if round < ROUNDS {
                let (there, solver) = sheet.solved(imager, &sheet.mean)?;
                linear = Linear::solved(&there, &solver, baseline, &options)?;
            }
        }
        Some(sheet)
    }

    fn solver(&self, imager: &Imager, unknowns: &DVector<f64>) -> Option<Solver> {
        let n = self.electrodes;
        let off: Vec<f64> = unknowns.rows(0, 2 * n).iter().copied().collect();
        let heights: Vec<f64> = unknowns.rows_range(2 * n..).iter().copied().collect();
        let sheet = imager.model.geometry().displaced(imager.model.sheet(), &off)?;
        let model = Arc::new(Model::new(&sheet, &ModelOptions::default()).ok()?);
        let mut solver = Solver::new(Arc::clone(&model)).ok()?;
        let rise = |p: [f64; 2]| self.bumps.sum(&heights, p).exp_m1();
        solver.solve(&conductivity_of(model.mesh(), rise)).ok()?;
        Some(solver)
    }

    fn solved(&self, imager: &Imager, unknowns: &DVector<f64>) -> Option<(Imager, Solver)> {
        let solver = self.solver(imager, unknowns)?;
        let matrix = solver.electrode_matrix();
        let sensitivity = Sensitivity::by_cell(&solver, &imager.grid);
        let there = Imager {
            model: Arc::clone(solver.model()),
            model_v: imager.drive.frame_v(matrix, &imager.pattern),
            sensitivity: sensitivity.matrix_v(imager.drive, matrix, &imager.pattern),
            ..imager.clone()
        };
        Some((there, solver))
    }

    /// With no unknowns but those that are given.
    pub(crate) fn known(imager: &Imager, distance: f64) -> Self {
        Self {
            bumps: Bumps::new(imager, distance),
            distance,
            mean: DVector::zeros(0),
            covariance: DMatrix::zeros(0, 0),
            electrodes: imager.model.electrodes(),
        }
    }

    /// How many unknowns there are.
    pub(crate) fn count(&self) -> usize {
        2 * self.electrodes + self.bumps.len()
    }

    /// How the sheet with these unknowns answers to every cell of a grid, normalised as differences to its own baseline are: in volts of
    /// the imager's model.
    pub(crate) fn responses(&self, imager: &Imager, unknowns: &DVector<f64>, grid: &CellGrid) -> Option<DMatrix<f64>> {
        Some(normalised(imager, &self.solver(imager, unknowns)?, grid))
    }
}
