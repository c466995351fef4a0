//! Ratio of signal to noise by the paper's definition, and time of a frame, for every way of measuring.

use crate::paper::rig::{Press, Recording, Rig};
use crate::paper::{Options, PaperError};
use link::plans::adjacent_plan_for;
use protocol::{Plan, PlanError};
use serde::Serialize;

/// The paper's figures.
pub const PAPER_DB: f64 = 27.0;
/// Update time in the paper, measurement and reconstruction, ms.
pub const PAPER_UPDATE_MS: f64 = 360.0;

/// One way of measuring.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Way {
    /// Its name.
    pub name: &'static str,
    /// Values of a frame.
    pub values: usize,
    /// Periods of the excitation that a frame takes by the plan.
    pub periods: f64,
    /// The time that they take at 3684 Hz, ms.
    pub computed_ms: f64,
    /// Time from frame to frame by the board's clock, ms.
    pub measured_ms: f64,
    /// Frames in a second.
    pub frames_per_s: f64,
    /// Bytes of a frame on the wire.
    pub bytes: f64,
    /// `20 log10(|change under 25 N in the middle| / |noise|)`, 2-norms over the values of a frame, dB.
    pub snr_db: f64,
}

/// All ways, the paper's first.
///
/// # Errors
/// As for [`ours`].
pub fn ways() -> Result<Vec<(&'static str, Plan)>, PlanError> {
    Ok(vec![
        ("the paper: 208 values one by one, 6 periods each", Plan::paper()),
        ("ours: all pairs of a drive at once, 1 + 6", ours()?),
        ("208 one by one, 1 settle + 1 integrate", Plan::sequential()),
        ("104 independent values, 1 + 1", Plan::independent()),
        ("all pairs of a drive at once, 1 + 1", Plan::fast()),
        ("the same, settling a quarter period", Plan::fastest()),
        ("the same, 14 of the 16 drives", Plan::fourteen()),
    ])
}

/// The plan of `skin run` for a board with a channel for each pair.
///
/// # Errors
/// None for 16 electrodes.
pub fn ours() -> Result<Plan, PlanError> {
    adjacent_plan_for(16, 16)
}

/// Measures every way: first the unpressed sheet, then 25 N on the tip in the middle.
pub(super) fn run(rig: &dyn Rig, options: Options, progress: &dyn Fn(&str)) -> Result<Vec<Way>, PaperError> {
    ways()?
        .into_iter()
        .enumerate()
        .map(|(k, (name, plan))| {
            progress(name);
            let periods = f64::from(plan.quarters()) / 4.0;
            let frame_s = periods * 16.0 * 1425.0 / 84e6;
            let frames = if options.quick { 12 } else { 40 };
            // Board and link need a moment to start. Frames during the fall of the tip are left out.
            let rest = [0.2, 0.2 + frame_s * f64::from(frames + 1)];
            let press = [rest[1] + frame_s + 0.2, rest[1] + frame_s * f64::from(frames + 2) + 0.2];
            let path = [[rest[1], 0.0], [press[0], 25.0], [press[1] + 1.0, 25.0]];
            let skin = rig.mount(&[Press::tip([0.0, 0.0], &path)], false, options.seed + k as u64)?;
            let r = Recording::make(skin, &plan, press[1])?;
            Ok(Way {
                name,
                values: plan.value_count(),
                periods,
                computed_ms: 1e3 * frame_s,
                measured_ms: 1e3 * r.interval_s,
                frames_per_s: 1.0 / r.interval_s,
                bytes: r.bytes_per_frame,
                snr_db: snr_db(&r, rest, press),
            })
        })
        .collect()
}

fn snr_db(r: &Recording, rest: [f64; 2], press: [f64; 2]) -> f64 {
    let (untouched, count) = r.mean(rest[0], rest[1]);
    let (pressed, _) = r.mean(press[0], press[1]);
    let square = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum::<f64>();
    let noise = r
        .within(rest[0], rest[1])
        .map(|f| square(&f.values_v, &untouched))
        .sum::<f64>()
        / (count as f64 - 1.0);
    10.0 * (square(&pressed, &untouched) / noise).log10()
}
