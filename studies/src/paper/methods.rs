//! One frame by one method: the paper's or ours.

use crate::paper::PaperError;
use crate::test_sheet::imager_for;
use forward::Drive;
use inverse::pipeline::{FrameResult, Reconstructor, ReconstructorOptions};
use inverse::reference::Reference;
use inverse::reference::imager::Imager;
use inverse::reference::noise::FrameNoise;
use inverse::solvers::Method;
use std::sync::Arc;

/// A method, ready for frames.
pub(super) struct Reader {
    pub(super) imager: Arc<Imager>,
    reconstructor: Reconstructor,
}

impl Reader {
    /// The imager of our method.
    pub(super) fn our_imager() -> Result<Arc<Imager>, PaperError> {
        Ok(imager_for(Method::Nnls, Drive::PAPER, 5.0)?)
    }

    /// The paper's: Lawson and Hanson's method on 20 mm elements with the sensitivity of a constant current.
    pub(super) fn theirs(baseline: &[f64]) -> Result<Self, PaperError> {
        Self::new(Method::LawsonHanson, 20.0, baseline)
    }

    /// Ours: non-negative least squares with a ridge on 5 mm cells, touches fitted to the measurements.
    pub(super) fn ours(baseline: &[f64]) -> Result<Self, PaperError> {
        Self::new(Method::Nnls, 5.0, baseline)
    }

    pub(super) fn new(method: Method, cell_mm: f64, baseline: &[f64]) -> Result<Self, PaperError> {
        let imager = imager_for(method, Drive::PAPER, cell_mm)?;
        let options = ReconstructorOptions::for_imager(&imager, method);
        let reference = Reference::new(Arc::clone(&imager), baseline.to_vec(), FrameNoise::Unknown)?;
        Ok(Self {
            reconstructor: Reconstructor::new(reference, options),
            imager,
        })
    }

    pub(super) fn read(&mut self, frame: &[f64]) -> Result<&mut FrameResult, PaperError> {
        Ok(self.reconstructor.frame(frame)?)
    }
}
