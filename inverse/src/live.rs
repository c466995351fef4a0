//! A stream of frames to pictures: takes the baseline, then reconstructs, follows touches and computes their forces.

use crate::force::meter::{Calibration, ForceMeter};
use crate::learned::{LearnedSheet, PressFollower};
use crate::pipeline::{FrameResult, Reconstructor, ReconstructorOptions};
use crate::quality::doubt::Doubt;
use crate::quality::repeats::Repeats;
use crate::reference::baseline::{Baseline, BaselineTaker};
use crate::reference::imager::{Imager, ImagerError};
use crate::reference::inspection::{Inspection, InspectionOptions, inspect};
use crate::reference::{Reference, ToldSheet};
use crate::solvers::Method;
use crate::touches::polarity::Polarity;
use crate::touches::radius_filter::RadiusFilter;
use crate::touches::tracker::{Numbered, Tracker, TrackerOptions};
use std::sync::Arc;

/// How a live picture is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LiveOptions {
    /// Frames of the unpressed sheet that make the baseline.
    pub baseline_frames: usize,
    /// The solver.
    pub method: Method,
    /// Which way touches change the resistivity; none where that is learned from the first ones.
    pub polarity: Option<Polarity>,
    /// Whether the electrodes are looked for in the baseline, or taken to be where the sheet says.
    pub find_electrodes: bool,
    /// What the forces of the touches are computed with; none: no forces.
    pub calibration: Option<Calibration>,
    /// Without a calibration: the force of each mm² of a touch's integrated rise, N/mm², which marks the force as uncalibrated
    /// ([`TYPICAL_N_PER_MM2`](crate::force::TYPICAL_N_PER_MM2)); none: no forces.
    pub uncalibrated_n_per_mm2: Option<f64>,
    /// Longest time between the pictures of touches that explain their frames, s; 0 for one with every frame, infinite for none but those
    /// that [`Live::picture`] asks for. The touches are those of every frame in any case, to the last bit. A thirtieth of a second is
    /// what an eye follows.
    pub picture_s: f64,
    /// How far a touch may move from one frame to the next and keep its number, as a part of the sheet's width; and how far
    /// from where it vanished it may be seen again. Touches nearer to each other are seldom resolved. Chosen by hand.
    pub reach: f64,
    /// How long something that lay on the sheet in the baseline must have gone for [`Live::rested`], s. Chosen by hand: a
    /// finger lifts in less.
    pub gone_s: f64,
    /// How long a touch may be gone and keep its number, s. A second tap at the same place within it is the same touch. Chosen
    /// by hand.
    pub patience_s: f64,
}

impl Default for LiveOptions {
    fn default() -> Self {
        Self {
            baseline_frames: 24,
            method: Method::Nnls,
            polarity: None,
            find_electrodes: true,
            calibration: None,
            uncalibrated_n_per_mm2: None,
            picture_s: 1.0 / 30.0,
            reach: 0.1,
            gone_s: 0.5,
            patience_s: 0.5,
        }
    }
}

/// A baseline is taken again so often where the sheet moved meanwhile: a finger that comes down or lifts does it once or twice, and what
/// never rests, as hum that wires pick up, shall not keep the program from starting.
const AGAIN: usize = 4;

/// So many baselines that were looked at are kept: the one in force, and the one to go back to.
const LOOKED_AT: usize = 2;

/// What became of a measured frame.
#[derive(Debug, PartialEq)]
pub enum LiveFrame<'a> {
    /// It went into the baseline; so many more are wanted.
    Baseline {
        /// Frames still wanted.
        left: usize,
        /// Whether the sheet moved meanwhile: the baseline is taken again, from the next frame on.
        again: bool,
    },
    /// A picture, its touches numbered.
    Picture(&'a FrameResult),
}

