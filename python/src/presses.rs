//! Calibrations of real skins, from presses at known places.

use crate::arrays::{Frames, matrix};
use crate::error::{raised, said};
use crate::reconstruct::{Picked, pattern, warn};
use crate::sheet::Sheet;
use ::forward::Measurement;
use host::taught::{Frames as Setting, Taught};
use inverse::learned::{Findings, Located, Order, Presence};
use numpy::PyArray2;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::path::PathBuf;

/// A press that was located by what others taught.
#[pyclass(frozen, get_all, eq, module = "skin")]
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Press {
    x_mm: f64,
    y_mm: f64,
    x_sd_mm: f64,
    y_sd_mm: f64,
    strength: f64,
    strength_sd: f64,
}

impl From<&Located> for Press {
    fn from(of: &Located) -> Self {
        Self {
            x_mm: of.place_mm[0],
            y_mm: of.place_mm[1],
            x_sd_mm: of.covariance_mm2[0][0].sqrt(),
            y_sd_mm: of.covariance_mm2[1][1].sqrt(),
            strength: of.strength,
            strength_sd: of.strength_sd,
        }
    }
}

#[pymethods]
impl Press {
    fn __repr__(&self) -> String {
        format!(
            "Press(x_mm={:.1}, y_mm={:.1}, strength={:.2})",
            self.x_mm, self.y_mm, self.strength
        )
    }
}

/// The presses that were located in a frame.
#[pyclass(frozen, get_all, module = "skin")]
pub(crate) struct Presses {
    presses: Py<PyTuple>,
    explained: f64,
    misfit: f64,
    doubt: Option<String>,
}

impl Presses {
    fn new(py: Python<'_>, of: &Presence) -> PyResult<Self> {
        let presses: Vec<Press> = of.presses.iter().map(Press::from).collect();
        Ok(Self {
            presses: PyTuple::new(py, presses)?.unbind(),
            explained: of.explained,
            misfit: of.misfit,
            doubt: of.doubt().map(|doubt| doubt.to_string()),
        })
    }
}

#[pymethods]
impl Presses {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let presses = self.presses.bind(py).as_any().repr()?;
        let doubt = self.doubt.as_ref().map_or(String::new(), |doubt| format!(", {doubt}"));
        Ok(format!("<skin.Presses {presses}{doubt}>"))
    }
}

/// What presses at known places taught of a real skin: calibrate_presses makes it, load reads the file of `skin calibrate presses`.
#[pyclass(frozen, module = "skin")]
pub(crate) struct PressCalibration {
    taught: Taught,
    /// How frames are laid unless something else is said.
    layout: Layout,
    /// What was found while learning; none of a file.
    found: Option<Findings>,
}

/// How the values of frames are laid.
struct Layout {
    picked: Picked,
    /// Where the calibration's measurements are among those picked.
    order: Order,
}

impl PressCalibration {
    /// The layout of frames of another sheet or order, with what it lacks in words.
    fn other(&self, sheet: &Sheet, order: Option<&str>, values: usize) -> PyResult<(Layout, Option<String>)> {
        let (pattern, picked) = pattern(sheet, order, values)?;
        let (order, missing) = self.taught.order(pattern.measurements()).map_err(raised)?;
        Ok((Layout { picked, order }, missing))
    }
}

/// Pressed less unpressed, frame by frame, of the values that are used.
fn changes(
    picked: &Picked,
    pressed: &Bound<'_, PyAny>,
    unpressed: Option<&Bound<'_, PyAny>>,
) -> PyResult<Vec<Vec<f64>>> {
    let pressed = Frames::of("values", pressed)?;
    let unpressed = unpressed.map(|given| Frames::of("unpressed", given)).transpose()?;
    let count = pressed.rows().count();
    for (what, of) in [("values", Some(&pressed)), ("unpressed", unpressed.as_ref())] {
        if let Some(of) = of.filter(|of| of.length != picked.of) {
            return Err(said(format!(
                "{what}: {} values a frame, but there are {} measurements; give a value for each",
                of.length, picked.of
            )));
        }
    }
    let before: Option<Vec<&[f64]>> = unpressed.as_ref().map(|of| of.rows().collect());
    if let Some(before) = before
        .as_ref()
        .filter(|before| before.len() != 1 && before.len() != count)
    {
        return Err(said(format!(
            "unpressed: {} frames for {count} pressed ones; give one for all, or the one before each",
            before.len()
        )));
    }
    let change = |(k, frame): (usize, &[f64])| {
        let picked_frame = picked.of(frame);
        match &before {
            None => picked_frame.into_owned(),
            Some(before) => {
                let unpressed = picked.of(before[if before.len() == 1 { 0 } else { k }]);
                picked_frame.iter().zip(unpressed.iter()).map(|(v, u)| v - u).collect()
            }
        }
    };
    Ok(pressed.rows().enumerate().map(change).collect())
}

