//! One frame, with the values and contacts that take part given: weigh, reduce, gate, picture, fit.

mod contacts;
mod outliers;
mod rim;
mod time;
mod unexplained;
mod unreached;

pub(crate) use self::contacts::Candidate;
use self::rim::{AtRim, BesideTouches};
use self::unreached::tells_noise;
use crate::change::detector::ChangeDetector;
use crate::linalg::vector::square;
use crate::pipeline::image::ImageSolver;
use crate::pipeline::options::ReconstructorOptions;
use crate::pipeline::result::FrameResult;
use crate::pipeline::weighted::{Pictures, Weightings};
use crate::pipeline::work::Work;
use crate::quality::contact::{Cause, Contacts};
use crate::reference::Difference;
use crate::reference::drift::{Drift, DriftShapes, Drifting};
use crate::reference::imager::Imager;
use crate::reference::noise::{NoiseEstimate, NoiseSource};
use crate::stats::fisher_quantile;
use crate::touches::fit::disc::MOST_TOUCHES;
use crate::touches::fit::fitter::{Beside, Data, Fitter, Places};
use crate::touches::fit::fitter_options::FitterOptions;
use crate::touches::fit::matched_filter::MatchedFilter;
use crate::touches::fit::reduction::WeightedProjection;
use crate::touches::polarity::Polarity;
use crate::touches::touch::Touch;
use arrayvec::ArrayVec;
use forward::Geometry;
use std::sync::Arc;
use std::time::Instant;

/// A picture that leaves more than this part of a change is no picture of what is on the sheet: the model is wrong. Those of objects in
/// tanks leave up to 0.15, those of real skins half and more.
const MOST_RESIDUAL: f64 = 0.3;
/// Touches that stand out together by so many standard deviations are not passed over in silence.
const UNPLACED_SAID: f64 = 20.0;

/// Of how many frames the values are the mean.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Averaged {
    pub(crate) frames: usize,
    /// Whether frames of the result before are among them.
    pub(crate) grown: bool,
    /// Variance of one frame's noise over that of the mean.
    pub(crate) gain: f64,
    /// Noise of one of the frames, V of the model, where there are several.
    pub(crate) frame_sigma: Option<f64>,
}

impl Averaged {
    /// One frame.
    pub(crate) const ONE: Self = Self {
        frames: 1,
        grown: false,
        gain: 1.0,
        frame_sigma: None,
    };
}

/// A frame to be solved.
#[derive(Clone, Copy)]
pub(crate) struct Task<'a> {
    pub(crate) difference: &'a Difference,
    /// None where nothing tells it.
    pub(crate) noise: Option<NoiseEstimate>,
    pub(crate) averaged: Averaged,
    /// What is taken to drift.
    pub(crate) drifting: Drifting,
    /// What changed at the rim, whose shapes are left out.
    pub(crate) changed: &'a [Cause],
    /// Which way touches change the resistivity.
    pub(crate) polarity: Polarity,
    /// Whether the detector has seen the frame: only then it can take it for the last one.
    pub(crate) seen: bool,
    /// Whether the frame shows no touch: what it shows is drift, or contacts.
    pub(crate) quiet: bool,
    /// Whether every search of the fit goes as far as a frame may: to its end, where frames do not follow one another.
    pub(crate) patient: bool,
    /// Whether the error of the linear model may be solved for.
    pub(crate) corrected: bool,
}

/// A frame's picture, made when it is asked for.
struct Picture<'a> {
    image: &'a mut ImageSolver,
    pictures: &'a mut Pictures,
    options: &'a ReconstructorOptions,
    values: &'a [f64],
    sigma: f64,
    polarity: Polarity,
    result: &'a mut FrameResult,
    made: bool,
    ridge: Option<f64>,
}

