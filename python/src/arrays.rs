//! Numbers from Python, and to it.

use crate::error::{raised, said};
use numpy::ndarray::Array2;
use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

/// Frames of one length.
pub(crate) struct Frames {
    /// Frame by frame; not a number where a value is infinite.
    pub(crate) values: Vec<f64>,
    /// Values of a frame.
    pub(crate) length: usize,
}

impl Frames {
    /// One frame (one axis), or a frame a row (two axes), of whatever NumPy makes an array of. Of complex values the magnitudes are
    /// taken, as the program does.
    ///
    /// # Errors
    /// It has other axes, no numbers or no values.
    pub(crate) fn of(what: &str, given: &Bound<'_, PyAny>) -> PyResult<Self> {
        // As most are, and at once.
        if let Ok(array) = given.cast::<PyArrayDyn<f64>>() {
            return Self::read(what, array);
        }
        let py = given.py();
        let numpy = py.import(intern!(py, "numpy"))?;
        let mut array = numpy.call_method1(intern!(py, "asarray"), (given,))?;
        if array
            .getattr(intern!(py, "dtype"))?
            .getattr(intern!(py, "kind"))?
            .eq("c")?
        {
            array = numpy.call_method1(intern!(py, "abs"), (array,))?;
        }
        let array = numpy.call_method1(intern!(py, "asarray"), (array, "float64"))?;
        Self::read(what, array.cast::<PyArrayDyn<f64>>()?)
    }

    fn read(what: &str, array: &Bound<'_, PyArrayDyn<f64>>) -> PyResult<Self> {
        let length = match array.shape() {
            [length] => *length,
            [_, length] => *length,
            shape => {
                return Err(said(format!(
                    "{what}: an array of {} axes; give one frame, or a frame a row",
                    shape.len()
                )));
            }
        };
        // Row by row, whatever the steps in memory are.
        let mut values: Vec<f64> = match array.is_c_contiguous() {
            true => array.to_vec().map_err(raised)?,
            false => array.to_owned_array().iter().copied().collect(),
        };
        if values.is_empty() {
            return Err(said(format!("{what}: no values in it")));
        }
        for v in values.iter_mut().filter(|v| v.is_infinite()) {
            *v = f64::NAN;
        }
        Ok(Self { values, length })
    }

    /// The frames.
    pub(crate) fn rows(&self) -> impl Iterator<Item = &[f64]> {
        self.values.chunks_exact(self.length)
    }
}

/// NumPy can be had. What makes an array without it panics, and takes the numbers with it.
pub(crate) fn need_numpy(py: Python<'_>) -> PyResult<()> {
    static THERE: PyOnceLock<()> = PyOnceLock::new();
    THERE
        .get_or_try_init(py, || py.import(intern!(py, "numpy")).map(drop))
        .copied()
}

/// Numbers as an array, without a copy.
pub(crate) fn vector<T: numpy::Element>(py: Python<'_>, values: Vec<T>) -> PyResult<Bound<'_, PyArray1<T>>> {
    need_numpy(py)?;
    Ok(PyArray1::from_vec(py, values))
}

/// Numbers row by row as an array of two axes, without a copy.
pub(crate) fn matrix<T: numpy::Element>(py: Python<'_>, values: Vec<T>, columns: usize) -> PyResult<Py<PyArray2<T>>> {
    need_numpy(py)?;
    let rows = values.len() / columns.max(1);
    let array = Array2::from_shape_vec([rows, columns], values).map_err(raised)?;
    Ok(PyArray2::from_owned_array(py, array).unbind())
}

/// Points, mm, a row each.
pub(crate) fn points(py: Python<'_>, points: &[[f64; 2]]) -> PyResult<Py<PyArray2<f64>>> {
    matrix(py, points.as_flattened().to_vec(), 2)
}