/// The chain behind the link, with its state.
pub struct Live {
    /// With the electrodes where they are said to be.
    nominal: Arc<Imager>,
    options: LiveOptions,
    taker: Option<BaselineTaker>,
    /// After the first baseline.
    running: Option<Running>,
    /// What the last baselines were found to be, the newest last. To look at one takes a second.
    inspected: Vec<(Baseline, Inspection)>,
    tracker: Tracker,
    radius_filter: RadiusFilter,
    meter: Option<ForceMeter>,
    /// What presses taught, where that takes the place of the model.
    learned: Option<LearnedSheet>,
    /// When the frame before was measured, s.
    before_s: Option<f64>,
    /// Frames that are the same.
    repeats: Repeats,
    /// Time from a frame to the next, s, as last seen.
    interval_s: Option<f64>,
    /// Where nothing is on the sheet, and something that lay there in the baseline has gone.
    gone: Option<Gone>,
    /// The baseline of that sheet, when it is complete.
    rested: Option<Baseline>,
}

/// Something has gone, and nothing touches.
struct Gone {
    /// Since when, s.
    since_s: f64,
    /// Frames of it, for a baseline.
    taker: BaselineTaker,
}

/// What a baseline makes possible.
struct Running {
    inspection: Inspection,
    way: Way,
}

/// How touches are found.
enum Way {
    /// By the sheet's model.
    Model(Box<Reconstructor>),
    /// By what presses at known places taught.
    Presses(Box<PressFollower>),
}

impl Way {
    fn imager(&self) -> &Arc<Imager> {
        match self {
            Self::Model(reconstructor) => reconstructor.imager(),
            Self::Presses(follower) => follower.imager(),
        }
    }
}

impl Live {
    /// Starts with taking the baseline.
    pub fn new(imager: Arc<Imager>, options: LiveOptions) -> Self {
        let extent = imager.reach_mm();
        let values = imager.pattern.len();
        Self {
            tracker: Tracker::new(TrackerOptions::new(2.0 * options.reach * extent, options.patience_s)),
            radius_filter: RadiusFilter::default(),
            meter: options.calibration.map(|c| ForceMeter::new(&imager, c)),
            taker: Some(BaselineTaker::new(values, options.baseline_frames).until_still(AGAIN)),
            running: None,
            inspected: Vec::new(),
            learned: None,
            before_s: None,
            repeats: Repeats::default(),
            interval_s: None,
            gone: None,
            rested: None,
            nominal: imager,
            options,
        }
    }

    /// Finds touches by what presses at known places taught instead of by the sheet's model, from the next baseline on. Of a touch
    /// the rise is then its strength over the usual press, and the area that of the spot that is drawn.
    #[must_use]
    pub fn with_learned(mut self, learned: LearnedSheet) -> Self {
        self.learned = Some(learned);
        self
    }

    /// Takes the sheet to be what presses told of it, from the next baseline on that shows its electrodes.
    #[must_use]
    pub fn with_told(mut self, told: Option<Arc<ToldSheet>>) -> Self {
        if let Some(told) = told {
            let mut nominal = Imager::clone(&self.nominal);
            nominal.told = Some(told);
            self.nominal = Arc::new(nominal);
        }
        self
    }

    /// One that has seen no frame and has no baseline: what it makes of frames is what a new one would, to the last bit. But baselines
    /// that this one looked at it need not look at again.
    #[must_use]
    pub fn anew(&self) -> Self {
        let anew = Self::new(Arc::clone(&self.nominal), self.options);
        Self {
            inspected: self.inspected.clone(),
            learned: self.learned.clone(),
            ..anew
        }
    }

    /// The last frame's result with its picture, which is made now where none was: touches and events need not wait for it. None before
    /// the first baseline.
    pub fn picture(&mut self) -> Option<&FrameResult> {
        match &mut self.running.as_mut()?.way {
            Way::Model(reconstructor) => Some(reconstructor.picture()),
            Way::Presses(follower) => Some(follower.result()),
        }
    }

    /// The model behind: after the baseline, with the electrodes where that showed them to be.
    pub fn imager(&self) -> &Arc<Imager> {
        self.running.as_ref().map_or(&self.nominal, |r| r.way.imager())
    }