impl Picture<'_> {
    /// Solves for it, once. Its peaks are then the result's touches.
    fn make(&mut self) {
        if std::mem::replace(&mut self.made, true) {
            return;
        }
        let start = Instant::now();
        let Self { options, values, .. } = *self;
        let (sigma, polarity) = (self.sigma, self.polarity);
        self.ridge = self
            .image
            .solve(options, self.pictures, values, (sigma, polarity), self.result);
        if let (Polarity::Either, Some(ridge)) = (polarity, self.ridge) {
            self.image
                .solve_with_falls(options, self.pictures, values, (ridge, polarity), self.result);
        }
        self.result.solve_us += start.elapsed().as_secs_f64() * 1e6;
    }

    /// Where its peaks are, mm.
    fn places(&mut self) -> Places {
        self.make();
        let touches = self.result.touches.iter().take(MOST_TOUCHES);
        touches.map(|t| [t.x_mm, t.y_mm]).collect()
    }

    /// Squares of what it leaves of the whole frame, and of the reduced one.
    fn left(&self, reduced: &[f64]) -> [f64; 2] {
        let whole = square(self.values);
        let left = self.result.residual.powi(2) * whole;
        [left, (left - whole + square(reduced)).max(0.0)]
    }
}

/// Solves frames of one imager.
pub(crate) struct FrameSolver {
    imager: Arc<Imager>,
    options: ReconstructorOptions,
    weightings: Weightings,
    image: ImageSolver,
    fitter: Option<Fitter>,
    filter: MatchedFilter,
    /// What the fit goes on from.
    fitting: Drifting,
    /// None where the sheet cannot be solved.
    drift: Option<DriftShapes>,
    contacts: Option<Contacts>,
    /// Ranks and noise that gates were computed for, and the gates.
    gates: ArrayVec<(usize, NoiseSource, f64), 4>,
    /// The frame weighted, and reduced.
    values: Vec<f64>,
    reduced: Vec<f64>,
    /// The frame along the nuisance directions.
    sizes: Vec<f64>,
    /// Square of what the picture made last leaves of the reduced frame.
    left: f64,
    /// The contact that would explain the frame alone.
    alone: Option<usize>,
    /// The electrode that slipped, or the leak, by what drifts beside it.
    at_rim: [Option<AtRim>; Drifting::ALL.len()],
    beside_touches: BesideTouches,
    /// Ridges of the pictures solved last, by what drifts.
    ridges: [Option<f64>; Drifting::ALL.len()],
    /// Room for touches.
    spare: Vec<Touch>,
    /// What this frame has taken.
    work: Work,
    /// Whether time for a search is kept free in it.
    keeps_free: bool,
}

impl FrameSolver {
    pub(crate) fn new(imager: &Arc<Imager>, options: ReconstructorOptions) -> Self {
        let drift = DriftShapes::new(imager);
        let of_fitter = FitterOptions {
            most_misfit: options.most_misfit,
            ..FitterOptions::default()
        };
        let mut fitter = options.fit.and_then(|f| Fitter::with_options(imager, f, of_fitter));
        if options.sequence {
            fitter.iter_mut().for_each(Fitter::prepare_motion);
        }
        Self {
            weightings: Weightings::default(),
            image: ImageSolver::new(imager, &options),
            fitter,
            filter: MatchedFilter::default(),
            contacts: options.fit.and(drift.as_ref()).map(|d| Contacts::new(imager, d)),
            drift,
            fitting: Drifting::Common,
            gates: ArrayVec::new(),
            values: Vec::new(),
            reduced: Vec::new(),
            sizes: Vec::new(),
            left: 0.0,
            alone: None,
            at_rim: [None; Drifting::ALL.len()],
            beside_touches: BesideTouches::default(),
            ridges: [None; Drifting::ALL.len()],
            spare: Vec::new(),
            work: Work::default(),
            keeps_free: false,
            imager: Arc::clone(imager),
            options,
        }
    }

    /// The imager.
    pub(crate) fn imager(&self) -> &Imager {
        &self.imager
    }

    /// Whether its frames follow one another.
    pub(crate) fn is_of_sequence(&self) -> bool {
        self.options.sequence
    }

