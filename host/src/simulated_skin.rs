//! The simulated skin, as a port that runs in real time.

use ::forward::Sheet;
use anyhow::{Context, Result};
use hil_sim::{Fault, FixedSheet, Pace, Preset, Rubber, Scene, SceneFile, SimBoard, SimConfig, SimPort};
use link::Port;
use link::phantom::Known;
use std::time::Duration;

/// The demo on a sheet.
///
/// # Errors
/// It does not start.
pub(crate) fn demo(sheet: Sheet) -> Result<Box<dyn Port>> {
    start(&SceneFile::demo(sheet))
}

/// A board with these faults on an untouched sheet, or on such a ring of resistors. Its time passes as fast as
/// it is listened to.
///
/// # Errors
/// A fault that cannot be.
pub(crate) fn bench(sheet: &Sheet, preset: Preset, faults: &[Fault], ring: Option<Known>) -> Result<Box<dyn Port>> {
    let config = SimConfig {
        electronics: preset.electronics(),
        faults: faults.to_vec(),
        ..SimConfig::default()
    };
    Ok(match ring {
        Some(known) => {
            let electrodes = sheet.electrodes.len();
            let ring = FixedSheet::ring(electrodes, known.resistor_ohm(electrodes));
            Box::new(SimPort::new(SimBoard::new(config, ring)?, Pace::Unpaced)?)
        }
        None => {
            let rubber = Rubber::new(sheet, Scene::empty())?;
            Box::new(SimPort::new(SimBoard::new(config, rubber)?, Pace::Unpaced)?)
        }
    })
}

/// A scene that runs from power-up.
///
/// # Errors
/// It does not start.
fn start(scene: &SceneFile) -> Result<Box<dyn Port>> {
    Ok(Box::new(port(scene.board()?)?))
}

/// A scene that waits at its beginning until [`SimPort::begin_scene`].
///
/// # Errors
/// It does not start.
pub(crate) fn start_held(scene: &SceneFile) -> Result<SimPort> {
    port(scene.board()?.holding_scene())
}

fn port(board: SimBoard<Rubber>) -> Result<SimPort> {
    let mut port = SimPort::new(board, Pace::RealTime).context("the simulated skin does not start")?;
    port.set_timeout(Duration::from_millis(20));
    Ok(port)
}
