//! What `skin run --json` and `skin replay --json` print: a header, then a line for every picture and every event. The schema is
//! docs/live.schema.json.

use crate::event::Said;
use crate::json;
use crate::recorded::{BoardRecord, CalibrationNote, SessionRecord, pressed};
use crate::say;
use crate::skin_file::Place;
use ::forward::CellGrid;
use ::protocol::{Plan, Version};
use anyhow::Result;
use inverse::pipeline::FrameResult;
use inverse::quality::doubt::Doubt;
use inverse::reference::diagnosis::Fault;
use inverse::reference::drift::Drift;
use inverse::reference::screening::Finding;
use inverse::touches::gestures::TouchEvent;
use inverse::touches::touch::Touch;
use link::{LinkCounters, MeasuredFrame, Session};
use serde::Serialize;
use serde_json::{Value, json};
use std::io::Write;
use view::picture::BaselineNote;

/// Version of the lines. It grows when a reader of the version before would misunderstand them.
const SCHEMA: u32 = 2;

/// The first line.
#[derive(Serialize)]
struct Header<'a> {
    kind: &'static str,
    schema: u32,
    program: &'a str,
    protocol: String,
    started_unix_s: f64,
    source: &'a str,
    board: &'a BoardRecord,
    plan: PlanLine,
    /// TOML.
    sheet: &'a str,
    /// From 1.
    wires: &'a [usize],
    calibrated: bool,
    /// Where the sheet is on the robot.
    #[serde(skip_serializing_if = "Option::is_none")]
    place: Option<PlaceLine<'a>>,
    /// Presses that taught what a touch does, where that takes the place of the sheet's model.
    #[serde(skip_serializing_if = "Option::is_none")]
    learned_from: Option<usize>,
    /// The calibration, where there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    calibration: Option<&'a CalibrationNote>,
    /// Where the cells of a picture are.
    #[serde(skip_serializing_if = "Option::is_none")]
    cells: Option<CellsLine>,
    units: Value,
}

#[derive(Serialize)]
struct PlaceLine<'a> {
    #[serde(flatten)]
    place: &'a Place,
    /// Which way the sheet faces in the robot's frame, of length 1.
    normal: [f64; 3],
}

impl<'a> From<&'a Place> for PlaceLine<'a> {
    fn from(place: &'a Place) -> Self {
        Self {
            place,
            normal: place.normal(),
        }
    }
}

#[derive(Serialize)]
struct CellsLine {
    /// Side of a cell.
    side_mm: f64,
    /// Centre of every cell, mm.
    centres_mm: Vec<[f64; 2]>,
    /// The same in the robot's frame, mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    robot_mm: Option<Vec<[f64; 3]>>,
}

impl CellsLine {
    fn of(grid: &CellGrid, place: Option<&Place>) -> Self {
        let centres_mm: Vec<_> = (0..grid.len()).map(|cell| grid.centre(cell)).collect();
        Self {
            side_mm: grid.cell_mm(),
            robot_mm: place.map(|place| centres_mm.iter().map(|c| place.point_mm(*c)).collect()),
            centres_mm,
        }
    }
}

/// A touch or an event, and where it is on the robot.
#[derive(Serialize)]
struct Placed<'a, T> {
    #[serde(flatten)]
    of: &'a T,
    /// In the robot's frame, mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    robot_mm: Option<[f64; 3]>,
}

#[derive(Serialize)]
struct PlanLine {
    id: u16,
    values: usize,
    frames_per_s: f64,
    /// Drive plus and minus, sense plus and minus of every value, electrodes from 1.
    measurements: Vec<[usize; 4]>,
}

/// The unit of every number, by its name.
fn units(learned: bool) -> Value {
    let [area, rise] = if learned {
        [
            "mm^2, of the spot that is drawn; presses do not teach it",
            "strength over that of the usual press of the calibration",
        ]
    } else {
        [
            "mm^2",
            "relative rise of the resistivity at the touch's centre, 0.2 is 20 %",
        ]
    };
    json!({
        "time_s": "s of the board's clock, 0 at its power-up",
        "unix_s": "s since 1970 (UTC), this computer's clock",
        "x_mm": "mm from the sheet's centre, to the right",
        "y_mm": "mm from the sheet's centre, up",
        "robot_mm": "x, y, z in mm in the frame of place",
        "area_mm2": area,
        "rise": rise,
        "total_mm2": "rise integrated over the area, mm^2",
        "force_n": "N; of a typical rubber where uncalibrated is true, with --calibration of this one",
        "residual": "part of the change that the touches do not explain, 0 to 1",
        "solve_us": "us",
        "electrodes": "counted from 1",
    })
}

