//! Thresholds of the fitter.

use crate::touches::fit::linearisation_error::ErrorGrowth;
use crate::touches::fit::model_order::ModelOrderOptions;

/// When the linear model is corrected, when touches are followed, and when they explain a frame.
///
/// Norms and errors of a whole frame are in standard deviations of the noise of one value. Where a field names no
/// experiment, none is on record: the value was chosen by hand, on the seeds that docs/results.md names. What all give
/// together is `cargo run --release -p studies --example touch_accuracy`; what the corrections cost is the column
/// `median` of `skin bench cost`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitterOptions {
    /// Relative error of the linear model before anything is known of the touches, 0 to 1. More adds no touch for the
    /// linearisation error of strong ones, and finds fewer weak touches beside these.
    pub linear_error: f64,
    /// Norm of `linear_error` of a frame from which that error is taken to show. Less is careful with weaker frames, at
    /// the cost of a second fit.
    pub linear_error_shows: f64,
    /// Norm of the expected linearisation error that is worth a nonlinear solution. Less solves more often, 5 ms each.
    /// At 27 dB a touch of +20 % alone is below, two side by side are above.
    pub worth_a_solution: f64,
    /// How many times its estimate the linearisation error may be. Less solves for fewer frames that touches do not explain, and leaves
    /// some uncorrected that they would.
    pub error_estimate: f64,
    /// Norm of the error of a carried linearisation error before it is solved for anew. It is less than
    /// `worth_a_solution`, because all of it may lie along one touch's move.
    pub carried_error: f64,
    /// Part of `worth_a_solution` from which a linearisation error goes on being carried. Below 1, so that touches at
    /// the limit do not switch from frame to frame.
    pub still_worth: f64,
    /// Most solutions of a frame that cannot leave its correction to the next. More lets the totals of strong touches
    /// settle further.
    pub most_rounds: usize,
    /// Relative change of the integrated rises from one solution to the next that ends them. Less takes more rounds.
    pub settled: f64,
    /// A new solution for a mean of frames failed if it leaves more than this misfit, and more than `failed_part` of
    /// the misfit before: the touches are no discs.
    pub failed_misfit: f64,
    /// See `failed_misfit`.
    pub failed_part: f64,
    /// After a failed solution there is no other while the unexplained misfit is at most this many times what it was
    /// then.
    pub failed_until: f64,
    /// By how much the misfit of one frame scatters: three standard deviations. More follows touches that explain a
    /// mean less well than they explained its first frame.
    pub misfit_scatter: f64,
    /// Frames one after another whose search may be cut short. The next frame's has no limit.
    pub most_unfinished: usize,
    /// Least strength of a touch, in its standard deviations. What drift may have made is part of these. 4.2 is the quantile for
    /// one false touch in 1,000 frames anywhere on the paper's disc, which has room for 60 fingertips.
    pub least_significance: f64,
    /// Contrast of a disc above which one touch in place of two is tried: a rise of seven.
    pub too_strong: f64,
    /// Mean square misfit, in noise variances of one frame, up to which discs explain a frame. More shows discs where
    /// something else presses; less falls back to the picture's peaks, without an uncertainty.
    pub most_misfit: f64,
    /// Norm of the residual over that of the data up to which discs explain a frame, whatever the noise. As
    /// `most_misfit`.
    pub most_residual: f64,
    /// How many times the norm that discs may leave a picture may. Where it leaves more by `most_misfit` and by `most_residual`, no touches
    /// are looked for. Less saves searches, and gives up frames of strong touches.
    pub most_of_picture: f64,
    /// How the number of touches is chosen.
    pub order: ModelOrderOptions,
    /// When a carried linearisation error is no longer that of the touches.
    pub growth: ErrorGrowth,
}

impl FitterOptions {
    /// Whether discs explain a frame that they leave this misfit of, by the noise alone; `gain` is that of a mean.
    pub(crate) fn explains(&self, misfit: f64, gain: f64) -> bool {
        misfit <= gain * self.most_misfit
    }

    /// Whether discs may explain a frame of which a picture leaves this misfit, and this part of the norm: it is free to show any disc. Of
    /// discs that were fitted the same is asked before more is done with them.
    pub(crate) fn may_explain(&self, misfit: f64, residual: f64, gain: f64) -> bool {
        let most = self.most_of_picture;
        self.explains(misfit / most.powi(2), gain) || residual <= most * self.most_residual
    }
}

impl Default for FitterOptions {
    fn default() -> Self {
        Self {
            linear_error: 0.02,
            linear_error_shows: 9.0,
            worth_a_solution: 4.2,
            error_estimate: 2.0,
            carried_error: 1.5,
            still_worth: 0.7,
            most_rounds: 4,
            settled: 0.01,
            failed_misfit: 1.5,
            failed_part: 0.8,
            failed_until: 1.5,
            misfit_scatter: 0.4,
            most_unfinished: 8,
            least_significance: 4.2,
            too_strong: 1.55,
            most_misfit: 4.0,
            most_residual: 0.06,
            most_of_picture: 5.0,
            order: ModelOrderOptions::default(),
            growth: ErrorGrowth::default(),
        }
    }
}
