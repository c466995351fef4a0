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

    /// Whether its strength asks for more contrast than is accepted: how much it rises or falls is then not known, but that it is at least
    /// so much.
    pub fn is_at_limit(&self) -> bool {
        self.strength.abs() >= LARGEST_CONTRAST * self.area_mm2()
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

#[cfg(test)]
mod tests {
    use super::*;

    /// The clamped contrast and the flag say the same: below the limit the strength is that of the rise, and beyond it more.
    #[test]
    fn at_the_limit_the_strength_is_more_than_that_of_the_rise() {
        for strength in [-900.0, -500.0, -10.0, 10.0, 500.0, 900.0] {
            let disc = Disc {
                at: [0.0; 2],
                radius: 12.5,
                strength,
            };
            let of_rise = 2.0 * disc.rise() / (2.0 + disc.rise()) * disc.area_mm2();
            let is_measured = (of_rise - strength).abs() < 1e-9 * strength.abs();
            assert_eq!(disc.is_at_limit(), !is_measured, "{strength}");
        }
    }
}