impl PlanLine {
    fn of(session: &Session) -> Self {
        let plan: &Plan = session.plan();
        Self {
            id: plan.id,
            values: plan.value_count(),
            frames_per_s: session.frame_s().recip(),
            measurements: session
                .measurements()
                .map(|[[a, b], [c, d]]| [a, b, c, d].map(|e| e + 1))
                .collect(),
        }
    }
}

/// Prints the first line, with the cells where pictures have them.
///
/// # Errors
/// Nobody reads it.
pub(crate) fn header(session: &Session, record: &SessionRecord, cells: Option<&CellGrid>) -> Result<()> {
    let Version { major, minor } = session.hello().version;
    print(&Header {
        kind: "header",
        schema: SCHEMA,
        program: &record.program,
        protocol: format!("{major}.{minor}"),
        started_unix_s: record.started_unix_s,
        source: &record.source,
        board: &record.board,
        plan: PlanLine::of(session),
        sheet: &record.sheet,
        wires: &record.wires,
        calibrated: record.calibration.is_some() || record.calibrated_by.as_ref().is_some_and(|note| note.force),
        place: record.place.as_ref().map(PlaceLine::from),
        learned_from: record.learned_from,
        calibration: record.calibrated_by.as_ref(),
        cells: cells.map(|grid| CellsLine::of(grid, record.place.as_ref())),
        units: units(record.learned_from.is_some()),
    })
}

#[derive(Serialize)]
struct EventLine<'a> {
    kind: &'static str,
    /// The board's time of the last frame before it, s; none before the first.
    time_s: Option<f64>,
    unix_s: f64,
    #[serde(flatten)]
    said: &'a Said,
}

/// Prints that something happened, after the frame of a time.
///
/// # Errors
/// Nobody reads it.
pub(crate) fn event(said: &Said, time_s: Option<f64>, unix_s: f64) -> Result<()> {
    print(&EventLine {
        kind: "event",
        time_s,
        unix_s,
        said,
    })
}

#[derive(Serialize)]
struct Line<'a> {
    kind: &'static str,
    frame: u32,
    time_s: f64,
    unix_s: f64,
    touches: Vec<Placed<'a, Touch>>,
    /// Relative rise of every cell.
    #[serde(skip_serializing_if = "Option::is_none")]
    cells: Option<&'a [f64]>,
    /// What touches did, as this frame shows.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    events: Vec<Placed<'a, TouchEvent>>,
    residual: f64,
    gap: f64,
    solve_us: f64,
    lost_frames: u64,
    /// Passed over so far for newer ones.
    skipped_frames: u64,
    /// What the frames are compared with.
    #[serde(skip_serializing_if = "Option::is_none")]
    baseline: Option<BaselineLine<'a>>,
    /// What speaks against the touches.
    #[serde(skip_serializing_if = "Option::is_none")]
    doubt: Option<Doubt>,
    /// What is broken on the board or at its wires.
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    faults: &'a [Fault],
    /// Values that have nothing to do with the others and took no part: places in the plan, from 0.
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    rejected: &'a [usize],
    /// What was said of the line within the last second.
    #[serde(skip_serializing_if = "Option::is_none")]
    line: Option<&'a str>,
    /// What drifted since the baseline.
    #[serde(skip_serializing_if = "Drift::is_none")]
    drift: &'a Drift,
    /// What is left out of all frames, since it is wrong in the baseline.
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    left_out: &'a [Finding],
}

/// The baseline in force.
#[derive(Serialize)]
struct BaselineLine<'a> {
    age_s: f64,
    /// Whether it was not taken now, but stored.
    stored: bool,
    /// What speaks against it.
    #[serde(skip_serializing_if = "Option::is_none")]
    warning: Option<&'a str>,
}

