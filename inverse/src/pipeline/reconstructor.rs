//! From a frame to a picture and its touches: every step is entered once and returns a value.

mod faults;

use crate::change::detector::{Change, ChangeDetector, own_stretch};
use crate::pipeline::contact_test::{ContactTest, Detectors, is_rare};
use crate::pipeline::following::Following;
use crate::pipeline::frame_solver::{Averaged, FrameSolver, Task};
use crate::pipeline::options::ReconstructorOptions;
use crate::pipeline::result::FrameResult;
use crate::pipeline::work::Work;
use crate::quality::doubt::Doubt;
use crate::quality::fault_monitor::FaultMonitor;
use crate::quality::faults::{FaultDetector, leave_out};
use crate::quality::flickers::{Flickers, is_alike};
use crate::quality::reciprocity::Reciprocity;
use crate::reference::diagnosis::{Fault, Faults, factor};
use crate::reference::drift::{COMMON, Drifting};
use crate::reference::imager::{Imager, ImagerError};
use crate::reference::noise::NoiseEstimate;
use crate::reference::{Difference, Reference};
use crate::touches::polarity::Polarity;
use std::sync::Arc;

/// Frames one after another that are not solved because what they are solved with has to be made: one for a problem, one for its tables.
/// Frames that leave out other values each time are solved all the same.
const MOST_MAKING: usize = 2;

/// Turns the frames of one reference into pictures, with its state from frame to frame.
pub struct Reconstructor {
    reference: Reference,
    options: ReconstructorOptions,
    /// By what drifts.
    detectors: Detectors,
    faults: FaultDetector,
    broken: FaultMonitor,
    /// What exchanged pairs of frames at rest say, and whether those disagreed last.
    reciprocity: Reciprocity,
    disagrees: bool,
    /// The frame before, and whether this one differs from it by nothing but noise: then nothing moved while it was measured.
    last: Vec<f64>,
    rests: bool,
    flickers: Flickers,
    /// What was broken as the baseline was taken.
    before: Option<Fault>,
    /// Whether the fault that is named is to be looked for in the frame.
    due: bool,
    /// Whether other values are left out than in the frame before; and what an unpressed frame has without these.
    left_changed: bool,
    left: Difference,
    /// A fault that was named just now in a frame with so many touches and this misfit, whose place it has to take.
    instead_of: Option<(Faults, usize, Option<f64>)>,
    contacts: ContactTest,
    solver: FrameSolver,
    /// By what frames are divided: the gain that drifted since the baseline.
    gain: f64,
    /// That of the last frame of which nothing was doubted.
    sound_gain: f64,
    /// That of the last frame in which a fault was looked for in vain.
    looked_gain: f64,
    /// What the baseline has become since.
    following: Following,
    /// Frames one after another that no touches explained.
    unexplained: usize,
    /// Frames one after another that were not solved, but made what they are solved with; and whether this one is among them.
    making: usize,
    makes: bool,
    /// Time since the last picture, s.
    since_picture_s: f64,
    /// Parts of searches for what is broken before this frame.
    searched: usize,
    /// Of how many frames the result is the mean's.
    averaged: Averaged,
    /// Room for a frame, and for the mean of several.
    divided: Vec<f64>,
    difference: Difference,
    /// Which values took part before the frame was held against itself.
    judged: Vec<bool>,
    /// Values that are numbers, but none that a converter gives.
    beyond: Vec<usize>,
    /// Whether each value of the frame is missing that the baseline has.
    missing: Vec<bool>,
    whole: Difference,
    /// The frame in which faults are looked for, where its gain is not to be trusted.
    suspicious: Difference,
    mean: Vec<f64>,
    result: FrameResult,
}

