//! Which circles the mesh can follow.

use crate::curve::{Point, distance};
use crate::geometry::Geometry;

/// Nearest that a circle which the mesh follows may come to a rim or another circle, over its radius. Less lets gaps ask for
/// very short edges; more leaves more circles to be averaged over the elements they cut.
pub(super) const CLEAR: f64 = 0.002;

/// Whether the mesh can follow a circle: it is inside the sheet, and neither a rim nor another circle is too near.
pub(crate) fn followed(geometry: &Geometry, circles: &[(Point, f64, f64)], k: usize) -> bool {
    let (centre, radius, edge) = circles[k];
    let near = CLEAR * radius;
    let rims_clear = geometry.rings.iter().all(|ring| ring.nearest(centre).1 > radius + near);
    let others_clear = circles.iter().enumerate().all(|(other, (c, r, _))| {
        let d = distance(centre, *c);
        other == k || d > radius + r + near || d + radius.min(*r) + near < radius.max(*r)
    });
    rims_clear && others_clear && radius > edge && geometry.contains(centre)
}
