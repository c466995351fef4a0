//! A sheet, and what it gives when it is touched.

use crate::arrays::{matrix, points, vector};
use crate::error::{raised, said};
use crate::touch::Pressed;
use ::forward::file::{parse_sheet, sheet_text};
use ::forward::{DiscTouch, Drive, Geometry, Pattern, touched_frame};
use anyhow::Context;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use std::path::PathBuf;

/// A conductive sheet with its electrodes, and what is measured on it. It never changes.
#[pyclass(frozen, module = "skin")]
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Sheet {
    pub(crate) sheet: ::forward::Sheet,
    pub(crate) pattern: Pattern,
}

impl Sheet {
    /// The one that was given, or the paper's disc.
    pub(crate) fn or_paper(given: Option<&Bound<'_, Self>>) -> PyResult<Self> {
        given.map_or_else(Self::paper, |sheet| Ok(sheet.get().clone()))
    }

    fn geometry(&self) -> PyResult<Geometry> {
        Geometry::new(&self.sheet).map_err(raised)
    }
}

#[pymethods]
impl Sheet {
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        let named = || path.display().to_string();
        let text = ::forward::whole::text(&path).with_context(|| format!("{}: cannot be read", named()));
        let read = text.and_then(|text| parse_sheet(&text).with_context(named));
        let (sheet, pattern) = read.map_err(raised)?;
        let read = Self { sheet, pattern };
        read.geometry().map(|_| read)
    }

    #[staticmethod]
    fn parse(text: &str) -> PyResult<Self> {
        let (sheet, pattern) = parse_sheet(text).map_err(raised)?;
        let read = Self { sheet, pattern };
        read.geometry().map(|_| read)
    }

    #[staticmethod]
    pub(crate) fn paper() -> PyResult<Self> {
        let pattern = Pattern::adjacent(16).map_err(raised)?;
        let sheet = ::forward::Sheet::paper();
        Ok(Self { sheet, pattern })
    }

    #[staticmethod]
    #[pyo3(signature = (diameter_mm, electrodes, electrode_mm, *, contact_mm = 1.0, sheet_resistance_ohm = 1000.0))]
    fn disc(
        diameter_mm: f64,
        electrodes: usize,
        electrode_mm: f64,
        contact_mm: f64,
        sheet_resistance_ohm: f64,
    ) -> PyResult<Self> {
        let most = ::forward::file::MOST_ELECTRODES;
        if electrodes > most {
            return Err(said(format!(
                "{electrodes} electrodes are asked for; at most {most} can be modelled"
            )));
        }
        let sheet = ::forward::Sheet::disc(diameter_mm, electrodes, electrode_mm, contact_mm, sheet_resistance_ohm);
        let pattern = Pattern::adjacent(electrodes).map_err(raised)?;
        let made = Self { sheet, pattern };
        made.geometry().map(|_| made)
    }

    #[getter]
    fn electrodes(&self) -> usize {
        self.sheet.electrodes.len()
    }

    #[getter]
    fn electrodes_mm(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        points(py, &self.geometry()?.electrode_centres())
    }

    #[getter]
    fn outline_mm(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        points(py, self.geometry()?.outline().polyline())
    }

    #[getter]
    fn measurements(&self, py: Python<'_>) -> PyResult<Py<PyArray2<i64>>> {
        let of = self.pattern.measurements().iter();
        let numbers = of.flat_map(|m| [m.drive.plus, m.drive.minus, m.sense.minus, m.sense.plus]);
        matrix(py, numbers.map(|electrode| electrode as i64 + 1).collect(), 4)
    }

    #[getter]
    fn text(&self) -> PyResult<String> {
        sheet_text(&self.sheet).map_err(raised)
    }

    fn __eq__(&self, other: &Self) -> bool {
        self == other
    }

    fn __repr__(&self) -> String {
        let (electrodes, values) = (self.electrodes(), self.pattern.len());
        format!("<skin.Sheet of {electrodes} electrodes, {values} values a frame>")
    }
}

/// How a sheet is driven, by its name.
pub(crate) fn drive(name: &str, amplitude_a: f64) -> PyResult<Drive> {
    match name {
        "voltage" => Ok(Drive::PAPER),
        "current" => Ok(Drive::Current { amplitude_a }),
        _ => Err(said(format!("there is no drive '{name}'; choose voltage or current"))),
    }
}

/// The frame of a touched sheet, simulated by finite elements: float64 of shape (values,), V; with drive="current" ohm.
///
/// A touch is a Touch that was found, or (x_mm, y_mm, radius_mm, rise): 0.2 is a rise of the resistivity by 20 %.
#[pyfunction]
#[pyo3(signature = (sheet = None, touches = None, *, drive = "voltage"))]
pub(crate) fn forward<'py>(
    py: Python<'py>,
    sheet: Option<&Bound<'py, Sheet>>,
    touches: Option<Vec<Pressed>>,
    drive: &str,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let sheet = Sheet::or_paper(sheet)?;
    // Transfer impedances, as skin forward gives them.
    let drive = self::drive(drive, 1.0)?;
    let touches: Vec<DiscTouch> = touches.into_iter().flatten().map(DiscTouch::from).collect();
    let values = py.detach(|| touched_frame(&sheet.sheet, &sheet.pattern, drive, &touches));
    vector(py, values.map_err(raised)?)
}
