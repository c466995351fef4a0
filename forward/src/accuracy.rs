//! From the accuracy wanted to the lengths of a mesh.

use crate::geometry::{Geometry, Sheet};
use crate::mesh::MeshSizes;
use crate::model::{ForwardError, ModelOptions};

/// Accuracy, electrode fraction, growth, largest edge over the sheet's smaller extent: what a study of quadratic elements
/// on the paper's disc gave, with a third to spare.
const QUADRATIC: [[f64; 4]; 4] = [
    [1e-2, 0.2, 0.7, 0.062],
    [1e-3, 0.025, 0.6, 0.046],
    [1e-4, 0.01, 0.35, 0.028],
    [1e-5, 0.002, 0.2, 0.015],
];

pub(crate) fn sizes(
    _sheet: &Sheet,
    geometry: &Geometry,
    options: &ModelOptions,
) -> Result<MeshSizes, ForwardError> {
    let a = options.accuracy;
    if !(1e-5..=0.1).contains(&a) {
        return Err(ForwardError::Accuracy { value: a });
    }
    let k = QUADRATIC
        .iter()
        .skip(1)
        .position(|row| a >= row[0])
        .unwrap_or(2);
    let (coarse, fine) = (QUADRATIC[k], QUADRATIC[k + 1]);
    let t = ((coarse[0] / a).log10() / (coarse[0] / fine[0]).log10()).max(0.0);
    let between = |i: usize| coarse[i] * (fine[i] / coarse[i]).powf(t);
    let (low, high) = geometry.bounding_box();
    let extent = (high[0] - low[0]).min(high[1] - low[1]);
    Ok(MeshSizes {
        largest_mm: between(3) * extent,
        electrode_fraction: between(1),
        electrode_most_mm: 0.05 * extent,
        growth: between(2),
        circles: options.circles.clone(),
    })
}