    /// Takes the baseline anew, from the next frame on.
    pub fn tare(&mut self) {
        self.forget_gone();
        self.repeats = Repeats::default();
        let taker = BaselineTaker::new(self.nominal.pattern.len(), self.options.baseline_frames);
        self.taker = Some(taker.until_still(AGAIN));
    }

    /// Puts a baseline in force that was taken before, of the same pattern. One that is being taken is given up. Touches keep
    /// their numbers. What is pressed in now counts as pressed from now on.
    ///
    /// # Errors
    /// [`ImagerError`] when the baseline does not have the pattern's length; then nothing has changed.
    pub fn resume(&mut self, baseline: Baseline) -> Result<(), ImagerError> {
        self.nominal.fits(&baseline.values_v, &baseline.values_v)?;
        self.taker = None;
        self.forget_gone();
        self.repeats = Repeats::after(&baseline);
        self.put_in_force(baseline, self.learned_polarity())
    }

    /// The touches that are followed, with their numbers.
    pub fn numbered(&self) -> Numbered {
        self.tracker.numbered()
    }

    /// Goes on with the touches that another one followed in the frames before: they keep their numbers.
    pub fn go_on(&mut self, numbered: Numbered) {
        self.tracker.go_on(numbered);
    }

    /// Frames are missing here, however many: touches that were there keep their numbers, if they are there after it.
    pub fn gap(&mut self) {
        self.tracker.gap();
        self.before_s = None;
        self.forget_gone();
    }

    /// The baseline that is called for: something that lay on the sheet in the one in force has gone, for [`LiveOptions::gone_s`],
    /// nothing touches, and as many frames more as a baseline has were so. It is the mean of these: so a finger that comes down meanwhile
    /// is a touch. Not before it is known which way touches change the resistivity: what has gone may else be a touch.
    /// [`Live::resume`] puts it in force.
    pub fn rested(&mut self) -> Option<Baseline> {
        self.rested.take()
    }

    fn forget_gone(&mut self) {
        (self.gone, self.rested) = (None, None);
    }

    fn learned_polarity(&self) -> Option<Polarity> {
        match &self.running.as_ref()?.way {
            Way::Model(reconstructor) => reconstructor.learned_polarity(),
            Way::Presses(_) => None,
        }
    }

    /// The baseline in force.
    pub fn baseline(&self) -> Option<&Baseline> {
        self.running.as_ref().map(|r| &r.inspection.baseline)
    }

    /// What the baseline in force was found to be worth.
    pub fn inspection(&self) -> Option<&Inspection> {
        self.running.as_ref().map(|r| &r.inspection)
    }