#[pymethods]
impl PressCalibration {
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let taught = py.detach(|| Taught::read(&path)).map_err(raised)?;
        let own = taught.measurements().to_vec();
        let (order, _) = taught.order(&own).map_err(raised)?;
        Ok(Self {
            taught,
            layout: Layout {
                picked: Picked::all(own.len()),
                order,
            },
            found: None,
        })
    }

    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| self.taught.write(&path)).map_err(raised)
    }

    #[pyo3(signature = (values, unpressed = None, *, sheet = None, order = None))]
    fn locate(
        &self,
        py: Python<'_>,
        values: &Bound<'_, PyAny>,
        unpressed: Option<&Bound<'_, PyAny>>,
        sheet: Option<&Bound<'_, Sheet>>,
        order: Option<&str>,
    ) -> PyResult<Vec<Presses>> {
        let mut other = None;
        if sheet.is_some() || order.is_some() {
            let length = Frames::of("values", values)?.length;
            let (layout, missing) = self.other(&Sheet::or_paper(sheet)?, order, length)?;
            if let Some(line) = missing {
                warn(py, &line)?;
            }
            other = Some(layout);
        }
        let layout = other.as_ref().unwrap_or(&self.layout);
        let mut before_mm = None;
        let mut out = Vec::new();
        for change in changes(&layout.picked, values, unpressed)? {
            let presence = py.detach(|| self.taught.locate(&layout.order.ordered(&change), before_mm));
            if let Some(press) = presence.presses.first() {
                before_mm = Some(press.place_mm);
            }
            out.push(Presses::new(py, &presence)?);
            py.check_signals()?;
        }
        Ok(out)
    }

    #[getter]
    fn presses(&self) -> usize {
        self.taught.presses()
    }

    #[getter]
    fn error_mm(&self) -> f64 {
        self.taught.error_mm()
    }

    #[getter]
    fn error_95th_percentile_mm(&self) -> Option<f64> {
        self.found.as_ref().map(|found| found.error_mm[1])
    }

    #[getter]
    fn explained(&self) -> Option<f64> {
        self.found.as_ref().map(|found| found.explained)
    }

    #[getter]
    fn gross(&self) -> Vec<usize> {
        self.found.as_ref().map_or(Vec::new(), |found| found.gross.clone())
    }

    #[getter]
    fn missed(&self) -> Vec<usize> {
        self.found.as_ref().map_or(Vec::new(), |found| found.missed.clone())
    }

    #[getter]
    fn measurements(&self, py: Python<'_>) -> PyResult<Py<PyArray2<i64>>> {
        let numbers = |m: &Measurement| [m.drive.plus, m.drive.minus, m.sense.minus, m.sense.plus];
        let of = self.taught.measurements().iter().flat_map(numbers);
        matrix(py, of.map(|electrode| electrode as i64 + 1).collect(), 4)
    }

    fn __repr__(&self) -> String {
        format!(
            "<skin.PressCalibration of {} presses, {:.1} mm median error>",
            self.presses(),
            self.error_mm()
        )
    }
}

/// Learns what presses at known places do to the values of a real skin: places_mm of shape (presses, 2), mm, in order of time.
///
/// values and unpressed have shape (presses, values), in one unit, whichever; unpressed is the frame before each press, or one for all.
/// Without unpressed the values are changes, pressed less unpressed.
#[pyfunction]
#[pyo3(signature = (values, places_mm, unpressed = None, *, sheet = None, order = None))]
pub(crate) fn calibrate_presses(
    py: Python<'_>,
    values: &Bound<'_, PyAny>,
    places_mm: &Bound<'_, PyAny>,
    unpressed: Option<&Bound<'_, PyAny>>,
    sheet: Option<&Bound<'_, Sheet>>,
    order: Option<&str>,
) -> PyResult<PressCalibration> {
    let sheet = Sheet::or_paper(sheet)?;
    let length = Frames::of("values", values)?.length;
    let (pattern, picked) = pattern(&sheet, order, length)?;
    let places = Frames::of("places_mm", places_mm)?;
    if places.length != 2 {
        return Err(said(format!(
            "places_mm: {} numbers a press; give x and y of each, shape (presses, 2)",
            places.length
        )));
    }
    let changes = changes(&picked, values, unpressed)?;
    let places: Vec<[f64; 2]> = places.rows().map(|row| [row[0], row[1]]).collect();
    if places.len() != changes.len() {
        return Err(said(format!(
            "places_mm: {} places for {} pressed frames; give one for each",
            places.len(),
            changes.len()
        )));
    }
    let presses: Vec<inverse::learned::Press> = places
        .into_iter()
        .zip(changes)
        .map(|(place_mm, change)| inverse::learned::Press { place_mm, change })
        .collect();
    let setting = Setting {
        measurements: pattern.measurements(),
        sheet: &sheet.sheet,
    };
    let difference = unpressed.is_none();
    let (taught, found) = py
        .detach(|| Taught::learn(setting, &presses, difference))
        .map_err(raised)?;
    let (order, _) = taught.order(pattern.measurements()).map_err(raised)?;
    Ok(PressCalibration {
        taught,
        layout: Layout { picked, order },
        found: Some(found),
    })
}
