//! From a frame to a picture and its touches: gate, weigh, solve, find.

mod contact_test;

use crate::change::detector::{Seen, Watch};
use crate::quality::contact::{Basis, Contacts, Inquiry, Suspects};
use crate::quality::doubt::Doubt;
use crate::quality::faults::Health;
use crate::quality::reciprocity::{NoiseEstimate, Reciprocity};
use crate::reference::difference::{Difference, Differences};
use crate::reference::imager::{Imager, ImagerError};
use crate::solvers::{
    Method, Nnls, NnlsOptions, Problem, Projector, Status, discrepancy_ridge, lawson_hanson, pseudo_inverse, tikhonov,
};
use crate::touches::fit::FitOptions;
use crate::touches::fit::fitter::{Data, Fitter};
use crate::touches::fit::reduction::WeightedProjection;
use crate::touches::fit::responses::ResponseTable;
use crate::touches::peaks::{TouchFinder, TouchOptions};
use crate::touches::touch::Touch;
use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ContinuousCDF, FisherSnedecor};
use std::sync::Arc;
use std::time::Instant;

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
    /// Whether frames are measured one after another. What broke or changed on the sheet stays so: an electrode of which not much
    /// can be said against it is then only left out when that lasts, a contact only believed to have changed after
    /// 16 frames, and that no touches explain them only said after 4. Otherwise each frame is judged by itself.
    pub sequence: bool,
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
            drop: 0.0,
            drop_below_ridge: 0.1,
            false_alarm: 1e-6,
            touches: TouchOptions {
                smoothing_mm: (0.05 * extent).max(0.6 * imager.grid.cell_mm()),
                least_of_strongest: 0.25,
                prominence: 0.08,
                least_rise: 0.005,
            },
            fit: (method == Method::Nnls).then(|| FitOptions::for_extent(extent)),
            sequence: false,
        }
    }

    /// The same for frames measured one after another.
    pub fn of_sequence(self) -> Self {
        Self { sequence: true, ..self }
    }
}

/// What became of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameResult {
    /// Relative rise in resistivity of every cell; all zero when the gate found nothing.
    pub x: Vec<f64>,
    /// Touches, strongest first.
    pub touches: Vec<Touch>,
    /// Part of the change that the picture leaves unexplained, 0 to 1.
    pub residual: f64,
    /// The solve's proof: relative KKT residual of the problem that was solved, which leaves out the directions below
    /// [`ReconstructorOptions::drop_below_ridge`].
    pub gap: f64,
    /// Time of the solve alone, us; 0 when the gate found nothing.
    pub solve_us: f64,
    /// Noise of one value, V of the model, where it could be told; of a mean, where this is that of several frames.
    pub noise: Option<NoiseEstimate>,
    /// Of how many frames one after another, in which nothing changed, this is the mean's result.
    pub frames: usize,
    /// Whether frames of the result before are among them.
    pub grown: bool,
    /// How many values took part.
    pub used: usize,
    /// Whether there was a change above the noise.
    pub changed: bool,
    /// How the solve ended.
    pub status: Status,
    /// Mean squared misfit of the touches' fit, in variances of the noise; none where the touches are the picture's peaks
    /// because discs do not explain the frame.
    pub misfit: Option<f64>,
    /// What speaks against the touches.
    pub doubt: Option<Doubt>,
    /// Electrodes whose contact changed since the baseline, and whose doing was taken out of the frame.
    pub contacts: Vec<usize>,
    /// Whether this frame was reconstructed. Otherwise it differs from an earlier one by nothing but noise, and the rest is
    /// that one's result.
    pub anew: bool,
}

impl FrameResult {
    /// The result of a frame in which nothing was looked for.
    pub fn nothing(imager: &Imager) -> Self {
        Self {
            x: vec![0.0; imager.grid.len()],
            touches: Vec::new(),
            residual: 0.0,
            gap: 0.0,
            solve_us: 0.0,
            noise: None,
            frames: 1,
            grown: false,
            used: 0,
            changed: false,
            status: Status::Converged,
            misfit: None,
            doubt: None,
            contacts: Vec::new(),
            anew: true,
        }
    }