impl Reconstructor {
    /// Prepares for the frames of a reference; where its noise is known, that takes as long as many frames (60 ms).
    pub fn new(reference: Reference, options: ReconstructorOptions) -> Self {
        let imager = reference.imager();
        let mut solver = FrameSolver::new(imager, options);
        let detectors = detectors(&mut solver, &reference);
        let mut broken = FaultMonitor::new(imager, options.sequence);
        if let Some(noise) = reference.noise().filter(|_| options.sequence && options.fit.is_some()) {
            broken.prepare(noise.sigma, reference.unchanged());
        }
        Self {
            detectors,
            faults: FaultDetector::new(&imager.pattern, options.sequence, options.faults)
                .at_least(reference.least_noise()),
            broken,
            reciprocity: Reciprocity::new(&imager.pattern),
            disagrees: false,
            last: Vec::new(),
            rests: false,
            flickers: Flickers::default(),
            before: None,
            due: false,
            left_changed: false,
            left: reference.unchanged().clone(),
            instead_of: None,
            contacts: ContactTest::new(&options),
            solver,
            gain: 1.0,
            sound_gain: 1.0,
            looked_gain: 1.0,
            following: Following::new(reference.baseline().len(), options.follow_s),
            unexplained: 0,
            making: 0,
            makes: false,
            since_picture_s: f64::INFINITY,
            searched: 0,
            averaged: Averaged::ONE,
            divided: Vec::new(),
            difference: reference.unchanged().clone(),
            judged: Vec::new(),
            beyond: Vec::new(),
            missing: Vec::new(),
            whole: reference.unchanged().clone(),
            suspicious: reference.unchanged().clone(),
            mean: Vec::new(),
            result: FrameResult::nothing(imager),
            reference,
            options,
        }
    }

    /// The same after a baseline that was taken with something broken: no touches are shown, since none can be right.
    pub fn after(self, fault: Option<Fault>) -> Self {
        Self { before: fault, ..self }
    }

    /// The same of a sheet of which it was learned which way touches change the resistivity; none where it was not.
    #[must_use]
    pub fn with_learned(mut self, polarity: Option<Polarity>) -> Self {
        self.contacts.learn_polarity(polarity);
        self
    }

    /// Which way touches change the resistivity, where frames told.
    pub fn learned_polarity(&self) -> Option<Polarity> {
        self.contacts.learned_polarity()
    }

    /// What frames are compared with.
    pub fn reference(&self) -> &Reference {
        &self.reference
    }

    /// The imager.
    pub fn imager(&self) -> &Arc<Imager> {
        self.reference.imager()
    }

    /// Rank of the sensitivity in use; none before the first frame.
    pub fn rank(&self) -> Option<usize> {
        self.solver.rank()
    }

    /// What the last frame took.
    pub fn work(&self) -> Work {
        Work {
            search_parts: self.broken.parts() - self.searched,
            ..self.solver.work()
        }
    }

    /// How long that takes about on a processor of 2023, ms: the same number on every machine.
    pub fn nominal_ms(&self) -> f64 {
        self.solver.costs().of(self.work())
    }

    /// Reconstructs a frame (the baseline's unit).
    ///
    /// With the noise known, a frame that shows nothing, or in a sequence ([`ReconstructorOptions::sequence`]) nothing new,
    /// costs one product with a small matrix and no allocation: the result is then the earlier one ([`FrameResult::anew`]). So is it of a
    /// frame of a sequence whose time went into what it is to be solved with, which of many values takes one or two.
    /// Frames of a sequence that show nothing new are averaged, and the result is made anew from the mean of 2, 4, 8 and 16.
    ///
    /// # Errors
    /// [`ImagerError::Baseline`] when the length does not match the pattern.
    pub fn frame(&mut self, values: &[f64]) -> Result<&mut FrameResult, ImagerError> {
        self.frame_after(values, None)
    }

