//! The simulated skin, as a port that runs in real time.

use ::forward::Sheet;
use anyhow::{Context, Result};
use hil_sim::{Pace, Rubber, SceneFile, SimBoard, SimPort};
use link::Port;
use std::time::Duration;

/// The demo on a sheet.
///
/// # Errors
/// It does not start.
pub(crate) fn demo(sheet: Sheet) -> Result<Box<dyn Port>> {
    start(&SceneFile::demo(sheet))
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
