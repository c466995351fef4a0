//! The scene that a command simulates.

use ::forward::Sheet;
use anyhow::Result;
use hil_sim::{Scene, SceneFile, SimConfig};
use std::path::Path;

/// The scene of a file, or of the library by its name.
pub(crate) fn load(path: &Path) -> Result<SceneFile> {
    Ok(SceneFile::load(path)?)
}

/// One to four fingers on a sheet, for ever.
pub(crate) fn demo(sheet: &Sheet) -> SceneFile {
    let scene = Scene::demo();
    SceneFile {
        title: "One to four fingers".to_owned(),
        description: "Fingers that come, move and go, for ever.".to_owned(),
        duration_s: scene.loop_s.unwrap_or(24.0),
        sheet: sheet.clone(),
        scene,
        config: SimConfig::default(),
    }
}
