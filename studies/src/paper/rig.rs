//! The bench of the experiments: a skin behind a serial port, a tip with a force gauge, and a recorder of frames.

use crate::paper::PaperError;
use forward::Pattern;
use link::{MeasuredFrame, Port, Session};
use protocol::Plan;
use std::time::Duration;

/// What presses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tip {
    /// A flat round tip.
    Disc,
    /// A finger: half of its pressure at the radius.
    Finger,
}

/// One press and its way in time.
#[derive(Clone, Debug, PartialEq)]
pub struct Press {
    /// Its shape.
    pub tip: Tip,
    /// Its radius, mm.
    pub radius_mm: f64,
    /// Time (s), x and y (mm) and force (N), by rising time. There is no press before the first entry and after the
    /// last.
    pub path: Vec<[f64; 4]>,
}

impl Press {
    /// The paper's tip of 25 mm at a place, with the force going through these (time s, N).
    pub fn tip(at: [f64; 2], forces: &[[f64; 2]]) -> Self {
        Self {
            tip: Tip::Disc,
            radius_mm: 12.5,
            path: forces.iter().map(|[t, f]| [*t, at[0], at[1], *f]).collect(),
        }
    }
}

/// A skin ready to be measured.
pub struct Mounted {
    /// The board's port. Time passes as it is read.
    pub port: Box<dyn Port>,
    /// Reading of the gauge above the skin at a time of the board (s): the force of all presses, N.
    pub gauge: Box<dyn Fn(f64) -> f64 + Send>,
}

/// Why there is no skin.
pub type RigError = Box<dyn std::error::Error + Send + Sync>;

/// A source of skins.
pub trait Rig: Sync {
    /// A new skin under these presses, of rubber that creeps or of rubber that does not.
    ///
    /// # Errors
    /// Why there is none.
    fn mount(&self, presses: &[Press], creeps: bool, seed: u64) -> Result<Mounted, RigError>;

    /// True creep of the skin, if the rig knows: delayed ratio, time constant (s), unit rise (MPa).
    fn creep(&self) -> Option<[f64; 3]> {
        None
    }
}

/// Frames of one plan.
pub struct Recording {
    /// The plan.
    pub plan: Plan,
    /// The measurements of a frame.
    pub pattern: Pattern,
    /// The frames; `time_s` is when their first sample was taken.
    pub frames: Vec<MeasuredFrame>,
    /// Time from one frame to the next, s. Once a second the board measures its source in between, which is no part of it.
    pub interval_s: f64,
    /// Bytes of a frame on the wire, with all that comes between frames.
    pub bytes_per_frame: f64,
    /// Frames lost on the way.
    pub lost: u64,
    /// Readings of the gauge, N.
    pub gauge: Box<dyn Fn(f64) -> f64 + Send>,
}

/// Longest wait for a frame, in wall time.
const SILENCE: Duration = Duration::from_secs(60);

impl Recording {
    /// Measures a skin by a plan until the board's time `until_s`.
    ///
    /// # Errors
    /// [`PaperError`]: the skin, its board or the link.
    pub fn make(skin: Mounted, plan: &Plan, until_s: f64) -> Result<Self, PaperError> {
        let Mounted { port, gauge } = skin;
        let session = Session::start(port, |_| Ok(plan.clone()))?;
        let mut frames: Vec<MeasuredFrame> = Vec::new();
        while frames.last().is_none_or(|f| f.time_s < until_s) {
            match session.frame(SILENCE)? {
                Some(frame) => frames.push(frame),
                None => return Err(PaperError::Silent),
            }
        }
        let counters = session.link().counters();
        let intervals = frames.windows(2).map(|pair| {
            let count = pair[1].sequence.wrapping_sub(pair[0].sequence).max(1);
            (pair[1].time_s - pair[0].time_s) / f64::from(count)
        });
        let shortest_s = intervals.fold(f64::INFINITY, f64::min);
        Ok(Self {
            interval_s: if shortest_s.is_finite() { shortest_s } else { 0.0 },
            bytes_per_frame: counters.bytes as f64 / counters.frames.max(1) as f64,
            lost: counters.lost_frames,
            pattern: Pattern::from_pairs(session.electrodes(), session.measurements())?,
            plan: session.plan().clone(),
            frames,
            gauge,
        })
    }

    /// The middle of the time over which a frame was measured, s.
    pub fn middle_s(&self, frame: &MeasuredFrame) -> f64 {
        frame.time_s + 0.5 * self.interval_s
    }

    /// The frames that were measured completely between two times, s.
    pub fn within(&self, from_s: f64, to_s: f64) -> impl Iterator<Item = &MeasuredFrame> {
        self.frames
            .iter()
            .filter(move |f| f.time_s >= from_s && f.time_s + self.interval_s <= to_s)
    }

    /// The mean frame between two times, V, and how many there are.
    pub fn mean(&self, from_s: f64, to_s: f64) -> (Vec<f64>, usize) {
        let mut sum = vec![0.0; self.pattern.len()];
        let mut count = 0;
        for frame in self.within(from_s, to_s) {
            count += 1;
            for (s, v) in sum.iter_mut().zip(&frame.values_v) {
                *s += v;
            }
        }
        (sum.iter().map(|s| s / count as f64).collect(), count)
    }
}
