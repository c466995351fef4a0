//! A board with a fault, and what the program makes of its frames.

use super::{Case, Counts, Outcome, ValueFault, When, is_near};
use crate::error::StudyError;
use forward::{Drive, Model, ModelOptions, Pattern, Sheet};
use hil_sim::{Fault, Pace, Preset, Rubber, Scene, SimBoard, SimConfig, SimPort, Touch};
use inverse::live::{Live, LiveFrame, LiveOptions};
use inverse::pipeline::FrameResult;
use inverse::reference::imager::Imager;
use link::plans::live_plan;
use link::{LinkError, LinkNotices, Session};
use protocol::{Hello, PlanName};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Side of a cell, mm.
const CELL_MM: f64 = 5.0;
/// Where the finger presses, mm, its force and how long it takes to come down or lift.
const FINGER_MM: [f64; 2] = [30.0, 20.0];
const FORCE_N: f64 = 15.0;
const RAMP_S: f64 = 0.05;
/// Duration of the baseline, s, and its least number of frames, as in `skin run`.
const BASELINE_S: f64 = 0.7;
const LEAST_BASELINE: usize = 24;
/// Length of a scene in frames, and at least, s.
const FRAMES: f64 = 150.0;
const LEAST_S: f64 = 2.0;
/// How long a frame is waited for. The simulated board is not paced.
const WAIT: Duration = Duration::from_millis(100);
/// Silence after which a session ends, as in `skin run`.
const SILENCE: Duration = Duration::from_secs(3);
/// Longest start, tries of [`WAIT`].
const LONGEST: usize = 300;

/// A board, and what is measured with it.
type Board = (Preset, Option<PlanName>);

/// Boards with faults on the paper's sheet. What is computed for one is used for the next.
pub struct Bench {
    sheet: Sheet,
    model: Arc<Model>,
    imagers: Vec<(Board, Arc<Imager>)>,
}

/// A session whose scene is held until the baseline is taken.
struct Rig {
    port: SimPort,
    session: Session,
    live: Live,
    notices: LinkNotices,
    pattern: Pattern,
    length_s: f64,
}

impl Bench {
    /// The simulated sheet has a finer mesh than the imager's.
    ///
    /// # Errors
    /// [`StudyError`] where the sheet has no model.
    pub fn new() -> Result<Self, StudyError> {
        let sheet = Sheet::paper();
        let options = ModelOptions {
            accuracy: 5e-5,
            ..ModelOptions::default()
        };
        Ok(Self {
            model: Arc::new(Model::new(&sheet, &options)?),
            sheet,
            imagers: Vec::new(),
        })
    }

    /// Runs a scene with a fault.
    ///
    /// # Errors
    /// [`StudyError`] where the simulation breaks. What the program itself refuses is an outcome.
    pub fn run(&mut self, case: &Case, when: When) -> Result<Outcome, StudyError> {
        let ([down, up], at, _) = when.times();
        let mut outcome = Outcome::default();
        let length_s = length_s(case);
        let path = [(down, FINGER_MM), (up, FINGER_MM)].map(|(t, [x, y])| (t * length_s, x, y));
        let scene = Scene {
            touches: vec![Touch::finger(&path, FORCE_N, RAMP_S)],
            ..Scene::empty()
        };
        let mut rig = match self.start(case, scene, at * length_s, length_s) {
            Ok(rig) => rig,
            Err(StudyError::Link(why)) => {
                outcome.said.push((0.0, why.to_string()));
                outcome.ended = Some(why.to_string());
                return Ok(outcome);
            }
            Err(why) => return Err(why),
        };
        rig.watch(case, when, &mut outcome)?;
        Ok(outcome)
    }

    fn start(&mut self, case: &Case, scene: Scene, at_s: f64, length_s: f64) -> Result<Rig, StudyError> {
        let simulator = |e: &dyn std::error::Error| StudyError::Simulator(e.to_string());
        let text = |kind: &String| match case.for_s {
            Some(for_s) => format!("{kind}@{at_s}+{for_s}"),
            None => format!("{kind}@{at_s}"),
        };
        let faults: Result<Vec<Fault>, _> = case.board.iter().map(|kind| text(kind).parse()).collect();
        let config = SimConfig {
            faults: faults.map_err(|e| simulator(&e))?,
            electronics: case.preset.electronics(),
            ..SimConfig::default()
        };
        let rubber = Rubber::on_model(Arc::clone(&self.model), scene)?;
        let board = SimBoard::new(config, rubber)
            .map_err(|e| simulator(&e))?
            .holding_scene();
        let port = SimPort::new(board, Pace::Unpaced).map_err(|e| simulator(&e))?;
        let choose = |hello: &Hello| match case.plan {
            Some(plan) => plan.plan(hello.electrodes),
            None => live_plan(hello),
        };
        let session = Session::start(Box::new(port.clone()), choose)?;
        let pattern = Pattern::from_pairs(session.electrodes(), session.measurements())?;
        let frame_s = f64::from(session.plan().quarters()) / 4.0 / session.hello().excitation_hz();
        let options = LiveOptions {
            baseline_frames: ((BASELINE_S / frame_s).round() as usize).max(LEAST_BASELINE),
            ..LiveOptions::default()
        };
        Ok(Rig {
            live: Live::new(self.imager((case.preset, case.plan), &pattern)?, options),
            port,
            session,
            notices: LinkNotices::default(),
            pattern,
            length_s,
        })
    }

    fn imager(&mut self, board: Board, pattern: &Pattern) -> Result<Arc<Imager>, StudyError> {
        if let Some((_, imager)) = self.imagers.iter().find(|(of, _)| *of == board) {
            return Ok(Arc::clone(imager));
        }
        let imager = Arc::new(Imager::new(&self.sheet, Drive::PAPER, pattern.clone(), CELL_MM)?);
        self.imagers.push((board, Arc::clone(&imager)));
        Ok(imager)
    }
}