    /// The same for a frame of a sequence that was measured so long after the one before, s: fewer than 16 frames at rest are
    /// averaged where they are slow, so that what drifts is not left behind.
    ///
    /// # Errors
    /// As for [`Reconstructor::frame`].
    pub fn frame_after(&mut self, values: &[f64], interval_s: Option<f64>) -> Result<&mut FrameResult, ImagerError> {
        self.since_picture_s += interval_s.unwrap_or(f64::INFINITY);
        if !self.options.sequence {
            self.stand_alone();
        }
        self.solver.begin_frame(self.broken.owed());
        self.searched = self.broken.parts();
        self.makes = false;
        if self.before.is_some() {
            self.reference.difference_into(values, &mut self.whole)?;
            self.show_faults();
            return Ok(&mut self.result);
        }
        if !self.options.sequence {
            self.gain = self.told_gain(values)?;
        }
        self.reference.missing_into(values, &mut self.missing)?;
        if self
            .broken
            .take_missing(&self.missing, &self.reference.unchanged().used)
        {
            self.left_changed = true;
            self.show_faults();
        }
        let noise = self.reference.value_noise().filter(|_| self.options.sequence);
        self.rests = noise.is_some_and(|noise| is_alike(&self.last, values, &self.left.used, noise));
        self.last.clear();
        self.last.extend_from_slice(values);
        let mut divided = std::mem::take(&mut self.divided);
        let done = self.divided(values, interval_s, &mut divided);
        self.divided = divided;
        done?;
        if self.options.sequence {
            self.look_for_loose_contacts(values);
        } else {
            self.result.anew = true;
        }
        Ok(&mut self.result)
    }

    /// Forgets all frames before: one of a table stands alone, to the last bit.
    fn stand_alone(&mut self) {
        self.solver.stand_alone();
        self.contacts.stand_alone();
        self.broken.stand_alone();
        self.faults.clear();
        self.detectors.iter_mut().flatten().for_each(ChangeDetector::forget);
        (self.flickers, self.disagrees, self.rests) = (Flickers::default(), false, false);
        (self.due, self.left_changed, self.instead_of) = (false, false, None);
        (self.gain, self.sound_gain, self.looked_gain) = (1.0, 1.0, 1.0);
        (self.unexplained, self.making, self.averaged) = (0, 0, Averaged::ONE);
        self.last.clear();
        self.result = FrameResult::nothing(self.reference.imager());
    }

    /// What a source has left, where that alone makes the frame look like another sheet's: a gain is divided out before anything is looked
    /// for. Else 1.
    fn told_gain(&mut self, values: &[f64]) -> Result<f64, ImagerError> {
        self.reference.difference_into(values, &mut self.whole)?;
        let (model_v, most) = (&self.reference.imager().model_v, self.options.doubts.largest_change);
        if self.whole.part_of(model_v) <= most {
            return Ok(1.0);
        }
        let Some(gain) = factor(model_v, &self.whole).filter(|gain| (self.options.least_gain..1.0).contains(gain))
        else {
            return Ok(1.0);
        };
        let divided: Vec<f64> = values.iter().map(|v| v / gain).collect();
        self.reference.difference_into(&divided, &mut self.whole)?;
        let is_gain = self.whole.part_of(model_v) <= most;
        Ok(if is_gain { gain } else { 1.0 })
    }

    /// By how much the variance of a difference's noise is larger than with the baseline's gain: what is divided by a small gain is noisier.
    /// A gain above 1 divides by no more than it is: noise may grow with the values.
    pub(super) fn stretch(&self) -> f64 {
        let gain = self.gain * self.following.gain();
        let share = self.reference.baseline_share();
        ((1.0 / (gain * gain) + share) / (1.0 + share)).max(1.0)
    }

    /// Whether the gain is another, by more than sources drift, than in the last frame of which nothing was doubted, and than in the last in
    /// which a fault was looked for in vain.
    pub(super) fn gain_jumped(&self) -> bool {
        let is_other = |before: f64| (self.gain / before).ln().abs() > COMMON;
        let other = is_other(self.sound_gain) && is_other(self.looked_gain);
        self.options.sequence && other && self.broken.named().is_none()
    }

    /// Noise of one value of a difference, where the baseline told it.
    pub(super) fn noise(&self) -> Option<NoiseEstimate> {
        let stretch = self.stretch().sqrt();
        self.reference.noise().map(|noise| NoiseEstimate {
            sigma: stretch * noise.sigma,
            ..noise
        })
    }

    /// What is doubted of the last frame.
    pub(crate) fn doubt(&mut self) -> &mut Option<Doubt> {
        &mut self.result.doubt
    }

