//! Fits frame after frame: keeps what depends on the sheet only, and corrects the linear model where its error shows.

mod merged;
mod state;

use self::merged::{merged_if_strong, merged_if_unresolved};
use self::state::{Aside, Carried, Corrected, Fits, Followed, Found, Job, Values};
use crate::reference::ToldSheet;
use crate::reference::drift::{Drift, Drifting};
use crate::reference::imager::Imager;
use crate::reference::noise::{NoiseEstimate, NoiseSource};
use crate::touches::fit::disc::{Discs, MOST_TOUCHES};
use crate::touches::fit::electrode_uncertainty::ElectrodeUncertainty;
use crate::touches::fit::fitter_options::FitterOptions;
use crate::touches::fit::frame_fit::{Fitted, Frame, Seeds};
use crate::touches::fit::linearisation_error::LinearisationError;
use crate::touches::fit::model_order::{self, DiscModel, Scratch};
use crate::touches::fit::nonlinear::{self, NonlinearModel, ScatteringModel};
use crate::touches::fit::nuisance::{NuisanceScratch, Nuisances};
use crate::touches::fit::prior::FitOptions;
use crate::touches::fit::reduction::Reduce;
use crate::touches::fit::responses::ResponseTable;
use crate::touches::polarity::Polarity;
use arrayvec::ArrayVec;
use std::sync::Arc;

/// A frame to fit, reduced and weighted.
pub struct Data<'a> {
    /// Responses to touches in the space of the data.
    pub table: &'a ResponseTable,
    /// Brings other frames of the model there.
    pub reduction: &'a mut dyn Reduce,
    /// The difference, V.
    pub values: &'a [f64],
    /// What changes frames beside touches, where that is known.
    pub(crate) beside: Option<Beside<'a>>,
    /// The noise of one of them, and how it is known.
    pub noise: NoiseEstimate,
    /// Variance of one frame's noise over that of this one: 1, or more for a mean of several. The error of the disc
    /// model does not average out, so an additional touch needs as much in a mean as in one frame.
    pub gain: f64,
    /// Which way touches change the resistivity.
    pub polarity: Polarity,
    /// Whether the search goes as far as a frame may, however many follow.
    pub patient: bool,
    /// Whether the error of the linear model may be solved for: that takes as long as many fits.
    pub corrected: bool,
    /// Whether time does not count: the touches may get a mesh made for them, and multipoles must be as exact as the table.
    pub unhurried: bool,
    /// Whether the search may begin at the touches that another fit of this frame found.
    pub from_found: bool,
}

impl Data<'_> {
    /// Part of a misfit that noise does not explain, in variances of one frame's noise.
    fn unexplained(&self, misfit: f64) -> f64 {
        (misfit - 1.0) / self.gain
    }
}

/// Places to begin at, mm.
pub type Places = ArrayVec<[f64; 2], MOST_TOUCHES>;

/// What changes frames beside touches.
#[derive(Clone, Copy)]
pub(crate) struct Beside<'a> {
    pub(crate) nuisances: &'a Nuisances,
    /// The frame along them, V.
    pub(crate) sizes: &'a [f64],
}

/// What presses told of the sheet, of electrodes that were found in the baseline as they were then.
fn told(imager: &Imager) -> Option<&ToldSheet> {
    imager.told.as_deref().filter(|_| imager.electrode_covariance.is_some())
}

/// What the electrodes' uncertainty adds to that of touches, unless presses told of the sheet.
fn uncertain(imager: &Imager, radius_mm: f64) -> Option<ElectrodeUncertainty> {
    match told(imager) {
        Some(_) => None,
        None => ElectrodeUncertainty::new(imager, radius_mm),
    }
}

/// What the next fit of a frame may take.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Allowed {
    /// Most evaluations of the response to one touch.
    pub(crate) evaluations: usize,
    /// Most solutions of the sheet in the frame.
    pub(crate) solutions: usize,
    /// Evaluations that take as long as a solution, and those until which solutions of the frame have to be at their end.
    pub(crate) a_solution: f64,
    pub(crate) until: f64,
}

impl Default for Allowed {
    /// Anything.
    fn default() -> Self {
        Self {
            evaluations: usize::MAX,
            solutions: usize::MAX,
            a_solution: 0.0,
            until: f64::INFINITY,
        }
    }
}

