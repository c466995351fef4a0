//! What the linear model of discs leaves out: touches that see one another, the rim's image of a touch, the current that a
//! voltage drive loses.
//!
//! The difference of two solutions on one mesh: the discs with their true rises, and the same discs so weak that they answer
//! linearly, scaled up. What the mesh gets wrong of a disc's edge is in both and cancels. Taken off the data, it leaves
//! what the linear model can fit; a second round, from the touches of the first, is enough for +300 %.

use super::Disc;
use forward::field::conductivity_of_discs;
use forward::{DiscTouch, Drive, Model, Pattern, Solver};
use std::f64::consts::PI;
use std::sync::Arc;

/// Scale of the weak discs.
const WEAK: f64 = 0.02;

/// Solves for discs on the imager's own mesh.
pub struct Beyond {
    solver: Solver,
    drive: Drive,
    pattern: Pattern,
    unpressed_v: Vec<f64>,
}

impl Beyond {
    /// Prepares the solver; `None` when the model cannot be solved.
    pub fn new(model: &Arc<Model>, drive: Drive, pattern: &Pattern) -> Option<Self> {
        let solver = Solver::new(Arc::clone(model)).ok()?;
        let unpressed_v = drive.frame_v(solver.electrode_matrix(), pattern);
        Some(Self {
            solver,
            drive,
            pattern: pattern.clone(),
            unpressed_v,
        })
    }

    /// What the discs (strengths in mm²) change beyond the linear model, V.
    pub fn linear_v(&mut self, discs: &[Disc]) -> Option<Vec<f64>> {
        let strong = self.change_v(discs, |d| d.rise())?;
        let weak = self.change_v(discs, |d| WEAK * d.contrast())?;
        Some(strong.iter().zip(&weak).map(|(s, w)| s - w / WEAK).collect())
    }

    fn change_v(&mut self, discs: &[Disc], rise: impl Fn(&Disc) -> f64) -> Option<Vec<f64>> {
        let touches: Vec<DiscTouch> = discs
            .iter()
            .map(|d| DiscTouch {
                centre_mm: d.at,
                radius_mm: d.radius,
                rise: rise(d),
            })
            .collect();
        let conductivity = conductivity_of_discs(self.solver.model().mesh(), &touches);
        let matrix = self.solver.solve(&conductivity).ok()?;
        let v = self.drive.frame_v(matrix, &self.pattern);
        Some(v.iter().zip(&self.unpressed_v).map(|(v, u)| v - u).collect())
    }
}

/// About how much of a touch's answer the linear model gets wrong, relative: half the contrast times R²/d², summed over the
/// other touches and the rim's image (a dipole's field at the distance d, or twice the distance of the rim).
pub fn expected(discs: &[Disc], outline_mm: &[[f64; 2]]) -> f64 {
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
                0.5 * o.contrast() * o.area_mm2() / PI / apart.max(q)
            })
            .sum();
        own + others
    };
    discs.iter().map(one).fold(0.0, f64::max)
}