    /// Rank of the problem in use; none before the first.
    pub(crate) fn rank(&self) -> Option<usize> {
        self.weightings.current().map(|w| w.pictures.problem.rank())
    }

    /// Whether the search of the frame solved last came to its end. What is found beside its touches is then not theirs.
    pub(crate) fn is_finished(&self) -> bool {
        self.fitter.as_ref().is_some_and(|f| f.last().finished)
    }

    /// Whether it did, and no solution of the sheet would change its touches.
    pub(crate) fn is_settled(&self) -> bool {
        self.is_finished() && self.fitter.as_ref().is_some_and(|f| f.last().settled)
    }

    /// All touches that were fitted last: also those whose places are not known.
    pub(crate) fn fitted_touches(&self) -> &[Touch] {
        self.fitter.as_ref().map_or(&[], |f| &f.last().touches)
    }

    /// Whether touches are fitted to the measurements.
    pub(crate) fn fits(&self) -> bool {
        self.fitter.is_some()
    }

    /// Whether touches that leave this misfit explain a frame, by the noise alone; `gain` is that of a mean.
    pub(crate) fn explains(&self, misfit: f64, gain: f64) -> bool {
        self.fitter.as_ref().is_some_and(|f| f.options().explains(misfit, gain))
    }

    /// Whether touches may leave this misfit, and this part of the change, of a frame that they explain; `gain` is that of a mean.
    pub(crate) fn may_leave(&self, misfit: f64, part: f64, gain: f64) -> bool {
        let options = self.fitter.as_ref().map(Fitter::options);
        options.is_some_and(|o| o.explains(misfit, gain) || part <= o.most_residual)
    }

    /// Whether the touches of a result explain its frame; `gain` is that of a mean. A search that was cut short shows what it has, and
    /// explains nothing yet. In a table each comes to its end.
    pub(crate) fn is_explained(&self, result: &FrameResult, gain: f64) -> bool {
        let explains = |misfit| !self.options.sequence || self.may_leave(misfit, result.residual, gain);
        self.fits() && result.misfit.is_some_and(explains)
    }

    /// Begins another fit of the frame, with touches of other signs or without a contact.
    pub(crate) fn begin_other(&mut self, drifting: Drifting) {
        self.fit_beside(drifting);
        self.fitter.iter_mut().for_each(Fitter::begin_other);
    }

    /// Goes on from the last frame before that.
    pub(crate) fn end_other(&mut self) {
        self.fitter.iter_mut().for_each(Fitter::end_other);
    }

    /// Starts the next fit without the touches of the frame before: they have gone.
    pub(crate) fn forget_touches(&mut self) {
        self.fitter.iter_mut().for_each(Fitter::forget);
    }

    /// Starts the next fit of the frame without the touches that were found in it.
    pub(crate) fn forget_found(&mut self) {
        self.fitter.iter_mut().for_each(Fitter::forget_found);
    }

    /// Starts the next frame without anything of the frame before.
    pub(crate) fn forget(&mut self) {
        self.weightings.forget();
        self.forget_touches();
    }

    /// Makes the next frame stand alone: nothing of it depends on an earlier one, to the last bit.
    pub(crate) fn stand_alone(&mut self) {
        self.weightings.forget();
        self.fitter.iter_mut().for_each(Fitter::stand_alone);
        (self.fitting, self.ridges) = (Drifting::Common, [None; Drifting::ALL.len()]);
        self.left = 0.0;
    }