    /// Makes it the result of a frame in which there was nothing.
    fn clear(&mut self, noise: Option<NoiseEstimate>, used: usize) {
        self.anew = self.changed;
        if self.changed {
            self.x.fill(0.0);
            self.touches.clear();
            (self.residual, self.gap, self.solve_us) = (0.0, 0.0, 0.0);
            (self.changed, self.status, self.misfit) = (false, Status::Converged, None);
        }
        (self.noise, self.used, self.doubt) = (noise, used, None);
        (self.frames, self.grown) = (1, false);
        self.contacts.clear();
    }
}

/// The reduced problem for one set of weights.
struct Weighted {
    used: Vec<bool>,
    spread: Vec<f64>,
    /// Electrodes whose contact's doing is left out.
    contacts: Vec<usize>,
    /// What contacts do, reduced; made with the table.
    suspects: Option<Suspects>,
    problem: Problem,
    /// Onto its rows.
    projector: Projector,
    /// What is left of it for the solve, and the ridge that it was made for.
    solving: Option<(f64, Problem)>,
    /// Expected rise of every cell over `expected_rise`: the problem's columns are scaled by it.
    prior: DVector<f64>,
    /// The problem with cells that fall; made when a frame first needs it.
    with_falls: Option<Problem>,
    /// Answers to touches in the reduced space; made for the watch, or when a frame first needs them.
    table: Option<ResponseTable>,
}

/// Turns frames into pictures, with its state from frame to frame.
pub struct Reconstructor {
    imager: Arc<Imager>,
    options: ReconstructorOptions,
    reciprocity: Reciprocity,
    health: Health,
    fitter: Option<Fitter>,
    /// Rank, degrees of freedom, and the gate at them.
    gate: Option<([usize; 2], f64)>,
    finder: TouchFinder,
    weighted: Option<Weighted>,
    /// The one in use before: contacts and values may come and go.
    other: Option<Weighted>,
    nnls: Nnls,
    /// What contacts do.
    contacts: Option<Contacts>,
    /// Which of them changed.
    inquiry: Inquiry,
    /// Frames one after another that no touches explained.
    unexplained: usize,
    baselines: usize,
    /// A frame without its contacts' scales.
    evened: Option<Difference>,
    /// Noise of one value known from a recording of the unpressed sheet, V of the model.
    known_noise: Option<f64>,
    /// How many frames the baseline is the mean of.
    baseline_frames: f64,
    watch: Option<Watch>,
    /// The mean of frames at rest, and how many the frame being reconstructed is of.
    mean: Vec<f64>,
    frames: usize,
    grown: bool,
    most_frames: usize,
    /// Variance of one frame's noise over that of what is being reconstructed.
    gain: f64,
    differences: Differences,
    /// The frame weighted, and reduced.
    values: Vec<f64>,
    reduced: Vec<f64>,
    result: FrameResult,
}

/// Largest relative KKT residual of a converged solve.
const TOLERANCE: f64 = 1e-9;
const MOST_STEPS: usize = 60;
/// A picture's largest rise over the expected one before more is expected.
const LARGEST_OVER_EXPECTED: f64 = 4.0;
const MOST_RESCALINGS: usize = 2;
/// Frames one after another that no touches explain before that is said: a touch that comes down while a frame is measured fits
/// none either.
const NOT_TOUCHES_FRAMES: usize = 4;
/// Frames one after another in which a changed contact must explain more than touches do.
const CONTACT_FRAMES: usize = 16;
/// A peak whose integrated rise is less than this fraction of the greatest integrated fall is what the fall leaves around
/// it.
const LEAST_OVER_FALL: f64 = 0.5;
/// Least relative sensitivity of a cell, against the median, that its expected rise follows.
const LEAST_SENSITIVITY: f64 = 1e-3;

impl Reconstructor {
    /// Prepares for frames of an imager.
    pub fn new(imager: Arc<Imager>, options: ReconstructorOptions) -> Self {
        Self {
            reciprocity: Reciprocity::new(&imager.pattern, imager.drive),
            health: Health::new(&imager.pattern, options.sequence),
            fitter: options.fit.and_then(|f| Fitter::new(&imager, f)),
            gate: None,
            finder: TouchFinder::new(&imager.grid, options.touches),
            weighted: None,
            other: None,
            contacts: options.fit.and_then(|_| Contacts::new(&imager)),
            inquiry: Inquiry::new(if options.sequence { CONTACT_FRAMES } else { 1 }),
            unexplained: 0,
            baselines: 0,
            evened: None,
            nnls: Nnls::new(NnlsOptions {
                ridge: 1.0,
                tolerance: TOLERANCE,
                most_steps: MOST_STEPS,
            }),
            known_noise: None,
            baseline_frames: f64::INFINITY,
            watch: None,
            mean: Vec::new(),
            frames: 1,
            grown: false,
            most_frames: usize::MAX,
            gain: 1.0,
            differences: Differences::default(),
            values: Vec::new(),
            reduced: Vec::new(),
            result: FrameResult::nothing(&imager),
            imager,
            options,
        }
    }