impl Rig {
    /// Frames to the end of the scene.
    fn watch(&mut self, case: &Case, when: When, outcome: &mut Outcome) -> Result<(), StudyError> {
        let ([down, up], at, [rest, over]) = when.times();
        let [down, up, at, rest, over] = [down, up, at, rest, over].map(|part| part * self.length_s);
        let mut silent = 0;
        // The board's clock begins anew as a reset is over: when that is. One in the baseline comes with the power.
        let reset_s = case.for_s.filter(|_| {
            case.board
                .iter()
                .any(|kind| kind == "board_reset" || kind == "board_hangs")
        });
        let reset_s = reset_s.unwrap_or(0.0);
        let (mut last_s, mut before_s) = (0.0, if when == When::Baseline { reset_s } else { 0.0 });
        loop {
            let frame = match self.session.frame(WAIT) {
                Ok(frame) => frame,
                Err(why) => {
                    end(outcome, &why);
                    return Ok(());
                }
            };
            if let Err(why) = self.session.check_silence(SILENCE) {
                end(outcome, &why);
                return Ok(());
            }
            let counters = self.session.link().counters();
            let began_s = self.port.scene_began_s();
            if let Some(frame) = &frame {
                if frame.time_s < last_s {
                    before_s = began_s.unwrap_or(0.0) + at + reset_s;
                }
                last_s = frame.time_s;
            }
            let now_s = began_s.map_or(0.0, |began| (before_s + last_s - began).max(0.0));
            if let Some(notice) = self.notices.take(&counters, frame.as_ref()) {
                say(outcome, now_s - at, notice.to_string());
            }
            let Some(mut frame) = frame else {
                silent += 1;
                if silent > LONGEST {
                    end(outcome, &LinkError::NoFrames { s: 30, bytes: 0 });
                    return Ok(());
                }
                continue;
            };
            silent = 0;
            let faulty = when == When::Baseline || (now_s >= at && began_s.is_some());
            if let Some(fault) = case
                .values
                .filter(|f| faulty && (when != When::Baseline || !is_later(*f) || began_s.is_none()))
            {
                fault.apply(&mut frame.values_v, &self.pattern);
            }
            let start = Instant::now();
            match self.live.frame(frame.time_s, &frame.values_v)? {
                LiveFrame::Baseline { left: 0, .. } => {
                    if let Some(inspection) = self.live.inspection() {
                        inspection
                            .warnings()
                            .into_iter()
                            .for_each(|text| say(outcome, 0.0, text));
                    }
                    self.port.begin_scene();
                }
                LiveFrame::Baseline { .. } => {}
                LiveFrame::Picture(result) => {
                    if now_s >= at {
                        outcome.took_s.push(start.elapsed().as_secs_f64());
                        hear(outcome, now_s - at, result);
                        if now_s > at.max(down + 2.0 * RAMP_S) && now_s < up {
                            touched(outcome, result);
                        } else if now_s > rest.max(at + 2.0 * RAMP_S) && now_s < over {
                            outcome.rest.add(result.touches.is_empty(), result.doubt.is_some());
                        }
                    }
                    if now_s > self.length_s {
                        return Ok(());
                    }
                }
            }
        }
    }
}

/// Length of a scene, s.
fn length_s(case: &Case) -> f64 {
    // What measures one pair after the other has some 14 frames/s, the others 100 or more.
    match (case.plan, case.preset) {
        (None, Preset::SixteenChannels | Preset::Ideal | Preset::DrawnSixteen) => LEAST_S,
        _ => (FRAMES / 14.0).max(LEAST_S),
    }
}

/// Whether a fault is one of the baseline alone where it is there already: a wild value.
fn is_later(fault: ValueFault) -> bool {
    matches!(fault, ValueFault::Value(..))
}

fn end(outcome: &mut Outcome, why: &LinkError) {
    say(outcome, f64::NAN, why.to_string());
    outcome.ended = Some(why.to_string());
}

/// What the program says of a frame.
fn hear(outcome: &mut Outcome, after_s: f64, result: &FrameResult) {
    outcome.last = result.faults.iter().map(ToString::to_string).collect();
    let faults = outcome.last.clone().into_iter();
    let doubt = result.doubt.map(|doubt| doubt.to_string());
    let drift = result.drift.notice().map(|notice| notice.to_string());
    faults
        .chain(doubt)
        .chain(drift)
        .for_each(|text| say(outcome, after_s, text));
}

fn say(outcome: &mut Outcome, after_s: f64, text: String) {
    if !outcome.said.iter().any(|(_, said)| *said == text) {
        outcome.said.push((after_s, text));
    }
}

fn touched(outcome: &mut Outcome, result: &FrameResult) {
    let off = |t: &inverse::touches::touch::Touch| (t.x_mm - FINGER_MM[0]).hypot(t.y_mm - FINGER_MM[1]);
    let right = result.touches.len() == 1 && result.touches.iter().all(|t| is_near(off(t)));
    outcome.touched.add(right, result.doubt.is_some());
    if result.doubt.is_none()
        && let Some(t) = result.touches.iter().min_by(|a, b| off(a).total_cmp(&off(b)))
    {
        outcome.off_mm.push(off(t));
        outcome.totals.push(t.total_mm2);
        outcome.sd_mm.extend(t.x_sd_mm.zip(t.y_sd_mm).map(|(x, y)| x.hypot(y)));
    }
}

impl Counts {
    /// Part of the frames that are right.
    pub fn right_part(&self) -> f64 {
        self.right as f64 / self.frames.max(1) as f64
    }
}