    /// The detector of changes against a reference of which frames have this difference to themselves; none where no value
    /// can be used. Makes ready all that a first touch of a sequence needs; not `at_once` what takes as long as many frames.
    pub(crate) fn detector(
        &mut self,
        unchanged: &Difference,
        baseline: &[f64],
        sigma: f64,
        baseline_share: f64,
        drifting: Drifting,
        at_once: bool,
    ) -> Option<ChangeDetector> {
        self.weigh(unchanged, (drifting, &[]));
        if self.options.sequence {
            self.tabulate(at_once);
        }
        let weighted = self.weightings.current_mut()?;
        if at_once {
            let ridge = sigma / self.options.expected_rise;
            weighted.pictures.prepare(ridge, self.options.drop_below_ridge, false);
        }
        let offset: Vec<f64> = self
            .imager
            .model_v
            .iter()
            .enumerate()
            .map(|(k, v)| v * weighted.weight(k))
            .collect();
        let gain = baseline
            .iter()
            .zip(&offset)
            .map(|(b, o)| if *o == 0.0 { 0.0 } else { o / b })
            .collect();
        ChangeDetector::new(
            &weighted.pictures.problem,
            (gain, offset),
            sigma,
            baseline_share,
            self.options.expected_rise / sigma,
            self.options.false_alarm,
            self.options.change,
        )
    }

    /// Solves a frame into the result. `detector` is the one that let it through, and is told what was fitted.
    pub(crate) fn solve(&mut self, task: Task, detector: Option<&mut ChangeDetector>, result: &mut FrameResult) {
        let used = task.difference.used.iter().filter(|u| **u).count();
        // What the detector let through has something in it, unless it was in the values that are left out now.
        let passed = task.changed.is_empty() && !task.quiet && detector.as_ref().is_some_and(|d| d.used() == used);
        self.weigh(task.difference, (task.drifting, task.changed));
        self.reduce(task.difference);
        if self.reduced.is_empty() || task.noise.is_some_and(|n| !passed && !self.passes(n)) {
            result.clear(task.noise, used);
            if !self.reduced.is_empty() {
                self.drift_alone(task, result);
            }
            (result.anew, result.frames, result.grown) = (true, task.averaged.frames, task.averaged.grown);
            return;
        }
        let Some(noise) = task.noise else { return };
        self.work.fits += 1;
        (result.noise, result.used, result.changed, result.anew) = (Some(noise), used, true, true);
        (result.frames, result.grown) = (task.averaged.frames, task.averaged.grown);
        (result.misfit, result.explained, result.unplaced) = (None, None, false);
        (result.is_pictured, result.gap, result.solve_us) = (false, 0.0, 0.0);
        self.fit(task, noise, detector, result);
        if task.drifting == Drifting::Contacts {
            self.alone = self.alone(noise);
        }
        self.at_rim[task.drifting.index()] = self.at_rim(task, noise);
    }

    /// Finishes a frame. `task` is that of the solve whose result it is. Where no touches explain it, nothing says that the picture only
    /// rises.
    pub(crate) fn finish(&mut self, task: Task, result: &mut FrameResult) {
        let Some(noise) = result.noise.filter(|_| self.fits()) else {
            return;
        };
        // Reciprocity cannot tell an error of the model, or of the board, from noise.
        let hidden = !result.changed && noise.source != NoiseSource::Known && self.stands_out(task);
        if hidden {
            (result.changed, result.anew, result.is_pictured) = (true, true, true);
            result.x.resize(self.imager.grid.len(), 0.0);
        }
        if !result.changed || result.misfit.is_some() {
            return;
        }
        let said = self.said();
        let ridge = self.ridges[task.drifting.index()].filter(|_| !hidden);
        let ridge = ridge.unwrap_or(noise.sigma / self.options.expected_rise);
        // Beside what drifts where there is no time for another problem.
        let beside = if self.is_spent() || self.keeps_free {
            task.drifting
        } else {
            Drifting::Nothing
        };
        self.weigh(task.difference, (beside, task.changed));
        self.reduce(task.difference);
        if let Some(weighted) = self.weightings.current() {
            let pictures = &weighted.pictures;
            self.image
                .solve_with_falls(&self.options, pictures, &self.values, (ridge, said), result);
        }
        if result.residual > MOST_RESIDUAL {
            self.explain_most(task, result);
        }
    }

