//! The nonlinear model, and the linearisation error of discs.
//!
//! The linear model leaves out three effects: touches that see one another, the rim's image of a touch, and the current
//! that a voltage drive loses. The sheet is solved with the discs and without, on one mesh that follows their edges.
//! The linearisation error is the difference of the two solutions less the table's response. It includes the table's
//! interpolation error. Taken off the data, it leaves what the table can fit. A few rounds, each from the touches of
//! the round before, are enough for +300 %.
//!
//! A solution takes milliseconds. Where discs lie apart, the same error comes from multiple scattering in a fiftieth of the time
//! ([`ScatteringModel`]).

use crate::touches::fit::disc::{Disc, Discs, MOST_TOUCHES};
use crate::touches::fit::responses::ResponseTable;
use forward::scattering::Scattering;
use forward::{DiscTouch, Drive, ElectrodeMatrix, Model, Pattern, Solver};
use std::f64::consts::PI;
use std::sync::Arc;

/// How exact the table is: within so much of a response.
const TABLE_ERROR: f64 = 0.004;
/// How exact multipoles must be for a single frame. Their error in what they add is half of that; the test below holds it.
const FRAME_ERROR: f64 = 0.01;

/// Solves for discs on the imager's own mesh, moved onto their edges.
pub struct NonlinearModel {
    solver: Solver,
    drive: Drive,
    pattern: Pattern,
}

impl NonlinearModel {
    /// Prepares the solver; `None` when the model cannot be solved.
    pub fn new(model: &Arc<Model>, drive: Drive, pattern: &Pattern) -> Option<Self> {
        Some(Self {
            solver: Solver::new(Arc::clone(model)).ok()?,
            drive,
            pattern: pattern.clone(),
        })
    }

    /// Makes the next error depend on nothing that was solved before.
    pub(crate) fn forget(&mut self) {
        self.solver.forget();
    }

    /// Linearisation error of the discs (strengths in mm²): what they change, less the table's response, V of the
    /// model. `table` holds volts of the model. `None` when the sheet with these discs cannot be solved.
    ///
    /// The error depends on the strengths far more than on the radii. A disc too small for its strength is therefore
    /// taken larger, not weaker.
    /// With `remesh` strong touches at the rim get a mesh of their own, which takes twenty times as long.
    pub fn linearisation_error_v(&mut self, table: &ResponseTable, discs: &[Disc], remesh: bool) -> Option<Vec<f64>> {
        let discs: Discs = discs.iter().take(MOST_TOUCHES).map(Disc::believable).collect();
        let touches = touches_of(&discs);
        let touched = if remesh {
            self.solver.solve_touches(&touches)
        } else {
            self.solver.solve_touches_here(&touches)
        };
        let mut error_v = self.drive.frame_v(touched.ok()?, &self.pattern);
        let untouched = self.solver.solve_untouched_there().ok()?;
        for (error, unpressed) in error_v.iter_mut().zip(self.drive.frame_v(untouched, &self.pattern)) {
            *error -= unpressed;
        }
        for (error, response) in error_v.iter_mut().zip(response_v(table, &discs)) {
            *error -= response;
        }
        Some(error_v)
    }
}

/// Discs by multiple scattering, which needs no mesh.
pub struct ScatteringModel {
    scattering: Scattering,
    unpressed: ElectrodeMatrix,
    unpressed_v: Vec<f64>,
    drive: Drive,
    pattern: Pattern,
}

impl ScatteringModel {
    /// Prepares the sheet; `None` when it cannot be solved, or its rims leave no room ([`Scattering::new`]).
    pub fn new(model: &Arc<Model>, drive: Drive, pattern: &Pattern) -> Option<Self> {
        let solver = Solver::new(Arc::clone(model)).ok()?;
        let unpressed = solver.electrode_matrix().clone();
        Some(Self {
            scattering: Scattering::new(&solver)?,
            unpressed_v: drive.frame_v(&unpressed, pattern),
            unpressed,
            drive,
            pattern: pattern.clone(),
        })
    }

    /// Linearisation error of the discs (strengths in mm²): what they change, less the table's response, V of the model. `table` holds
    /// volts of the model. `None` where a disc reaches a rim or another one, or is so near the rim that multipoles are not exact: their
    /// first order tells by the table. With `exact` they must be as exact as the table is.
    pub fn linearisation_error_v(&self, table: &ResponseTable, discs: &[Disc], exact: bool) -> Option<Vec<f64>> {
        let discs: Discs = discs.iter().take(MOST_TOUCHES).map(Disc::believable).collect();
        let scattered = self.scattering.discs(&touches_of(&discs))?;
        let changed = ElectrodeMatrix::from_potentials(self.unpressed.potentials_ohm() + &scattered.change_ohm);
        let mut error_v = self.drive.frame_v(&changed, &self.pattern);
        for (error, unpressed) in error_v.iter_mut().zip(&self.unpressed_v) {
            *error -= unpressed;
        }
        let first_order = &scattered.first_order;
        let first_order = first_order.matrix_v(self.drive, &self.unpressed, &self.pattern);
        let response = response_v(table, &discs);
        let square = |v: &mut dyn Iterator<Item = f64>| v.map(|v| v * v).sum::<f64>();
        let apart = square(&mut first_order.iter().zip(&response).map(|(f, r)| f - r));
        let most = if exact { TABLE_ERROR } else { FRAME_ERROR };
        if apart > most * most * square(&mut response.iter().copied()) {
            return None;
        }
        for (error, response) in error_v.iter_mut().zip(&response) {
            *error -= response;
        }
        Some(error_v)
    }
}