    /// The same with room for the frame divided by its gain. Where the gain turns out to be another, once more.
    fn divided(&mut self, values: &[f64], interval_s: Option<f64>, room: &mut Vec<f64>) -> Result<(), ImagerError> {
        for last in [false, true] {
            self.following.divide(values, self.gain, room);
            self.take_leak_out(room)?;
            if !self.frame_of_gain(room, interval_s)? {
                break;
            }
            let found = self.result.drift.gain;
            let gain = found * self.gain;
            self.result.drift.gain = gain * self.following.gain();
            let off = (found - 1.0).abs() > self.options.gain_step && gain > self.options.least_gain;
            let settled = !self.result.changed || (self.result.misfit.is_some() && self.solver.is_finished());
            if last || !off || !settled || self.solver.is_spent() {
                break;
            }
            self.gain = gain;
            self.detectors.iter_mut().flatten().for_each(ChangeDetector::forget);
        }
        if self.makes {
            // Nothing is known of this frame. What was known of the one before, a fault or a change that nothing explains, weighs more.
            self.result.anew = false;
            self.result.doubt = self.result.doubt.or(Some(Doubt::NotSolved));
            self.making += 1;
            return Ok(());
        }
        if self.solver.made() == (0, 0) {
            self.making = 0;
        }
        let is_small = !self.options.sequence && self.result.drift.gain < self.options.least_gain;
        if is_small && self.result.doubt.is_none() {
            // No source drifts so far: what touches explain beside it is none either.
            self.result.touches.clear();
            self.result.doubt = Some(Doubt::NotThisSheet);
        }
        if self.result.anew && (!self.options.sequence || self.since_picture_s > self.options.picture_s) {
            self.picture();
        }
        if !self.result.changed {
            // What is shown is empty: the next touch is to be seen at once.
            self.since_picture_s = f64::INFINITY;
        } else if self.result.anew && self.result.is_pictured {
            self.since_picture_s = 0.0;
        }
        let result = &self.result;
        // What loose contacts spoil is left out of all.
        let is_loose = |fault: &Fault| matches!(fault, Fault::Loose(_));
        let sound = result.faults.iter().all(is_loose) && !self.broken.is_open();
        let untouched = sound && result.touches.is_empty() && result.doubt.is_none();
        // Beside a fault that leaves touches the gain is what they tell.
        let told = result.faults.iter().all(Fault::leaves_touches) && !self.broken.is_open() && result.doubt.is_none();
        if untouched || (told && !self.gain_jumped()) {
            self.sound_gain = self.gain;
        }
        if let Some(interval_s) = interval_s.filter(|_| untouched && self.options.sequence) {
            // A wild value is no drift.
            let (baseline, used) = (self.reference.baseline(), &self.difference.used);
            self.following.follow(room, baseline, used, interval_s);
        }
        Ok(())
    }

    /// Makes the picture of the last frame, where it has none yet: its touches needed none, or that of an earlier frame is newer than
    /// [`ReconstructorOptions::picture_s`]. No touch of any frame depends on it.
    pub fn picture(&mut self) -> &FrameResult {
        if !self.result.is_pictured && self.result.misfit.is_some() {
            let task = task(&self.difference, self.result.noise, self.averaged, false);
            self.contacts.picture(&mut self.solver, task, &mut self.result);
        }
        &self.result
    }