/// Fits touches to the frames of one imager.
pub struct Fitter {
    prior: FitOptions,
    options: FitterOptions,
    imager: Arc<Imager>,
    /// Responses to touches, V of the model.
    volts: ResponseTable,
    /// Those of the even sheet, where presses told of another one: errors of the linear model are taken to be the same on both.
    even: Option<ResponseTable>,
    /// What the electrodes' uncertainty adds to that of touches, where there is one; made when touches first need it.
    electrodes: Option<Option<ElectrodeUncertainty>>,
    /// Made when a frame first needs it.
    nonlinear: Option<NonlinearModel>,
    /// What takes its place where it is as exact; made when a frame first needs it. None inside where the sheet leaves no room for it.
    scattering: Option<Option<ScatteringModel>>,
    /// How the noise is known, and the chi-square threshold for that.
    chi_square_threshold: Option<(NoiseSource, f64)>,
    carried: Carried,
    followed: Followed,
    fits: Fits,
    corrected: Corrected,
    scratch: Scratch,
    /// Those of frames in which something else drifts, by what does; and of those that are fitted in another way for once.
    aside: [Aside; Drifting::ALL.len()],
    other: Aside,
    /// Whether the values fitted last were corrected.
    was_corrected: bool,
    /// Solutions of the sheet in this frame.
    solutions: usize,
    /// Evaluations of the response to one touch in this frame.
    evaluations: usize,
    allowed: Allowed,
    /// Touches that were found in this frame, by a search that came to its end; and by the fits that are none of the others' kind.
    found: Found,
    other_found: Found,
    /// Of the frame fitted last.
    drift: Drift,
    /// Of a frame without touches.
    alone: Drift,
    refining: NuisanceScratch,
    sizes: Vec<f64>,
    error_sizes: Vec<f64>,
    /// A fit without touches.
    nothing: Fitted,
}

impl Fitter {
    /// Tabulates the imager's sheet; `None` when that cannot be done.
    pub fn new(imager: &Arc<Imager>, prior: FitOptions) -> Option<Self> {
        Self::with_options(imager, prior, FitterOptions::default())
    }

    /// How it fits.
    pub(crate) fn options(&self) -> &FitterOptions {
        &self.options
    }

    /// The same with other thresholds.
    pub fn with_options(imager: &Arc<Imager>, prior: FitOptions, options: FitterOptions) -> Option<Self> {
        let even = ResponseTable::new(&imager.model, imager.drive, &imager.pattern, prior.radius_mm)?;
        let (volts, even) = match told(imager).and_then(|_| ResponseTable::told(imager, prior.radius_mm)) {
            Some(told) => (told, Some(even)),
            None => (even, None),
        };
        let fits = || Fits::with_room(volts.stride(), prior.most_touches.min(MOST_TOUCHES));
        let aside = || Aside {
            fits: fits(),
            ..Aside::default()
        };
        Some(Self {
            electrodes: None,
            imager: Arc::clone(imager),
            prior,
            options,
            nonlinear: None,
            scattering: None,
            chi_square_threshold: None,
            carried: Carried::default(),
            followed: Followed::default(),
            fits: fits(),
            corrected: Corrected::default(),
            scratch: Scratch::default(),
            aside: Drifting::ALL.map(|_| aside()),
            other: aside(),
            volts,
            even,
            was_corrected: false,
            solutions: 0,
            allowed: Allowed::default(),
            evaluations: 0,
            found: Found::default(),
            other_found: Found::default(),
            drift: Drift::with_room(imager.pattern.electrodes()),
            alone: Drift::with_room(imager.pattern.electrodes()),
            refining: NuisanceScratch::default(),
            sizes: Vec::new(),
            error_sizes: Vec::new(),
            nothing: Fitted::default(),
        })
    }

    /// The last fit, also where it does not explain its frame.
    pub fn last(&self) -> &Fitted {
        &self.fits.now
    }

    /// Makes ready for touches that move, which takes some 20 ms, and what is made of the electrodes' uncertainty.
    pub(crate) fn prepare_motion(&mut self) {
        let imager = &self.imager;
        self.electrodes = Some(uncertain(imager, self.prior.radius_mm));
        self.scattering = Some(ScatteringModel::new(&imager.model, imager.drive, &imager.pattern));
    }

    /// Begins a frame, however often it is fitted.
    pub(crate) fn begin_frame(&mut self) {
        (self.solutions, self.evaluations) = (0, 0);
        self.found = Found::default();
    }

