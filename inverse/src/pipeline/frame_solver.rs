//! One frame, with the values and contacts that take part given: weigh, reduce, gate, picture, fit.

use crate::change::detector::ChangeDetector;
use crate::pipeline::image::ImageSolver;
use crate::pipeline::options::ReconstructorOptions;
use crate::pipeline::result::FrameResult;
use crate::pipeline::weighted::Weightings;
use crate::quality::contact::{self, Contacts, Evidence, Judged};
use crate::reference::Difference;
use crate::reference::imager::Imager;
use crate::reference::noise::{NoiseEstimate, NoiseSource};
use crate::touches::fit::fitter::{Data, Fitter};
use statrs::distribution::{ContinuousCDF, FisherSnedecor};
use std::sync::Arc;
use std::time::Instant;

/// Noise that is assumed where nothing tells it, over the root mean square of the frame.
const ASSUMED_NOISE: f64 = 1e-2;

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
    /// Electrodes whose contact's shapes are left out.
    pub(crate) changed: &'a [usize],
    /// Whether every search of the fit is to come to its end in this frame, however long it takes.
    pub(crate) patient: bool,
}

/// Solves frames of one imager.
pub(crate) struct FrameSolver {
    imager: Arc<Imager>,
    options: ReconstructorOptions,
    weightings: Weightings,
    image: ImageSolver,
    fitter: Option<Fitter>,
    contacts: Option<Contacts>,
    /// Rank and noise that the gate was computed for, and the gate.
    gate: Option<(usize, NoiseSource, f64)>,
    /// The frame weighted, and reduced.
    values: Vec<f64>,
    reduced: Vec<f64>,
}

impl FrameSolver {
    pub(crate) fn new(imager: &Arc<Imager>, options: ReconstructorOptions) -> Self {
        Self {
            weightings: Weightings::default(),
            image: ImageSolver::new(imager, &options),
            fitter: options.fit.and_then(|f| Fitter::new(imager, f)),
            contacts: options.fit.and_then(|_| Contacts::new(imager, options.contacts)),
            gate: None,
            values: Vec::new(),
            reduced: Vec::new(),
            imager: Arc::clone(imager),
            options,
        }
    }

    /// Rank of the problem in use; none before the first.
    pub(crate) fn rank(&self) -> Option<usize> {
        self.weightings.current().map(|w| w.problem.rank())
    }

    /// Whether touches are fitted to the measurements.
    pub(crate) fn fits(&self) -> bool {
        self.fitter.is_some()
    }

    /// Starts the next fit without the touches of the frame before: they have gone.
    pub(crate) fn forget_touches(&mut self) {
        self.fitter.iter_mut().for_each(Fitter::forget);
    }

    /// Starts the next frame without anything of the frame before.
    pub(crate) fn forget(&mut self) {
        self.image.reset();
        self.forget_touches();
    }

    /// The detector of changes against a reference of which frames have this difference to themselves; none where no value
    /// can be used. Makes ready all that a first touch needs.
    pub(crate) fn detector(
        &mut self,
        unchanged: &Difference,
        baseline: &[f64],
        sigma: f64,
        baseline_share: f64,
    ) -> Option<ChangeDetector> {
        self.weigh(unchanged, &[]);
        self.tabulate();
        let weighted = self.weightings.current()?;
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
            &weighted.problem,
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
        let passed = task.changed.is_empty() && detector.as_ref().is_some_and(|d| d.used() == used);
        self.weigh(task.difference, task.changed);
        self.reduce(task.difference);
        if self.reduced.is_empty() || task.noise.is_some_and(|n| !passed && !self.passes(n)) {
            result.clear(task.noise, used);
            (result.anew, result.frames, result.grown) = (true, task.averaged.frames, task.averaged.grown);
            return;
        }
        // Without a way to estimate the noise everything counts as a change.
        let power = self.power();
        let noise = task.noise.unwrap_or(NoiseEstimate {
            sigma: ASSUMED_NOISE * power.sqrt(),
            source: NoiseSource::Assumed,
        });
        (result.noise, result.used, result.changed, result.anew) = (Some(noise), used, true, true);
        (result.frames, result.grown, result.misfit) = (task.averaged.frames, task.averaged.grown, None);
        let start = Instant::now();
        // The picture of a mean is as sharp as that of a frame, and quieter.
        let of_frame = task.averaged.frame_sigma.unwrap_or(noise.sigma);
        let sigma = of_frame.hypot(self.options.model_error * power.sqrt());
        let Some(weighted) = self.weightings.current_mut() else {
            return;
        };
        let ridge = self.image.solve(&self.options, weighted, &self.values, sigma, result);
        result.solve_us = start.elapsed().as_secs_f64() * 1e6;
        self.image.find(result);
        if !self.fit(task, noise, detector, result)
            && let (Some(ridge), Some(_)) = (ridge, &self.fitter)
            && let Some(weighted) = self.weightings.current_mut()
        {
            self.image
                .solve_with_falls(&self.options, weighted, &self.values, ridge, result);
        }
    }

    fn weigh(&mut self, difference: &Difference, changed: &[usize]) {
        let contacts = self.contacts.as_mut();
        if self
            .weightings
            .switch(&self.imager, &self.options, contacts, difference, changed)
        {
            self.image.reset();
        }
    }

    fn reduce(&mut self, difference: &Difference) {
        self.reduced.clear();
        if let Some(weighted) = self.weightings.current_mut() {
            weighted.reduce(difference, &mut self.values, &mut self.reduced);
        }
    }