    /// A frame divided by the gain; false where it is like the one before, and so is the result.
    fn frame_of_gain(&mut self, values: &[f64], interval_s: Option<f64>) -> Result<bool, ImagerError> {
        self.contacts.note_rest(false);
        if !self.look_without_faults() {
            // What the frame is to be solved with was made in its time.
            return Ok(false);
        }
        self.due |= self.broken.begin(self.contacts.causes());
        let stretch = self.stretch();
        if self.due {
            // What is broken is looked for in a frame that shows nothing, too.
            let detector = self.detectors[self.contacts.detector()].as_mut();
            let quiet = self.options.sequence
                && detector.is_some_and(|d| matches!(d.test(values, 1, stretch), Change::Nothing));
            self.detectors.iter_mut().flatten().for_each(ChangeDetector::forget);
            if quiet {
                // But where its values are those of the baseline again, it is over.
                self.look_for_end(values)?;
                self.due = self.broken.named().is_some();
                if !self.due && !self.drifted(values)? {
                    self.clear();
                    return Ok(true);
                }
            }
            return self.reconstruct(values, Averaged::ONE, quiet);
        }
        if self.broken.named().is_some_and(|fault| !fault.leaves_touches()) {
            self.result.anew = false;
            return Ok(false);
        }
        let most_averaged = self.options.most_averaged(interval_s);
        let change = self.detectors[self.contacts.detector()]
            .as_mut()
            .map(|d| d.test(values, most_averaged, stretch));
        let rests = matches!(change, Some(Change::Same | Change::Mean)) && self.contacts.waits_for_rest();
        self.contacts.note_rest(rests);
        if rests {
            // What holds the averaging up is decided in the first frame at rest, by itself.
            let solved = self.reconstruct(values, Averaged::ONE, false)?;
            self.contacts.note_rest(false);
            let decided = solved && self.detector().is_some_and(|d| d.rest().frames() > 1);
            // What the mean was made without may be another leak than what is known now.
            if !decided || self.left_changed || change == Some(Change::Same) {
                return Ok(solved);
            }
        }
        match change {
            Some(Change::Nothing) if !self.drifted(values)? => {
                self.clear();
                self.look_for_end(values)?;
            }
            Some(Change::Nothing) => {
                let solved = self.reconstruct(values, Averaged::ONE, true)?;
                if solved && !self.result.changed {
                    self.look_for_end(values)?;
                }
                return Ok(solved);
            }
            Some(Change::Same) => {
                self.result.anew = false;
                return Ok(false);
            }
            Some(Change::Mean) => {
                let mut mean = std::mem::take(&mut self.mean);
                let averaged = self.averaged(&mut mean);
                let done = self.reconstruct(&mean, averaged, false);
                self.mean = mean;
                return done;
            }
            Some(Change::New) | None => return self.reconstruct(values, Averaged::ONE, false),
        }
        Ok(true)
    }

    /// Whether a frame that shows no touch differs from the baseline all the same.
    fn drifted(&mut self, values: &[f64]) -> Result<bool, ImagerError> {
        let Some(noise) = self.noise() else {
            return Ok(false);
        };
        self.reference.difference_into(values, &mut self.difference)?;
        self.broken.leave_out(&mut self.difference);
        Ok(self
            .solver
            .drifted(&self.difference, self.contacts.may_drift(), noise.sigma))
    }

    fn detector(&self) -> Option<&ChangeDetector> {
        self.detectors[self.contacts.detector()].as_ref()
    }

    /// The frame showed nothing.
    fn clear(&mut self) {
        let used = self.detector().map_or(0, ChangeDetector::used);
        self.result.clear(self.noise(), used);
        self.solver.forget();
        self.contacts.clear();
        // Only one of them has seen the frame.
        self.detectors.iter_mut().flatten().for_each(ChangeDetector::forget);
        self.faults.clear();
        self.instead_of = None;
        if self.broken.named().is_none() {
            self.broken.clear();
        } else {
            self.broken.put_nothing_off();
        }
        self.show_faults();
        self.unexplained = 0;
        self.disagrees = false;
    }

    /// Copies the mean of the frames at rest, and says what it is the mean of.
    fn averaged(&self, mean: &mut Vec<f64>) -> Averaged {
        mean.clear();
        let Some(detector) = self.detector() else {
            return Averaged::ONE;
        };
        let rest = detector.rest();
        mean.extend_from_slice(rest.mean());
        let share = self.reference.baseline_share();
        // Variance of a frame's own noise, over that with the baseline's gain.
        let own = own_stretch(self.stretch(), share);
        Averaged {
            frames: rest.frames(),
            grown: rest.has_grown(),
            gain: (own + share) / (own / rest.frames() as f64 + share),
            frame_sigma: self.noise().map(|n| n.sigma).filter(|_| rest.frames() > 1),
        }
    }

