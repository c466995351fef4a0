//! The simulated skin as the bench of experiments, in simulated time.

use crate::paper::rig::{Mounted, Press, Rig, RigError, Tip};
use forward::{ForwardError, Model, ModelOptions, Sheet};
use hil_sim::{Key, Material, Pace, Rubber, Scene, Shape, SimBoard, SimConfig, SimPort, Touch};
use std::sync::Arc;

/// Relative accuracy of the simulated voltages, as for any simulated skin: finer than the reconstruction's mesh.
const ACCURACY: f64 = 5e-4;

/// Interval at which the board's front end takes the state of the rubber, s. A force of 25 N comes down in half a
/// second. A delay of half the interval is 1 % of that.
const LOOK_S: f64 = 0.01;

/// Skins of one sheet. All share a mesh, and each has its own rubber.
pub struct SimulatedRig {
    model: Arc<Model>,
}

impl SimulatedRig {
    /// Skins of the paper's sheet.
    ///
    /// # Errors
    /// None for the paper's sheet.
    pub fn new() -> Result<Self, ForwardError> {
        Self::on(&Sheet::paper())
    }

    /// Skins of a sheet, which is meshed.
    ///
    /// # Errors
    /// [`ForwardError`] for a sheet that makes no sense.
    pub fn on(sheet: &Sheet) -> Result<Self, ForwardError> {
        let options = ModelOptions {
            accuracy: ACCURACY,
            ..ModelOptions::default()
        };
        Ok(Self {
            model: Arc::new(Model::new(sheet, &options)?),
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
        let mut config = SimConfig {
            look_samples: Some(hil_sim::samples(LOOK_S)),
            ..SimConfig::default()
        };
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
    let shape = match press.tip {
        Tip::Disc => Shape::Disc,
        Tip::Finger => Shape::Finger,
    };
    let keys = press.path.iter().map(|[t_s, x, y, n]| Key::new(*t_s, *x, *y, *n));
    Touch::new(shape, press.radius_mm, keys.collect())
}