    /// Makes the picture of a frame whose touches are known; of a sequence beside the pictures that touches are looked for in.
    pub(crate) fn picture(&mut self, task: Task, result: &mut FrameResult) {
        let Some(noise) = result.noise else { return };
        self.weigh(task.difference, (task.drifting, task.changed));
        self.reduce(task.difference);
        let sigma = self.sigma(task, noise);
        let Some(weighted) = self.weightings.current_mut() else {
            return;
        };
        let (image, options, values) = (&mut self.image, &self.options, &self.values);
        std::mem::swap(&mut result.touches, &mut self.spare);
        let left = result.residual;
        let mut make = |pictures: &mut Pictures| {
            let mut picture = Picture {
                image,
                pictures,
                options,
                values,
                sigma,
                polarity: task.polarity,
                result: &mut *result,
                made: false,
                ridge: None,
            };
            picture.make();
        };
        if options.sequence {
            weighted.pictures.beside(make);
            result.residual = left;
        } else {
            make(&mut weighted.pictures);
        }
        std::mem::swap(&mut result.touches, &mut self.spare);
        result.is_pictured = true;
    }

    /// Noise of a value for pictures. That of a mean is as sharp as that of a frame, and quieter.
    fn sigma(&self, task: Task, noise: NoiseEstimate) -> f64 {
        let of_frame = task.averaged.frame_sigma.unwrap_or(noise.sigma);
        of_frame.hypot(self.options.model_error * self.power().sqrt())
    }

    /// Goes on from the touches that were fitted last beside this drift.
    pub(crate) fn fit_beside(&mut self, drifting: Drifting) {
        if self.fitting != drifting {
            let before = std::mem::replace(&mut self.fitting, drifting);
            self.fitter.iter_mut().for_each(|f| f.exchange(before, drifting));
        }
    }

    fn weigh(&mut self, difference: &Difference, left_out: (Drifting, &[Cause])) {
        if left_out.0 != Drifting::Nothing {
            self.fit_beside(left_out.0);
        }
        self.switch(difference, left_out);
    }

    /// Makes this problem the one in use.
    fn switch(&mut self, difference: &Difference, left_out: (Drifting, &[Cause])) {
        let (drift, contacts) = (self.drift.as_ref(), self.contacts.as_mut());
        self.work.problems +=
            self.weightings
                .switch(&self.imager, &self.options, drift, contacts, difference, left_out);
    }

    fn reduce(&mut self, difference: &Difference) {
        self.reduced.clear();
        if let Some(weighted) = self.weightings.current_mut() {
            weighted.reduce(difference, &mut self.values, &mut self.reduced);
        }
    }

    /// Whether the reduced frame holds more than noise. A quiet one makes the next solve start afresh.
    fn passes(&mut self, noise: NoiseEstimate) -> bool {
        let limit = self.limit(self.reduced.len(), noise.source);
        let passes = self.power() > noise.sigma * noise.sigma * limit;
        if !passes {
            self.forget();
        }
        passes
    }

    /// The gate of so many values.
    fn limit(&mut self, rank: usize, noise: NoiseSource) -> f64 {
        if let Some((.., limit)) = self.gates.iter().find(|g| (g.0, g.1) == (rank, noise)) {
            return *limit;
        }
        let limit = gate(rank, noise, self.options.false_alarm);
        if self.gates.is_full() {
            self.gates.pop_at(0);
        }
        self.gates.push((rank, noise, limit));
        limit
    }

    /// Mean square of the reduced frame.
    fn power(&self) -> f64 {
        self.reduced.iter().map(|v| v * v).sum::<f64>() / self.reduced.len() as f64
    }

    fn tabulate(&mut self, at_once: bool) {
        if let (Some(fitter), Some(weighted)) = (&self.fitter, self.weightings.current_mut()) {
            self.work.tables += usize::from(weighted.tables.is_none());
            let contacts = self.contacts.as_ref().filter(|_| self.imager.is_searched());
            let contacts = contacts.map(|contacts| (contacts, &*self.imager));
            weighted.tabulate(fitter, self.drift.as_ref(), contacts, at_once);
        }
    }