impl<'a> BaselineLine<'a> {
    fn of(note: &'a BaselineNote, now_unix_s: f64) -> Self {
        Self {
            // In whole seconds: the system's clock is no more certain.
            age_s: (now_unix_s - note.taken_unix_s).max(0.0).floor(),
            stored: note.stored,
            warning: note.warning.as_deref(),
        }
    }
}

/// What is said with a picture beside its touches.
pub(crate) struct Beside<'a> {
    /// Whether every cell is said.
    pub(crate) cells: bool,
    pub(crate) events: &'a [TouchEvent],
    pub(crate) unix_s: f64,
    pub(crate) baseline: Option<&'a BaselineNote>,
    pub(crate) line: Option<&'a str>,
    pub(crate) left_out: &'a [Finding],
    /// Where the sheet is on the robot.
    pub(crate) place: Option<&'a Place>,
}

/// The line of a picture's touches.
///
/// # Errors
/// None that a picture has.
pub(crate) fn picture(
    result: &FrameResult,
    frame: &MeasuredFrame,
    counters: LinkCounters,
    beside: &Beside<'_>,
) -> Result<Vec<u8>> {
    let robot_mm = |x_mm, y_mm| beside.place.map(|place| place.point_mm([x_mm, y_mm]));
    let touches = pressed(result).into_iter().map(|of| Placed {
        of,
        robot_mm: robot_mm(of.x_mm, of.y_mm),
    });
    let events = beside.events.iter().map(|of| Placed {
        of,
        robot_mm: robot_mm(of.x_mm, of.y_mm),
    });
    json::line(&Line {
        kind: "picture",
        frame: frame.sequence,
        time_s: frame.time_s,
        unix_s: beside.unix_s,
        touches: touches.collect(),
        cells: beside.cells.then_some(result.x.as_slice()),
        events: events.collect(),
        residual: result.residual,
        gap: result.gap,
        solve_us: result.solve_us,
        lost_frames: counters.lost_frames,
        skipped_frames: counters.skipped_frames,
        baseline: beside.baseline.map(|note| BaselineLine::of(note, beside.unix_s)),
        doubt: result.doubt,
        faults: &result.faults,
        rejected: &result.rejected,
        line: beside.line,
        drift: &result.drift,
        left_out: beside.left_out,
    })
}

/// Writes a line to stdout, in one piece.
///
/// # Errors
/// Nobody reads it.
pub(crate) fn write(line: &[u8]) -> Result<()> {
    let named = say::skin().and_then(|skin| of_skin(&skin, line));
    let mut out = say::stdout();
    out.write_all(named.as_deref().unwrap_or(line))?;
    out.flush()?;
    Ok(())
}

/// A line with the skin's name in front; names need no escape.
fn of_skin(skin: &str, line: &[u8]) -> Option<Vec<u8>> {
    let rest = line.strip_prefix(b"{")?;
    let mut out = format!("{{\"skin\":\"{skin}\",").into_bytes();
    out.extend_from_slice(rest);
    Some(out)
}

fn print(line: &impl Serialize) -> Result<()> {
    write(&json::line(line)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::forward::{Drive, Pattern, Sheet};
    use inverse::reference::imager::Imager;

    /// By the schema it is a list of at least one place, or not there.
    #[test]
    fn values_that_took_no_part_are_in_the_line() {
        let imager = Imager::new(&Sheet::paper(), Drive::PAPER, Pattern::adjacent(16).unwrap(), 12.0).unwrap();
        let frame = MeasuredFrame {
            sequence: 7,
            time_s: 1.0,
            values_v: vec![0.0; 208],
        };
        let beside = Beside {
            cells: false,
            events: &[],
            unix_s: 0.0,
            baseline: None,
            line: None,
            left_out: &[],
            place: None,
        };
        let mut result = FrameResult::nothing(&imager);
        for rejected in [vec![], vec![3, 17]] {
            result.rejected.clone_from(&rejected);
            let line = picture(&result, &frame, LinkCounters::default(), &beside).unwrap();
            let line: Value = serde_json::from_slice(&line).unwrap();
            let found = line.get("rejected").cloned();
            assert_eq!(found.as_ref(), (!rejected.is_empty()).then(|| json!(rejected)).as_ref());
            assert!(line["touches"].as_array().is_some_and(Vec::is_empty), "{line}");
        }
    }
}
