//! The sheet under a scene, solved by the forward model on a mesh of its own.

use crate::material::Material;
use crate::scene::{Scene, TouchNow};
use crate::sheet::SheetModel;
use crate::touch::Shape;
use forward::field::{conductivity_of, conductivity_of_discs};
use forward::{DiscTouch, ElectrodeMatrix, ForwardError, Mesh, Model, ModelOptions, Sheet, Solver, Tensor};
use std::sync::Arc;

/// Relative accuracy of the simulated voltages. Finer than the reconstruction's mesh, so that the two do not share their
/// errors.
const ACCURACY: f64 = 5e-4;

/// A sheet of rubber and what happens on it.
pub struct Rubber {
    scene: Scene,
    solver: Solver,
    /// The touches that the solver last solved for.
    solved: Vec<TouchNow>,
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
        Ok(Self {
            scene,
            solver: Solver::new(model)?,
            solved: Vec::new(),
        })
    }

    /// What happens on it.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }
}

impl SheetModel for Rubber {
    fn electrode_matrix(&mut self, t_s: f64) -> Result<&ElectrodeMatrix, ForwardError> {
        let touches = self.scene.truth(t_s);
        if touches != self.solved {
            let conductivity = conductivity(self.solver.model().mesh(), &self.scene.material, &touches);
            self.solver.solve(&conductivity)?;
            self.solved = touches;
        }
        Ok(self.solver.electrode_matrix())
    }
}

/// Conductivity of every element under touches, relative to the untouched sheet.
fn conductivity(mesh: &Mesh, material: &Material, touches: &[TouchNow]) -> Vec<Tensor> {
    let discs: Vec<DiscTouch> = touches
        .iter()
        .filter(|t| t.shape == Shape::Disc)
        .map(|t| DiscTouch {
            centre_mm: [t.x_mm, t.y_mm],
            radius_mm: t.radius_mm,
            rise: t.peak_rise,
        })
        .collect();
    let fingers: Vec<&TouchNow> = touches.iter().filter(|t| t.shape == Shape::Finger).collect();
    // Far from any disc's edge this is the untouched sheet.
    let stepped = conductivity_of_discs(mesh, &discs);
    if fingers.is_empty() {
        return stepped;
    }
    let smooth = conductivity_of(mesh, |p| {
        material.rise(fingers.iter().map(|t| t.pressure_mpa(p[0], p[1])).sum())
    });
    stepped.into_iter().zip(smooth).map(|(a, b)| both(a, b)).collect()
}

/// Rises add, so the resistivities over that of the untouched sheet do: `1 / (1/a + 1/b - 1)`, as tensors. `smooth` is the
/// same in all directions.
fn both(stepped: Tensor, smooth: Tensor) -> Tensor {
    let inverse = |[xx, xy, yy]: Tensor| {
        let det = xx * yy - xy * xy;
        [yy / det, -xy / det, xx / det]
    };
    let rise = 1.0 / smooth[0] - 1.0;
    if rise == 0.0 {
        return stepped;
    }
    let [xx, xy, yy] = inverse(stepped);
    inverse([xx + rise, xy, yy + rise])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rises_of_a_disc_and_a_finger_add() {
        let of = |rise: f64| [1.0 / (1.0 + rise), 0.0, 1.0 / (1.0 + rise)];
        let sum = both(of(0.2), of(0.3));
        assert!((sum[0] - of(0.5)[0]).abs() < 1e-15 && sum[1] == 0.0, "{sum:?}");
        let cut = [0.9, 0.02, 0.95];
        assert_eq!(both(cut, of(0.0)), cut);
    }
}
