//! Frames of other hardware, or of a table, to touches.

use crate::arrays::{Frames, points};
use crate::error::{SkinWarning, raised, said};
use crate::frame::Frame;
use crate::sheet::{Sheet, drive};
use ::forward::Pattern;
use ::forward::order::ValueOrder;
use inverse::batch::{Batch, BatchOptions};
use inverse::reference::imager::{Imager, ImagerError};
use inverse::solvers::Method;
use inverse::touches::polarity::Polarity;
use numpy::PyArray2;
use pyo3::prelude::*;
use std::borrow::Cow;
use std::ffi::CString;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// So often Ctrl-C is looked for between frames.
const LOOK: Duration = Duration::from_millis(100);

/// Which of a frame's values are used, in the order of the pattern.
pub(crate) struct Picked {
    /// How many values a frame has.
    pub(crate) of: usize,
    /// Those that are used, in order.
    kept: Vec<usize>,
}

impl Picked {
    /// All of so many.
    pub(crate) fn all(values: usize) -> Self {
        Self {
            of: values,
            kept: (0..values).collect(),
        }
    }

    /// Those of a frame; the frame itself where all are used.
    pub(crate) fn of<'a>(&self, frame: &'a [f64]) -> Cow<'a, [f64]> {
        if self.kept.len() == frame.len() {
            return Cow::Borrowed(frame);
        }
        Cow::Owned(self.kept.iter().map(|k| frame[*k]).collect())
    }
}

/// The pattern of frames of this length in an order; without one they are the sheet's own.
pub(crate) fn pattern(sheet: &Sheet, order: Option<&str>, values: usize) -> PyResult<(Pattern, Picked)> {
    let Some(order) = order else {
        let expected = sheet.pattern.len();
        if values != expected {
            return Err(said(format!(
                "{values} values a frame, but the sheet's measurements are {expected}; give a value for each, or name the program \
                 that wrote them with order"
            )));
        }
        return Ok((sheet.pattern.clone(), Picked::all(values)));
    };
    let order: ValueOrder = order.parse().map_err(raised)?;
    let layout = order.layout(values).ok_or_else(|| {
        let counts = order.counts();
        said(format!("{values} values a frame, but the order {order} has {counts}"))
    })?;
    let (named, electrodes) = (layout.electrodes, sheet.sheet.electrodes.len());
    if named != electrodes {
        return Err(said(format!(
            "{values} values in the order {order} are of {named} electrodes, but the sheet has {electrodes}; describe the sheet \
             that was measured with sheet"
        )));
    }
    let kept = (0..values).filter(|k| layout.values[*k].is_some()).collect();
    let measurements = layout.values.into_iter().flatten().collect();
    let pattern = Pattern::from_list(electrodes, measurements).map_err(raised)?;
    Ok((pattern, Picked { of: values, kept }))
}

struct State {
    batch: Batch,
    /// Frames so far.
    place: usize,
}

/// What finds touches in frames, one after another: reconstruct with one baseline, float64 of shape (frames, values) or (values,).
#[pyclass(frozen, module = "skin")]
pub(crate) struct Reconstructor {
    state: Mutex<State>,
    picked: Picked,
    frame_s: Option<f64>,
    electrodes_mm: Vec<[f64; 2]>,
}

impl Reconstructor {
    /// The frame of these values, in the order that was said.
    fn solve(&self, values: Vec<f64>) -> Result<Frame, ImagerError> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let begin = Instant::now();
        let picked = self.picked.of(&values);
        let place = state.place;
        let mut result = state.batch.frame(place, &picked)?;
        let compute_us = 1e6 * begin.elapsed().as_secs_f64();
        state.place += 1;
        let time_s = self.frame_s.map(|s| s * place as f64);
        // Its number has 32 bits, as a board's.
        let of = (place as u32, time_s, values);
        let rises = std::mem::take(&mut result.x);
        Ok(Frame::new(of, (&result, rises), state.batch.imager(), Some(compute_us)))
    }

    /// Frames that are as long as the baseline's.
    fn taken(&self, values: &Bound<'_, PyAny>) -> PyResult<Frames> {
        let frames = Frames::of("values", values)?;
        if frames.length != self.picked.of {
            return Err(said(format!(
                "{} values a frame, but the baseline has {}; give frames as long as it",
                frames.length, self.picked.of
            )));
        }
        Ok(frames)
    }

    fn all(&self, py: Python<'_>, values: &Bound<'_, PyAny>) -> PyResult<Vec<Frame>> {
        let frames = self.taken(values)?;
        let mut found = Vec::new();
        let mut rows = frames.rows();
        loop {
            let solved = py.detach(|| {
                let until = Instant::now() + LOOK;
                for frame in rows.by_ref() {
                    found.push(self.solve(frame.to_vec())?);
                    if Instant::now() >= until {
                        return Ok(false);
                    }
                }
                Ok(true)
            });
            let all = solved.map_err(|error: ImagerError| raised(error))?;
            py.check_signals()?;
            if all {
                return Ok(found);
            }
        }
    }
}

