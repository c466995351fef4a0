//! What the electrodes see of a sheet under discs, fast.

use super::file::Physics;
use forward::field::{conductivity_of, conductivity_of_discs};
use forward::scattering::Scattering;
use forward::{
    DiscTouch, Electrode, ElectrodeMatrix, ForwardError, Geometry, Model, ModelOptions, Place, Sheet, Solver,
};
use hil_sim::Variation;
use nalgebra::DMatrix;
use std::sync::Arc;

/// Relative accuracy of the untouched sheet's voltages. A reconstruction's mesh is coarser. Less takes longer for every sheet and for
/// every frame that is solved on the mesh.
const ACCURACY: f64 = 1e-4;

/// A sheet that discs press.
pub(super) struct Rubber {
    solver: Solver,
    /// None where a mesh is asked for, or none can do without.
    scattering: Option<Scattering>,
    /// Conductance of every element by unevenness; empty for an even sheet.
    uneven: Vec<f64>,
    untouched: ElectrodeMatrix,
}

impl Rubber {
    pub(super) fn new(sheet: &Sheet, physics: Physics, variation: Variation) -> Result<Self, ForwardError> {
        let options = ModelOptions {
            accuracy: ACCURACY,
            ..ModelOptions::default()
        };
        let model = Arc::new(Model::new(sheet, &options)?);
        let mut uneven = Vec::new();
        let mut solver = Solver::new(Arc::clone(&model))?;
        if variation.resistivity_sd > 0.0 {
            let resistivity = variation.resistivity();
            let conductivity = conductivity_of(model.mesh(), |p| resistivity(p) - 1.0);
            uneven = conductivity.iter().map(|s| s[0]).collect();
            solver.solve(&conductivity)?;
        }
        let even = uneven.is_empty() && physics == Physics::Discs;
        Ok(Self {
            scattering: if even { Scattering::new(&solver) } else { None },
            untouched: solver.electrode_matrix().clone(),
            uneven,
            solver,
        })
    }

    pub(super) fn untouched(&self) -> &ElectrodeMatrix {
        &self.untouched
    }

    /// The sheet under discs, and whether its mesh was solved.
    pub(super) fn pressed(&mut self, touches: &[DiscTouch]) -> Result<(ElectrodeMatrix, bool), ForwardError> {
        if touches.is_empty() {
            return Ok((self.untouched.clone(), false));
        }
        if let Some(scattered) = self.scattering.as_ref().and_then(|s| s.discs(touches)) {
            return Ok((self.changed(&scattered.change_ohm), false));
        }
        if !self.uneven.is_empty() {
            let mut conductivity = conductivity_of_discs(self.solver.model().mesh(), touches);
            for (tensor, even) in conductivity.iter_mut().zip(&self.uneven) {
                tensor.iter_mut().for_each(|s| *s *= even);
            }
            return Ok((self.solver.solve(&conductivity)?.clone(), true));
        }
        let touched = self.solver.solve_touches(touches)?.potentials_ohm().clone();
        // On the mesh as the touches moved it.
        let change = touched - self.solver.solve_untouched_there()?.potentials_ohm();
        Ok((self.changed(&change), true))
    }

    fn changed(&self, change: &DMatrix<f64>) -> ElectrodeMatrix {
        ElectrodeMatrix::from_potentials(self.untouched.potentials_ohm() + change)
    }
}

/// Moves an electrode along the outer rim, counter-clockwise. One on a hole's rim or inside stays.
pub(super) fn shift(electrode: &mut Electrode, centre: [f64; 2], geometry: &Geometry, off_mm: f64) {
    let outline = geometry.outline();
    let width_mm = match electrode.place {
        Place::Angle { width_mm, .. } | Place::Arc { width_mm, .. } | Place::Point { width_mm, .. } => width_mm,
        Place::Inside { .. } => return,
    };
    let (arc_mm, away_mm) = outline.nearest(centre);
    if off_mm != 0.0 && away_mm < 0.01 * width_mm {
        electrode.place = Place::Arc {
            arc_mm: (arc_mm + off_mm).rem_euclid(outline.length()),
            width_mm,
        };
    }
}