    /// Whether a frame that shows no touch differs from the baseline by more than noise along what may drift.
    pub(crate) fn drifted(&mut self, difference: &Difference, drifting: Drifting, sigma: f64) -> bool {
        self.weigh(difference, (drifting, &[]));
        self.tabulate(false);
        let nuisances = self
            .weightings
            .current()
            .and_then(|w| w.tables.as_ref()?.nuisances.as_ref());
        let Some(nuisances) = nuisances else { return false };
        self.sizes.clear();
        nuisances.along(difference.y.as_slice(), &mut self.sizes);
        let square: f64 = self.sizes.iter().map(|v| v * v).sum();
        square > self.sizes.len() as f64 * sigma * sigma * self.limit(self.sizes.len(), NoiseSource::Known)
    }

    /// What drifted in a frame without touches.
    fn drift_alone(&mut self, task: Task, result: &mut FrameResult) {
        self.tabulate(false);
        if let Some(drift) = self.drift_beside(task) {
            result.drift.copy_from(drift);
        }
    }

    /// The same of the values and directions at hand.
    fn drift_beside(&mut self, task: Task) -> Option<&Drift> {
        let nuisances = self.weightings.current()?.tables.as_ref()?.nuisances.as_ref()?;
        let (noise, fitter) = (task.noise?, self.fitter.as_mut()?);
        self.sizes.clear();
        nuisances.along(task.difference.y.as_slice(), &mut self.sizes);
        let sizes = &self.sizes;
        Some(fitter.drift_alone(Beside { nuisances, sizes }, noise.sigma))
    }

    /// Fits touches: those of the frame before, or the picture's peaks. The result has no misfit where discs do not explain the frame,
    /// and the picture's peaks for touches.
    fn fit(
        &mut self,
        task: Task,
        noise: NoiseEstimate,
        detector: Option<&mut ChangeDetector>,
        result: &mut FrameResult,
    ) {
        self.tabulate(false);
        self.allow();
        let sigma = self.sigma(task, noise);
        let Some(weighted) = self.weightings.current_mut() else {
            return;
        };
        let used = task.difference.used.iter().filter(|used| **used).count();
        let freedom = used.saturating_sub(weighted.directions()).max(1);
        let mut picture = Picture {
            image: &mut self.image,
            pictures: &mut weighted.pictures,
            options: &self.options,
            values: &self.values,
            sigma,
            polarity: task.polarity,
            result,
            made: false,
            ridge: None,
        };
        let (Some(fitter), Some(tables)) = (&mut self.fitter, &weighted.tables) else {
            picture.make();
            result.is_pictured = true;
            return;
        };
        let mut reduction = WeightedProjection {
            used: &task.difference.used,
            spread: &task.difference.spread,
            projector: &mut weighted.projector,
        };
        let beside = tables.nuisances.as_ref().map(|nuisances| {
            self.sizes.clear();
            nuisances.along(task.difference.y.as_slice(), &mut self.sizes);
            Beside {
                nuisances,
                sizes: &self.sizes,
            }
        });
        let data = Data {
            table: &tables.touches,
            reduction: &mut reduction,
            values: &self.reduced,
            beside,
            noise,
            gain: task.averaged.gain,
            patient: task.patient,
            polarity: task.polarity,
            corrected: task.corrected,
            unhurried: !self.options.sequence,
            from_found: task.changed.is_empty(),
        };
        let options = *fitter.options();
        // What no sheet shows at any one time is in frames while touches move as well, and may be what the noise is estimated by.
        let counts_whole = !self.options.sequence && noise.source == NoiseSource::Known;
        let (reduced, left) = (self.reduced.as_slice(), &mut self.left);
        let mut peaks = || {
            let places = picture.places();
            let [of_whole, of_reduced] = picture.left(reduced);
            *left = of_reduced;
            let (left, values, freedom) = match counts_whole {
                true => (of_whole, picture.values, freedom),
                false => (of_reduced, reduced, reduced.len()),
            };
            let misfit = left / (noise.sigma.powi(2) * freedom as f64);
            let residual = (left / square(values)).sqrt();
            options
                .may_explain(misfit, residual, task.averaged.gain)
                .then_some(places)
        };
        let explained = fitter.fit(data, &mut peaks).is_some();
        if !explained {
            picture.make();
        }
        if picture.made {
            self.ridges[task.drifting.index()] = picture.ridge;
        }
        result.is_pictured = picture.made;
        result.drift.copy_from(fitter.drift());
        if !explained {
            return;
        }
        let fitted = fitter.last();
        // Only a frame of which all values took part lies in the space that the detector looks at; and frames that have
        // nothing to do with each other are not each other's results.
        let whole =
            |d: &&mut ChangeDetector| d.used() == result.used && task.changed.is_empty() && self.options.sequence;
        let mean = task.averaged.frames > 1;
        if let Some(detector) = detector.filter(|d| (fitted.settled || mean) && task.seen && whole(d)) {
            detector.remember(&self.reduced, &fitted.slopes, tables.touches.stride());
            if !(fitted.settled && fitted.finished) {
                detector.once_more();
            }
        }
        let (geometry, unplaced) = (self.imager.model.geometry(), self.options.unplaced_mm);
        let significant = fitted.standing_out(fitter.options().least_significance);
        let placed = significant.filter(|t| is_placed(t, &fitted.touches, geometry, unplaced));
        result.touches.clear();
        result.touches.extend(placed.copied());
        // Neither of two that look like one another's absence stands out, and both together do.
        let left = square(&fitted.residual_whitened);
        let together = (left / fitted.relative_residual.powi(2) - left) / fitted.variance;
        result.unplaced = result.touches.is_empty() && !fitted.touches.is_empty() && together > UNPLACED_SAID.powi(2);
        result.misfit = Some(fitted.misfit);
        if self.options.sequence {
            result.residual = fitted.relative_residual;
        }
    }

