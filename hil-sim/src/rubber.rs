//! The sheet under a scene, solved by the forward model on a mesh of its own.

use crate::creep::{Creep, Points};
use crate::scene::{Scene, TouchNow};
use crate::sheet::SheetModel;
use forward::field::{POINTS, conductivity_of_steps};
use forward::{DiscTouch, ElectrodeMatrix, ForwardError, Model, ModelOptions, Sheet, Solver, Tensor};
use std::sync::Arc;

/// Relative accuracy of the simulated voltages. Finer than the reconstruction's mesh, so that the two do not share their
/// errors.
const ACCURACY: f64 = 5e-4;

/// Largest relative change of an element's conductivity that is not worth solving for again: what creeps so little moves no
/// voltage by more than that, and mostly by far less.
const UNCHANGED: f64 = 1e-5;

/// A sheet of rubber and what happens on it.
pub struct Rubber {
    scene: Scene,
    solver: Solver,
    points: Points,
    creep: Creep,
    /// The touches and whether anything crept when the state was last computed.
    seen: (Vec<TouchNow>, bool),
}

impl Rubber {
    /// Meshes a sheet and solves it untouched.
    ///
    /// # Errors
    /// [`ForwardError`] says what is wrong with the sheet.
    pub fn new(sheet: &Sheet, scene: Scene) -> Result<Self, ForwardError> {
        let options = ModelOptions {
            accuracy: ACCURACY,
            ..ModelOptions::default()
        };
        Self::on_model(Arc::new(Model::new(sheet, &options)?), scene)
    }

    /// The same on a mesh that is there already.
    ///
    /// # Errors
    /// As for [`Solver::new`].
    pub fn on_model(model: Arc<Model>, scene: Scene) -> Result<Self, ForwardError> {
        let points = Points::new(model.mesh());
        Ok(Self {
            creep: Creep::new(&scene, &points),
            scene,
            solver: Solver::new(model)?,
            points,
            seen: (Vec::new(), false),
        })
    }

    /// What happens on it.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Strain of discs with sharp edges, and of all else at the points of every element.
    fn strain(&self, touches: &[TouchNow]) -> (Vec<DiscTouch>, Vec<[f64; POINTS]>) {
        let material = &self.scene.material;
        let mut discs: Vec<DiscTouch> = Vec::new();
        let mut disc = |centre_mm, radius_mm, strain| {
            let same = |d: &&mut DiscTouch| d.centre_mm == centre_mm && d.radius_mm == radius_mm;
            match discs.iter_mut().find(same) {
                Some(d) => d.rise += strain,
                None => discs.push(DiscTouch {
                    centre_mm,
                    radius_mm,
                    rise: strain,
                }),
            }
        };
        let mut smooth = Vec::new();
        if let Some(field) = self.creep.field() {
            let scaled = field.iter().map(|q| q.map(|q| material.delayed_per_mpa * q));
            smooth.extend(scaled);
        }
        for bump in touches.iter().flat_map(TouchNow::bumps) {
            if bump.flat {
                disc(
                    bump.centre_mm,
                    bump.half_axes_mm[0],
                    material.instant_per_mpa * bump.peak_mpa,
                );
                continue;
            }
            smooth.resize(self.points.elements.len(), [0.0; POINTS]);
            self.points.within(&bump, |element| {
                for (s, p) in smooth[element].iter_mut().zip(&self.points.elements[element].points) {
                    *s += material.instant_per_mpa * bump.pressure_mpa(*p);
                }
            });
        }
        for imprint in self.creep.imprints() {
            disc(
                imprint.centre_mm,
                imprint.radius_mm,
                material.delayed_per_mpa * imprint.delayed_mpa,
            );
        }
        (discs, smooth)
    }
}

impl SheetModel for Rubber {
    fn electrode_matrix(&mut self, t_s: f64) -> Result<&ElectrodeMatrix, ForwardError> {
        let touches = self.scene.truth(t_s);
        self.creep.advance(&self.scene, &self.points, t_s);
        let crept = self.creep.field().is_some() || !self.creep.imprints().is_empty();
        if touches == self.seen.0 && !crept && !self.seen.1 {
            return Ok(self.solver.electrode_matrix());
        }
        let (discs, smooth) = self.strain(&touches);
        let material = &self.scene.material;
        let mesh = self.solver.model().mesh();
        let conductivity = conductivity_of_steps(mesh, &discs, &smooth, |s| 1.0 + material.rise_of_strain(s));
        if changed(self.solver.conductivity(), &conductivity) {
            self.solver.solve(&conductivity)?;
        }
        self.seen = (touches, crept);
        Ok(self.solver.electrode_matrix())
    }
}

/// Whether any conductivity is another.
fn changed(before: &[Tensor], after: &[Tensor]) -> bool {
    before.iter().zip(after).any(|(a, b)| {
        let size = UNCHANGED * a[0].min(a[2]);
        a.iter().zip(b).any(|(a, b)| (a - b).abs() > size)
    })
}
