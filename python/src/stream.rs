//! Frames of a board, of the simulated skin or of a recording, one after another.

use crate::error::{raised, said};
use crate::frame::Frame;
use crate::reconstruct::warn;
use crate::sheet::Sheet;
use host::stream::{Next, Origin, Stream, StreamOptions};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, TryLockError};
use std::time::{Duration, Instant};

/// So long a frame is waited for before Python may say that it was interrupted.
const WAIT: Duration = Duration::from_millis(100);
/// A thread that finds another at work looks again so much later.
const LOOK: Duration = Duration::from_millis(1);

/// Frames, one after another.
#[pyclass(frozen, module = "skin")]
pub(crate) struct Skin {
    /// None once it is closed.
    stream: Mutex<Option<Stream>>,
    closed: AtomicBool,
    /// The process that opened it: threads do not live on in another.
    process: u32,
    name: String,
    /// Nothing is waited for then.
    is_recording: bool,
}

/// What came of asking.
enum Taken {
    Frame(Box<Frame>),
    Waiting,
    Ended,
}

impl Skin {
    /// The stream, as soon as no other thread is at work with it; none where that takes longer than so.
    fn lock(&self, wait: Duration) -> Option<MutexGuard<'_, Option<Stream>>> {
        let end = Instant::now() + wait;
        loop {
            match self.stream.try_lock() {
                Ok(stream) => return Some(stream),
                Err(TryLockError::Poisoned(stream)) => return Some(stream.into_inner()),
                Err(TryLockError::WouldBlock) if Instant::now() >= end => return None,
                Err(TryLockError::WouldBlock) => std::thread::sleep(LOOK),
            }
        }
    }

    /// The next frame, with what there is to say before it.
    fn take(&self) -> anyhow::Result<(Taken, Vec<String>)> {
        let Some(mut stream) = self.lock(WAIT) else {
            return Ok((Taken::Waiting, Vec::new()));
        };
        let Some(stream) = stream.as_mut().filter(|_| !self.closed.load(Ordering::Acquire)) else {
            return Ok((Taken::Ended, Vec::new()));
        };
        let mut lines = Vec::new();
        let imager = std::sync::Arc::clone(stream.imager());
        let begin = Instant::now();
        let taken = match stream.next(WAIT)? {
            Next::Frame(frame, result) => {
                let compute_us = self.is_recording.then(|| 1e6 * begin.elapsed().as_secs_f64());
                let of = (frame.sequence, Some(frame.time_s), frame.values_v);
                Taken::Frame(Box::new(Frame::new(
                    of,
                    (result, result.x.clone()),
                    &imager,
                    compute_us,
                )))
            }
            Next::Waiting => Taken::Waiting,
            Next::Ended => Taken::Ended,
        };
        while let Some(line) = stream.said() {
            lines.push(line);
        }
        Ok((taken, lines))
    }

    fn check_process(&self) -> PyResult<()> {
        if self.process == std::process::id() {
            return Ok(());
        }
        Err(said(
            "this skin was opened before the process was forked, and its threads did not come along; open it in this process, or \
             start processes by spawn",
        ))
    }

    /// With the stream, while no other thread is at work with it; none once it is closed.
    fn with<T: Send>(&self, py: Python<'_>, work: impl Fn(&mut Stream) -> T + Sync) -> PyResult<Option<T>> {
        self.check_process()?;
        loop {
            let done = py.detach(|| self.lock(WAIT).map(|mut stream| stream.as_mut().map(&work)));
            if let Some(done) = done {
                return Ok(done);
            }
            py.check_signals()?;
        }
    }
}

#[pymethods]
impl Skin {
    #[getter]
    fn name(&self) -> &str {
        &self.name
    }

    #[getter]
    fn closed(&self) -> bool {
        self.closed.load(Ordering::Acquire)
    }

    fn tare(&self, py: Python<'_>) -> PyResult<()> {
        match self.with(py, Stream::tare)? {
            Some(done) => done.map_err(raised),
            None => Err(said("this skin is closed; open it again")),
        }
    }

    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.closed.store(true, Ordering::Release);
        if self.process != std::process::id() {
            return Ok(());
        }
        loop {
            // What ends the link's thread takes a moment.
            let done = py.detach(|| self.lock(WAIT).map(|mut stream| drop(stream.take())));
            if done.is_some() {
                return Ok(());
            }
            py.check_signals()?;
        }
    }

    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Frame>> {
        loop {
            self.check_process()?;
            // Each time: a loop in C, such as list(skin), does not look itself.
            py.check_signals()?;
            let (taken, lines) = py.detach(|| self.take()).map_err(raised)?;
            for line in lines {
                warn(py, &line)?;
            }
            match taken {
                Taken::Frame(frame) => return Ok(Some(*frame)),
                Taken::Ended => return Ok(None),
                Taken::Waiting => {}
            }
        }
    }

    fn __enter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    #[pyo3(signature = (*_why))]
    fn __exit__(&self, py: Python<'_>, _why: &Bound<'_, pyo3::types::PyTuple>) -> PyResult<()> {
        self.close(py)
    }

    fn __repr__(&self) -> String {
        let closed = if self.closed() { ", closed" } else { "" };
        format!("<skin.Skin: {}{closed}>", self.name)
    }
}