/// The table's response to discs, V of the model.
pub(super) fn response_v(table: &ResponseTable, discs: &[Disc]) -> Vec<f64> {
    let mut sum = vec![0.0; table.stride()];
    let mut response: [Vec<f64>; 4] = std::array::from_fn(|_| vec![0.0; table.stride()]);
    for d in discs {
        let [value, x, y, radius] = &mut response;
        table.at(d.at, d.radius, [value, x, y, radius]);
        for (sum, v) in sum.iter_mut().zip(value) {
            *sum += d.strength * *v;
        }
    }
    sum
}

fn touches_of(discs: &[Disc]) -> Vec<DiscTouch> {
    let touch = |d: &Disc| DiscTouch {
        centre_mm: d.at,
        radius_mm: d.radius,
        rise: d.rise(),
    };
    discs.iter().map(touch).collect()
}

/// Norm of the linearisation error as dipoles estimate it, in the unit of `norms`, which are those of the discs'
/// responses.
///
/// Every other touch, and the rim's image, changes a response by half the contrast times R²/d². This is a dipole's
/// field at the distance d, which is twice the distance of the rim for the image. Dipoles lie in all directions: their
/// parts are added by squares. The estimate is within a factor of 1.6 of a solution's.
pub fn expected_error(discs: &[Disc], norms: &[f64], outline_mm: &[[f64; 2]]) -> f64 {
    let one = |d: &Disc| {
        let q = d.radius * d.radius;
        let rim = outline_mm
            .iter()
            .map(|p| (p[0] - d.at[0]).powi(2) + (p[1] - d.at[1]).powi(2))
            .fold(f64::INFINITY, f64::min);
        let own = 0.5 * d.contrast() * q / (4.0 * rim).max(q);
        let others: f64 = discs
            .iter()
            .filter(|o| *o != d)
            .map(|o| {
                let apart = (o.at[0] - d.at[0]).powi(2) + (o.at[1] - d.at[1]).powi(2);
                (0.5 * o.contrast() * o.area_mm2() / PI / apart.max(q)).powi(2)
            })
            .sum();
        own * own + others
    };
    let square: f64 = discs.iter().zip(norms).map(|(d, norm)| one(d) * norm * norm).sum();
    square.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::imager::Imager;
    use crate::touches::fit::fitter::Fitter;
    use crate::touches::fit::prior::FitOptions;
    use forward::Sheet;

    /// What multipoles say of the error is what a solution says, within a thousandth of the whole change; within half a percent with
    /// 6 mm to the rim. Nearer to it they say nothing.
    #[test]
    fn multipoles_and_solutions_say_the_same_of_the_error() {
        let pattern = Pattern::adjacent(16).unwrap();
        let imager = Arc::new(Imager::new(&Sheet::paper(), Drive::PAPER, pattern, 5.0).unwrap());
        let fitter = Fitter::new(&imager, FitOptions::for_extent(97.5)).unwrap();
        let table = fitter.volts();
        let mut solutions = NonlinearModel::new(&imager.model, imager.drive, &imager.pattern).unwrap();
        let multipoles = ScatteringModel::new(&imager.model, imager.drive, &imager.pattern).unwrap();
        let disc = |x: f64, y: f64, s: f64| Disc {
            at: [x, y],
            radius: 12.5,
            strength: s * 12.5 * 12.5 * std::f64::consts::PI,
        };
        let norm = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
        let of = |y: f64, s: f64| vec![disc(0.0, y, s), disc(30.0, 62.0, 0.5)];
        for (most, discs) in [
            (0.001, vec![disc(0.0, 20.0, 0.2), disc(32.0, 20.0, 0.2)]),
            (
                0.001,
                vec![disc(-30.0, 0.0, 0.9), disc(10.0, 12.0, 0.7), disc(40.0, -40.0, 0.5)],
            ),
            (0.001, of(76.0, 0.5)),
            (0.005, of(79.0, 0.5)),
        ] {
            let error = multipoles.linearisation_error_v(table, &discs, false).unwrap();
            let truth = solutions.linearisation_error_v(table, &discs, true).unwrap();
            let off: Vec<f64> = error.iter().zip(&truth).map(|(e, t)| e - t).collect();
            let off = norm(&off) / norm(&response_v(table, &discs));
            assert!(off < most, "{discs:?}: {off}");
        }
        assert!(multipoles.linearisation_error_v(table, &of(79.0, 0.5), true).is_none());
        assert!(multipoles.linearisation_error_v(table, &of(83.0, 0.5), false).is_none());
    }
}
