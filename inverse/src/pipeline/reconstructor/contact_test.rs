//! Reconstructs a frame as one of touches, or of touches and contacts that changed.

use crate::pipeline::reconstructor::Reconstructor;
use crate::quality::contact::{self, EXPLAINED, Judged, MOST_CONTACTS, Outcome, Verdict};
use crate::quality::reciprocity::NoiseEstimate;
use crate::reference::difference::Difference;
use crate::touches::fit::fitter::Fitter;

impl Reconstructor {
    /// Reconstructs a difference, and asks whether contacts changed.
    pub(super) fn settle(&mut self, difference: &Difference, noise: Option<NoiseEstimate>) {
        if self.frames > 1 {
            // Contacts are asked for in frames: what touches are not discs shows more in a mean.
            self.solve_evened(difference, noise, false);
            return;
        }
        // With and without a contact is told by what both come to in the end.
        let patient = !self.options.sequence || self.inquiry.asks_next();
        if let Some(changed) = self.inquiry.begin() {
            let without = self.solve_evened(difference, noise, patient);
            let result = self.result.clone();
            self.inquiry.keep(changed);
            let with = self.solve_evened(difference, noise, patient);
            if self.inquiry.hear_again(with, without) {
                self.result = result;
                self.fitter.iter_mut().for_each(Fitter::forget);
            }
            return;
        }
        let mut without = self.solve_evened(difference, noise, patient);
        while self.inquiry.changed().len() < MOST_CONTACTS {
            let suspect = self.suspect();
            if !self.inquiry.suspect(suspect) {
                break;
            }
            let result = self.result.clone();
            let with = self.solve_evened(difference, noise, patient);
            if self.inquiry.hear(with, without) != Verdict::Changed {
                tracing::debug!(suspect, ?with, ?without, "no contact yet");
                self.result = result;
                self.fitter.iter_mut().for_each(Fitter::forget);
                break;
            }
            tracing::debug!(suspect, ?with, ?without, "a contact");
            without = with;
        }
    }

    /// Reconstructs a difference without what the contacts did that changed.
    fn solve_evened(
        &mut self,
        difference: &Difference,
        noise: Option<NoiseEstimate>,
        patient: bool,
    ) -> Option<Outcome> {
        if self.inquiry.changed().is_empty() {
            self.solve(difference, noise, patient);
        } else {
            let mut evened = self.evened.take().unwrap_or_else(|| difference.clone());
            evened.clone_from(difference);
            if let Some(contacts) = &self.contacts {
                contacts.even_out(self.inquiry.changed(), &self.imager.model_v, &mut evened);
            }
            self.solve(&evened, noise, patient);
            self.evened = Some(evened);
        }
        let changed = self.inquiry.changed().iter();
        let directions: usize = self
            .contacts
            .iter()
            .map(|c| changed.clone().map(|l| c.directions(*l)).sum::<usize>())
            .sum();
        let power = self.power() * self.reduced.len() as f64;
        let (cost, misfit, sigma) = if self.result.changed {
            let fitted = self.fitter.as_ref()?.last();
            (fitted.cost, fitted.misfit, self.result.noise?.sigma)
        } else {
            let sigma = noise?.sigma;
            let square = power / sigma.powi(2);
            (square, square / self.reduced.len() as f64, sigma)
        };
        let error = self.options.fit?.model_error;
        Some(Outcome {
            cost: cost + directions as f64,
            misfit,
            model: error * error * power / sigma.powi(2),
        })
    }

    /// An electrode whose contact would explain the frame better than its touches do.
    fn suspect(&mut self) -> Option<usize> {
        let sigma = self.result.noise?.sigma;
        let (fitter, weighted) = (self.fitter.as_ref()?, self.weighted.as_mut()?);
        let table = weighted.table.as_ref().filter(|_| self.result.changed)?;
        let fitted = fitter.last();
        // What is left of an earlier frame, where this one could not be fitted.
        if fitted.residual_whitened.len() < self.reduced.len() {
            return None;
        }
        if fitted.misfit <= EXPLAINED && !contact::near(&self.imager, &fitted.all) {
            return None;
        }
        let judged = Judged {
            fitted,
            stride: table.stride(),
            data: &self.reduced,
            sigma,
        };
        let suspects = weighted.suspects.as_mut()?;
        suspects.suspect(&self.imager, self.inquiry.changed(), judged)
    }
}