#[pymethods]
impl Reconstructor {
    #[new]
    #[pyo3(signature = (baseline, *, sheet = None, order = None, method = "nnls", rise = None, drive = "voltage", frame_s = None,
        trust_electrodes = false))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        baseline: &Bound<'_, PyAny>,
        sheet: Option<&Bound<'_, Sheet>>,
        order: Option<&str>,
        method: &str,
        rise: Option<&str>,
        drive: &str,
        frame_s: Option<f64>,
        trust_electrodes: bool,
    ) -> PyResult<Self> {
        if frame_s.is_some_and(|s| !(s.is_finite() && s > 0.0)) {
            return Err(said("frame_s: give a time in seconds above 0"));
        }
        let sheet = Sheet::or_paper(sheet)?;
        let method: Method = method.parse().map_err(raised)?;
        let polarity: Option<Polarity> = rise.map(str::parse).transpose().map_err(raised)?;
        let drive = self::drive(drive, 1e-3)?;
        let baseline = Frames::of("baseline", baseline)?;
        let (pattern, picked) = pattern(&sheet, order, baseline.length)?;
        let unpressed: Vec<Cow<'_, [f64]>> = baseline.rows().map(|frame| picked.of(frame)).collect();
        if !unpressed
            .iter()
            .flat_map(|frame| frame.iter())
            .any(|v| v.is_finite() && *v != 0.0)
        {
            return Err(said("baseline: it holds no value; give a frame of the unpressed sheet"));
        }
        let batch = py.detach(|| -> anyhow::Result<Batch> {
            let cell_mm = method.cell_mm_on(&sheet.sheet)?;
            let imager = Imager::for_method(method, &sheet.sheet, drive, pattern, cell_mm)?;
            let usual = BatchOptions::of(method);
            let options = BatchOptions {
                polarity,
                find_electrodes: usual.find_electrodes && !trust_electrodes,
                interval_s: frame_s,
                ..usual
            };
            let unpressed: Vec<&[f64]> = unpressed.iter().map(AsRef::as_ref).collect();
            Ok(Batch::new(Arc::new(imager), &unpressed, options)?)
        });
        let batch = batch.map_err(raised)?;
        let inspection = batch.inspection();
        for line in inspection.warnings().into_iter().chain(inspection.notes()) {
            warn(py, &line)?;
        }
        Ok(Self {
            electrodes_mm: batch.imager().electrodes_mm.clone(),
            state: Mutex::new(State { batch, place: 0 }),
            picked,
            frame_s,
        })
    }

    fn frame(&self, py: Python<'_>, values: &Bound<'_, PyAny>) -> PyResult<Frame> {
        let frame = self.taken(values)?;
        if frame.values.len() > frame.length {
            return Err(said("several frames; ask for them with frames"));
        }
        py.detach(|| self.solve(frame.values)).map_err(raised)
    }

    fn frames(&self, py: Python<'_>, values: &Bound<'_, PyAny>) -> PyResult<Vec<Frame>> {
        self.all(py, values)
    }

    #[getter]
    fn electrodes_mm(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        points(py, &self.electrodes_mm)
    }
}

/// Warns of something, as Python's `warnings` has it.
pub(crate) fn warn(py: Python<'_>, text: &str) -> PyResult<()> {
    // No text of the program has a zero in it.
    let text = CString::new(text.replace('\0', " ")).map_err(raised)?;
    PyErr::warn(py, &py.get_type::<SkinWarning>(), &text, 1)
}

/// Touches of frames: a list of Frame.
///
/// values and baseline have shape (frames, values) or (values,), in one unit, whichever; NaN is a missing value. frame_s is the time
/// from a frame to the next, s. order names the program whose order the values have; None is that of sheet.measurements.
#[pyfunction]
#[pyo3(signature = (values, baseline, *, sheet = None, order = None, method = "nnls", rise = None, drive = "voltage", frame_s = None,
    trust_electrodes = false))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn reconstruct(
    py: Python<'_>,
    values: &Bound<'_, PyAny>,
    baseline: &Bound<'_, PyAny>,
    sheet: Option<&Bound<'_, Sheet>>,
    order: Option<&str>,
    method: &str,
    rise: Option<&str>,
    drive: &str,
    frame_s: Option<f64>,
    trust_electrodes: bool,
) -> PyResult<Vec<Frame>> {
    Reconstructor::new(
        py,
        baseline,
        sheet,
        order,
        method,
        rise,
        drive,
        frame_s,
        trust_electrodes,
    )?
    .all(py, values)
}
