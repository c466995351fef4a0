//! End-to-end tests: the firmware on the simulated skin, through protocol and link, to the host's touches.
#![forbid(unsafe_code)]

use forward::Sheet;
use hil_sim::{Pace, Rubber, Scene, SimBoard, SimConfig, SimPort};
use inverse::live::{LiveFrame, LiveOptions};
use inverse::touches::touch::Touch;
use link::Port;
use link::plans::adjacent_plan;
use protocol::{Hello, Plan, PlanError};
use std::error::Error;
use studies::chain::Chain;

/// What the tests need of a run that went well.
pub struct Run {
    /// Board time (s) and touches of every picture.
    pub pictures: Vec<(f64, Vec<Touch>)>,
    /// Frames lost on the way.
    pub lost_frames: u64,
    /// Values clipped or left out, over all frames.
    pub values_missing: usize,
}

/// A simulated board with a scene, as a port without pace.
///
/// # Errors
/// The sheet, the board or the port.
pub fn simulated(scene: Scene, config: SimConfig) -> Result<SimPort, Box<dyn Error>> {
    let rubber = Rubber::new(&Sheet::paper(), scene)?;
    Ok(SimPort::new(SimBoard::new(config, rubber)?, Pace::Unpaced)?)
}

/// Runs the whole chain until board time `until_s`, with the first `baseline_frames` frames as baseline.
///
/// # Errors
/// Whatever goes wrong on the way.
pub fn run(port: Box<dyn Port>, baseline_frames: usize, until_s: f64) -> Result<Run, Box<dyn Error>> {
    run_by(port, adjacent_plan, baseline_frames, until_s)
}

/// The same by the plan that `choose` makes for the board.
///
/// # Errors
/// As [`run`].
pub fn run_by(
    port: Box<dyn Port>,
    choose: impl FnOnce(&Hello) -> Result<Plan, PlanError>,
    baseline_frames: usize,
    until_s: f64,
) -> Result<Run, Box<dyn Error>> {
    let mut chain = Chain::start(port, &Sheet::paper(), choose, |_| LiveOptions {
        baseline_frames,
        ..LiveOptions::default()
    })?;
    let mut pictures = Vec::new();
    let mut values_missing = 0;
    loop {
        let (frame, _, made) = chain.next()?;
        if frame.time_s > until_s {
            break;
        }
        values_missing += frame.values_v.iter().filter(|v| !v.is_finite()).count();
        if let LiveFrame::Picture(result) = made {
            pictures.push((frame.time_s, result.touches.clone()));
        }
    }
    Ok(Run {
        pictures,
        lost_frames: chain.session().link().counters().lost_frames,
        values_missing,
    })
}