    /// Reconstructs a frame, or the mean of several. `quiet`: it is known to show no touch. Where touches do not explain it, what is
    /// broken is looked for; once that is known, the frame is solved anew, or doubted where another follows.
    /// False where the frame has time only for what it is to be solved with.
    fn reconstruct(&mut self, values: &[f64], averaged: Averaged, quiet: bool) -> Result<bool, ImagerError> {
        self.reference.difference_into(values, &mut self.difference)?;
        let usual = self.reference.unchanged().used.iter().zip(&self.difference.used);
        let beyond = usual
            .zip(values)
            .enumerate()
            .filter(|(_, ((usual, used), v))| **usual && !**used && v.is_finite());
        self.beyond.clear();
        self.beyond.extend(beyond.map(|(k, _)| k));
        if !self.options.sequence {
            // Nor does what was said of it with another gain say anything.
            self.solver.forget_touches();
            self.broken.clear();
        }
        if averaged.frames > 1 {
            self.broken.leave_out(&mut self.difference);
            self.solve(averaged, quiet);
            self.show_faults();
            return Ok(true);
        }
        self.whole.copy_from(&self.difference);
        self.broken.add_leak(&mut self.whole, 1.0);
        let mut due = std::mem::take(&mut self.due);
        loop {
            let blind = self.broken.named().is_some_and(|fault| !fault.leaves_touches());
            if !blind {
                self.broken.leave_out(&mut self.difference);
                if !self.solve(averaged, quiet) {
                    self.due = due;
                    return Ok(false);
                }
            }
            if self.hand_over_contacts() {
                break;
            }
            if self.took_no_place() {
                self.begin_anew();
                continue;
            }
            if (blind && !due) || !self.look_for_faults(blind, due) {
                break;
            }
            due = false;
            self.begin_anew();
            let put_off = |faults: &Faults| self.options.sequence && faults.leaves_touches();
            let put_off = self.broken.named().filter(put_off);
            if let Some(fault) = put_off.and_then(|faults| faults.iter().next()) {
                // The problem without what it spoils takes as long as the search: the next frame has it, and its picture.
                if !self.result.is_pictured {
                    self.result.x.fill(0.0);
                    self.result.is_pictured = true;
                }
                self.result.doubt = Some(Doubt::Fault(fault));
                self.solver.forget();
                break;
            }
        }
        if !self.options.sequence && self.broken.named().is_none() {
            self.solve_without_outliers(quiet);
        }
        let open = self.broken.is_open() && self.contacts.leaves(&self.result);
        let jumped = self.gain_jumped();
        if jumped {
            // Every frame counts.
            self.detectors.iter_mut().flatten().for_each(ChangeDetector::forget);
        }
        if (open || jumped || self.broken.is_searching()) && self.result.changed {
            // What is shown may be what a fault looks like.
            self.result.doubt = self.result.doubt.or(Some(Doubt::NotTouches));
        }
        self.show_faults();
        Ok(true)
    }

    /// Begins with the frame once more, as it was measured but for what is known to be broken now.
    fn begin_anew(&mut self) {
        self.difference.copy_from(&self.whole);
        self.broken.add_leak(&mut self.difference, -1.0);
        self.left_changed = true;
        // They were fitted to values that are known to be wrong by now.
        self.solver.forget_found();
    }

    /// Solves a frame that its touches do not explain without the values that stand out of what they leave, where the noise is known. The
    /// result is kept where touches explain the others: no more than before, where these explained the frame in part.
    fn solve_without_outliers(&mut self, quiet: bool) {
        let may = self.imager().is_searched() && self.solver.fits() && self.contacts.causes().is_empty();
        let Some(noise) = self.noise().filter(|_| may) else {
            return;
        };
        if !(self.result.changed && self.contacts.leaves(&self.result)) {
            return;
        }
        let task = Task {
            patient: true,
            ..task(&self.difference, Some(noise), Averaged::ONE, quiet)
        };
        let outliers = self.solver.outliers(self.contacts.signed(task), noise);
        if outliers.is_empty() {
            return;
        }
        let (kept, before) = (self.result.clone(), self.difference.clone());
        let mut used = self.difference.used.clone();
        outliers.iter().for_each(|k| used[*k] = false);
        leave_out(&mut self.difference, used);
        self.solver.forget_touches();
        self.solve_judged(Averaged::ONE, quiet, Some(noise));
        let result = &self.result;
        let explained = match (kept.misfit, result.misfit) {
            _ if !result.changed => true,
            (None, now) => now.is_some(),
            (Some(_), _) => !self.contacts.leaves(result) && result.touches.len() <= kept.touches.len(),
        };
        if !explained || result.doubt.is_some() {
            // All that the frame has decided is decided once more.
            self.difference = before;
            self.solver.forget_touches();
            self.solve_judged(Averaged::ONE, quiet, Some(noise));
        }
    }

