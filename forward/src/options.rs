//! How a model is made.

use crate::curve::Point;
use crate::field::DiscTouch;
use crate::mesh::Order;

/// How a model is made.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelOptions {
    /// Largest relative error wanted of any voltage, 1e-5 to 0.1. Calibrated on the paper's disc; see docs/forward.md.
    pub accuracy: f64,
    /// Degree of the elements.
    pub order: Order,
    /// Circles to resolve (centre, radius, edge length along them, all mm).
    pub circles: Vec<(Point, f64, f64)>,
    /// Touches whose edges the mesh follows, so that their jump costs no accuracy; see [`ModelOptions::for_touches`].
    pub touches: Vec<DiscTouch>,
}

impl ModelOptions {
    /// The default accuracy for these touches, however strong. The mesh follows the edge of every disc that keeps clear of
    /// the rim and of the other discs. Along the edges of the others the mesh is fine.
    pub fn for_touches(touches: &[DiscTouch]) -> Self {
        Self {
            touches: touches.to_vec(),
            ..Self::default()
        }
    }
}

impl Default for ModelOptions {
    fn default() -> Self {
        Self {
            accuracy: 1e-3,
            order: Order::Quadratic,
            circles: Vec::new(),
            touches: Vec::new(),
        }
    }
}