    /// Whether the reduced frame holds more than noise. A quiet one makes the next solve start afresh.
    fn passes(&mut self, noise: NoiseEstimate) -> bool {
        let rank = self.reduced.len();
        let limit = match self.gate {
            Some((known, source, limit)) if (known, source) == (rank, noise.source) => limit,
            _ => gate(rank, noise.source, self.options.false_alarm),
        };
        self.gate = Some((rank, noise.source, limit));
        let passes = self.power() > noise.sigma * noise.sigma * limit;
        if !passes {
            self.forget();
        }
        passes
    }

    /// Mean square of the reduced frame.
    fn power(&self) -> f64 {
        self.reduced.iter().map(|v| v * v).sum::<f64>() / self.reduced.len() as f64
    }

    fn tabulate(&mut self) {
        if let (Some(fitter), Some(weighted)) = (&self.fitter, self.weightings.current_mut()) {
            weighted.tabulate(&self.imager, fitter, self.contacts.as_ref());
        }
    }

    /// Fits touches from the picture's; false when discs do not explain the frame.
    fn fit(
        &mut self,
        task: Task,
        noise: NoiseEstimate,
        detector: Option<&mut ChangeDetector>,
        result: &mut FrameResult,
    ) -> bool {
        self.tabulate();
        let (Some(fitter), Some(weighted)) = (&mut self.fitter, self.weightings.current_mut()) else {
            return false;
        };
        let difference = task.difference;
        let weight = |k: usize| {
            if difference.used[k] {
                1.0 / difference.spread[k]
            } else {
                0.0
            }
        };
        let Some(tables) = &weighted.tables else { return false };
        let projector = &mut weighted.projector;
        let reduce = |volts: &[f64], reduced: &mut Vec<f64>| {
            let fill = |to: &mut [f64]| {
                to.iter_mut()
                    .zip(volts)
                    .enumerate()
                    .for_each(|(k, (to, v))| *to = v * weight(k))
            };
            reduced.extend_from_slice(projector.project(fill));
        };
        let data = Data {
            values: &self.reduced,
            noise,
            gain: task.averaged.gain,
        };
        let seeds = result.touches.iter().map(|t| [t.x_mm, t.y_mm]);
        fitter.set_patient(task.patient);
        let Some(fitted) = fitter.fit(&tables.touches, reduce, data, seeds) else {
            return false;
        };
        // Only a frame of which all values took part lies in the space that the detector looks at; and frames that have
        // nothing to do with each other are not each other's results.
        let whole =
            |d: &&mut ChangeDetector| d.used() == result.used && task.changed.is_empty() && self.options.sequence;
        let mean = task.averaged.frames > 1;
        if let Some(detector) = detector.filter(|d| (fitted.settled || mean) && whole(d)) {
            detector.remember(&self.reduced, &fitted.slopes, tables.touches.stride());
            if !(fitted.settled && fitted.finished) {
                detector.once_more();
            }
        }
        result.touches.clone_from(&fitted.touches);
        result.misfit = Some(fitted.misfit);
        true
    }

    /// What the last solve came to, to be compared with one with other contacts; none where nothing tells the noise.
    pub(crate) fn evidence(&self, task: Task, result: &FrameResult) -> Option<Evidence> {
        let directions: usize = self
            .contacts
            .iter()
            .map(|c| task.changed.iter().map(|l| c.directions(*l)).sum::<usize>())
            .sum();
        let sigma = task.noise?.sigma;
        let power = self.power() * self.reduced.len() as f64;
        let (cost, misfit) = if result.changed {
            let fitted = self.fitter.as_ref()?.last();
            (fitted.cost, fitted.misfit)
        } else {
            let square = power / sigma.powi(2);
            (square, square / self.reduced.len() as f64)
        };
        let error = self.options.fit?.model_error;
        Some(Evidence {
            cost: cost + directions as f64,
            misfit,
            model: error * error * power / sigma.powi(2),
        })
    }

    /// An electrode whose contact would explain the frame solved last better than its touches do.
    pub(crate) fn candidate(&mut self, task: Task, result: &FrameResult) -> Option<usize> {
        let sigma = task.noise?.sigma;
        let fitter = self.fitter.as_ref()?;
        let tables = self
            .weightings
            .current_mut()?
            .tables
            .as_mut()
            .filter(|_| result.changed)?;
        let fitted = fitter.last();
        // The residual is that of an earlier frame, where this one could not be fitted.
        if fitted.left.len() < self.reduced.len() {
            return None;
        }
        if fitted.misfit <= self.options.contacts.explained
            && !contact::near(&self.imager, &fitted.all, &self.options.contacts)
        {
            return None;
        }
        let judged = Judged {
            fitted,
            stride: tables.touches.stride(),
            data: &self.reduced,
            sigma,
        };
        tables.contacts.as_mut()?.best(&self.imager, task.changed, judged)
    }

    /// Undoes the scales of the drives through these electrodes, in a copy of the difference.
    pub(crate) fn even_out(&self, changed: &[usize], difference: &mut Difference) {
        if let Some(contacts) = &self.contacts {
            contacts.even_out(changed, &self.imager.model_v, difference);
        }
    }
}

/// How many times its noise the mean power of a frame may be by chance: the quantile of Fisher's distribution (of
/// chi-square where the noise is known).
fn gate(rank: usize, noise: NoiseSource, false_alarm: f64) -> f64 {
    FisherSnedecor::new(rank as f64, noise.freedom()).map_or(f64::INFINITY, |f| f.inverse_cdf(1.0 - false_alarm))
}