    /// The imager.
    pub fn imager(&self) -> &Arc<Imager> {
        &self.imager
    }

    /// Rank of the sensitivity in use; none before the first frame.
    pub fn rank(&self) -> Option<usize> {
        self.weighted.as_ref().map(|w| w.problem.rank())
    }

    /// Sets the noise of one value of the difference (V of the model), known from a recording of the unpressed sheet;
    /// `None` to tell it from every frame.
    pub fn set_noise(&mut self, sigma: Option<f64>) {
        self.known_noise = sigma.filter(|s| *s > 0.0 && s.is_finite());
    }

    /// Sets of how many frames the baseline is the mean: its noise stays where those of a scene at rest are averaged. Without, or for 0,
    /// the baseline is taken to have none.
    pub fn set_baseline_frames(&mut self, frames: usize) {
        let frames = if frames > 0 { frames as f64 } else { f64::INFINITY };
        if std::mem::replace(&mut self.baseline_frames, frames) != frames {
            // It was made for another one's noise.
            self.watch = None;
        }
    }

    /// Averages at most so many frames of a scene at rest: fewer than 16 where frames are slow, so that what drifts is not left behind; fewer
    /// than two average nothing.
    pub fn set_most_frames(&mut self, frames: usize) {
        self.most_frames = frames;
    }

    /// Makes ready for frames against a baseline, which takes as long as many frames (60 ms): else the first one waits for it. With the
    /// noise known only.
    ///
    /// # Errors
    /// [`ImagerError::Baseline`] when its length does not match the pattern.
    pub fn prepare(&mut self, baseline: &[f64]) -> Result<(), ImagerError> {
        if let Some(sigma) = self.known_noise
            && self.watch.as_ref().is_none_or(|w| !w.is_for(baseline, sigma))
        {
            self.watch = self.start_watch(baseline, sigma)?;
        }
        Ok(())
    }

    /// Reconstructs a frame against a baseline (both in any one unit).
    ///
    /// With the noise known, a frame that shows nothing, or in a sequence ([`ReconstructorOptions::sequence`]) nothing new, costs one
    /// product with a small matrix and no allocation: the result is then the earlier one ([`FrameResult::anew`]). Frames of a sequence
    /// that show nothing new are averaged, and the result is made anew from the mean of 2, 4,
    /// 8 and 16.
    ///
    /// # Errors
    /// [`ImagerError::Baseline`] when a length does not match the pattern.
    pub fn frame(&mut self, baseline: &[f64], frame: &[f64]) -> Result<&mut FrameResult, ImagerError> {
        let mut known = self.known_noise.map(|sigma| NoiseEstimate {
            sigma,
            freedom: usize::MAX,
        });
        (self.frames, self.grown, self.gain) = (1, false, 1.0);
        if let Some(known) = &mut known {
            self.prepare(baseline)?;
            if let Some(watch) = &mut self.watch {
                watch.set_most(if self.options.sequence { self.most_frames } else { 1 });
                match watch.look(frame) {
                    Seen::Nothing => {
                        watch.forget();
                        self.result.clear(Some(*known), watch.used());
                        self.nnls.reset();
                        self.fitter.iter_mut().for_each(Fitter::forget);
                        self.begin_anew();
                        return Ok(&mut self.result);
                    }
                    Seen::Same if self.options.sequence => {
                        self.result.anew = false;
                        return Ok(&mut self.result);
                    }
                    Seen::Mean => {
                        let (mean, frames, grown) = watch.mean();
                        self.mean.clear();
                        self.mean.extend_from_slice(mean);
                        (self.frames, self.grown) = (frames, grown);
                        let of_baseline = 1.0 / self.baseline_frames;
                        self.gain = (1.0 + of_baseline) / (1.0 / frames as f64 + of_baseline);
                        known.sigma /= self.gain.sqrt();
                    }
                    // Frames that have nothing to do with each other are not each other's results.
                    Seen::Same | Seen::New => watch.begin(frame),
                }
            }
        }
        let mean = std::mem::take(&mut self.mean);
        let frame = if self.frames > 1 { &mean } else { frame };
        let done = self.reconstruct(baseline, frame, known);
        self.mean = mean;
        done?;
        Ok(&mut self.result)
    }

