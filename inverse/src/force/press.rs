//! Takes a press-and-hold from a running board.

use crate::force::recording::Sample;
use crate::pipeline::{Reconstructor, ReconstructorOptions};
use crate::reference::Reference;
use crate::reference::baseline::BaselineTaker;
use crate::reference::electrode_fit;
use crate::reference::imager::{Imager, ImagerError};
use crate::reference::noise::FrameNoise;
use crate::solvers::Method;
use std::sync::Arc;

/// Turns frames into samples: the first ones of the unpressed sheet into the baseline, then every frame for itself, so that
/// the samples' noise is independent (a live picture stands until it changes).
pub struct Recorder {
    nominal: Arc<Imager>,
    taker: BaselineTaker,
    ready: Option<Reconstructor>,
    /// Half of the time over which a frame is measured, s.
    half_s: f64,
    near_mm: Option<[f64; 2]>,
    /// Largest integrated rise so far, mm², and whether the dent of that press was lost in the noise since.
    largest_mm2: f64,
    lost: bool,
    samples: Vec<Sample>,
}

/// A touch this far from where the tip is, as a part of the sheet, is another.
const NEAR: f64 = 0.25;

/// A touch of this part of the largest so far is another press.
const AGAIN: f64 = 0.25;

impl Recorder {
    /// Waits for `baseline_frames` frames of the unpressed sheet. `frame_s` is how long one takes; `near_mm` where the tip
    /// is, else the strongest touch counts.
    pub fn new(imager: Arc<Imager>, baseline_frames: usize, frame_s: f64, near_mm: Option<[f64; 2]>) -> Self {
        Self {
            taker: BaselineTaker::new(imager.pattern.len(), baseline_frames),
            nominal: imager,
            ready: None,
            half_s: 0.5 * frame_s,
            near_mm,
            largest_mm2: 0.0,
            lost: false,
            samples: Vec::new(),
        }
    }

    /// Whether the baseline is taken.
    pub fn is_ready(&self) -> bool {
        self.ready.is_some()
    }

    /// Takes a frame: when it began (s), its values (V), and the force that the gauge showed in its middle (N).
    ///
    /// # Errors
    /// [`ImagerError`] when the frame does not have the pattern's length.
    pub fn take(&mut self, time_s: f64, values_v: &[f64], force_n: f64) -> Result<(), ImagerError> {
        let Some(reconstructor) = &mut self.ready else {
            if let Some(baseline) = self.taker.take(values_v) {
                let found = electrode_fit::find(&self.nominal, &baseline.values_v);
                let imager = found.map_or_else(|| Arc::clone(&self.nominal), |f| Arc::new(f.imager));
                let options = ReconstructorOptions::for_imager(&imager, Method::Nnls).of_sequence();
                // The noise is estimated from every frame: a drift since the baseline counts as noise then.
                let reference = Reference::new(imager, baseline.values_v, FrameNoise::Unknown)?;
                self.ready = Some(Reconstructor::new(reference, options));
            }
            return Ok(());
        };
        let touches = &reconstructor.frame(values_v)?.touches;
        let reach = 2.0 * NEAR * self.nominal.reach_mm();
        let off = |t: &&crate::touches::touch::Touch| match self.near_mm {
            Some([x, y]) => (t.x_mm - x).hypot(t.y_mm - y),
            None => 0.0,
        };
        let pressed = touches.iter().filter(|t| off(t) < reach);
        let strongest = pressed.max_by(|a, b| a.total_mm2.total_cmp(&b.total_mm2));
        let total_mm2 = strongest.map_or(0.0, |t| t.total_mm2);
        // A dent that is no longer found is not 0, and of those found after that only the larger ones are seen: none of
        // them is used until the next press.
        let pressed_before = self.largest_mm2 > 0.0;
        self.largest_mm2 = self.largest_mm2.max(total_mm2);
        self.lost = (self.lost || pressed_before && strongest.is_none()) && total_mm2 < AGAIN * self.largest_mm2;
        self.samples.push(Sample {
            time_s: time_s + self.half_s,
            force_n,
            total_mm2,
            area_mm2: strongest.map(|t| t.area_mm2),
            used: !self.lost,
        });
        Ok(())
    }

    /// The middle of the time over which a frame that began then (s) is measured, s.
    pub fn middle_s(&self, time_s: f64) -> f64 {
        time_s + self.half_s
    }

    /// What was taken so far, after the baseline.
    pub fn samples(&self) -> &[Sample] {
        &self.samples
    }

    /// The recording.
    pub fn into_samples(self) -> Vec<Sample> {
        self.samples
    }
}