    /// Makes the next frame stand alone: nothing of it depends on an earlier one, to the last bit.
    pub(crate) fn stand_alone(&mut self) {
        self.nonlinear.iter_mut().for_each(NonlinearModel::forget);
        self.chi_square_threshold = None;
        (self.carried, self.followed) = (Carried::default(), Followed::default());
        self.fits.forget();
        for aside in self.aside.iter_mut().chain([&mut self.other]) {
            (aside.carried, aside.followed) = (Carried::default(), Followed::default());
            aside.fits.forget();
        }
        self.forget_found();
        self.was_corrected = false;
        self.drift.clear();
        self.alone.clear();
    }

    /// Lets the next fit take so much.
    pub(crate) fn allow(&mut self, allowed: Allowed) {
        self.allowed = allowed;
    }

    /// Solutions of the sheet in this frame.
    pub(crate) fn solutions(&self) -> usize {
        self.solutions
    }

    /// Evaluations of the response to one touch in this frame.
    pub(crate) fn evaluations(&self) -> usize {
        self.evaluations
    }

    /// Whether the sheet may be solved once more.
    fn may_solve(&self, job: &Job) -> bool {
        let Allowed {
            solutions,
            a_solution,
            until,
            ..
        } = self.allowed;
        let after = self.evaluations as f64 + a_solution * (self.solutions + 1) as f64;
        job.data.corrected && self.solutions < solutions && after <= until
    }

    /// Takes what the discs fitted last change off a difference, V of the model.
    pub(crate) fn take_touches_off(&self, difference: &mut [f64]) {
        let response = nonlinear::response_v(&self.volts, &self.fits.now.discs);
        difference.iter_mut().zip(&response).for_each(|(v, r)| *v -= r);
        if self.was_corrected {
            let errors = difference.iter_mut().zip(&self.corrected.volts);
            errors.for_each(|(v, error)| *v -= error);
        }
    }

    /// What drifted in the frame fitted last.
    pub fn drift(&self) -> &Drift {
        &self.drift
    }

    /// What drifted in a frame without touches, of which a value has this noise.
    pub(crate) fn drift_alone(&mut self, beside: Beside, sigma: f64) -> &Drift {
        let nothing = &mut self.nothing;
        (nothing.sigma, nothing.variance) = (sigma, 1.0);
        let Beside { nuisances, sizes } = beside;
        nuisances.refine(sizes, nothing, &mut self.refining, &mut self.alone);
        &self.alone
    }

    /// Goes on from the last frame in which `to` drifted, after one in which `from` did.
    pub(crate) fn exchange(&mut self, from: Drifting, to: Drifting) {
        for drifting in [from, to] {
            let mut aside = std::mem::take(&mut self.aside[drifting.index()]);
            self.exchange_with(&mut aside);
            self.aside[drifting.index()] = aside;
        }
    }

    /// Begins another fit of the frame, of which the frame before says nothing.
    pub(crate) fn begin_other(&mut self) {
        self.end_other();
        self.found = Found::default();
        self.forget_last();
    }

    /// Goes on from the last frame before that.
    pub(crate) fn end_other(&mut self) {
        let mut other = std::mem::take(&mut self.other);
        self.exchange_with(&mut other);
        self.other = other;
        std::mem::swap(&mut self.found, &mut self.other_found);
    }

    fn exchange_with(&mut self, aside: &mut Aside) {
        std::mem::swap(&mut self.carried, &mut aside.carried);
        std::mem::swap(&mut self.followed, &mut aside.followed);
        std::mem::swap(&mut self.fits, &mut aside.fits);
        std::mem::swap(&mut self.corrected, &mut aside.corrected);
    }

    /// Forgets the touches of the frame before: they have gone.
    pub fn forget(&mut self) {
        self.forget_last();
        self.forget_found();
        for aside in &mut self.aside {
            aside.followed.forget();
            aside.carried = Carried::default();
        }
    }

    /// Forgets the touches that were found in this frame.
    pub(crate) fn forget_found(&mut self) {
        (self.found, self.other_found) = (Found::default(), Found::default());
    }

    fn forget_last(&mut self) {
        self.followed.forget();
        self.carried = Carried::default();
    }

    /// Responses to touches, V of the model: to be reduced and weighted as the data are.
    pub fn volts(&self) -> &ResponseTable {
        &self.volts
    }

