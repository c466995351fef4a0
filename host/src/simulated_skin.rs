//! The simulated skin, as a port that runs in real time.

use ::forward::Sheet;
use anyhow::{Context, Result};
use hil_sim::{Pace, SceneFile, SimPort};
use link::Port;
use std::time::Duration;

/// The demo on the paper's sheet.
///
/// # Errors
/// It does not start.
pub(crate) fn demo() -> Result<Box<dyn Port>> {
    start(&SceneFile::demo(Sheet::paper()))
}

/// A scene.
///
/// # Errors
/// It does not start.
pub(crate) fn start(scene: &SceneFile) -> Result<Box<dyn Port>> {
    let mut port = SimPort::new(scene.board()?, Pace::RealTime).context("the simulated skin does not start")?;
    port.set_timeout(Duration::from_millis(20));
    Ok(Box::new(port))
}
