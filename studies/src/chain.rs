//! The whole chain of `skin run`: the simulated board with its firmware, the link, the live reconstruction.

use crate::error::StudyError;
use forward::{Drive, Pattern, Sheet};
use hil_sim::{Pace, SceneFile, SimPort};
use inverse::live::{Live, LiveFrame, LiveOptions};
use inverse::quality::doubt::Doubt;
use inverse::reference::imager::Imager;
use inverse::touches::touch::Touch;
use link::plans::{PlanChoice, live_plan};
use link::{MeasuredFrame, Port, Session};
use protocol::{Hello, Plan, PlanError};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Side of a cell, mm.
const CELL_MM: f64 = 5.0;
/// Longest wait for a frame. The simulated board is not paced, and a busy machine takes longer.
const WAIT: Duration = Duration::from_secs(60);
/// Duration of the baseline, s, and its least number of frames, as in `skin run`.
const BASELINE_S: f64 = 0.7;
const LEAST_BASELINE: usize = 24;
/// Part of the scene's greatest force from which a touch counts as present.
const LEAST_FORCE: f64 = 0.1;

/// Results of a scene.
#[derive(Debug, Default)]
pub struct Seen {
    /// Number of frames after the baseline.
    pub frames: usize,
    /// Every report of other changed contacts than before: number of the frame, and electrodes counted from 0.
    pub contacts: Vec<(u32, Vec<usize>)>,
    /// How often the fit reported that no touches explain the frames, and in how many frames.
    pub no_touches: [usize; 2],
    /// Frames in which the true number of touches is certain.
    pub judged: usize,
    /// Those of them with the right number of touches found.
    pub right: usize,
    /// Distance from every true touch to the nearest one found, mm.
    pub off_mm: Vec<f64>,
    /// Peak rise of every touch found.
    pub rises: Vec<f64>,
    /// The highest number given to a touch.
    pub highest: u32,
    /// Time of the reconstruction of every frame, us.
    pub us: Vec<f64>,
}

/// A session with a simulated board, and the live reconstruction of its frames.
pub struct Chain {
    session: Session,
    live: Live,
    frame_s: f64,
}

impl Chain {
    /// Starts the board behind a port with the plan that `choose` makes for it. `options` receives the time of a
    /// frame, s.
    ///
    /// # Errors
    /// [`StudyError`]: the board, its plan, the sheet.
    pub fn start(
        port: Box<dyn Port>,
        sheet: &Sheet,
        choose: impl FnOnce(&Hello) -> Result<Plan, PlanError>,
        options: impl FnOnce(f64) -> LiveOptions,
    ) -> Result<Self, StudyError> {
        let session = Session::start(port, choose)?;
        let pattern = Pattern::from_pairs(session.electrodes(), session.measurements())?;
        let imager = Imager::new(sheet, Drive::PAPER, pattern, CELL_MM)?;
        let frame_s = f64::from(session.plan().quarters()) / 4.0 / session.hello().excitation_hz();
        Ok(Self {
            live: Live::new(Arc::new(imager), options(frame_s)),
            session,
            frame_s,
        })
    }

    /// Time of a frame, s.
    pub fn frame_s(&self) -> f64 {
        self.frame_s
    }

    /// The session, for its counters.
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// The next frame, the time of its reconstruction, and its result.
    ///
    /// # Errors
    /// [`StudyError::Silent`] where none comes for a minute, the link, a frame of another pattern.
    pub fn next_frame(&mut self) -> Result<(MeasuredFrame, Duration, LiveFrame<'_>), StudyError> {
        let frame = self.session.frame(WAIT)?.ok_or(StudyError::Silent)?;
        let start = Instant::now();
        let made = self.live.frame(frame.time_s, &frame.values_v)?;
        Ok((frame, start.elapsed(), made))
    }
}

/// Reconstructs the frames of a scene as `skin run` does. The scene repeats for `seconds` of the board's time.
///
/// # Errors
/// [`StudyError`] where the simulated board does not come up, or the chain breaks.
pub fn watch(mut file: SceneFile, seconds: f64, plan: Option<PlanChoice>) -> Result<Seen, StudyError> {
    file.scene.loop_s.get_or_insert(file.duration_s);
    let truth = file.scene.clone();
    let board = file.board().map_err(|e| StudyError::Simulator(e.to_string()))?;
    let port = SimPort::new(board, Pace::Unpaced).map_err(|e| StudyError::Simulator(e.to_string()))?;
    let choose = |hello: &Hello| plan.map_or_else(|| live_plan(hello), |p| p.plan(hello));
    let mut chain = Chain::start(Box::new(port), &file.sheet, choose, |frame_s| LiveOptions {
        baseline_frames: ((BASELINE_S / frame_s).round() as usize).max(LEAST_BASELINE),
        ..LiveOptions::default()
    })?;
    let frame_s = chain.frame_s();
    let most_n = (0..2000)
        .flat_map(|k| truth.truth(f64::from(k) / 2000.0 * file.duration_s))
        .map(|t| t.force_n)
        .fold(0.0, f64::max);
    let mut seen = Seen::default();
    let (mut contacts, mut doubted) = (Vec::new(), false);
    loop {
        let (frame, took, made) = chain.next_frame()?;
        if frame.time_s > seconds {
            return Ok(seen);
        }
        let LiveFrame::Picture(result) = made else { continue };
        seen.us.push(took.as_secs_f64() * 1e6);
        seen.frames += 1;
        if result.contacts != contacts {
            contacts.clone_from(&result.contacts);
            if !contacts.is_empty() {
                seen.contacts.push((frame.sequence, contacts.clone()));
            }
        }
        let doubts = matches!(result.doubt, Some(Doubt::NotTouches));
        seen.no_touches[0] += usize::from(doubts && !doubted);
        seen.no_touches[1] += usize::from(doubts);
        doubted = doubts;
        let numbers = result.touches.iter().filter_map(|t| t.id);
        seen.highest = numbers.fold(seen.highest, u32::max);
        // The middle of the frame.
        let now = truth.truth(frame.time_s - 0.5 * frame_s);
        let dents = now.len() < truth.touches.len() && truth.material.delayed_per_mpa > 0.0;
        if dents || now.iter().any(|t| t.force_n < LEAST_FORCE * most_n) {
            continue;
        }
        seen.judged += 1;
        if now.len() == result.touches.len() {
            seen.right += 1;
        } else {
            tracing::debug!(frame.sequence, ?now, ?result.touches, ?result.doubt, "wrong");
        }
        seen.rises.extend(result.touches.iter().map(|t| t.rise));
        for t in &now {
            let off = |f: &Touch| (f.x_mm - t.x_mm).hypot(f.y_mm - t.y_mm);
            seen.off_mm
                .extend(result.touches.iter().map(off).min_by(f64::total_cmp));
        }
    }
}