    /// Reconstructs a frame, or the mean of several.
    fn reconstruct(
        &mut self,
        baseline: &[f64],
        frame: &[f64],
        known: Option<NoiseEstimate>,
    ) -> Result<(), ImagerError> {
        self.imager.fits(baseline, frame)?;
        let mut differences = std::mem::take(&mut self.differences);
        differences.to(&self.imager.model_v, baseline, frame);
        let baselines = differences.baselines();
        if self.baselines != baselines {
            self.baselines = baselines;
            self.begin_anew();
        }
        if !self.options.sequence {
            // What was in the frame before says nothing of this one.
            self.fitter.iter_mut().for_each(Fitter::forget);
        }
        let difference = differences.to(&self.imager.model_v, baseline, frame);
        // Nothing is left out of frames that are averaged, and what would be of their mean is not in a frame.
        let judged = if self.frames > 1 {
            None
        } else {
            self.health
                .judge(&mut self.reciprocity, &self.imager.model_v, difference)
        };
        self.settle(difference, known.or(judged));
        if let Some(watch) = &mut self.watch
            && (self.inquiry.is_open() || !self.inquiry.changed().is_empty() || self.health.is_open())
        {
            // Every frame counts.
            watch.forget();
        }
        let unexplained = self.fitter.is_some() && self.result.misfit.is_none() && !self.result.touches.is_empty();
        self.unexplained = if unexplained { self.unexplained + 1 } else { 0 };
        let unexplained = self.unexplained >= if self.options.sequence { NOT_TOUCHES_FRAMES } else { 1 };
        let changed = self.inquiry.changed();
        let contact = changed.first().map(|electrode| Doubt::Contact {
            electrode: *electrode,
            more: changed.len() - 1,
        });
        self.result.doubt = Doubt::of(difference, &self.imager.model_v)
            .or(unexplained.then_some(Doubt::NotTouches))
            .or(contact);
        self.result.contacts.clear();
        self.result.contacts.extend_from_slice(changed);
        self.differences = differences;
        Ok(())
    }

    /// Knows nothing of earlier frames any more that lasts on the sheet.
    fn begin_anew(&mut self) {
        self.inquiry.clear();
        self.health.clear();
        self.unexplained = 0;
    }

    fn start_watch(&mut self, baseline: &[f64], sigma: f64) -> Result<Option<Watch>, ImagerError> {
        let nothing = self.imager.difference(baseline, baseline)?;
        self.begin_anew();
        self.weigh(&nothing);
        // The first touch is not to wait for it.
        self.tabulate();
        let Some(weighted) = &self.weighted else {
            return Ok(None);
        };
        let weight = |k: usize| if nothing.used[k] { 1.0 / nothing.spread[k] } else { 0.0 };
        let offset: Vec<f64> = self
            .imager
            .model_v
            .iter()
            .enumerate()
            .map(|(k, v)| v * weight(k))
            .collect();
        let gain = baseline
            .iter()
            .zip(&offset)
            .map(|(b, o)| if *o == 0.0 { 0.0 } else { o / b })
            .collect();
        let (signal, false_alarm) = (self.options.expected_rise / sigma, self.options.false_alarm);
        Ok(Watch::new(
            &weighted.problem,
            baseline,
            (gain, offset),
            sigma,
            signal,
            false_alarm,
            1.0 / (1.0 + 1.0 / self.baseline_frames),
        ))
    }

