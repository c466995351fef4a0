//! From the accuracy wanted to the lengths of a mesh.

use crate::error::ForwardError;
use crate::geometry::Geometry;
use crate::mesh::{MeshSizes, followed};
use crate::options::ModelOptions;

/// Accuracy, electrode fraction, growth, largest edge over the sheet's smaller extent; between the rows, powers are
/// interpolated. A study of quadratic elements on the paper's disc gave them, with a third of the error to spare
/// (docs/forward.md). Smaller lengths cost nodes, larger ones accuracy.
const QUADRATIC: [[f64; 4]; 4] = [
    [1e-2, 0.2, 0.7, 0.062],
    [1e-3, 0.025, 0.6, 0.038],
    [1e-4, 0.01, 0.35, 0.028],
    [1e-5, 0.002, 0.2, 0.015],
];

/// Edge along a touch that the mesh follows, over its radius, at an accuracy of 1e-3. A quadratic edge of this length is
/// within 1e-5 of the radius of the circle. Less costs nodes, more bends elements too far.
const ALONG_A_TOUCH: f64 = 0.4;
/// The same for a touch that crosses a rim or another touch. Its jump is averaged over the elements it cuts, at an error in
/// proportion to their edges. Less costs nodes, more accuracy.
const ACROSS_A_TOUCH: f64 = 0.05;

pub(crate) fn sizes(
    geometry: &Geometry,
    contact_mm: &[f64],
    options: &ModelOptions,
) -> Result<MeshSizes, ForwardError> {
    let a = options.accuracy;
    if !(1e-5..=0.1).contains(&a) {
        return Err(ForwardError::Accuracy { value: a });
    }
    let k = QUADRATIC.iter().skip(1).position(|row| a >= row[0]).unwrap_or(2);
    let (coarse, fine) = (QUADRATIC[k], QUADRATIC[k + 1]);
    let t = (libm::log10(coarse[0] / a) / libm::log10(coarse[0] / fine[0])).max(0.0);
    let between = |i: usize| coarse[i] * libm::pow(fine[i] / coarse[i], t);
    let (low, high) = geometry.bounding_box();
    let extent = (high[0] - low[0]).min(high[1] - low[1]);
    // Quadratic elements that follow the jump: energy error with the fourth power of the edge. Cut elements: the first.
    let finer = a / 1e-3;
    let touches: Vec<_> = options.touches.iter().map(|t| (t.centre_mm, t.radius_mm)).collect();
    let along: Vec<_> = touches
        .iter()
        .map(|(centre, radius)| {
            let edge = radius * ALONG_A_TOUCH * libm::pow(finer, 0.25).min(1.5);
            (*centre, *radius, edge)
        })
        .collect();
    let mut circles = options.circles.clone();
    for (k, (centre, radius, edge)) in along.iter().enumerate() {
        let edge = if followed(geometry, &along, k) {
            *edge
        } else {
            radius * ACROSS_A_TOUCH * finer.min(2.0)
        };
        circles.push((*centre, *radius, edge));
    }
    Ok(MeshSizes {
        // The many electrodes' fields decay faster.
        largest_mm: between(3) * extent * libm::pow(32.0 / contact_mm.len() as f64, 0.25).min(1.0),
        electrode_fraction: at_the_ends(geometry, contact_mm, between(1)),
        electrode_most_mm: 0.05 * extent,
        growth: between(2),
        circles,
    })
}

/// Edge at the electrodes' ends, as a fraction of their length. The current density at an end rises over the contact's
/// length; down to a short contact's length it rises like the inverse root of the distance. The error is in proportion to the
/// edge at the end: edges must be short against the contact, but need not be shorter than the fraction's square.
fn at_the_ends(geometry: &Geometry, contact_mm: &[f64], fraction: f64) -> f64 {
    let ends = geometry.spans.iter().zip(contact_mm).filter(|(span, _)| !span.whole);
    ends.map(|(span, contact)| 10.0 * fraction * contact / span.length)
        .fold(fraction, f64::min)
        .max(fraction * fraction)
}
