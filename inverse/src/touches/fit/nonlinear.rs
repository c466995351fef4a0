//! What the linear model of discs leaves out: touches that see one another, the rim's image of a touch, the current that a
//! voltage drive loses.
//!
//! The sheet is solved with the discs and without, on one mesh that follows their edges; the difference, less what the table
//! says, is left out. Taken off the data, it leaves what the table can fit; a few rounds, each from the touches of the one before,
//! are enough for +300 %. What the table's interpolation gets wrong goes with it.

use crate::touches::fit::responses::TouchTable;
use crate::touches::fit::{Disc, Discs, MOST_TOUCHES};
use forward::{DiscTouch, Drive, Model, Pattern, Solver};
use std::f64::consts::PI;
use std::sync::Arc;

/// Solves for discs on the imager's own mesh, moved onto their edges.
pub struct Beyond {
    solver: Solver,
    drive: Drive,
    pattern: Pattern,
}

impl Beyond {
    /// Prepares the solver; `None` when the model cannot be solved.
    pub fn new(model: &Arc<Model>, drive: Drive, pattern: &Pattern) -> Option<Self> {
        Some(Self {
            solver: Solver::new(Arc::clone(model)).ok()?,
            drive,
            pattern: pattern.clone(),
        })
    }

    /// What the discs (strengths in mm²) change beyond what the table (volts of the model) says, V.
    ///
    /// It depends on the strengths far more than on the radii: a disc too small for its strength is taken larger, not weaker.
    pub fn table_v(&mut self, table: &TouchTable, discs: &[Disc]) -> Option<Vec<f64>> {
        let discs: Discs = discs.iter().take(MOST_TOUCHES).map(Disc::believable).collect();
        let touches: Vec<DiscTouch> = discs
            .iter()
            .map(|d| DiscTouch {
                centre_mm: d.at,
                radius_mm: d.radius,
                rise: d.rise(),
            })
            .collect();
        let mut more = self
            .drive
            .frame_v(self.solver.solve_touches(&touches).ok()?, &self.pattern);
        let untouched = self.solver.solve_untouched_there().ok()?;
        for (m, unpressed) in more.iter_mut().zip(self.drive.frame_v(untouched, &self.pattern)) {
            *m -= unpressed;
        }
        let mut answers: [Vec<f64>; 4] = std::array::from_fn(|_| vec![0.0; table.stride()]);
        for d in &discs {
            let [value, x, y, radius] = &mut answers;
            table.at(d.at, d.radius, [value, x, y, radius]);
            for (m, v) in more.iter_mut().zip(value) {
                *m -= d.strength * *v;
            }
        }
        Some(more)
    }
}

/// About how much the linear model gets wrong, in the unit of the norms of the discs' answers: of every answer half the contrast
/// times R²/d² for each of the other touches and for the rim's image (a dipole's field at the distance d, or twice the distance of
/// the rim). Dipoles lie in all directions, so all of it adds up by squares. Within a factor of 1.6 of what a solution says.
pub fn expected(discs: &[Disc], norms: &[f64], outline_mm: &[[f64; 2]]) -> f64 {
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
