//! A table of frames to pictures: baseline from some of its frames, then every other frame in order.

mod at_once;
mod recovery;

use crate::force::meter::{Calibration, ForceMeter};
use crate::pipeline::{FrameResult, Reconstructor, ReconstructorOptions};
use crate::quality::doubt::Doubt;
use crate::reference::Reference;
use crate::reference::baseline::Baseline;
use crate::reference::imager::{Imager, ImagerError};
use crate::reference::inspection::{Inspection, InspectionOptions, inspect};
use crate::reference::moved;
use crate::reference::noise::FrameNoise;
use crate::solvers::Method;
use crate::touches::polarity::Polarity;
use crate::touches::touch::Touch;
pub use recovery::{OwnFrame, Recovery};
use std::sync::Arc;

/// How a table is reconstructed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BatchOptions {
    /// The solver.
    pub method: Method,
    /// Which way touches change the resistivity; none where the frames say it.
    pub polarity: Option<Polarity>,
    /// Whether anything may have drifted since the baseline: not where every frame has its own.
    pub drifts: bool,
    /// Whether the electrodes are looked for in the baseline, or taken to be where the sheet says.
    pub find_electrodes: bool,
    /// Time from a frame to the next, s, where they follow one another; none where nothing says so.
    pub interval_s: Option<f64>,
    /// What the forces of the touches are computed with, for frames that follow one another; none: no forces.
    pub calibration: Option<Calibration>,
    /// Fewest baseline frames that tell the noise. Of fewer a drift looks like noise.
    pub noise_frames: usize,
}

impl BatchOptions {
    /// Defaults for a method: frames that have nothing to do with each other, electrodes looked for by the one that fits.
    pub fn of(method: Method) -> Self {
        Self {
            method,
            polarity: None,
            drifts: true,
            find_electrodes: method == Method::Nnls,
            interval_s: None,
            calibration: None,
            noise_frames: 8,
        }
    }
}

/// Reconstructs the frames of one table.
pub struct Batch {
    reconstructor: Reconstructor,
    /// What the baseline is worth, and what it said of the electrodes.
    inspection: Inspection,
    how: ReconstructorOptions,
    /// Whether the baseline is of enough frames to tell the noise.
    tells_noise: bool,
    interval_s: Option<f64>,
    meter: Option<ForceMeter>,
}

fn reconstructor(
    inspection: &Inspection,
    how: ReconstructorOptions,
    tells_noise: bool,
) -> Result<Reconstructor, ImagerError> {
    let (imager, baseline) = (Arc::clone(&inspection.imager), &inspection.baseline);
    let reference = if tells_noise {
        Reference::of(imager, baseline)?
    } else {
        Reference::new(imager, baseline.values_v.clone(), FrameNoise::Unknown)?
    };
    Ok(Reconstructor::new(reference, how).after(inspection.fault))
}

/// How far the sheet moved between two of two or three frames, as [`Baseline::moved`] has it: their scatter tells no noise, but exchanged
/// pairs do. So each is reconstructed with the first as its baseline, and the sheet moved where that shows anything.
fn moved_of_few(inspection: &Inspection, how: ReconstructorOptions, frames: &[&[f64]]) -> Result<f64, ImagerError> {
    let (imager, of) = (&inspection.imager, &inspection.baseline);
    let known: Vec<&[f64]> = (frames.iter().copied())
        .filter(|frame| frame.iter().any(|v| v.is_finite()))
        .collect();
    let [first, others @ ..] = &known[..] else {
        return Ok(0.0);
    };
    if others.is_empty() || known.len() >= moved::FEWEST_FRAMES || inspection.fault.is_some() {
        return Ok(0.0);
    }
    // What is left out of the baseline tells nothing.
    let left = first.iter().zip(&of.values_v);
    let first: Vec<f64> = left.map(|(v, of)| if of.is_finite() { *v } else { f64::NAN }).collect();
    let reference = Reference::new(Arc::clone(imager), first, FrameNoise::Unknown)?;
    let mut reconstructor = Reconstructor::new(reference.clone(), how);
    let mut most = 0.0_f64;
    for other in others {
        let result = reconstructor.frame(other)?;
        let shows = !result.touches.is_empty() || result.doubt.is_some() || !result.faults.is_empty();
        let (Some(noise), true) = (result.noise, result.changed && shows) else {
            continue;
        };
        let d = reference.difference(other)?;
        let sds = moved::beyond_gain(&d, &imager.model_v) / noise.sigma;
        if sds >= moved::LEAST_MOVED {
            most = most.max(sds);
        }
    }
    Ok(most.min(f64::MAX))
}

