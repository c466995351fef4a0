//! A frame with what was found in it.

use crate::arrays::{matrix, need_numpy, vector};
use crate::touch::Touch;
use inverse::pipeline::FrameResult;
use inverse::reference::imager::Imager;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::sync::MutexExt;
use pyo3::types::PyTuple;
use std::sync::{Arc, Mutex, PoisonError};

/// One measured frame (values: V, shape (values,)) and what was found in it: touches, and image, the relative rise of resistivity of
/// shape (rows, columns), row 0 lowest, NaN off the sheet.
///
/// It is made without the interpreter's lock. What is an object of Python's is made when it is first asked for: of most frames
/// little is.
#[pyclass(frozen, module = "skin")]
pub(crate) struct Frame {
    #[pyo3(get)]
    sequence: u32,
    #[pyo3(get)]
    time_s: Option<f64>,
    values: Made<Vec<f64>, PyArray1<f64>>,
    touches: Made<Vec<Touch>, PyTuple>,
    /// Rises of the model's cells, from which the picture is made.
    image: Made<Vec<f64>, PyArray2<f64>>,
    imager: Arc<Imager>,
    #[pyo3(get)]
    doubt: Option<String>,
    #[pyo3(get)]
    notice: Option<String>,
    #[pyo3(get)]
    changed: bool,
    #[pyo3(get)]
    used: usize,
    #[pyo3(get)]
    residual: f64,
    #[pyo3(get)]
    explained: Option<f64>,
    #[pyo3(get)]
    compute_us: Option<f64>,
}

impl Frame {
    /// Of a frame's number, time and values, its result with the rises of the cells apart, the model that it is of, and the time it
    /// took, us.
    pub(crate) fn new(
        (sequence, time_s, values): (u32, Option<f64>, Vec<f64>),
        (result, rises): (&FrameResult, Vec<f64>),
        imager: &Arc<Imager>,
        compute_us: Option<f64>,
    ) -> Self {
        let pressed = result.touches.iter().filter(|t| t.is_pressed());
        Self {
            sequence,
            time_s,
            values: Made::of(values),
            touches: Made::of(pressed.map(Touch::from).collect()),
            doubt: result.doubt.map(|doubt| doubt.to_string()),
            notice: result.notice().map(|notice| notice.to_string()),
            image: Made::of(rises),
            imager: Arc::clone(imager),
            changed: result.changed,
            used: result.used,
            residual: result.residual,
            explained: result.explained,
            compute_us,
        }
    }
}

#[pymethods]
impl Frame {
    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        self.values.get(py, |values| {
            need_numpy(py)?;
            vector(py, std::mem::take(values))
        })
    }

    #[getter]
    fn touches<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        self.touches
            .get(py, |touches| PyTuple::new(py, touches.iter().copied()))
    }

    #[getter]
    fn image<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.image.get(py, |rises| {
            let grid = &self.imager.grid;
            let (columns, rows) = grid.shape();
            let mut image = vec![f64::NAN; rows * columns];
            for ([column, row], rise) in grid.cells().iter().zip(rises.iter()) {
                image[*row as usize * columns + *column as usize] = *rise;
            }
            Ok(matrix(py, image, columns)?.into_bound(py))
        })
    }

    #[getter]
    fn extent_mm(&self) -> (f64, f64, f64, f64) {
        let grid = &self.imager.grid;
        let ((columns, rows), [left, bottom], cell_mm) = (grid.shape(), grid.low_mm(), grid.cell_mm());
        let (right, top) = (left + columns as f64 * cell_mm, bottom + rows as f64 * cell_mm);
        (left, right, bottom, top)
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let at = self.time_s.map_or(String::new(), |s| format!(" at {s:.3} s"));
        let doubt = self.doubt.as_ref().map_or(String::new(), |doubt| format!(", {doubt}"));
        let touches = self.touches(py)?.repr()?;
        Ok(format!("<skin.Frame {}{at}: {touches}{doubt}>", self.sequence))
    }
}

/// An object of Python's that is made of what Rust found when it is first asked for, and kept.
struct Made<Found, Object>(Mutex<State<Found, Object>>);

enum State<Found, Object> {
    Found(Found),
    Object(Py<Object>),
}

impl<Found, Object> Made<Found, Object> {
    fn of(found: Found) -> Self {
        Self(Mutex::new(State::Found(found)))
    }

    /// The object. `make` takes what it wants of what was found as the last thing it does: where it fails it is asked again.
    fn get<'py>(
        &self,
        py: Python<'py>,
        make: impl FnOnce(&mut Found) -> PyResult<Bound<'py, Object>>,
    ) -> PyResult<Bound<'py, Object>> {
        // Whoever waits for another thread lets go of the interpreter's lock, and nobody else does.
        let mut state = self.0.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner);
        match &mut *state {
            State::Object(object) => Ok(object.bind(py).clone()),
            State::Found(found) => {
                let object = make(found)?;
                *state = State::Object(object.clone().unbind());
                Ok(object)
            }
        }
    }
}
