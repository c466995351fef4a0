//! The nonlinear model, and the linearisation error of discs.
//!
//! The linear model leaves out three effects: touches that see one another, the rim's image of a touch, and the current
//! that a voltage drive loses. The sheet is solved with the discs and without, on one mesh that follows their edges.
//! The linearisation error is the difference of the two solutions less the table's response. It includes the table's
//! interpolation error. Taken off the data, it leaves what the table can fit. A few rounds, each from the touches of
//! the round before, are enough for +300 %.

use crate::touches::fit::disc::{Disc, Discs, MOST_TOUCHES};
use crate::touches::fit::responses::ResponseTable;
use forward::{DiscTouch, Drive, Model, Pattern, Solver};
use std::f64::consts::PI;
use std::sync::Arc;

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

    /// Linearisation error of the discs (strengths in mm²): what they change, less the table's response, V of the
    /// model. `table` holds volts of the model. `None` when the sheet with these discs cannot be solved.
    ///
    /// The error depends on the strengths far more than on the radii. A disc too small for its strength is therefore
    /// taken larger, not weaker.
    /// With `remesh` strong touches at the rim get a mesh of their own, which takes twenty times as long.
    pub fn linearisation_error_v(&mut self, table: &ResponseTable, discs: &[Disc], remesh: bool) -> Option<Vec<f64>> {
        let discs: Discs = discs.iter().take(MOST_TOUCHES).map(Disc::believable).collect();
        let touches: Vec<DiscTouch> = discs
            .iter()
            .map(|d| DiscTouch {
                centre_mm: d.at,
                radius_mm: d.radius,
                rise: d.rise(),
            })
            .collect();
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
        let mut response: [Vec<f64>; 4] = std::array::from_fn(|_| vec![0.0; table.stride()]);
        for d in &discs {
            let [value, x, y, radius] = &mut response;
            table.at(d.at, d.radius, [value, x, y, radius]);
            for (error, v) in error_v.iter_mut().zip(value) {
                *error -= d.strength * *v;
            }
        }
        Some(error_v)
    }
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
