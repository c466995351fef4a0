//! A touch: where the sheet is pressed and by how much its resistivity rises there.

use serde::{Deserialize, Serialize};

/// One touch found in the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Touch {
    /// Number that stays with the touch from frame to frame; none before it is tracked.
    pub id: Option<u32>,
    /// Centre, mm to the right of the sheet's centre.
    pub x_mm: f64,
    /// Centre, mm above the sheet's centre.
    pub y_mm: f64,
    /// Relative rise of resistivity at the centre, 0.2 = 20 %.
    pub rise: f64,
    /// Whether [`Touch::rise`] is the largest that the model of discs has, or the smallest. It is not measured then: the touch explains
    /// its frame best with at least as much.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub at_limit: bool,
    /// Area that is pressed, mm².
    pub area_mm2: f64,
    /// Rise integrated over the area, mm².
    pub total_mm2: f64,
    /// Standard uncertainty of `x_mm`; none where the touch was not fitted to the measurements.
    pub x_sd_mm: Option<f64>,
    /// Standard uncertainty of `y_mm`; none where the touch was not fitted to the measurements.
    pub y_sd_mm: Option<f64>,
    /// Standard uncertainty of `area_mm2`; none where the touch was not fitted to the measurements.
    pub area_sd_mm2: Option<f64>,
    /// Standard uncertainty of `total_mm2`; none where the touch was not fitted to the measurements.
    pub total_sd_mm2: Option<f64>,
    /// Force, N. With a calibration it is corrected for the creep of the rubber; 0 for a dent that an earlier touch left. None where
    /// nothing tells it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub force_n: Option<f64>,
    /// Whether the force is that of a typical rubber, without a calibration and without its creep.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub uncalibrated: bool,
    /// Frames in which it was seen, this one included; 0 before it is tracked.
    #[serde(skip)]
    pub frames: u32,
}

impl Touch {
    /// Whether anything presses there. A force of 0 is that of a dent, where nothing presses.
    pub fn is_pressed(&self) -> bool {
        self.force_n != Some(0.0)
    }
}
