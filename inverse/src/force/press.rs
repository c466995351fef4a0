//! Records a press-and-hold from the frames of a running board.

use crate::force::recording::Sample;
use crate::pipeline::{Reconstructor, ReconstructorOptions};
use crate::reference::Reference;
use crate::reference::baseline::BaselineTaker;
use crate::reference::imager::{Imager, ImagerError};
use crate::reference::inspection::{InspectionOptions, inspect};
use crate::reference::noise::FrameNoise;
use crate::solvers::Method;
use crate::touches::touch::Touch;
use std::sync::Arc;

/// Thresholds of a [`Recorder`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RecorderOptions {
    /// Distance from the tip within which a touch is that of the tip, as a part of the sheet's width.
    ///
    /// More takes other touches for the tip's; less loses the tip where the fit is off. Chosen by hand.
    pub near: f64,
    /// Integrated rise of a new press, as a part of the largest so far.
    ///
    /// More leaves weak presses out of the recording; less takes a dent that was lost and found again for a press.
    /// Chosen by hand: a dent of rubber with the delayed ratio k is at most k / (1 + k) of its press, 0.25 for k = 1/3.
    pub again: f64,
}

impl Default for RecorderOptions {
    fn default() -> Self {
        Self {
            near: 0.25,
            again: 0.25,
        }
    }
}

/// Turns frames into samples.
///
/// The first frames are of the unpressed sheet and make the baseline. Every later frame is reconstructed for itself, so
/// that the noise of the samples is independent. (A live picture stands until it changes.)
pub struct Recorder {
    options: RecorderOptions,
    nominal: Arc<Imager>,
    taker: BaselineTaker,
    ready: Option<Reconstructor>,
    /// Half of the time over which a frame is measured, s.
    half_s: f64,
    near_mm: Option<[f64; 2]>,
    /// Largest integrated rise so far, mm².
    largest_mm2: f64,
    /// Whether the dent of that press was lost in the noise since.
    lost: bool,
    samples: Vec<Sample>,
}

impl Recorder {
    /// Waits for `baseline_frames` frames of the unpressed sheet.
    ///
    /// `frame_s` is the time that one frame takes, s. `near_mm` is where the tip presses; without it the strongest
    /// touch counts.
    pub fn new(imager: Arc<Imager>, baseline_frames: usize, frame_s: f64, near_mm: Option<[f64; 2]>) -> Self {
        Self {
            options: RecorderOptions::default(),
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

    /// The same with other thresholds.
    pub fn with_options(self, options: RecorderOptions) -> Self {
        Self { options, ..self }
    }

    /// Whether the baseline is taken.
    pub fn is_ready(&self) -> bool {
        self.ready.is_some()
    }

    /// Takes a frame: its beginning (s), its values (V), and the force of the gauge in its middle (N).
    ///
    /// # Errors
    /// [`ImagerError`] when the frame does not have the pattern's length.
    pub fn take(&mut self, time_s: f64, values_v: &[f64], force_n: f64) -> Result<(), ImagerError> {
        let Some(reconstructor) = &mut self.ready else {
            if let Some(baseline) = self.taker.take(values_v) {
                let inspection = inspect(&self.nominal, baseline, true, &InspectionOptions::default());
                let imager = Arc::clone(&inspection.imager);
                let options = ReconstructorOptions::for_imager(&imager, Method::Nnls).of_sequence();
                // The noise is estimated from every frame: a drift since the baseline counts as noise then.
                let reference = Reference::new(imager, inspection.baseline.values_v, FrameNoise::Unknown)?;
                self.ready = Some(Reconstructor::new(reference, options));
            }
            return Ok(());
        };
        let touches = &reconstructor.frame(values_v)?.touches;
        let reach = 2.0 * self.options.near * self.nominal.reach_mm();
        let off = |t: &&Touch| match self.near_mm {
            Some([x, y]) => (t.x_mm - x).hypot(t.y_mm - y),
            None => 0.0,
        };
        let pressed = touches.iter().filter(|t| off(t) < reach);
        let strongest = pressed.max_by(|a, b| a.total_mm2.total_cmp(&b.total_mm2));
        let total_mm2 = strongest.map_or(0.0, |t| t.total_mm2);
        // A dent that is no longer found is not 0. Of dents found after that only the larger ones are seen. No such
        // sample is used until the next press.
        let pressed_before = self.largest_mm2 > 0.0;
        self.largest_mm2 = self.largest_mm2.max(total_mm2);
        self.lost =
            (self.lost || pressed_before && strongest.is_none()) && total_mm2 < self.options.again * self.largest_mm2;
        self.samples.push(Sample {
            time_s: time_s + self.half_s,
            force_n,
            total_mm2,
            area_mm2: strongest.map(|t| t.area_mm2),
            used: !self.lost,
        });
        Ok(())
    }

    /// The middle of the time over which a frame is measured that began at `time_s`, s.
    pub fn middle_s(&self, time_s: f64) -> f64 {
        time_s + self.half_s
    }

    /// The samples so far, after the baseline.
    pub fn samples(&self) -> &[Sample] {
        &self.samples
    }

    /// The samples of the whole recording.
    pub fn into_samples(self) -> Vec<Sample> {
        self.samples
    }
}