impl Inspection {
    /// The result of a frame after this baseline.
    fn doubted(&self, mut result: FrameResult) -> FrameResult {
        let moved = (self.baseline.moved > 0.0).then_some(Doubt::MovedBaseline);
        let unlike = (!self.conclusive).then_some(Doubt::OtherSheet);
        result.doubt = result.doubt.or(moved).or(unlike);
        result
    }
}

impl Batch {
    /// Takes frames of the unpressed sheet (any unit, in the pattern's order; not a number where a value is missing) as the
    /// baseline.
    ///
    /// # Errors
    /// [`ImagerError::Baseline`] when a frame does not have the pattern's length.
    pub fn new(imager: Arc<Imager>, unpressed: &[&[f64]], options: BatchOptions) -> Result<Self, ImagerError> {
        let mut baseline = Baseline::of_frames(imager.pattern.len(), unpressed);
        // Each frame has its own baseline, and these were taken hours apart.
        let are_apart = options.noise_frames == usize::MAX;
        if are_apart {
            baseline.moved = 0.0;
        }
        let mut inspection = inspect(
            &imager,
            baseline,
            options.find_electrodes,
            &InspectionOptions::default(),
        );
        let of_frames = ReconstructorOptions::for_imager(&inspection.imager, options.method);
        if !are_apart && of_frames.fit.is_some() {
            inspection.note_moved(moved_of_few(&inspection, of_frames, unpressed)?);
        }
        let (imager, baseline) = (&inspection.imager, &inspection.baseline);
        let how = ReconstructorOptions {
            polarity: options.polarity,
            drifts: options.drifts,
            sequence: options.interval_s.is_some(),
            ..of_frames
        };
        let meter = options.calibration.map(|c| ForceMeter::new(imager, c));
        let tells_noise = baseline.frames >= options.noise_frames;
        Ok(Self {
            reconstructor: reconstructor(&inspection, how, tells_noise)?,
            inspection,
            how,
            tells_noise,
            interval_s: options.interval_s,
            meter,
        })
    }

    /// The model in use: with the electrodes where the baseline showed them to be.
    pub fn imager(&self) -> &Arc<Imager> {
        self.reconstructor.imager()
    }

    /// What the baseline was found to be worth, with the electrodes where they were looked for and found.
    pub fn inspection(&self) -> &Inspection {
        &self.inspection
    }

    /// Passes over the baseline frame at this place of the table: nothing pressed then, so that what presses in the next
    /// frame came down since.
    pub fn pass_over(&mut self, place: usize) {
        if let (Some(meter), Some(interval_s)) = (&mut self.meter, self.interval_s) {
            meter.update(place as f64 * interval_s, &mut []);
        }
    }

    /// Reconstructs the frame at this place of the table. After a baseline that is not that of the sheet as described, or of one that
    /// moved meanwhile, each is doubted.
    ///
    /// # Errors
    /// [`ImagerError::Baseline`] when it does not have the pattern's length.
    pub fn frame(&mut self, place: usize, values: &[f64]) -> Result<FrameResult, ImagerError> {
        let mut result = self.reconstructor.frame_after(values, self.interval_s)?.clone();
        if let (Some(meter), Some(interval_s)) = (&mut self.meter, self.interval_s) {
            meter.update(place as f64 * interval_s, &mut result.touches);
            result.touches.retain(Touch::is_pressed);
        }
        Ok(self.inspection.doubted(result))
    }
}
