//! A touch, and a disc that presses on a simulated sheet.

use ::forward::DiscTouch;
use pyo3::prelude::*;

/// Where the sheet is pressed, and by how much its resistivity rises there.
#[pyclass(frozen, get_all, eq, from_py_object, module = "skin")]
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Touch {
    id: Option<u32>,
    x_mm: f64,
    y_mm: f64,
    rise: f64,
    at_limit: bool,
    area_mm2: f64,
    total_mm2: f64,
    x_sd_mm: Option<f64>,
    y_sd_mm: Option<f64>,
    area_sd_mm2: Option<f64>,
    total_sd_mm2: Option<f64>,
    force_n: Option<f64>,
    uncalibrated: bool,
}

impl From<&inverse::touches::touch::Touch> for Touch {
    fn from(of: &inverse::touches::touch::Touch) -> Self {
        Self {
            id: of.id,
            x_mm: of.x_mm,
            y_mm: of.y_mm,
            rise: of.rise,
            at_limit: of.at_limit,
            area_mm2: of.area_mm2,
            total_mm2: of.total_mm2,
            x_sd_mm: of.x_sd_mm,
            y_sd_mm: of.y_sd_mm,
            area_sd_mm2: of.area_sd_mm2,
            total_sd_mm2: of.total_sd_mm2,
            force_n: of.force_n,
            uncalibrated: of.uncalibrated,
        }
    }
}

#[pymethods]
impl Touch {
    fn __repr__(&self) -> String {
        let id = self.id.map_or(String::new(), |id| format!("id={id}, "));
        let force = self.force_n.map_or(String::new(), |n| format!(", force_n={n:.2}"));
        format!(
            "Touch({id}x_mm={:.1}, y_mm={:.1}, rise={:.3}, area_mm2={:.0}{force})",
            self.x_mm, self.y_mm, self.rise, self.area_mm2
        )
    }
}

/// What presses on a simulated sheet: a touch that was found, or centre x and y and radius in mm and relative rise.
#[derive(FromPyObject)]
pub(crate) enum Pressed {
    /// A touch, as a disc of its area.
    Found(Touch),
    /// A disc.
    Disc(f64, f64, f64, f64),
}

impl From<Pressed> for DiscTouch {
    fn from(pressed: Pressed) -> Self {
        match pressed {
            Pressed::Found(touch) => Self {
                centre_mm: [touch.x_mm, touch.y_mm],
                radius_mm: (touch.area_mm2 / std::f64::consts::PI).sqrt(),
                rise: touch.rise,
            },
            Pressed::Disc(x_mm, y_mm, radius_mm, rise) => Self {
                centre_mm: [x_mm, y_mm],
                radius_mm,
                rise,
            },
        }
    }
}
