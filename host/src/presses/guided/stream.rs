//! Frames of a guided calibration: of a board, of a recording, or of the simulated skin with a presser.

use super::arguments::Arguments;
use crate::board;
use crate::played_board::PlayedBoard;
use ::forward::Sheet;
use anyhow::{Context, Result, anyhow};
use hil_sim::{Key, Pace, SceneFile, Shape, SimPort, Touch};
use link::ports::Place;
use link::{MeasuredFrame, Session};
use recording::Speed;
use std::path::Path;
use std::time::Duration;

/// How often the loop looks up while no frame comes.
const LOOK: Duration = Duration::from_millis(100);
/// A board that says nothing for so long is gone.
const SILENCE: Duration = Duration::from_secs(10);

/// When the simulated presser begins, and its times of a press, s.
const BEGIN_S: f64 = 2.0;
const RAMP_S: f64 = 0.1;
const HOLD_S: f64 = 0.9;
const PAUSE_S: f64 = 1.3;

/// Frames one after another.
pub(super) enum Stream {
    Board(Box<Session>),
    Recording(Box<PlayedBoard>),
}

impl Stream {
    /// That of a recording.
    ///
    /// # Errors
    /// It cannot be read.
    pub(super) fn play(path: &Path) -> Result<Self> {
        Ok(Self::Recording(Box::new(PlayedBoard::open(path, Speed::Unpaced)?)))
    }

    /// That of the board that is asked for.
    ///
    /// # Errors
    /// It does not answer.
    pub(super) fn board(arguments: &Arguments) -> Result<(Self, String)> {
        let start = |place: &Place| -> Result<(Self, String)> {
            let port = place.open().map_err(|e| anyhow!(e))?;
            let session = Session::start(port, |hello| arguments.plan.plan(hello));
            let session = session.with_context(|| place.path().to_owned())?;
            Ok((Self::Board(Box::new(session)), place.path().to_owned()))
        };
        if let Some(path) = &arguments.port {
            return start(&Place::of(path));
        }
        board::only(arguments.serial.as_deref(), start)?.map_err(|why| anyhow!("{why}; skin list shows what there is"))
    }

    /// That of a simulated skin with what presses it.
    ///
    /// # Errors
    /// It does not start.
    pub(super) fn simulated(scene: &SceneFile, arguments: &Arguments) -> Result<Self> {
        let pace = if arguments.listen.is_some() {
            Pace::RealTime
        } else {
            Pace::Unpaced
        };
        let mut port = SimPort::new(scene.board()?, pace).context("the simulated skin does not start")?;
        if pace == Pace::RealTime {
            port.set_timeout(Duration::from_millis(20));
        }
        let plan = scene.config.plan.clone();
        let session = Session::start(Box::new(port), |hello| {
            plan.map_or_else(|| arguments.plan.plan(hello), Ok)
        })?;
        Ok(Self::Board(Box::new(session)))
    }

    pub(super) fn session(&self) -> &Session {
        match self {
            Self::Board(session) => session,
            Self::Recording(board) => &board.session,
        }
    }

    /// The next frame; `Err(None)` at the end, `Ok(None)` where none came for a while.
    ///
    /// # Errors
    /// The board is gone.
    pub(super) fn next(&self) -> Result<Frame> {
        match self {
            Self::Recording(board) => Ok(board.frame()?.map_or(Frame::End, Frame::Some)),
            Self::Board(session) => match session.frame(LOOK)? {
                Some(frame) => Ok(Frame::Some(frame)),
                None => {
                    session.check_silence(SILENCE)?;
                    Ok(Frame::NoneYet)
                }
            },
        }
    }
}

/// What a stream gives.
pub(super) enum Frame {
    Some(MeasuredFrame),
    NoneYet,
    End,
}

/// The scene that a simulated presser works on.
///
/// # Errors
/// It cannot be read.
pub(super) fn scene(arguments: &Arguments, sheet: &Sheet) -> Result<SceneFile> {
    let mut scene = match &arguments.scene {
        Some(path) => crate::scene::load(path)?,
        None => {
            let mut demo = SceneFile::demo(sheet.clone());
            demo.scene.touches.clear();
            demo
        }
    };
    scene.config.electronics.seed = arguments.seed;
    scene.scene.loop_s = None;
    Ok(scene)
}

/// A finger that presses these places: at given times, s, or one after the other. Returns the forces beside.
pub(super) fn pressed(scene: &SceneFile, places: &[([f64; 2], Option<f64>)], arguments: &Arguments) -> SceneFile {
    let first_s = places.iter().find_map(|p| p.1).unwrap_or(0.0);
    let period_s = 2.0 * RAMP_S + HOLD_S + PAUSE_S;
    let touch = |k: usize, place: [f64; 2], at_s: Option<f64>| {
        let from_s = BEGIN_S + at_s.map_or(k as f64 * period_s, |t| t - first_s);
        let [x, y] = place;
        // Around the force by a quarter, in a sequence that does not repeat.
        let force_n = arguments.force_n * (0.75 + 0.5 * (0.618_034 * (k + 1) as f64).fract());
        let keys = [
            (0.0, 0.0),
            (RAMP_S, force_n),
            (RAMP_S + HOLD_S, force_n),
            (2.0 * RAMP_S + HOLD_S, 0.0),
        ];
        let keys = keys.map(|(t, n)| Key::new(from_s + t, x, y, n));
        Touch::new(Shape::Finger, arguments.tip_mm, keys.to_vec())
    };
    let mut scene = scene.clone();
    scene.scene.touches = places
        .iter()
        .enumerate()
        .map(|(k, (place, at_s))| touch(k, *place, *at_s))
        .collect();
    let last_s = scene
        .scene
        .touches
        .iter()
        .flat_map(|t| &t.keys)
        .map(|k| k.t_s)
        .fold(0.0, f64::max);
    scene.duration_s = last_s + 2.0 * PAUSE_S;
    scene
}