    /// Whether the frame may go by without being solved.
    fn may_make(&self) -> bool {
        self.making < MOST_MAKING && !self.solver.has_solved()
    }

    /// Whether the touches of a result leave more of its frame than a whole hand would change: no touch that comes down.
    fn leaves_more_than_a_hand(&self) -> bool {
        let left = self.result.residual * self.difference.part_of(&self.imager().model_v);
        self.result.changed && left > self.options.doubts.largest_hand
    }

    /// Whether the result is a change that shows no touch, and that none explains; `gain` is that of the frame's mean.
    fn is_bare(&self, gain: f64) -> bool {
        let result = &self.result;
        let explained = result.misfit.is_some_and(|misfit| self.solver.explains(misfit, gain));
        let explained = explained && !self.contacts.leaves_beside_rare(result);
        self.solver.fits() && result.changed && result.touches.is_empty() && !explained
    }

    /// Solves the difference of a frame, or of the mean of several. False where what it is solved with had to be made, and took the frame's
    /// time.
    fn solve(&mut self, averaged: Averaged, quiet: bool) -> bool {
        let model_v = &self.reference.imager().model_v;
        // Nothing is left out of frames that are averaged, and what would be of their mean is not in a frame.
        self.judged.clone_from(&self.difference.used);
        let mut estimated = None;
        if averaged.frames == 1 {
            estimated = self.faults.judge(model_v, &mut self.difference);
            self.solver.leave_out_wild(estimated, &mut self.difference);
            if self.may_make() && self.contacts.prepare(&mut self.solver, &self.difference, quiet) {
                self.makes = true;
                return false;
            }
        }
        let known = self.noise().map(|noise| NoiseEstimate {
            sigma: if averaged.frames > 1 {
                noise.sigma / averaged.gain.sqrt()
            } else {
                noise.sigma
            },
            ..noise
        });
        // What moves makes exchanged pairs disagree as well, so frames at rest tell it, and any frame that it is over.
        if let Some(noise) = known {
            let may = self.solver.fits() && (averaged.frames > 1 || self.disagrees || self.rests);
            self.disagrees = may && self.disagree(averaged.gain, noise.sigma);
        }
        self.solve_judged(averaged, quiet, known.or(estimated));
        true
    }

    /// Whether exchanged pairs disagree by more than touches may leave of a frame that they explain: a few variances of its noise, and a
    /// small part of the change. `gain` is that of a mean, `sigma` its noise.
    fn disagree(&mut self, gain: f64, sigma: f64) -> bool {
        let (model_v, d) = (&self.reference.imager().model_v, &self.difference);
        let Some((now, _)) = self.reciprocity.look(&d.y, model_v, &d.spread, &d.used) else {
            return false;
        };
        let values = (0..d.used.len()).filter(|k| d.used[*k]);
        let change: f64 = values.map(|k| (d.y[k] / d.spread[k]).powi(2)).sum();
        let part = (now.square / change).sqrt();
        let noise = now.noise();
        noise.is_some_and(|found| !self.solver.may_leave((found.sigma / sigma).powi(2), part, gain))
    }

