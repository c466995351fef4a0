//! The whole chain in every frame of a scene: the simulated board with its firmware, the link, the live reconstruction.

use anyhow::{Result, bail};
use forward::{Drive, Sheet};
use hil_sim::{Pace, SceneFile, SimPort};
use host::doubt::Doubt;
use host::imager::Imager;
use host::live::{Live, LiveFrame, LiveOptions};
use host::picture::Touch;
use host::plans::{PlanChoice, live_plan};
use host::session::Session;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

const BASELINE_S: f64 = 0.7;
const LEAST_BASELINE: usize = 24;
/// Part of the scene's greatest force from which a touch is one.
const LEAST_FORCE: f64 = 0.1;

/// What was seen of a scene.
#[derive(Debug, Default)]
pub(crate) struct Seen {
    /// How many frames there were after the baseline.
    pub(crate) frames: usize,
    /// Where contacts were first said to have changed: the frame's number, and the electrodes from 0.
    pub(crate) contacts: Vec<(u32, Vec<usize>)>,
    /// How often no touches were said to explain what there is, and in how many frames.
    pub(crate) no_touches: [usize; 2],
    /// Frames in which the number of touches is known, and those of them with as many.
    pub(crate) judged: usize,
    pub(crate) right: usize,
    /// From every touch there was to the nearest one found.
    pub(crate) off_mm: Vec<f64>,
    /// Peak rise of every touch found.
    pub(crate) rises: Vec<f64>,
    /// The highest number given to a touch.
    pub(crate) highest: u32,
    /// What the frames took.
    pub(crate) us: Vec<f64>,
}

/// `demo`, or a scene of the library.
pub(crate) fn scene(name: &str) -> Result<SceneFile> {
    if name == "demo" {
        return Ok(SceneFile::demo(Sheet::paper()));
    }
    Ok(SceneFile::load(Path::new(name))?)
}

/// Reconstructs the frames of a scene, over and over for so many seconds of the board's time, as `skin run` does.
pub(crate) fn watch(mut file: SceneFile, seconds: f64, plan: Option<PlanChoice>) -> Result<Seen> {
    file.scene.loop_s.get_or_insert(file.duration_s);
    let truth = file.scene.clone();
    let port = SimPort::new(file.board()?, Pace::Unpaced)?;
    let session = Session::start(Box::new(port), |hello| {
        plan.map_or_else(|| live_plan(hello), |p| p.plan(hello))
    })?;
    let imager = Arc::new(Imager::new(&file.sheet, Drive::PAPER, session.pattern()?, 5.0)?);
    let frame_s = f64::from(session.plan().quarters()) / 4.0 / session.hello().excitation_hz();
    let mut live = Live::new(
        imager,
        LiveOptions {
            baseline_frames: ((BASELINE_S / frame_s).round() as usize).max(LEAST_BASELINE),
            ..LiveOptions::default()
        },
    );
    let most_n = (0..2000)
        .flat_map(|k| truth.truth(f64::from(k) / 2000.0 * file.duration_s))
        .map(|t| t.force_n)
        .fold(0.0, f64::max);
    let mut seen = Seen::default();
    let (mut contacts, mut doubted) = (Vec::new(), false);
    loop {
        let Some(frame) = session.frame(Duration::from_secs(60))? else {
            bail!("the board is silent");
        };
        if frame.time_s > seconds {
            return Ok(seen);
        }
        let start = Instant::now();
        let LiveFrame::Picture(result) = live.frame(&frame)? else {
            continue;
        };
        seen.us.push(start.elapsed().as_secs_f64() * 1e6);
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
