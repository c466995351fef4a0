//! A recording in memory.

use crate::arrays::{matrix, vector};
use crate::error::raised;
use crate::sheet::Sheet;
use crate::touch::Touch;
use host::loaded::{Loaded, LoadedPicture};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::path::PathBuf;

/// A recording: its frames, and what was found then.
#[pyclass(frozen, get_all, module = "skin")]
pub(crate) struct Recording {
    source: String,
    started_unix_s: f64,
    sheet: Py<Sheet>,
    times_s: Py<PyArray1<f64>>,
    sequences: Py<PyArray1<u32>>,
    values: Py<PyArray2<f64>>,
    baseline: Py<PyArray1<i64>>,
    touches: Py<PyTuple>,
}

/// The touches of every frame; none for a frame that was not shown. After a reset numbers come again: pictures are in order.
fn by_frame(sequences: &[u32], pictures: Vec<LoadedPicture>) -> Vec<Option<Vec<Touch>>> {
    let mut found = vec![None; sequences.len()];
    let mut next = 0;
    for picture in pictures {
        let there = sequences[next..].iter().position(|s| *s == picture.sequence);
        if let Some(there) = there {
            found[next + there] = Some(picture.touches.iter().map(Touch::from).collect());
            next += there + 1;
        }
    }
    found
}

#[pymethods]
impl Recording {
    fn __len__(&self, py: Python<'_>) -> PyResult<usize> {
        self.times_s.bind(py).len()
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        Ok(format!(
            "<skin.Recording of {}: {} frames>",
            self.source,
            self.__len__(py)?
        ))
    }
}

/// Reads a recording: FILE, or FILE#NAME for one of several skins. Its values have shape (frames, values), V.
#[pyfunction]
pub(crate) fn load(py: Python<'_>, path: PathBuf) -> PyResult<Recording> {
    let loaded = py.detach(|| Loaded::read(&path)).map_err(raised)?;
    let place = |sequence: &u32| loaded.sequences.iter().position(|s| s == sequence);
    let baseline = loaded.baseline.iter().filter_map(place).map(|k| k as i64).collect();
    let values = loaded.pattern.len();
    let touches: Vec<Option<Bound<'_, PyTuple>>> = by_frame(&loaded.sequences, loaded.pictures)
        .into_iter()
        .map(|touches| touches.map(|touches| PyTuple::new(py, touches)).transpose())
        .collect::<PyResult<_>>()?;
    Ok(Recording {
        source: loaded.source,
        started_unix_s: loaded.started_unix_s,
        sheet: Py::new(
            py,
            Sheet {
                sheet: loaded.sheet,
                pattern: loaded.pattern,
            },
        )?,
        times_s: vector(py, loaded.at_s)?.unbind(),
        sequences: vector(py, loaded.sequences)?.unbind(),
        values: matrix(py, loaded.values_v, values)?,
        baseline: vector(py, baseline)?.unbind(),
        touches: PyTuple::new(py, touches)?.unbind(),
    })
}
