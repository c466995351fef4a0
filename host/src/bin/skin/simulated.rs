//! The simulated skin as the bench of experiments, in simulated time.

use ::forward::{Model, ModelOptions, Sheet};
use anyhow::Result;
use hil_sim::{Key, Material, Pace, Rubber, Scene, Shape, SimBoard, SimConfig, SimPort, Touch};
use host::paper::rig::{Mounted, Press, Rig, RigError, Tip};
use std::sync::Arc;

/// Relative accuracy of the simulated voltages, as for any simulated skin: finer than the reconstruction's mesh.
const ACCURACY: f64 = 5e-4;

/// Skins of the paper's sheet. All share a mesh, none its rubber.
pub(crate) struct SimulatedRig {
    model: Arc<Model>,
}

impl SimulatedRig {
    /// Meshes the sheet.
    ///
    /// # Errors
    /// None for the paper's sheet.
    pub(crate) fn new() -> Result<Self> {
        let options = ModelOptions {
            accuracy: ACCURACY,
            ..ModelOptions::default()
        };
        Ok(Self {
            model: Arc::new(Model::new(&Sheet::paper(), &options)?),
        })
    }
}

impl Rig for SimulatedRig {
    fn mount(&self, presses: &[Press], creeps: bool, seed: u64) -> Result<Mounted, RigError> {
        let scene = Scene {
            touches: presses.iter().map(touch).collect(),
            material: if creeps {
                Material::viscoelastic()
            } else {
                Material::default()
            },
            ..Scene::empty()
        };
        let mut config = SimConfig::default();
        config.electronics.seed = seed;
        let rubber = Rubber::on_model(Arc::clone(&self.model), scene.clone())?;
        let port = SimPort::new(SimBoard::new(config, rubber)?, Pace::Unpaced)?;
        Ok(Mounted {
            port: Box::new(port),
            gauge: Box::new(move |t_s| scene.truth(t_s).iter().map(|t| t.force_n).sum()),
        })
    }

    fn creep(&self) -> Option<[f64; 3]> {
        let m = Material::viscoelastic();
        Some([
            m.delayed_per_mpa / m.instant_per_mpa,
            m.retardation_s,
            1.0 / (m.gauge * m.instant_per_mpa),
        ])
    }
}

fn touch(press: &Press) -> Touch {
    let key = |[t_s, x_mm, y_mm, force_n]: &[f64; 4]| Key {
        t_s: *t_s,
        x_mm: *x_mm,
        y_mm: *y_mm,
        force_n: *force_n,
    };
    Touch {
        shape: match press.tip {
            Tip::Disc => Shape::Disc,
            Tip::Finger => Shape::Finger,
        },
        radius_mm: press.radius_mm,
        keys: press.path.iter().map(key).collect(),
    }
}
