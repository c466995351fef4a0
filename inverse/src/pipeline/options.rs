//! How frames are turned into pictures.

use crate::change::ChangeOptions;
use crate::quality::contact::ContactOptions;
use crate::quality::doubt::DoubtOptions;
use crate::quality::faults::FaultOptions;
use crate::reference::drift::LEAST_GAIN;
use crate::reference::imager::Imager;
use crate::solvers::Method;
use crate::touches::fit::FitOptions;
use crate::touches::fit::fitter_options::FitterOptions;
use crate::touches::peaks::TouchOptions;
use crate::touches::polarity::Polarity;

/// Frames of more values have many directions that no board tells from nothing, and that take memory and time: 16 electrodes have 208
/// values, 32 have 928.
const MANY_VALUES: usize = 512;
/// Of these frames directions are left out below this part of the largest. A touch's noise at 60 dB is four times as large.
const LEAST_OF_MANY: f64 = 1e-5;

/// How frames are turned into pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReconstructorOptions {
    /// The solver.
    pub method: Method,
    /// Relative rise in resistivity that a cell is expected to take (one standard deviation of the prior that the ridge
    /// stands for): the ridge is the noise over this.
    pub expected_rise: f64,
    /// How the expected rise falls with a cell's sensitivity: `(sensitivity / median) ^ -depth`. 0 is the same for all
    /// cells; larger keeps what the model gets wrong from being drawn at the rim, where the sensitivity is greatest.
    pub depth: f64,
    /// Relative error of the linear model against the change measured, as a standard deviation: the picture is not fitted
    /// more closely than that, however little noise there is.
    pub model_error: f64,
    /// Directions of the weighted sensitivity whose singular value is below this fraction of the largest are left out.
    pub drop: f64,
    /// The non-negative solve leaves out directions whose singular value is below this fraction of its ridge as well: they
    /// hardly change the picture. The fit of the touches does not.
    pub drop_below_ridge: f64,
    /// Probability that a frame of nothing but noise passes the gate.
    pub false_alarm: f64,
    /// What counts as a touch.
    pub touches: TouchOptions,
    /// How the picture's touches are fitted to the measurements; none leaves them as the picture has them. Only
    /// [`Method::Nnls`] has a fit.
    pub fit: Option<FitOptions>,
    /// Which way touches change the resistivity; none where that is to be learned from the frames. A sheet of which nothing is
    /// known is first taken for one whose touches raise it.
    pub polarity: Option<Polarity>,
    /// Whether anything may have drifted since the baseline: not where every frame has its own, taken just before it.
    pub drifts: bool,
    /// Whether frames are measured one after another. What broke or changed on the sheet stays so. A doubtful electrode is
    /// then left out only when its fault lasts, a contact is accepted as changed after
    /// [`ContactOptions::frames`], and unexplained frames are reported after
    /// [`ReconstructorOptions::unexplained_frames`]. Otherwise each frame is judged by itself.
    pub sequence: bool,
    /// Longest time over which frames of a scene at rest are averaged, s. More is quieter; a press creeps meanwhile.
    pub averaged_s: f64,
    /// Longest time between the pictures of a sequence whose touches are followed, s; 0 for one with every frame. The fit of touches
    /// that are followed needs no picture, which takes half of the frame's time.
    pub picture_s: f64,
    /// How fast the baseline follows what drifts while nothing touches, s. More is quieter and lags further behind: by this time
    /// the rate of the drift. A touch that comes down more slowly than this is taken for drift.
    pub follow_s: f64,
    /// Frames one after another that no touches explain before that is reported: a touch that comes down while a frame is
    /// measured fits none either.
    pub unexplained_frames: usize,
    /// Mean square misfit, in noise variances of one frame, up to which discs explain a frame. More shows discs where something else
    /// presses.
    pub most_misfit: f64,
    /// Largest relative KKT residual of a converged non-negative solve.
    pub tolerance: f64,
    /// Most steps of a non-negative solve.
    pub most_steps: usize,
    /// A picture's largest rise over the expected one before more is expected, and the solve repeated: the ridge would hold
    /// it down.
    pub largest_over_expected: f64,
    /// How often that is done at most.
    pub most_rescalings: usize,
    /// A peak whose integrated rise is less than this fraction of the greatest integrated fall is what the fall leaves
    /// around it. Chosen by hand on the tanks with metal (`tests/data`).
    pub least_over_fall: f64,
    /// Least relative sensitivity of a cell, against the median, that its expected rise follows.
    pub least_sensitivity: f64,
    /// Standard deviation of a place, mm, from which a touch must be further from the rim, and from stronger touches, than that to
    /// be one. Fingers are known to a tenth of it.
    pub unplaced_mm: f64,
    /// A gain that drifted by more than this part since the frame before is divided out, and the frame solved once more: touches
    /// scale with it. Less costs time in drifting scenes.
    pub gain_step: f64,
    /// A gain below this is no drift: the source is lost.
    pub least_gain: f64,
    /// When a frame is a change.
    pub change: ChangeOptions,
    /// When values are rejected.
    pub faults: FaultOptions,
    /// When a contact counts as changed.
    pub contacts: ContactOptions,
    /// When the values of a frame speak against it.
    pub doubts: DoubtOptions,
}

impl ReconstructorOptions {
    /// Defaults for an imager, and frames that have nothing to do with each other: lengths follow the sheet's size and the cells.
    pub fn for_imager(imager: &Imager, method: Method) -> Self {
        let extent = imager.reach_mm();
        Self {
            method,
            expected_rise: 0.07,
            depth: 0.3,
            model_error: 0.004,
            drop: if imager.pattern.len() > MANY_VALUES {
                LEAST_OF_MANY
            } else {
                0.0
            },
            drop_below_ridge: 0.1,
            false_alarm: 1e-6,
            touches: TouchOptions {
                smoothing_mm: (0.05 * extent).max(0.6 * imager.grid.cell_mm()),
                least_of_strongest: 0.25,
                prominence: 0.08,
                least_rise: 0.005,
            },
            fit: (method == Method::Nnls).then(|| FitOptions::for_extent(extent)),
            polarity: None,
            drifts: true,
            sequence: false,
            averaged_s: 0.25,
            picture_s: 0.0,
            follow_s: 10.0,
            unexplained_frames: 4,
            most_misfit: FitterOptions::default().most_misfit,
            tolerance: 1e-9,
            most_steps: 60,
            largest_over_expected: 4.0,
            most_rescalings: 2,
            least_over_fall: 0.5,
            least_sensitivity: 1e-3,
            unplaced_mm: 0.03 * extent,
            gain_step: 0.005,
            least_gain: LEAST_GAIN,
            change: ChangeOptions::default(),
            faults: FaultOptions::default(),
            contacts: ContactOptions::default(),
            doubts: DoubtOptions::default(),
        }
    }

    /// The same for frames measured one after another.
    pub fn of_sequence(self) -> Self {
        Self { sequence: true, ..self }
    }

    /// How many frames at rest are averaged at most that are measured so long after one another, s; none: at once.
    pub(crate) fn most_averaged(&self, interval_s: Option<f64>) -> usize {
        match interval_s {
            _ if !self.sequence => 1,
            Some(interval_s) => (self.averaged_s / interval_s) as usize,
            None => usize::MAX,
        }
    }
}
