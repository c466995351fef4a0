//! One frame by one method, as the paper would and as we do.

use crate::paper::PaperError;
use crate::scenes;
use forward::Drive;
use inverse::pipeline::reconstructor::{FrameResult, Reconstructor, ReconstructorOptions};
use inverse::reference::imager::Imager;
use inverse::solvers::Method;
use std::sync::Arc;

/// A method, ready.
pub(super) struct Reader {
    pub(super) imager: Arc<Imager>,
    reconstructor: Reconstructor,
}

impl Reader {
    /// The paper's: Lawson and Hanson's method on 20 mm elements with the sensitivity of a constant current.
    pub(super) fn theirs() -> Result<Self, PaperError> {
        Self::new(Method::LawsonHanson, 20.0)
    }

    /// Ours: non-negative least squares with a ridge on 5 mm cells, touches fitted to the measurements.
    pub(super) fn ours() -> Result<Self, PaperError> {
        Self::new(Method::Nnls, 5.0)
    }

    pub(super) fn new(method: Method, cell_mm: f64) -> Result<Self, PaperError> {
        let imager = scenes::imager_for(method, Drive::PAPER, cell_mm)?;
        let options = ReconstructorOptions::for_imager(&imager, method);
        Ok(Self {
            reconstructor: Reconstructor::new(Arc::clone(&imager), options),
            imager,
        })
    }

    pub(super) fn read(&mut self, baseline: &[f64], frame: &[f64]) -> Result<&mut FrameResult, PaperError> {
        Ok(self.reconstructor.frame(baseline, frame)?)
    }
}
