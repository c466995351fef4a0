//! A test sheet whose frames are a sequence with known noise.

use crate::error::StudyError;
use crate::scene::rng;
use crate::test_sheet::{TestSheet, imager, noise_v, noisy};
use forward::{Drive, ForwardError};
use inverse::pipeline::{FrameResult, Reconstructor};
use inverse::reference::noise::FrameNoise;
use rand::rngs::StdRng;

/// Ratio of signal to noise that sets the noise, dB.
const SNR_DB: f64 = 27.0;

/// A test sheet without errors, with cells of 5 mm and a live reconstructor that knows the noise.
pub struct LiveSheet {
    /// The sheet.
    pub sheet: TestSheet,
    /// The reconstructor for the frames of the sheet.
    pub reconstructor: Reconstructor,
    /// Standard deviation of the noise of a value, V.
    pub sigma: f64,
    /// The source of the noise, and of what a study draws between the frames.
    pub rng: StdRng,
}

impl LiveSheet {
    /// Takes the noise at which the frame that `loud` returns, V without noise, has 27 dB.
    ///
    /// # Errors
    /// [`StudyError`] where the model of `loud` has no solution.
    pub fn new(
        drive: Drive,
        seed: u64,
        loud: impl FnOnce(&mut TestSheet, &mut StdRng) -> Result<Vec<f64>, ForwardError>,
    ) -> Result<Self, StudyError> {
        let mut rng = rng(seed);
        let imager = imager(drive, 5.0)?;
        let mut sheet = TestSheet::new(&imager, drive, 0.0, 0.0, &mut rng)?;
        let clean = loud(&mut sheet, &mut rng)?;
        let sigma = noise_v(&clean, &sheet.baseline, SNR_DB);
        let reconstructor = sheet.live_reconstructor(FrameNoise::of_frames(sigma))?;
        Ok(Self {
            sheet,
            reconstructor,
            sigma,
            rng,
        })
    }

    /// Adds the noise to a frame, V.
    pub fn frame(&mut self, clean: &[f64]) -> Vec<f64> {
        noisy(clean.to_vec(), self.sigma, &mut self.rng)
    }

    /// A frame of the untouched sheet with the noise, V.
    pub fn empty(&mut self) -> Vec<f64> {
        self.sheet.empty(self.sigma, &mut self.rng)
    }

    /// Adds the noise to a frame, V, and reconstructs it.
    ///
    /// # Errors
    /// [`StudyError`] where the frame does not have the length of the pattern.
    pub fn reconstruct(&mut self, clean: &[f64]) -> Result<&FrameResult, StudyError> {
        let frame = self.frame(clean);
        Ok(self.reconstructor.frame(&frame)?)
    }
}
