//! The paper's figures of a recorded run: its frames by the paper's method and by ours, its forces, its noise and its times.
//!
//! A recording does not say where was pressed. In the place of true positions are the touches that were found while it was
//! recorded, and the force gauge is there only where somebody gives its readings.

use crate::paper::recorded_page;
use crate::paper::touches::{Outcome, outcome};
use crate::paper::tracking::ForceError;
use crate::paper::{PaperError, write_report};
use crate::score::quantile;
use forward::{Drive, Pattern, Sheet};
use inverse::batch::{Batch, BatchOptions};
use inverse::reference::imager::Imager;
use inverse::solvers::Method;
use inverse::touches::polarity::Polarity;
use inverse::touches::touch::Touch;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A recorded run.
#[derive(Debug)]
pub struct Run {
    /// Where the frames came from, in words.
    pub source: String,
    /// The sheet.
    pub sheet: Sheet,
    /// What the values of a frame are.
    pub pattern: Pattern,
    /// Which way touches change the resistivity; none where the frames say it.
    pub polarity: Option<Polarity>,
    /// The frames in their order.
    pub frames: Vec<Frame>,
    /// Places in `frames` of those that made the baseline.
    pub unpressed: Vec<usize>,
    /// Force of each mm² of integrated rise without the creep taken out, N/mm²; none where no force is known.
    pub n_per_mm2: Option<f64>,
    /// Readings of a force gauge: time (s, as that of the frames) and force (N), in order of time.
    pub gauge: Option<Vec<[f64; 2]>>,
    /// Bytes of a frame on the wire; none where that is not known.
    pub bytes_per_frame: Option<f64>,
}

/// A frame of the run.
#[derive(Clone, Debug)]
pub struct Frame {
    /// The board's count.
    pub sequence: u32,
    /// Time since the first frame, s.
    pub at_s: f64,
    /// Values, V; not a number where one is missing.
    pub values_v: Vec<f64>,
    /// The touches that were found then; none where no picture was made of it.
    pub touches: Option<Vec<Touch>>,
}

/// Noise and times.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Timing {
    /// Values of a frame.
    pub values: usize,
    /// Frames that were kept, and seconds from the first to the last.
    pub frames: usize,
    /// As above.
    pub seconds: f64,
    /// Time from frame to frame by the board's clock, ms (the median).
    pub measured_ms: f64,
    /// Bytes of a frame on the wire.
    pub bytes: Option<f64>,
    /// Frame that differs most from the unpressed sheet, s.
    pub strongest_s: f64,
    /// `20 log10(|its change| / |noise|)`, 2-norms over the values of a frame, dB.
    pub snr_db: f64,
}

/// A frame with so many touches.
#[derive(Clone, Debug, Serialize)]
pub struct RecordedScene {
    /// When it was measured, s.
    pub at_s: f64,
    /// The board's count.
    pub sequence: u32,
    /// The touches that were found while it was recorded, mm.
    pub recorded_mm: Vec<[f64; 2]>,
    /// By the paper's method; its errors are the distances from the recorded touches.
    pub theirs: Outcome,
    /// By ours, of this frame alone.
    pub ours: Outcome,
}

/// One method on the frame of most touches.
#[derive(Clone, Debug, Serialize)]
pub struct RecordedPanel {
    /// Its name.
    pub name: String,
    /// Its result.
    pub outcome: Outcome,
}

/// One moment of the forces.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RecordedMoment {
    /// Time since the first frame, s.
    pub time_s: f64,
    /// Reading of the gauge, N.
    pub gauge_n: Option<f64>,
    /// The paper's method: integrated rise of the picture in newtons, by the gain that fits best.
    pub theirs_n: f64,
    /// The touches with the creep in them, N.
    pub before_n: f64,
    /// The forces of the touches as they were recorded, N.
    pub recorded_n: f64,
}