    /// Weighs and reduces a difference, into `weighted` and `reduced`; false when no value is left.
    fn reduce(&mut self, difference: &Difference) -> bool {
        self.weigh(difference);
        let Some(weighted) = &mut self.weighted else {
            return false;
        };
        self.values.clear();
        self.values
            .extend(difference.y.iter().zip(&difference.spread).map(|(y, s)| y / s));
        let values = &self.values;
        let reduced = weighted
            .projector
            .project(|to| to[..values.len()].copy_from_slice(values));
        self.reduced.clear();
        self.reduced.extend_from_slice(reduced);
        !self.reduced.is_empty()
    }

    /// Whether the reduced frame holds more than noise. A quiet one makes the next solve start afresh.
    fn passes(&mut self, noise: NoiseEstimate) -> bool {
        let arguments = [self.reduced.len(), noise.freedom];
        let limit = match self.gate {
            Some((known, limit)) if known == arguments => limit,
            _ => gate(self.reduced.len(), noise.freedom, self.options.false_alarm),
        };
        self.gate = Some((arguments, limit));
        let passes = self.power() > noise.sigma * noise.sigma * limit;
        if !passes {
            self.nnls.reset();
            self.fitter.iter_mut().for_each(Fitter::forget);
        }
        passes
    }

    /// Mean square of the reduced frame.
    fn power(&self) -> f64 {
        self.reduced.iter().map(|v| v * v).sum::<f64>() / self.reduced.len() as f64
    }

    /// Reconstructs a difference into the result. With `patient`, the touches' search must end in this frame.
    fn solve(&mut self, difference: &Difference, noise: Option<NoiseEstimate>, patient: bool) {
        let used = difference.used.iter().filter(|u| **u).count();
        // What the watch let through has something in it, unless it was in the values that are left out now.
        let watched = self.known_noise.is_some()
            && self.inquiry.changed().is_empty()
            && self.watch.as_ref().is_some_and(|w| w.used() == used);
        if !self.reduce(difference) || noise.is_some_and(|n| !watched && !self.passes(n)) {
            self.result.clear(noise, used);
            (self.result.anew, self.result.frames, self.result.grown) = (true, self.frames, self.grown);
            return;
        }
        // Without a way to tell the noise everything counts as a change, at a noise that keeps the solve well posed.
        let power = self.power();
        let sigma = noise.map_or(1e-2 * power.sqrt(), |n| n.sigma);
        let mut result = std::mem::take(&mut self.result);
        (result.noise, result.used, result.changed, result.anew) = (noise, used, true, true);
        (result.frames, result.grown, result.misfit) = (self.frames, self.grown, None);
        let start = Instant::now();
        // The picture of a mean is as sharp as that of a frame, and quieter.
        let of_frame = self.known_noise.filter(|_| self.frames > 1).unwrap_or(sigma);
        let ridge = self.picture(of_frame.hypot(self.options.model_error * power.sqrt()), &mut result);
        result.solve_us = start.elapsed().as_secs_f64() * 1e6;
        self.finder.find(&result.x, &mut result.touches);
        if !self.fit(sigma, noise, patient, &mut result)
            && let Some(ridge) = ridge.filter(|_| self.fitter.is_some())
        {
            self.with_falls(ridge, &mut result);
        }
        self.result = result;
    }

    /// Reduces the answers to touches and to contacts for the values in use, once.
    fn tabulate(&mut self) {
        let (Some(fitter), Some(weighted)) = (&self.fitter, &mut self.weighted) else {
            return;
        };
        if weighted.table.is_none() {
            let (used, spread, problem) = (&weighted.used, &weighted.spread, &weighted.problem);
            let reduce_all = |volts: &DMatrix<f64>| problem.reduce_all(&weighed(volts, used, spread));
            let contacts = self.contacts.as_ref();
            weighted.suspects = contacts.map(|c| Suspects::new(c, &self.imager, reduce_all));
            weighted.table = Some(fitter.volts().map(reduce_all));
        }
    }