    /// Takes the next frame: when it was measured (the board's time, s) and its values (V, in the pattern's order; not a
    /// number where one is missing).
    ///
    /// # Errors
    /// [`ImagerError`] when the frame does not have the pattern's length.
    pub fn frame(&mut self, time_s: f64, values_v: &[f64]) -> Result<LiveFrame<'_>, ImagerError> {
        if let Some(taker) = &mut self.taker {
            self.repeats.rest(values_v);
            let done = taker.take(values_v);
            let again = taker.is_empty() && values_v.len() == self.nominal.pattern.len();
            let left = taker.left();
            let Some(baseline) = done else {
                return Ok(LiveFrame::Baseline { left, again });
            };
            self.taker = None;
            self.put_in_force(baseline, None)?;
            return Ok(LiveFrame::Baseline { left: 0, again: false });
        }
        let Some(Running { way, .. }) = &mut self.running else {
            return Ok(LiveFrame::Baseline { left: 0, again: false });
        };
        let interval_s = self.before_s.replace(time_s).map(|before| time_s - before);
        self.interval_s = interval_s.filter(|s| *s > 0.0).or(self.interval_s);
        let reconstructor = match way {
            Way::Model(reconstructor) => reconstructor,
            Way::Presses(follower) => {
                let result = follower.frame(values_v, interval_s)?;
                self.repeats.take(values_v, &mut result.doubt);
                self.tracker.update(time_s, &mut result.touches, result.doubt.is_some());
                return Ok(LiveFrame::Picture(result));
            }
        };
        self.repeats.uncover(reconstructor.doubt());
        let result = reconstructor.frame_after(values_v, self.interval_s)?;
        self.repeats.take(values_v, &mut result.doubt);
        let gone = matches!(result.doubt, Some(Doubt::Gone { .. })) && result.touches.is_empty();
        let doubted = result.doubt.is_some() || !result.faults.is_empty();
        self.tracker.update(time_s, &mut result.touches, doubted);
        if result.anew {
            self.radius_filter.update(time_s, result.grown, &mut result.touches);
        } else {
            self.radius_filter.keep(time_s, &result.touches);
        }
        if let Some(meter) = &mut self.meter {
            meter.update(time_s, &mut result.touches);
        } else if let Some(n_per_mm2) = self.options.uncalibrated_n_per_mm2 {
            // Of what lowers the resistivity the typical rubber tells nothing.
            for touch in result.touches.iter_mut().filter(|t| t.total_mm2 > 0.0) {
                touch.force_n = Some(n_per_mm2 * touch.total_mm2);
                touch.uncalibrated = true;
            }
        }
        if gone && self.rested.is_some() {
            // Nobody took it yet.
        } else if gone {
            let begun = self.gone.get_or_insert_with(|| Gone {
                since_s: time_s,
                taker: BaselineTaker::new(values_v.len(), self.options.baseline_frames).until_still(AGAIN),
            });
            let waited = time_s - begun.since_s >= self.options.gone_s;
            if let Some(baseline) = waited.then(|| begun.taker.take(values_v)).flatten() {
                (self.gone, self.rested) = (None, Some(baseline));
            }
        } else {
            (self.gone, self.rested) = (None, None);
        }
        Ok(LiveFrame::Picture(result))
    }

    /// `learned`: what the sheet's touches do, where the baseline before told.
    fn put_in_force(&mut self, baseline: Baseline, learned: Option<Polarity>) -> Result<(), ImagerError> {
        if let Some(meter) = &mut self.meter {
            // What is pressed in now belongs to the baseline.
            meter.rest();
        }
        if let Some(learned) = &self.learned {
            let follower = PressFollower::new(learned, Arc::clone(&self.nominal), &baseline.values_v);
            self.running = Some(Running {
                inspection: Inspection::unlooked(&self.nominal, baseline),
                way: Way::Presses(Box::new(follower)),
            });
            return Ok(());
        }
        let inspection = self.inspected(baseline);
        // Electrodes that a baseline does not tell are where the one before showed them to be.
        let found = inspection.electrodes.is_some();
        let imager = Arc::clone(if found { &inspection.imager } else { self.imager() });
        let options = ReconstructorOptions {
            polarity: self.options.polarity,
            picture_s: self.options.picture_s,
            ..ReconstructorOptions::for_imager(&imager, self.options.method).of_sequence()
        };
        let reference = Reference::of(imager, &inspection.baseline)?;
        self.running = Some(Running {
            way: Way::Model(Box::new(
                Reconstructor::new(reference, options)
                    .after(inspection.fault)
                    .with_learned(learned),
            )),
            inspection,
        });
        Ok(())
    }

    fn inspected(&mut self, baseline: Baseline) -> Inspection {
        let known = self.inspected.iter().position(|(of, _)| of.is_same(&baseline));
        let looked = match known {
            Some(at) => self.inspected.remove(at),
            None => {
                let options = InspectionOptions::default();
                let found = inspect(&self.nominal, baseline.clone(), self.options.find_electrodes, &options);
                (baseline, found)
            }
        };
        let inspection = looked.1.clone();
        let too_many = (self.inspected.len() + 1).saturating_sub(LOOKED_AT);
        self.inspected.drain(..too_many);
        self.inspected.push(looked);
        inspection
    }
}
