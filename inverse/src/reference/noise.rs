//! The noise of a value, and how it is known.

/// Degrees of freedom from which a variance is as good as known: quantiles do not change beyond.
const KNOWN_FREEDOM: f64 = 1e7;

/// Where the size of the noise comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoiseSource {
    /// Measured on the unpressed sheet, over so many values that nothing of it is uncertain.
    Known,
    /// Estimated from the frame itself.
    Estimated {
        /// Degrees of freedom of the estimate.
        freedom: usize,
    },
    /// Estimated from the part of the frame that touches hardly reach: few or no pairs of the pattern are reciprocal.
    Residual {
        /// Degrees of freedom of the estimate.
        freedom: usize,
    },
}

impl NoiseSource {
    /// Degrees of freedom, for the quantiles of tests: 1 to 10 million.
    pub fn freedom(self) -> f64 {
        match self {
            Self::Known => KNOWN_FREEDOM,
            Self::Estimated { freedom } | Self::Residual { freedom } => (freedom as f64).clamp(1.0, KNOWN_FREEDOM),
        }
    }
}

/// The noise of one value of a difference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseEstimate {
    /// Standard deviation, V of the model.
    pub sigma: f64,
    /// How it is known.
    pub source: NoiseSource,
}

/// What is known of the noise before a frame comes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum FrameNoise {
    /// Nothing: it is estimated from every frame, by reciprocity.
    #[default]
    Unknown,
    /// It was measured on the unpressed sheet.
    Known {
        /// Standard deviation of one value in one frame, in the baseline's unit.
        sigma: f64,
        /// Number of frames averaged into the baseline. Its noise is common to all frames, so averaging frames at rest
        /// does not reduce it. None for a baseline without noise.
        baseline_frames: Option<usize>,
    },
}

impl FrameNoise {
    /// Noise of this standard deviation (the baseline's unit) in every frame, and none in the baseline.
    pub fn of_frames(sigma: f64) -> Self {
        Self::Known {
            sigma,
            baseline_frames: None,
        }
    }
}