    /// Fits touches from the picture's; false when discs do not explain the frame.
    fn fit(&mut self, sigma: f64, noise: Option<NoiseEstimate>, patient: bool, result: &mut FrameResult) -> bool {
        self.tabulate();
        let (Some(fitter), Some(weighted)) = (&mut self.fitter, &mut self.weighted) else {
            return false;
        };
        let Some(table) = &weighted.table else { return false };
        let mut reduction = WeightedProjection {
            used: &weighted.used,
            spread: &weighted.spread,
            projector: &mut weighted.projector,
        };
        let data = Data {
            table,
            reduction: &mut reduction,
            values: &self.reduced,
            sigma,
            noise,
            gain: self.gain,
            patient,
        };
        let seeds = result.touches.iter().map(|t| [t.x_mm, t.y_mm]);
        let Some(fitted) = fitter.fit(data, seeds) else {
            return false;
        };
        // Only a frame of which all values took part lies in the space that the watch looks at.
        let whole = |w: &&mut Watch| w.used() == result.used && self.inquiry.changed().is_empty();
        let mean = self.frames > 1;
        if let Some(watch) = self.watch.as_mut().filter(|w| (fitted.settled || mean) && whole(w)) {
            watch.remember(&self.reduced, &fitted.slopes, table.stride());
            if !(fitted.settled && fitted.finished) {
                watch.once_more();
            }
        }
        result.touches.clone_from(&fitted.touches);
        result.misfit = Some(fitted.misfit);
        true
    }

    /// Lets the picture fall as well as rise: where no touches explain a frame, nothing says that it only rises (metal
    /// beside a finger, say). With a voltage drive a fall somewhere looks much like a rise everywhere else, so that a
    /// picture of rises alone can explain it well and be wrong.
    fn with_falls(&mut self, ridge: f64, result: &mut FrameResult) {
        let Some(weighted) = self.weighted.as_mut() else {
            return;
        };
        let problem = &weighted.problem;
        let both = weighted.with_falls.get_or_insert_with(|| problem.with_falls(1.0));
        let solution = Nnls::new(NnlsOptions {
            ridge,
            ..self.nnls.options()
        })
        .solve(both, &DVector::from_column_slice(&self.values));
        let mut x = solution.x;
        scale(x.as_mut_slice(), &weighted.prior);
        let (rises, falls) = x.as_slice().split_at(self.imager.grid.len());
        self.finder.find(falls, &mut result.touches);
        let fall = result.touches.iter().map(|t| t.total_mm2).fold(0.0, f64::max);
        result.x.copy_from_slice(rises);
        result.residual = solution.residual;
        result.gap = solution.gap;
        result.status = solution.status;
        self.finder.find(rises, &mut result.touches);
        result.touches.retain(|t| t.total_mm2 >= LEAST_OVER_FALL * fall);
    }

    /// Solves by the method asked for, x in relative rise; returns the ridge where there is one to go on with.
    fn picture(&mut self, sigma: f64, result: &mut FrameResult) -> Option<f64> {
        result.x.resize(self.imager.grid.len(), 0.0);
        let Some(weighted) = &mut self.weighted else {
            result.x.fill(0.0);
            result.status = Status::BadInput;
            return None;
        };
        let problem = &weighted.problem;
        let mut expected = self.options.expected_rise;
        if self.options.method != Method::Nnls {
            let b = DVector::from_column_slice(&self.values);
            let solution = match self.options.method {
                Method::LawsonHanson => lawson_hanson(problem, &b),
                Method::PseudoInverse => pseudo_inverse(problem, &b),
                _ => {
                    // What the model gets wrong cannot be explained by any ridge: then that of the expected rise.
                    let ridge = discrepancy_ridge(problem, &b, sigma).max(sigma / expected);
                    let mut solution = tikhonov(problem, &b, ridge);
                    scale(solution.x.as_mut_slice(), &weighted.prior);
                    solution
                }
            };
            result.x.copy_from_slice(solution.x.as_slice());
            (result.residual, result.gap, result.status) = (solution.residual, solution.gap, solution.status);
            return None;
        }
        let ridge = sigma / expected;
        let known = weighted.solving.as_ref().map_or(0.0, |(made_for, _)| ridge / made_for);
        // A ridge told from frame after frame scatters; a larger one loses less by what is left out, not more.
        if !(0.5..8.0).contains(&known) {
            let fraction = self.options.drop_below_ridge * ridge / problem.singular().max();
            weighted.solving = Some((ridge, problem.without(fraction)));
        }
        let problem = weighted.solving.as_ref().map_or(problem, |(_, p)| p);
        self.nnls.set_ridge(ridge);
        let mut outcome = self.nnls.solve_into(problem, &self.values, &mut result.x);
        // A picture far beyond what was expected was held down by the ridge: expect more and solve again.
        for _ in 0..MOST_RESCALINGS {
            let rises = result.x.iter().zip(&weighted.prior).map(|(x, prior)| x * prior);
            let largest = rises.fold(0.0, f64::max);
            if largest <= LARGEST_OVER_EXPECTED * expected {
                break;
            }
            expected = largest / LARGEST_OVER_EXPECTED;
            self.nnls.set_ridge(sigma / expected);
            outcome = self.nnls.solve_into(problem, &self.values, &mut result.x);
        }
        scale(&mut result.x, &weighted.prior);
        (result.residual, result.gap, result.status) = (outcome.residual, outcome.gap, outcome.status);
        Some(sigma / expected)
    }