    /// The same of values that were judged; `noise` is none where nothing tells it.
    fn solve_judged(&mut self, averaged: Averaged, quiet: bool, noise: Option<NoiseEstimate>) {
        let model_v = &self.reference.imager().model_v;
        self.averaged = averaged;
        let task = task(&self.difference, noise, averaged, quiet);
        let gone = self
            .contacts
            .solve(&mut self.solver, task, &mut self.detectors, &mut self.result);
        let changed = self.contacts.faults().next();
        if let Some(detector) = &mut self.detectors[self.contacts.detector()]
            && ((self.contacts.is_open() && !self.contacts.waits_for_rest())
                || !self.contacts.causes().is_empty()
                || self.faults.is_open())
        {
            // Every frame counts.
            detector.forget();
        }
        // What shows nothing leaves nothing to doubt.
        self.disagrees &= self.result.changed;
        let bare = self.is_bare(averaged.gain);
        let explained = !self.result.changed || self.solver.is_explained(&self.result, averaged.gain);
        let unexplained = bare || (self.solver.fits() && !explained);
        self.unexplained = if unexplained { self.unexplained + 1 } else { 0 };
        let may_come_down = self.options.sequence && !self.flickers.often() && !self.leaves_more_than_a_hand();
        let least = match (may_come_down, bare) {
            (false, _) => 1,
            // Half of the frame in which a touch lands is as before.
            (true, true) => 2,
            (true, false) => self.options.unexplained_frames,
        };
        let hidden = self.contacts.hides_both_signs(&self.result);
        // With their shapes left out, touches that explain the rest are right.
        let leaves = self.contacts.leaves_beside_changed(&self.result, averaged);
        let doubted = self.result.changed && leaves;
        let contact = changed.filter(|_| doubted).map(Doubt::Fault);
        self.result.doubt = Doubt::of(&self.difference, model_v, self.options.doubts)
            .or(gone.map(|touch| Doubt::Gone {
                x_mm: touch.x_mm.round() as i32,
                y_mm: touch.y_mm.round() as i32,
                fell: touch.rise < 0.0,
            }))
            .or((self.disagrees && contact.is_none()).then_some(Doubt::NotReciprocal))
            .or((self.unexplained >= least || hidden).then_some(Doubt::NotTouches))
            .or((self.result.unplaced && self.result.changed).then_some(Doubt::Unplaced))
            .or(contact);
        if self.result.doubt == Some(Doubt::NotThisSheet) {
            // Whatever they are, they are no touches on the sheet of the baseline.
            self.result.touches.clear();
        }
        let left_out = self.judged.iter().zip(&self.difference.used).enumerate();
        let left_out = left_out.filter(|(_, (before, now))| **before && !**now);
        self.result.rejected.clone_from(&self.beyond);
        self.result.rejected.extend(left_out.map(|(k, _)| k));
        self.result.rejected.sort_unstable();
    }
}

/// A frame to be solved, of which the contact test says what drifts.
fn task(difference: &Difference, noise: Option<NoiseEstimate>, averaged: Averaged, quiet: bool) -> Task<'_> {
    Task {
        difference,
        noise,
        averaged,
        drifting: Drifting::Common,
        polarity: Polarity::Up,
        changed: &[],
        seen: true,
        quiet,
        patient: false,
        corrected: true,
    }
}

/// Detectors of changes against a reference, by what drifts: all that the frames of a sequence may need.
fn detectors(solver: &mut FrameSolver, reference: &Reference) -> Detectors {
    let mut detectors = Drifting::ALL.map(|_| None);
    // The first is in use next.
    for drifting in Drifting::ALL.into_iter().rev() {
        detectors[drifting.index()] = detector(solver, reference, reference.unchanged(), drifting, true);
    }
    detectors
}

/// Whether changes are looked for: not where the noise is not known, nor where frames of many values are solved sooner.
fn has_detector(solver: &FrameSolver, reference: &Reference, drifting: Drifting) -> bool {
    let asked = match (reference.imager().is_searched(), solver.is_of_sequence()) {
        (true, _) => true,
        (false, true) => !is_rare(drifting),
        (false, false) => drifting == Drifting::Common,
    };
    asked && reference.noise().is_some()
}

/// The detector of changes in the values of a difference that has nothing in it, if there is one. Those of what drifts rarely are made
/// `at_once` only as far as every frame needs them.
fn detector(
    solver: &mut FrameSolver,
    reference: &Reference,
    unchanged: &Difference,
    drifting: Drifting,
    at_once: bool,
) -> Option<ChangeDetector> {
    let noise = reference.noise()?;
    // What a frame of a table is fitted with does not depend on which one came first.
    let at_once = at_once && solver.is_of_sequence() && reference.imager().is_searched();
    let at_once = at_once && matches!(drifting, Drifting::Common | Drifting::Contacts);
    let (baseline, share) = (reference.baseline(), reference.baseline_share());
    has_detector(solver, reference, drifting)
        .then(|| solver.detector(unchanged, baseline, noise.sigma, share, drifting, at_once))
        .flatten()
}