    /// Touches fitted from those of the frame before, or from the places of a picture's peaks, mm. These are asked for only where the
    /// former do not explain the frame; they are `None` where no discs may. Returns `None` when discs do not explain it.
    pub fn fit(&mut self, data: Data, peaks: &mut dyn FnMut() -> Option<Places>) -> Option<&Fitted> {
        let source = data.noise.source;
        self.drift.clear();
        self.followed.turn = self.followed.turn.wrapping_add(1);
        let of_drift = data.beside.map_or(0.0, |b| b.nuisances.linearisation_error(b.sizes));
        let mut job = Job {
            // No touch is added for what the linear model of drift is wrong by.
            chi_square_threshold: data.gain * self.chi_square_threshold(data.table, source)
                + (of_drift / data.noise.sigma).powi(2),
            hurried: source == NoiseSource::Known
                && !data.patient
                && self.followed.unfinished < self.options.most_unfinished,
            turn: self.followed.turn,
            until_evaluations: self.evaluations.saturating_add(self.allowed.evaluations),
            data,
        };
        let prior = self.prior;
        let found = std::mem::take(&mut self.found);
        let begin = Some(&found).filter(|found| job.data.from_found && !found.discs.is_empty());
        let error = begin.and_then(|found| found.error.clone());
        self.find(&mut job, error, &mut || match begin {
            Some(found) => Some(found.discs.clone()),
            None => Some(peaks()?.iter().map(|at| prior.seed(*at)).collect()),
        })?;
        self.refine(&job.data);
        let fitted = &self.fits.now;
        let explained = self.options.explains(fitted.misfit, job.data.gain)
            || fitted.relative_residual <= self.options.most_residual;
        let may = || (self.options).may_explain(fitted.misfit, fitted.relative_residual, job.data.gain);
        if explained || !fitted.finished && may() {
            self.tell_as_one(&mut job);
        }
        let fitted = &mut self.fits.now;
        self.followed
            .note(&job.data, fitted, explained, self.options.least_significance);
        if self.followed.holds {
            let (imager, radius_mm) = (&self.imager, self.prior.radius_mm);
            let made = || uncertain(imager, radius_mm);
            if let Some(told) = told(imager) {
                for t in &mut fitted.touches {
                    let [x, y] = told.sd_at([t.x_mm, t.y_mm]);
                    t.x_sd_mm = t.x_sd_mm.map(|sd| sd.hypot(x));
                    t.y_sd_mm = t.y_sd_mm.map(|sd| sd.hypot(y));
                }
            } else if let Some(electrodes) = self.electrodes.get_or_insert_with(made) {
                for t in &mut fitted.touches {
                    let [x, y] = electrodes.variance(imager, [t.x_mm, t.y_mm]);
                    t.x_sd_mm = t.x_sd_mm.map(|sd| sd.hypot(x.sqrt()));
                    t.y_sd_mm = t.y_sd_mm.map(|sd| sd.hypot(y.sqrt()));
                }
            }
        }
        self.found = if explained && fitted.finished {
            Found {
                discs: fitted.discs.clone(),
                // Where frames follow one another, it may be that of an earlier one.
                error: (self.carried.error.as_ref())
                    .filter(|_| self.was_corrected && job.data.unhurried)
                    .cloned(),
            }
        } else {
            found
        };
        self.followed.holds.then_some(&self.fits.now)
    }

    /// Makes the touches fitted last those beside what drifts.
    fn refine(&mut self, data: &Data) {
        let Some(Beside { nuisances, sizes }) = data.beside else {
            return;
        };
        self.sizes.clear();
        self.sizes.extend_from_slice(sizes);
        if self.was_corrected {
            self.error_sizes.clear();
            nuisances.along(&self.corrected.volts, &mut self.error_sizes);
            let errors = self.sizes.iter_mut().zip(&self.error_sizes);
            errors.for_each(|(s, e)| *s -= e);
        }
        nuisances.refine(&self.sizes, &mut self.fits.now, &mut self.refining, &mut self.drift);
    }