    /// Prepares the reduced problem for the values in use and their weights; kept while they stay the same.
    fn weigh(&mut self, difference: &Difference) {
        let changed = self.inquiry.changed();
        let fits = |w: &Weighted| w.used == difference.used && w.spread == difference.spread && w.contacts == changed;
        if self.weighted.as_ref().is_some_and(fits) {
            return;
        }
        std::mem::swap(&mut self.weighted, &mut self.other);
        if self.weighted.as_ref().is_some_and(fits) {
            self.nnls.reset();
            return;
        }
        let mut a = self.imager.sensitivity.clone();
        for (k, mut row) in a.row_iter_mut().enumerate() {
            row *= if difference.used[k] {
                1.0 / difference.spread[k]
            } else {
                0.0
            };
        }
        // Lawson-Hanson and the generalised inverse are the plain methods; the others expect less of sensitive cells.
        let ridged = matches!(self.options.method, Method::Nnls | Method::Tikhonov);
        let depth = if ridged { self.options.depth } else { 0.0 };
        let norms: Vec<f64> = a.column_iter().map(|c| c.norm()).collect();
        let mut sorted = norms.clone();
        sorted.sort_by(f64::total_cmp);
        let median = sorted[sorted.len() / 2].max(f64::MIN_POSITIVE);
        let prior = DVector::from_iterator(
            norms.len(),
            norms.iter().map(|n| (n / median).max(LEAST_SENSITIVITY).powf(-depth)),
        );
        for (mut column, prior) in a.column_iter_mut().zip(&prior) {
            column *= *prior;
        }
        let mut left_out = Basis::default();
        for electrode in self.inquiry.changed() {
            let shapes = self.contacts.as_mut().and_then(|c| c.shapes(&self.imager, *electrode));
            if let Some(shapes) = shapes {
                let shapes = weighed(shapes, &difference.used, &difference.spread);
                shapes.column_iter().for_each(|c| left_out.add(c.as_slice()));
            }
        }
        for mut column in a.column_iter_mut() {
            left_out.outside(column.as_mut_slice());
        }
        self.nnls.reset();
        let problem = Problem::new(&a, self.options.drop);
        self.weighted = Some(Weighted {
            used: difference.used.clone(),
            spread: difference.spread.clone(),
            contacts: self.inquiry.changed().to_vec(),
            suspects: None,
            projector: Projector::new(&problem, problem.rank()),
            problem,
            solving: None,
            prior,
            with_falls: None,
            table: None,
        });
    }
}

/// Volts of the model (a frame in each column) over the spread of the values, 0 for those that are not used.
fn weighed(volts: &DMatrix<f64>, used: &[bool], spread: &[f64]) -> DMatrix<f64> {
    DMatrix::from_fn(volts.nrows(), volts.ncols(), |k, c| {
        if used[k] { volts[(k, c)] / spread[k] } else { 0.0 }
    })
}

/// Makes a solution of the scaled problem relative rises (and falls, where it holds both).
fn scale(x: &mut [f64], prior: &DVector<f64>) {
    for part in x.chunks_exact_mut(prior.len().max(1)) {
        part.iter_mut().zip(prior).for_each(|(x, prior)| *x *= prior);
    }
}

/// How many times its noise the mean power of a frame may be by chance: the quantile of Fisher's distribution (of
/// chi-square where the noise is known).
fn gate(rank: usize, freedom: usize, false_alarm: f64) -> f64 {
    let freedom = if freedom == usize::MAX { 1e7 } else { freedom as f64 };
    FisherSnedecor::new(rank as f64, freedom).map_or(f64::INFINITY, |f| f.inverse_cdf(1.0 - false_alarm))
}
