//! A disc of raised resistivity: a touch as it is fitted.

use arrayvec::ArrayVec;
use std::f64::consts::PI;

/// A touch as it is fitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disc {
    /// Centre, mm.
    pub at: [f64; 2],
    /// Radius, mm.
    pub radius: f64,
    /// Strength as the linear model sees it: rise times area, mm²; below 0 for a fall.
    pub strength: f64,
}

/// Largest size of `s = S / (pi R²)` that is accepted: a rise of 11, a fall to a twelfth. The rise goes to infinity as s goes to 2,
/// the resistivity to 0 as s goes to -2. Chosen by hand.
const LARGEST_CONTRAST: f64 = 1.7;

impl Disc {
    /// Area, mm².
    pub fn area_mm2(&self) -> f64 {
        PI * self.radius * self.radius
    }

    /// The rise that the linear model sees, `s = S / (pi R²)`, no larger than what is accepted.
    pub fn contrast(&self) -> f64 {
        (self.strength / self.area_mm2()).clamp(-LARGEST_CONTRAST, LARGEST_CONTRAST)
    }

    /// The same strength on a disc that is large enough for its contrast to be accepted.
    pub fn believable(&self) -> Self {
        let least = (self.strength.abs() / (PI * LARGEST_CONTRAST)).sqrt();
        Self {
            radius: self.radius.max(least),
            ..*self
        }
    }

    /// Relative rise of the resistivity inside: `2 s / (2 - s)`.
    pub fn rise(&self) -> f64 {
        let s = self.contrast();
        2.0 * s / (2.0 - s)
    }

    /// Derivatives of the integrated rise, `2 S / (2 - s)`, by the radius (mm²/mm) and by the strength.
    pub(super) fn total_slopes(&self) -> [f64; 2] {
        let s = self.contrast();
        let below = (2.0 - s) * (2.0 - s);
        [-4.0 * s * self.strength / self.radius / below, 4.0 / below]
    }
}

/// Most touches that can be fitted together.
pub const MOST_TOUCHES: usize = 24;

/// Touches as they are fitted together.
pub type Discs = ArrayVec<Disc, MOST_TOUCHES>;