impl Drop for Skin {
    fn drop(&mut self) {
        if self.process != std::process::id() {
            // Its thread is not here to be waited for.
            let stream = self.stream.get_mut().unwrap_or_else(std::sync::PoisonError::into_inner);
            std::mem::forget(stream.take());
        }
    }
}

/// Whether a source is a recording: by its name, or since there is such a file.
fn is_recording(source: &str) -> bool {
    let file = source.rsplit_once('#').map_or(source, |(file, _)| file);
    [source, file].iter().any(|name| {
        let path = std::path::Path::new(name);
        path.extension().is_some_and(|e| e.eq_ignore_ascii_case("mcap")) || path.is_file()
    })
}

/// Opens a source of frames: a serial port, tcp://HOST:PORT, a recording (.mcap), or nothing for the only board on USB.
///
/// With simulate=True it is the simulated skin. Nothing may touch the sheet of a board in the first second: its baseline is taken.
/// A Skin gives Frame after Frame.
#[pyfunction]
#[pyo3(signature = (source = None, *, simulate = false, scene = None, serial = None, sheet = None, plan = "auto",
    baseline_frames = None, rise = None, trust_electrodes = false, every_frame = false, wires = None, calibration = None,
    state_dir = None))]
#[allow(clippy::too_many_arguments)]
pub(crate) fn open(
    py: Python<'_>,
    source: Option<PathBuf>,
    simulate: bool,
    scene: Option<PathBuf>,
    serial: Option<String>,
    sheet: Option<&Bound<'_, Sheet>>,
    plan: &str,
    baseline_frames: Option<usize>,
    rise: Option<&str>,
    trust_electrodes: bool,
    every_frame: bool,
    wires: Option<Vec<usize>>,
    calibration: Option<PathBuf>,
    state_dir: Option<PathBuf>,
) -> PyResult<Skin> {
    let source = source.map(|path| path.to_string_lossy().into_owned());
    let simulated = simulate || scene.is_some();
    if usize::from(source.is_some()) + usize::from(simulated) + usize::from(serial.is_some()) > 1 {
        return Err(said(
            "source, serial and simulate (or scene) exclude one another; give one of them",
        ));
    }
    if baseline_frames.is_some_and(|frames| frames < 2) {
        return Err(said("baseline_frames: give 2 or more"));
    }
    let origin = match source {
        _ if simulated => Origin::Simulated { scene },
        Some(source) if is_recording(&source) => Origin::Recording(source.into()),
        port => Origin::Board { port, serial },
    };
    let given = [
        (sheet.is_some(), "sheet"),
        (plan != "auto", "plan"),
        (baseline_frames.is_some(), "baseline_frames"),
        (rise.is_some(), "rise"),
        (trust_electrodes, "trust_electrodes"),
        (every_frame, "every_frame"),
        (wires.is_some(), "wires"),
        (calibration.is_some(), "calibration"),
        (state_dir.is_some(), "state_dir"),
    ];
    if let (Origin::Recording(_), Some((_, name))) = (&origin, given.iter().find(|(given, _)| *given)) {
        return Err(said(format!(
            "a recording says itself how it was made; leave {name} out"
        )));
    }
    let options = StreamOptions {
        sheet: sheet.map(|sheet| sheet.get().sheet.clone()),
        plan: plan.parse().map_err(raised)?,
        baseline_frames,
        rise: rise.map(str::parse).transpose().map_err(raised)?,
        trust_electrodes,
        every_frame,
        wires: wires.unwrap_or_default(),
        calibration,
        state_dir,
    };
    let stream = py.detach(|| Stream::open(&origin, &options)).map_err(raised)?;
    Ok(Skin {
        name: stream.name().to_owned(),
        stream: Mutex::new(Some(stream)),
        closed: AtomicBool::new(false),
        process: std::process::id(),
        is_recording: matches!(origin, Origin::Recording(_)),
    })
}
