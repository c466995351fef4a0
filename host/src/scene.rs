//! The scene that a command simulates.

use crate::sheet::extent;
use ::forward::Geometry;
use anyhow::Result;
use hil_sim::SceneFile;
use std::path::Path;

/// The scene of a file, or of the library by its name.
pub(crate) fn load(path: &Path) -> Result<SceneFile> {
    let file = SceneFile::load(path)?;
    for warning in touches_off(&file)? {
        eprintln!("warning: {}: {warning}", path.display());
    }
    Ok(file)
}

/// How often a touch is looked at.
const LOOKS: u32 = 2000;

/// What is to be said of touches that press, but never on the sheet.
fn touches_off(file: &SceneFile) -> Result<Vec<String>> {
    let geometry = Geometry::new(&file.sheet)?;
    let mut warnings = Vec::new();
    for (k, touch) in file.scene.touches.iter().enumerate() {
        let times = (0..LOOKS).map(|n| file.duration_s * f64::from(n) / f64::from(LOOKS));
        let mut pressed = times.filter_map(|t_s| touch.at(t_s)).peekable();
        let Some(first) = pressed.peek().copied() else { continue };
        // A bump's pressure reaches beyond the radius, where it is half.
        if !pressed.any(|key| geometry.reaches([key.x_mm, key.y_mm], 2.0 * touch.radius_under_mm(key.force_n))) {
            warnings.push(format!(
                "touch {}, which comes down at ({}, {}) mm, is off the sheet all the time and changes nothing; {}",
                k + 1,
                first.x_mm,
                first.y_mm,
                extent(&geometry)
            ));
        }
    }
    Ok(warnings)
}