    /// Fits one touch in place of two neighbours that the frame does not resolve: neither stands out beside the other. A touch that
    /// lands while the frame is measured looks like two. Where as many stood out in the frame before they stay two: they cross.
    fn tell_as_one(&mut self, job: &mut Job) {
        let (radius_mm, least) = (self.prior.radius_mm, self.options.least_significance);
        while self.fits.now.discs.len() > self.followed.stood_out
            && let Some(discs) = merged_if_unresolved(&self.fits.now, radius_mm, least)
        {
            let fitted = &mut self.fits.now;
            let (settled, followed) = (fitted.settled, fitted.followed);
            let two = std::mem::replace(&mut fitted.discs, discs);
            fitted.followed = false;
            let values = if self.was_corrected {
                Values::Corrected
            } else {
                Values::Measured
            };
            // A search would find two again.
            if self.again_without_search(job, values).is_none() {
                std::mem::swap(&mut self.fits.now, &mut self.fits.before);
                (self.fits.now.discs, self.fits.now.followed) = (two, followed);
                return;
            }
            self.carried.error = None;
            self.fits.now.settled &= settled;
            self.refine(&job.data);
        }
    }

    /// Fits the linear model, corrected by what the frame before left or where a nonlinear solution is worth it. `error` is that of the
    /// touches that the search begins at, where it is known.
    fn find(&mut self, job: &mut Job, error: Option<LinearisationError>, seeds: Seeds) -> Option<()> {
        let follows = std::mem::replace(&mut self.followed.holds, false);
        if job.data.gain <= 1.0 {
            self.carried.failed = None;
        }
        self.carried.error = self.carried.error.take().filter(|_| follows);
        let known = !follows && error.is_some();
        if known {
            self.carried.error = error;
        }
        let carried = self.carried.error.as_ref().map(|error| {
            let scale = if known { 1.0 } else { error.scale(&self.fits.now.discs) };
            (scale, self.corrected.take_off(error, scale, &mut job.data))
        });
        // Where the linear model's error shows, no touch may be added for it before it is corrected.
        let norm = job.data.values.iter().map(|v| v * v).sum::<f64>().sqrt() / job.data.noise.sigma;
        let linear_error = self.options.linear_error;
        let shows = carried.is_none() && linear_error * norm > self.options.linear_error_shows;
        let model_error = self.prior.model_error;
        match carried {
            Some(_) => self.fit_from(job, Values::Corrected, model_error, Some(seeds), follows)?,
            None => {
                let error = if shows { linear_error } else { model_error };
                self.fit_from(job, Values::Measured, error, Some(seeds), follows)?;
            }
        }
        if self.fits.now.hopeless {
            if self.carried.error.take().is_some() {
                self.fit_from(job, Values::Measured, model_error, Some(&mut || None), false)?;
            }
            return Some(());
        }
        if let Some((scale, size)) = carried
            && self.fits.now.followed
        {
            return self.renew(job, scale, size);
        }
        if let Some((scale, size)) = carried.filter(|_| known) {
            self.fits.now.settled = self.serves(scale, size)?;
            if self.fits.now.settled {
                return Some(());
            }
        }
        let is_worth = |now: &Self| now.expected_error() > now.options.worth_a_solution && now.may_explain(job, 0.0);
        let mut corrects = self.may_solve(job) && is_worth(self);
        let fitted = &self.fits.now;
        // What a search that goes no further in this frame leaves is far more than the error of the linear model.
        let ended = fitted.finished || self.evaluations >= job.until_evaluations;
        let far = ended && !(self.options).may_explain(fitted.misfit, fitted.relative_residual, job.data.gain);
        if !corrects && far && carried.is_none() {
            self.fits.now.settled &= self.may_solve(job);
        } else if !corrects && (shows || carried.is_some()) {
            let was_worth = self.expected_error() > self.options.worth_a_solution;
            self.carried.error = None;
            self.again(job, Values::Measured)?;
            self.fits.now.settled &= self.may_solve(job);
            // With the touches that this one added the frame may be one that a correction explains.
            corrects = was_worth && self.may_solve(job) && is_worth(self);
        }
        if corrects {
            self.correct(job)?;
            // In a mean, the first of its frames decided between one touch and two.
            if job.data.gain <= 1.0
                && self.may_solve(job)
                && let Some(discs) =
                    merged_if_strong(&self.fits.now.discs, self.prior.radius_mm, self.options.too_strong)
            {
                self.try_merged(job, discs)?;
            }
        }
        Some(())
    }

