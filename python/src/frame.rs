//! A frame with what was found in it.

use crate::arrays::matrix;
use crate::touch::Touch;
use inverse::pipeline::FrameResult;
use inverse::reference::imager::Imager;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

/// What makes a frame, gathered without the interpreter's lock.
pub(crate) struct Found {
    sequence: u32,
    time_s: Option<f64>,
    values: Vec<f64>,
    touches: Vec<Touch>,
    image: Vec<f64>,
    columns: usize,
    extent_mm: (f64, f64, f64, f64),
    doubt: Option<String>,
    notice: Option<String>,
    changed: bool,
    used: usize,
    residual: f64,
    explained: Option<f64>,
    compute_us: Option<f64>,
}

impl Found {
    /// Of a frame's number, time and values, its result and the model that it is of.
    pub(crate) fn new(
        (sequence, time_s, values): (u32, Option<f64>, Vec<f64>),
        result: &FrameResult,
        imager: &Imager,
    ) -> Self {
        let grid = &imager.grid;
        let (columns, rows) = grid.shape();
        let mut image = vec![f64::NAN; rows * columns];
        for ([column, row], rise) in grid.cells().iter().zip(&result.x) {
            image[*row as usize * columns + *column as usize] = *rise;
        }
        let ([left, bottom], cell_mm) = (grid.low_mm(), grid.cell_mm());
        let (right, top) = (left + columns as f64 * cell_mm, bottom + rows as f64 * cell_mm);
        Self {
            sequence,
            time_s,
            values,
            touches: result
                .touches
                .iter()
                .filter(|t| t.is_pressed())
                .map(Touch::from)
                .collect(),
            image,
            columns,
            extent_mm: (left, right, bottom, top),
            doubt: result.doubt.map(|doubt| doubt.to_string()),
            notice: result.notice().map(|notice| notice.to_string()),
            changed: result.changed,
            used: result.used,
            residual: result.residual,
            explained: result.explained,
            compute_us: None,
        }
    }

    /// The same, with how long it took, us.
    pub(crate) fn took(mut self, us: f64) -> Self {
        self.compute_us = Some(us);
        self
    }
}

/// One measured frame (values: V, shape (values,)) and what was found in it: touches, and image, the relative rise of resistivity of
/// shape (rows, columns), row 0 lowest, NaN off the sheet.
#[pyclass(frozen, get_all, module = "skin")]
pub(crate) struct Frame {
    sequence: u32,
    time_s: Option<f64>,
    values: Py<PyArray1<f64>>,
    touches: Py<PyTuple>,
    image: Py<PyArray2<f64>>,
    extent_mm: (f64, f64, f64, f64),
    doubt: Option<String>,
    notice: Option<String>,
    changed: bool,
    used: usize,
    residual: f64,
    explained: Option<f64>,
    compute_us: Option<f64>,
}

impl Frame {
    pub(crate) fn new(py: Python<'_>, found: Found) -> PyResult<Self> {
        Ok(Self {
            sequence: found.sequence,
            time_s: found.time_s,
            values: PyArray1::from_vec(py, found.values).unbind(),
            touches: PyTuple::new(py, found.touches)?.unbind(),
            image: matrix(py, found.image, found.columns)?,
            extent_mm: found.extent_mm,
            doubt: found.doubt,
            notice: found.notice,
            changed: found.changed,
            used: found.used,
            residual: found.residual,
            explained: found.explained,
            compute_us: found.compute_us,
        })
    }
}

#[pymethods]
impl Frame {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let at = self.time_s.map_or(String::new(), |s| format!(" at {s:.3} s"));
        let doubt = self.doubt.as_ref().map_or(String::new(), |doubt| format!(", {doubt}"));
        let touches = self.touches.bind(py).as_any().repr()?;
        Ok(format!("<skin.Frame {}{at}: {touches}{doubt}>", self.sequence))
    }
}
