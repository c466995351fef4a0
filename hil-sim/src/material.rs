//! What the rubber makes of pressure.

use std::f64::consts::PI;

/// Pressure-sensitive rubber: its resistivity rises with the pressure on it, at once and in proportion.
///
/// Only the instant, linear part of a viscoelastic solid is here: nothing creeps, and nothing is left when a touch lifts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Relative rise in resistivity per MPa.
    pub rise_per_mpa: f64,
}

impl Default for Material {
    /// 25 N on a disc tip of 25 mm raise the resistivity below it by 20 %.
    fn default() -> Self {
        let area_mm2 = PI * 12.5 * 12.5;
        Self {
            rise_per_mpa: 0.2 / (25.0 / area_mm2),
        }
    }
}

impl Material {
    /// Relative rise in resistivity, 0.2 for +20 %, under a pressure (MPa, 0 or more).
    pub fn rise(&self, pressure_mpa: f64) -> f64 {
        self.rise_per_mpa * pressure_mpa.max(0.0)
    }
}