    /// Solves anew for touches that were followed, if the linearisation error taken off is not theirs any more. `scale`
    /// is how many times the carried one was taken off, `size` its norm.
    fn renew(&mut self, job: &mut Job, scale: f64, size: f64) -> Option<()> {
        let options = self.options;
        self.fits.now.settled = self.serves(scale, size)?;
        // Once a solution has brought nothing, none does for the mean of more frames of the same.
        let unexplained = job.data.unexplained(self.fits.now.misfit);
        let failed_before = |then| unexplained <= options.failed_until * then;
        self.fits.now.settled |= self.carried.failed.is_some_and(failed_before);
        if !self.fits.now.settled && self.may_solve(job) && self.may_explain(job, size) {
            let before = self.fits.now.misfit;
            let Some(error) = self.solve(job) else {
                return Some(());
            };
            let size = self.corrected.take_off(&error, 1.0, &mut job.data);
            self.carried.error = Some(error);
            self.again(job, Values::Corrected)?;
            self.fits.now.settled = self.serves(1.0, size)?;
            let misfit = self.fits.now.misfit;
            let failed = job.data.gain > 1.0 && misfit > options.failed_misfit.max(options.failed_part * before);
            self.carried.failed = failed.then_some(job.data.unexplained(misfit));
        }
        if self.expected_error() <= options.still_worth * options.worth_a_solution {
            self.carried.error = None;
        }
        Some(())
    }

    /// Whether the linearisation error that was taken off, so many times and of this norm, is that of the touches as
    /// far as it shows. A residual that no correction explains hides errors as noise does.
    fn serves(&self, scale: f64, size: f64) -> Option<bool> {
        let fitted = &self.fits.now;
        let error = self.carried.error.as_ref()?;
        let error = size * error.error(&self.options.growth, &fitted.discs, scale);
        Some(error <= self.options.carried_error * fitted.misfit.max(1.0).sqrt())
    }

    /// Whether the touches fitted last may explain the frame once their linearisation error is taken off. The residual is then smaller by
    /// the norm of that error at most, and by that of what was taken off already (`taken`), which may be wrong.
    fn may_explain(&self, job: &Job, taken: f64) -> bool {
        let (fitted, options) = (&self.fits.now, &self.options);
        let norm = job.data.values.iter().map(|v| v * v).sum::<f64>().sqrt() / job.data.noise.sigma;
        let error = options.error_estimate * self.expected_error() + taken;
        let left = (1.0 - error / (fitted.relative_residual * norm).max(f64::MIN_POSITIVE)).max(0.0);
        options.explains(left * left * fitted.misfit, job.data.gain)
            || left * fitted.relative_residual <= options.most_residual
    }

    /// Takes the linearisation error of the touches fitted last off the data and fits again, until that changes
    /// nothing.
    fn correct(&mut self, job: &mut Job) -> Option<()> {
        // Whether a search found as many touches with a correction as with the one before: the next one would, too.
        let mut stays = false;
        // In a hurry, the next frame goes on with the correction.
        for round in 0..if job.hurried { 1 } else { self.options.most_rounds } {
            if !self.may_solve(job) {
                // As if in a hurry.
                break;
            }
            if round > 0 && self.expected_error() <= self.options.worth_a_solution {
                self.fits.now.settled = true;
                break;
            }
            let error = self.solve(job)?;
            self.corrected.take_off(&error, 1.0, &mut job.data);
            self.carried.error = Some(error);
            if stays {
                self.again_without_search(job, Values::Corrected)?;
            } else {
                self.again(job, Values::Corrected)?;
                stays = round > 0 && self.fits.before.discs.len() == self.fits.now.discs.len();
            }
            self.fits.now.settled = settled(&self.fits.before, &self.fits.now, self.options.settled);
            if self.fits.now.settled {
                break;
            }
        }
        Some(())
    }

    /// Tries fewer discs than were fitted; keeps them if they explain the frame better. Both are corrected to the end
    /// before they are compared.
    fn try_merged(&mut self, job: &mut Job, discs: Discs) -> Option<()> {
        job.hurried = false;
        if !self.fits.now.settled {
            self.correct(job)?;
        }
        if !self.may_solve(job) {
            return Some(());
        }
        let (two, error) = (self.fits.now.clone(), self.carried.error.clone());
        self.fits.now = Fitted { discs, ..two.clone() };
        self.fits.now.followed = false;
        let better = self.correct(job).is_some() && self.fits.now.misfit < two.misfit;
        if !better {
            if let Some(error) = &error {
                self.corrected.take_off(error, 1.0, &mut job.data);
            }
            (self.fits.now, self.carried.error) = (two, error);
        }
        Some(())
    }