    /// Begins a frame: nothing is known of its contacts. The noise is estimated where nothing else tells it as well: a few pairs that
    /// happen to be reciprocal do not.
    pub(crate) fn begin<'a>(&mut self, task: Task<'a>) -> Task<'a> {
        (self.alone, self.at_rim) = (None, [None; Drifting::ALL.len()]);
        if tells_noise(task.noise, task.difference) {
            return task;
        }
        self.weigh(task.difference, (Drifting::Common, task.changed));
        self.reduce(task.difference);
        Task {
            noise: self.residual_noise(),
            ..task
        }
    }
}

/// Whether a touch has a place: one whose uncertainty is larger than the distance to the rim, to a stronger touch, or to one of the other
/// sign, has none.
fn is_placed(touch: &Touch, touches: &[Touch], geometry: &Geometry, unplaced_mm: f64) -> bool {
    let sd = touch.x_sd_mm.unwrap_or(0.0).max(touch.y_sd_mm.unwrap_or(0.0));
    sd <= unplaced_mm || sd <= apart(touch, touches, geometry)
}

/// Distance of a touch from the rim, or from a stronger touch or one of the other sign where that is nearer, mm.
fn apart(touch: &Touch, touches: &[Touch], geometry: &Geometry) -> f64 {
    let rim = geometry.outline().nearest([touch.x_mm, touch.y_mm]).1;
    let others = touches
        .iter()
        .filter(|t| t.total_mm2.abs() > touch.total_mm2.abs() || t.rise * touch.rise < 0.0);
    let distances = others.map(|t| (t.x_mm - touch.x_mm).hypot(t.y_mm - touch.y_mm));
    distances.fold(rim, f64::min)
}

/// How many times its noise the mean power of a frame may be by chance: the quantile of Fisher's distribution (of
/// chi-square where the noise is known).
fn gate(rank: usize, noise: NoiseSource, false_alarm: f64) -> f64 {
    fisher_quantile(rank as f64, noise.freedom(), 1.0 - false_alarm).unwrap_or(f64::INFINITY)
}