/// Forces of all touches together.
#[derive(Clone, Debug, Serialize)]
pub struct Forces {
    /// Of every picture that was recorded.
    pub moments: Vec<RecordedMoment>,
    /// Whether they are those of a typical rubber.
    pub uncalibrated: bool,
    /// Largest reading of the gauge, N, of which the errors are parts; none without a gauge.
    pub full_scale_n: Option<f64>,
    /// Differences from the gauge: by the paper's method, with the creep in it, as recorded.
    pub errors: Option<[ForceError; 3]>,
}

/// Everything that was made of a run.
#[derive(Clone, Debug, Serialize)]
pub struct RecordedReport {
    /// Where the frames came from.
    pub source: String,
    /// Noise and times.
    pub timing: Timing,
    /// Fig. 8: the clearest frame of one, two, three and four touches, as far as there were so many.
    pub scenes: Vec<RecordedScene>,
    /// Fig. 7: the last of these frames by every method.
    pub panels: Vec<RecordedPanel>,
    /// Figs. 10 and 11: the forces over time; none where no force is known.
    pub forces: Option<Forces>,
}

/// Most touches of a frame in Fig. 8.
const MOST: usize = 4;

/// Makes the figures; `progress` is called with the name of each before it begins, and how much of it is done.
///
/// # Errors
/// A sheet that cannot be modelled, frames that do not fit it; no frames of the unpressed sheet.
pub fn run(run: &Run, progress: &mut dyn FnMut(&'static str, usize, usize)) -> Result<RecordedReport, PaperError> {
    if run.unpressed.len() < 2 {
        return Err(PaperError::NoBaseline);
    }
    let timing = timing(run);
    let mut theirs = reader(run, Method::LawsonHanson, 20.0)?;
    let mut ours = reader(run, Method::Nnls, 5.0)?;
    let mut scenes = Vec::new();
    for count in 1..=MOST {
        progress("one to four touches", count, MOST);
        let Some(frame) = clearest(run, count) else {
            continue;
        };
        let recorded_mm: Vec<[f64; 2]> = touches(frame).iter().map(|t| [t.x_mm, t.y_mm]).collect();
        scenes.push(RecordedScene {
            at_s: frame.at_s,
            sequence: frame.sequence,
            theirs: of_frame(&mut theirs, frame, &recorded_mm)?,
            ours: of_frame(&mut ours, frame, &recorded_mm)?,
            recorded_mm,
        });
    }
    let panels = panels(run, &scenes, progress)?;
    Ok(RecordedReport {
        source: run.source.clone(),
        timing,
        scenes,
        panels,
        forces: forces(run, &mut theirs, progress)?,
    })
}

impl RecordedReport {
    /// The report as one page, without other files.
    pub fn html(&self) -> String {
        recorded_page::html(self)
    }

    /// Writes `report.html` and `report.json` into a folder, which is made if it does not exist.
    ///
    /// # Errors
    /// [`PaperError::Write`] with the file.
    pub fn write(&self, folder: &Path) -> Result<[PathBuf; 2], PaperError> {
        write_report(folder, &self.html(), serde_json::to_string_pretty(self))
    }
}

fn touches(frame: &Frame) -> &[Touch] {
    frame.touches.as_deref().unwrap_or_default()
}

/// The frame in which so many touches were found whose weakest is strongest.
fn clearest(run: &Run, count: usize) -> Option<&Frame> {
    let weakest = |frame: &Frame| {
        touches(frame)
            .iter()
            .map(|t| t.rise.abs())
            .fold(f64::INFINITY, f64::min)
    };
    let of_count = run.frames.iter().filter(|frame| touches(frame).len() == count);
    of_count.max_by(|a, b| weakest(a).total_cmp(&weakest(b)))
}

/// A method, ready for the frames of a run; cells of the paper's disc, on other sheets in proportion.
fn reader(run: &Run, method: Method, cell_mm: f64) -> Result<Batch, PaperError> {
    let cell_mm = method.cell_mm_on(&run.sheet)? * cell_mm / method.cell_mm();
    let imager = Imager::for_method(method, &run.sheet, Drive::PAPER, run.pattern.clone(), cell_mm)?;
    let unpressed: Vec<&[f64]> = run
        .unpressed
        .iter()
        .map(|k| run.frames[*k].values_v.as_slice())
        .collect();
    let options = BatchOptions {
        polarity: run.polarity,
        ..BatchOptions::of(method)
    };
    Ok(Batch::new(Arc::new(imager), &unpressed, options)?)
}

fn of_frame(reader: &mut Batch, frame: &Frame, recorded_mm: &[[f64; 2]]) -> Result<Outcome, PaperError> {
    let imager = Arc::clone(reader.imager());
    outcome(&imager, recorded_mm, || Ok(reader.frame(0, &frame.values_v)?))
}

fn panels(
    run: &Run,
    scenes: &[RecordedScene],
    progress: &mut dyn FnMut(&'static str, usize, usize),
) -> Result<Vec<RecordedPanel>, PaperError> {
    let Some(scene) = scenes.last() else {
        return Ok(Vec::new());
    };
    let Some(frame) = run
        .frames
        .iter()
        .find(|f| f.sequence == scene.sequence && f.at_s == scene.at_s)
    else {
        return Ok(Vec::new());
    };
    let list = [
        ("generalised inverse", Method::PseudoInverse, 20.0),
        ("generalised inverse", Method::PseudoInverse, 5.0),
        ("Lawson-Hanson (the paper)", Method::LawsonHanson, 20.0),
        ("Tikhonov", Method::Tikhonov, 5.0),
        ("ours: ridge and x ≥ 0, fitted", Method::Nnls, 5.0),
    ];
    let mut panels = Vec::new();
    for (k, (name, method, cell_mm)) in list.into_iter().enumerate() {
        progress("every method", k + 1, list.len());
        let mut reader = reader(run, method, cell_mm)?;
        let cell_mm = reader.imager().grid.cell_mm();
        panels.push(RecordedPanel {
            name: format!("{name}, {cell_mm:.0} mm"),
            outcome: of_frame(&mut reader, frame, &scene.recorded_mm)?,
        });
    }
    Ok(panels)
}

fn timing(run: &Run) -> Timing {
    let values = run.pattern.len();
    let unpressed = || run.unpressed.iter().map(|k| &run.frames[*k].values_v);
    let count = run.unpressed.len() as f64;
    let mut mean = vec![0.0; values];
    for frame in unpressed() {
        for (m, v) in mean.iter_mut().zip(frame) {
            *m += v / count;
        }
    }
    let change = |frame: &[f64]| -> f64 {
        let squares = frame.iter().zip(&mean).map(|(v, m)| (v - m).powi(2));
        squares.filter(|s| s.is_finite()).sum()
    };
    let noise = unpressed().map(|frame| change(frame)).sum::<f64>() / (count - 1.0);
    let changes = run.frames.iter().map(|f| (f.at_s, change(&f.values_v)));
    let (strongest_s, signal) = changes.fold((0.0, 0.0), |most, now| if now.1 > most.1 { now } else { most });
    let steps = run.frames.windows(2).filter_map(|pair| {
        let count = pair[1].sequence.wrapping_sub(pair[0].sequence);
        (count == 1).then(|| 1e3 * (pair[1].at_s - pair[0].at_s))
    });
    let ends = run.frames.first().zip(run.frames.last());
    Timing {
        values,
        frames: run.frames.len(),
        seconds: ends.map_or(0.0, |(first, last)| last.at_s - first.at_s),
        measured_ms: quantile(&steps.collect::<Vec<_>>(), 0.5),
        bytes: run.bytes_per_frame,
        strongest_s,
        snr_db: 10.0 * (signal / noise).log10(),
    }
}

/// The gauge's reading at a time, between two of its readings on the line through both; none before the first and after the last.
fn reading(gauge: &[[f64; 2]], at_s: f64) -> Option<f64> {
    let after = gauge.iter().position(|[t, _]| *t >= at_s)?;
    let [t1, f1] = gauge[after];
    let Some([t0, f0]) = after.checked_sub(1).map(|k| gauge[k]) else {
        return (t1 == at_s).then_some(f1);
    };
    Some(f0 + (f1 - f0) * (at_s - t0) / (t1 - t0).max(f64::MIN_POSITIVE))
}

fn forces(
    run: &Run,
    theirs: &mut Batch,
    progress: &mut dyn FnMut(&'static str, usize, usize),
) -> Result<Option<Forces>, PaperError> {
    let Some(n_per_mm2) = run.n_per_mm2 else {
        return Ok(None);
    };
    let cell_mm2 = theirs.imager().grid.cell_mm().powi(2);
    let pictures: Vec<&Frame> = run.frames.iter().filter(|f| f.touches.is_some()).collect();
    // Nothing is over time in a moment.
    if pictures.len() < 2 {
        return Ok(None);
    }
    let mut moments = Vec::new();
    let mut uncalibrated = false;
    for (k, frame) in pictures.iter().enumerate() {
        progress("the forces by the paper's method", k + 1, pictures.len());
        let found = touches(frame);
        uncalibrated |= found.iter().any(|t| t.uncalibrated);
        moments.push(RecordedMoment {
            time_s: frame.at_s,
            gauge_n: run.gauge.as_deref().and_then(|gauge| reading(gauge, frame.at_s)),
            theirs_n: theirs.frame(0, &frame.values_v)?.x.iter().sum::<f64>() * cell_mm2,
            before_n: found.iter().map(|t| t.total_mm2).sum::<f64>() * n_per_mm2,
            recorded_n: found.iter().filter_map(|t| t.force_n).sum(),
        });
    }
    // Without a gauge the paper's picture is scaled to the recorded forces: its own unit is none of force.
    let (mut rt, mut rr) = (0.0, 0.0);
    for m in &moments {
        if let Some(wanted) = m.gauge_n.or(run.gauge.is_none().then_some(m.recorded_n)) {
            rt += m.theirs_n * wanted;
            rr += m.theirs_n * m.theirs_n;
        }
    }
    let gain = if rr > 0.0 { rt / rr } else { 0.0 };
    for m in &mut moments {
        m.theirs_n *= gain;
    }
    let full_scale_n = moments
        .iter()
        .filter_map(|m| m.gauge_n)
        .reduce(f64::max)
        .filter(|n| *n > 0.0);
    let errors = full_scale_n.map(|full| {
        let reads: [fn(&RecordedMoment) -> f64; 3] = [|m| m.theirs_n, |m| m.before_n, |m| m.recorded_n];
        reads.map(|read| {
            let off = moments
                .iter()
                .filter_map(|m| m.gauge_n.map(|gauge| (read(m) - gauge).abs() / full));
            ForceError::of(&off.collect::<Vec<_>>())
        })
    });
    Ok(Some(Forces {
        moments,
        uncalibrated,
        full_scale_n,
        errors,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gauge_is_read_between_its_readings_and_not_beside_them() {
        let gauge = [[1.0, 0.0], [2.0, 10.0], [4.0, 0.0]];
        assert_eq!(reading(&gauge, 0.9), None);
        assert_eq!(reading(&gauge, 1.0), Some(0.0));
        assert_eq!(reading(&gauge, 1.25), Some(2.5));
        assert_eq!(reading(&gauge, 3.0), Some(5.0));
        assert_eq!(reading(&gauge, 4.1), None);
        // A step within a tick of its clock.
        let step = [[1.0, 0.0], [2.0, 10.0], [2.0, 4.0], [4.0, 0.0]];
        assert_eq!(
            [1.5, 2.0, 3.0].map(|t| reading(&step, t)),
            [Some(5.0), Some(10.0), Some(2.0)]
        );
    }
}