    /// The linearisation error of the touches fitted last; `None` when the sheet cannot be solved with them. What is exact enough for a
    /// frame may show in the mean of several.
    fn solve(&mut self, job: &Job) -> Option<LinearisationError> {
        let Imager {
            model, drive, pattern, ..
        } = &*self.imager;
        let table = self.even.as_ref().unwrap_or(&self.volts);
        let (discs, unhurried) = (&self.fits.now.discs, job.data.unhurried);
        let made = || ScatteringModel::new(model, *drive, pattern);
        let scattering = self.scattering.get_or_insert_with(made).as_ref();
        let exact = unhurried || job.data.gain > 1.0;
        let scattered = scattering.and_then(|s| LinearisationError::scattered(s, table, discs, exact));
        if scattered.is_some() {
            return scattered;
        }
        if self.nonlinear.is_none() {
            self.nonlinear = NonlinearModel::new(model, *drive, pattern);
            // The first solution is made as the first of any later frame.
            self.nonlinear.iter_mut().for_each(NonlinearModel::forget);
        }
        self.solutions += 1;
        LinearisationError::solve(self.nonlinear.as_mut()?, table, discs, unhurried)
    }

    /// Estimated norm of the linearisation error of the touches fitted last, in standard deviations of the noise.
    fn expected_error(&self) -> f64 {
        let fitted = &self.fits.now;
        nonlinear::expected_error(&fitted.discs, &fitted.norms, &self.imager.outline_mm)
    }

    /// Fits from the touches fitted last.
    fn again(&mut self, job: &Job, values: Values) -> Option<()> {
        let follows = self.fits.now.followed;
        self.fit_from(job, values, self.prior.model_error, None, follows)
    }

    /// The same with as many touches.
    fn again_without_search(&mut self, job: &mut Job, values: Values) -> Option<()> {
        let finished = self.fits.now.finished;
        let until = std::mem::replace(&mut job.until_evaluations, self.evaluations);
        let fitted = self.again(job, values);
        job.until_evaluations = until;
        fitted?;
        self.fits.now.finished = finished;
        Some(())
    }

    /// Fits from these places, or from the touches fitted last. `error` is the part of the data that the model may get
    /// wrong; with `follows` the touches fitted last are followed.
    fn fit_from(&mut self, job: &Job, values: Values, error: f64, seeds: Option<Seeds>, follows: bool) -> Option<()> {
        let model = DiscModel {
            table: job.data.table,
            prior: &self.prior,
            order: &self.options.order,
        };
        let left = job.until_evaluations.saturating_sub(self.evaluations);
        let frame = Frame {
            values: match values {
                Values::Measured => job.data.values,
                Values::Corrected => &self.corrected.values,
            },
            sigma: job.data.noise.sigma,
            chi_square_threshold: job.chi_square_threshold,
            error,
            polarity: job.data.polarity,
            most_work: if job.hurried {
                self.prior.most_work.min(left)
            } else {
                left
            },
        };
        self.was_corrected = matches!(values, Values::Corrected);
        let least_misfit = || self.followed.least_misfit(job.data.gain, self.options.misfit_scatter);
        let (least_misfit, scratch) = (follows.then(least_misfit), &mut self.scratch);
        // What is fitted takes its place.
        self.fits.before.work = 0;
        let fitted = self.fits.fit(model, frame, seeds, least_misfit, job.turn, scratch);
        self.evaluations += self.fits.now.work;
        fitted
    }

    /// The chi-square threshold, kept as long as the noise is known as well.
    fn chi_square_threshold(&mut self, table: &ResponseTable, source: NoiseSource) -> f64 {
        match self.chi_square_threshold {
            Some((known, threshold)) if known == source => threshold,
            _ => {
                let threshold = model_order::chi_square_threshold(table, &self.prior, source.freedom());
                self.chi_square_threshold = Some((source, threshold));
                threshold
            }
        }
    }
}

/// Whether a correction changed no integrated rise by more than this part of it.
fn settled(before: &Fitted, after: &Fitted, part: f64) -> bool {
    before.touches.len() == after.touches.len()
        && before
            .touches
            .iter()
            .zip(&after.touches)
            .all(|(a, b)| (a.total_mm2 - b.total_mm2).abs() <= part * b.total_mm2.abs())
}

#[cfg(test)]
mod tests;
