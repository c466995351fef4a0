//! What a touched sheet gives, in one call.

use crate::error::ForwardError;
use crate::field::{DiscTouch, conductivity_of_discs};
use crate::geometry::{Geometry, Sheet};
use crate::impedance::Drive;
use crate::model::Model;
use crate::options::ModelOptions;
use crate::pattern::Pattern;
use crate::solver::Solver;
use std::sync::Arc;

/// Largest relative error of the untouched sheet's voltages.
const ACCURACY: f64 = 2e-4;
/// Mesh edge along a touch's rim: this fraction of its radius, but no finer than the second one of the sheet's extent.
const RIM: [f64; 2] = [0.04, 1e-3];

/// The frame of a touched sheet: for a [`Drive::Voltage`] amplitudes in V, for a current of 1 A transfer impedances in ohm, in the
/// order of the pattern. The mesh is made for these touches, finer than that of a reconstruction.
///
/// # Errors
/// [`ForwardError`]: a sheet or a touch that makes no sense.
pub fn touched_frame(
    sheet: &Sheet,
    pattern: &Pattern,
    drive: Drive,
    touches: &[DiscTouch],
) -> Result<Vec<f64>, ForwardError> {
    for (touch, t) in touches.iter().enumerate() {
        t.check(touch)?;
    }
    let extent = {
        let (low, high) = Geometry::new(sheet)?.bounding_box();
        (high[0] - low[0]).max(high[1] - low[1])
    };
    let options = ModelOptions {
        accuracy: ACCURACY,
        circles: touches
            .iter()
            .map(|t| (t.centre_mm, t.radius_mm, (RIM[0] * t.radius_mm).max(RIM[1] * extent)))
            .collect(),
        ..ModelOptions::default()
    };
    let model = Arc::new(Model::new(sheet, &options)?);
    let mut solver = Solver::new(Arc::clone(&model))?;
    let matrix = solver.solve(&conductivity_of_discs(model.mesh(), touches))?;
    Ok(drive.frame_v(matrix, pattern))
}
