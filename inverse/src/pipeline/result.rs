//! What became of a frame.

use crate::quality::doubt::Doubt;
use crate::reference::Drift;
use crate::reference::diagnosis::Fault;
use crate::reference::drift::DriftNotice;
use crate::reference::imager::Imager;
use crate::reference::noise::NoiseEstimate;
use crate::solvers::Status;
use crate::touches::touch::Touch;

/// What became of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameResult {
    /// Relative rise in resistivity of every cell; all zero when the gate found nothing. That of an earlier frame where
    /// [`FrameResult::is_pictured`] says so.
    pub x: Vec<f64>,
    /// Whether [`FrameResult::x`] is of these values. Touches that explain a frame of a sequence need no picture
    /// ([`Live::picture`](crate::live::Live::picture)).
    pub is_pictured: bool,
    /// Touches, strongest first.
    pub touches: Vec<Touch>,
    /// Part of the change that stays unexplained, 0 to 1: by the touches, where they explain a frame of a sequence, else by the picture.
    pub residual: f64,
    /// The picture's proof: relative KKT residual of the problem that was solved, which leaves out the directions below
    /// [`ReconstructorOptions::drop_below_ridge`](crate::pipeline::ReconstructorOptions::drop_below_ridge); 0 where none was made.
    pub gap: f64,
    /// Time of the picture's solve, us; 0 where none was made.
    pub solve_us: f64,
    /// Noise of one value, V of the model, and how it is known; of the mean where the result is of several frames. None where
    /// nothing was looked for and nothing tells it.
    pub noise: Option<NoiseEstimate>,
    /// Of how many frames one after another, in which nothing changed, this is the mean's result.
    pub frames: usize,
    /// Whether frames of the result before are among them.
    pub grown: bool,
    /// How many values took part.
    pub used: usize,
    /// Values of this frame that have nothing to do with the others, and took no part (places in the pattern).
    pub rejected: Vec<usize>,
    /// Whether there was a change above the noise.
    pub changed: bool,
    /// How the solve ended.
    pub status: Status,
    /// Mean squared misfit of the touches' fit, in variances of the noise; none where the touches are the picture's peaks
    /// because discs do not explain the frame.
    pub misfit: Option<f64>,
    /// Part of the change's square that its touches take, 0 to 1, where discs do not explain the frame. Those that have no place are not
    /// listed, and count.
    pub explained: Option<f64>,
    /// Whether touches that stand out together explain the change, and none of them is listed: none stands out alone and has a place.
    pub unplaced: bool,
    /// What speaks against the touches.
    pub doubt: Option<Doubt>,
    /// What drifted since the baseline. It is taken out of the frame, and touches are right beside it.
    pub drift: Drift,
    /// What is known to be broken. Values that it spoils are left out; where that leaves no touches, it is the doubt.
    pub faults: Vec<Fault>,
    /// Electrodes whose contact changed since the baseline, and whose doing was taken out of the frame.
    pub contacts: Vec<usize>,
    /// Whether this frame was reconstructed. Otherwise the rest is an earlier one's result: it differs from that by nothing but noise, or
    /// its time went into what the next one is solved with, and it is doubted.
    pub anew: bool,
}

impl FrameResult {
    /// The result of a frame in which nothing was looked for.
    pub fn nothing(imager: &Imager) -> Self {
        Self {
            x: vec![0.0; imager.grid.len()],
            is_pictured: true,
            touches: Vec::new(),
            residual: 0.0,
            gap: 0.0,
            solve_us: 0.0,
            noise: None,
            frames: 1,
            grown: false,
            used: 0,
            rejected: Vec::new(),
            changed: false,
            status: Status::Converged,
            misfit: None,
            explained: None,
            unplaced: false,
            doubt: None,
            drift: Drift::none(),
            faults: Vec::new(),
            contacts: Vec::new(),
            anew: true,
        }
    }

    /// What a person is told of the drift; nothing where touches do not explain the frame: what is found beside them is then
    /// perhaps none.
    pub fn notice(&self) -> Option<DriftNotice> {
        let explained = self.doubt.is_none() && (self.misfit.is_some() || !self.changed);
        self.drift.notice().filter(|_| explained)
    }

    /// Makes it another, without allocation where that is no larger.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        let Self {
            x,
            touches,
            drift,
            contacts,
            faults,
            rejected,
            ..
        } = self;
        x.clone_from(&other.x);
        touches.clone_from(&other.touches);
        contacts.clone_from(&other.contacts);
        faults.clone_from(&other.faults);
        rejected.clone_from(&other.rejected);
        drift.copy_from(&other.drift);
        let (x, touches) = (std::mem::take(x), std::mem::take(touches));
        let (drift, contacts) = (std::mem::take(drift), std::mem::take(contacts));
        let (faults, rejected) = (std::mem::take(faults), std::mem::take(rejected));
        *self = Self {
            x,
            touches,
            drift,
            contacts,
            faults,
            rejected,
            ..*other
        };
    }

    /// Makes it the result of a frame in which there was nothing.
    pub(crate) fn clear(&mut self, noise: Option<NoiseEstimate>, used: usize) {
        self.anew = self.changed;
        if self.changed {
            self.x.fill(0.0);
            self.is_pictured = true;
            self.touches.clear();
            (self.residual, self.gap, self.solve_us) = (0.0, 0.0, 0.0);
            (self.changed, self.status, self.misfit, self.explained) = (false, Status::Converged, None, None);
        }
        (self.noise, self.used, self.doubt) = (noise, used, None);
        (self.frames, self.grown, self.unplaced) = (1, false, false);
        self.contacts.clear();
        self.faults.clear();
        self.rejected.clear();
        self.drift.clear();
    }
}
