//! What is kept within a frame and from frame to frame.

use crate::touches::fit::disc::Discs;
use crate::touches::fit::fitter::Data;
use crate::touches::fit::frame_fit::{Fitted, Frame, Seeds, Start, fit};
use crate::touches::fit::linearisation_error::LinearisationError;
use crate::touches::fit::model_order::{Before, DiscModel, Scratch};

/// Touches that a search found, and their linearisation error where it was solved for.
#[derive(Clone, Debug, Default)]
pub(super) struct Found {
    pub(super) discs: Discs,
    pub(super) error: Option<LinearisationError>,
}

/// What is the same for all fits of a frame.
pub(super) struct Job<'a> {
    pub(super) data: Data<'a>,
    pub(super) chi_square_threshold: f64,
    /// Whether the next frame may go on with it.
    pub(super) hurried: bool,
    /// Number of the frame.
    pub(super) turn: usize,
    /// Evaluations in this frame at which the fits end.
    pub(super) until_evaluations: usize,
}

/// Which values are fitted.
#[derive(Clone, Copy)]
pub(super) enum Values {
    Measured,
    /// Without the linearisation error.
    Corrected,
}

/// Values without a linearisation error.
#[derive(Debug, Default)]
pub(super) struct Corrected {
    pub(super) error: Vec<f64>,
    pub(super) values: Vec<f64>,
    /// What was taken off, V.
    pub(super) volts: Vec<f64>,
}

impl Corrected {
    /// Takes `scale` times a linearisation error off the data. Returns the norm of what was taken off, over the noise.
    pub(super) fn take_off(&mut self, error: &LinearisationError, scale: f64, data: &mut Data) -> f64 {
        self.error.clear();
        data.reduction.reduce(error.volts(), &mut self.error);
        self.error.resize(data.values.len(), 0.0);
        self.values.clear();
        let values = data.values.iter().zip(&self.error).map(|(v, e)| v - scale * e);
        self.values.extend(values);
        self.volts.clear();
        self.volts.extend(error.volts().iter().map(|e| scale * e));
        scale * self.error.iter().map(|v| v * v).sum::<f64>().sqrt() / data.noise.sigma
    }
}

/// The nonlinear correction, carried from frame to frame.
#[derive(Debug, Default)]
pub(super) struct Carried {
    /// Linearisation error of the frame before, solved for in that frame or an earlier one; or of another fit of this frame.
    pub(super) error: Option<LinearisationError>,
    /// Unexplained misfit after the last failed solution for a mean, in variances of one frame's noise.
    pub(super) failed: Option<f64>,
}

/// The touches of the frame before, as far as the next frame goes on from them.
#[derive(Debug)]
pub(super) struct Followed {
    /// Whether the next frame is to follow them.
    pub(super) holds: bool,
    /// Frames so far.
    pub(super) turn: usize,
    /// Least unexplained misfit since the touches were searched for, in variances of one frame's noise.
    pub(super) least_unexplained: f64,
    /// The gain of the data in which that was found.
    pub(super) gain: f64,
    /// Frames one after another in which a search did not come to its end.
    pub(super) unfinished: usize,
    /// Touches that stood out in the frame before; 0 where it is not followed.
    pub(super) stood_out: usize,
}

impl Default for Followed {
    fn default() -> Self {
        Self {
            holds: false,
            turn: 0,
            least_unexplained: f64::INFINITY,
            gain: 1.0,
            unfinished: 0,
            stood_out: 0,
        }
    }
}

impl Followed {
    /// The misfit that data of this gain have if they are explained as well as the best before. `scatter` is that of
    /// the misfit of one frame: a mean determines it better.
    pub(super) fn least_misfit(&self, gain: f64, scatter: f64) -> f64 {
        let scatter = if gain > self.gain { scatter / self.gain } else { 0.0 };
        1.0 + gain * (self.least_unexplained + scatter)
    }

    /// Notes the outcome of a frame.
    pub(super) fn note(&mut self, data: &Data, fitted: &Fitted, explained: bool, least_significance: f64) {
        let unexplained = data.unexplained(fitted.misfit);
        if !(fitted.followed && self.least_unexplained <= unexplained) {
            (self.least_unexplained, self.gain) = (unexplained, data.gain);
        }
        self.unfinished = if fitted.finished { 0 } else { self.unfinished + 1 };
        self.holds = explained || !fitted.finished;
        self.stood_out = if self.holds {
            fitted.standing_out(least_significance).count()
        } else {
            0
        };
    }

    /// Begins anew with the next frame.
    pub(super) fn forget(&mut self) {
        (self.holds, self.stood_out) = (false, 0);
    }
}

/// The last two fits.
#[derive(Debug, Default)]
pub(super) struct Fits {
    pub(super) now: Fitted,
    pub(super) before: Fitted,
}

impl Fits {
    pub(super) fn with_room(stride: usize, most: usize) -> Self {
        let fitted = || Fitted::with_room(stride, most);
        Self {
            now: fitted(),
            before: fitted(),
        }
    }

    /// Forgets both.
    pub(super) fn forget(&mut self) {
        self.now.forget();
        self.before.forget();
    }

    /// Fits a frame from these places, or from the touches fitted last. With a misfit, the touches fitted last are
    /// followed as long as the frame's misfit is about as small.
    pub(super) fn fit(
        &mut self,
        model: DiscModel,
        frame: Frame,
        seeds: Option<Seeds>,
        least_misfit: Option<f64>,
        turn: usize,
        scratch: &mut Scratch,
    ) -> Option<()> {
        std::mem::swap(&mut self.before, &mut self.now);
        let from = &self.before;
        let follow = |misfit| Before {
            discs: &from.all,
            misfit,
            finished: from.finished,
            turn,
        };
        let mut those = || Some(from.discs.clone());
        let start = Start {
            seeds: match seeds {
                Some(seeds) => seeds,
                None => &mut those,
            },
            before: least_misfit.map(follow),
        };
        fit(model, frame, start, scratch, &mut self.now)
    }
}

/// What is kept from frame to frame of fits that are not in use.
#[derive(Debug, Default)]
pub(super) struct Aside {
    pub(super) carried: Carried,
    pub(super) followed: Followed,
    pub(super) fits: Fits,
    pub(super) corrected: Corrected,
}
