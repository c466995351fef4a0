//! What a frame that was solved says of contacts.

use super::{FrameSolver, Task};
use crate::pipeline::result::FrameResult;
use crate::quality::contact::{Cause, Contacts, Evidence};
use crate::reference::Difference;
use crate::reference::drift::{ContactChange, Drifting};
use crate::reference::noise::{NoiseEstimate, NoiseSource};
use crate::touches::fit::fitter::Beside;

/// What may have changed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Candidate {
    pub(crate) cause: Cause,
    /// Whether its change is small: estimated beside touches, which are right.
    pub(crate) linear: bool,
    /// Whether an electrode slipped along the rim, or two leak: its shapes are those of its change.
    pub(crate) at_rim: bool,
}

impl FrameSolver {
    /// What the last solve came to, to be compared with one with other contacts; none where nothing tells the noise.
    pub(crate) fn evidence(&self, task: Task, result: &FrameResult) -> Option<Evidence> {
        let of_changed = |c: &Contacts| task.changed.iter().map(|l| c.directions(*l)).sum::<usize>();
        let directions = self.contacts.as_ref().map_or(0, of_changed);
        let sigma = task.noise?.sigma;
        let power = self.power() * self.reduced.len() as f64;
        let (cost, open, misfit) = if result.changed {
            let fitted = self.fitter.as_ref()?.last();
            if fitted.hopeless {
                // No touches leave less than the picture does.
                let square = self.left / sigma.powi(2);
                (square, 0.0, square / self.reduced.len() as f64)
            } else {
                (fitted.cost, fitted.open, fitted.misfit)
            }
        } else {
            let square = power / sigma.powi(2);
            (square, 0.0, square / self.reduced.len() as f64)
        };
        let error = self.options.fit?.model_error;
        Some(Evidence {
            cost: cost + directions as f64 + result.drift.cost,
            open,
            misfit,
            model: error * error * power / sigma.powi(2),
        })
    }

    /// What the last solve with this drift came to, with what explains its frame better at the rim, if anything does. To first order.
    pub(crate) fn with_rim(&self, evidence: Evidence, drifting: Drifting) -> Evidence {
        let at_rim = self.at_rim[drifting.index()];
        at_rim.map_or(evidence, |at_rim| Evidence {
            cost: evidence.cost - at_rim.cost,
            open: evidence.open - at_rim.open,
            ..evidence
        })
    }

    /// An electrode whose contact changed more than the others in the frame solved last, beside its touches; or one that would
    /// explain the frame alone, without touches; or a leak. What is `known` is no candidate, nor what is of electrodes that are `left_out`.
    /// `drifting`: beside what the result was found.
    pub(crate) fn candidate(
        &self,
        (known, rejected, left_out): (&[Cause], Option<Cause>, &[usize]),
        drifting: Drifting,
        result: &FrameResult,
    ) -> Option<Candidate> {
        // An estimate of the noise by a few directions is not good enough to blame a contact.
        if matches!(result.noise?.source, NoiseSource::Residual { .. }) {
            return None;
        }
        let new = |cause: &Cause| !known.contains(cause) && !cause.is_of(left_out);
        let beside = result
            .drift
            .contact
            .filter(|c| self.is_fault(c))
            .map(|c| Cause::Contact(c.electrode))
            .filter(new);
        let contact = self.alone.map(Cause::Contact).filter(new);
        // What drifts more rarely than contacts do is much like a slip.
        let beside_drift = [drifting, Drifting::Contacts, Drifting::Common];
        let at_rim = beside_drift
            .iter()
            .find_map(|d| self.at_rim[d.index()].map(|a| a.cause).filter(new));
        let alone = contact.or(at_rim);
        // What is found beside touches that do not explain the frame is worth less than what the frame says without them.
        let most = self.options.contacts.explained;
        let linear = !result.changed || result.misfit.is_some_and(|misfit| misfit <= most);
        // A contact that stands out beside touches is much like a leak of its neighbours, and more frequent: it is tested first.
        let is_leak = matches!(alone, Some(Cause::Leak(_))) && beside.is_none_or(|beside| Some(beside) != rejected);
        let cause = match linear || is_leak {
            true => beside.or(alone),
            false => alone.or(beside),
        }?;
        let linear = linear && beside.is_some();
        let is_contact = contact == Some(cause) || beside == Some(cause);
        let at_rim = !is_contact && at_rim == Some(cause);
        Some(Candidate { cause, linear, at_rim })
    }

    fn is_fault(&self, contact: &ContactChange) -> bool {
        let options = &self.options.contacts;
        contact.evidence > options.evidence && contact.change.abs() > options.least_change
    }

    /// The contact that would explain the frame alone: its touches may be phantoms.
    pub(super) fn alone(&mut self, noise: NoiseEstimate) -> Option<usize> {
        let fitter = self.fitter.as_mut()?;
        let nuisances = self.weightings.current()?.tables.as_ref()?.nuisances.as_ref()?;
        let along: f64 = self.sizes.iter().map(|v| v * v).sum();
        let outside: f64 = self.reduced.iter().map(|v| v * v).sum();
        if along < self.options.contacts.of_frame * (along + outside) {
            return None;
        }
        let sizes = &self.sizes;
        let contact = fitter.drift_alone(Beside { nuisances, sizes }, noise.sigma).contact;
        contact.filter(|c| self.is_fault(c)).map(|c| c.electrode)
    }

    /// The contact that would explain the frame alone is none where something else at the rim explains it better, beside what drifts, than
    /// all contacts do.
    pub(crate) fn forget_alone(&mut self, drifting: Drifting, evidence: Evidence, of_contacts: Evidence) {
        let alone = self.alone.map(Cause::Contact);
        let at_rim = self.at_rim[drifting.index()];
        let is_other = at_rim.is_some_and(|at_rim| at_rim.cost > 0.0 && Some(at_rim.cause) != alone);
        if is_other && self.with_rim(evidence, drifting).cost < of_contacts.cost {
            self.alone = None;
        }
    }

    /// Resistance of a leak beside which a frame was solved, ohm; none where the frame does not tell it, or tells that nothing conducts.
    pub(crate) fn leak_ohm(&self, pair: [usize; 2], result: &FrameResult) -> Option<f64> {
        let (_, size) = result.drift.leaks.iter().find(|(of, _)| *of == pair)?;
        self.contacts.as_ref()?.leak_ohm(pair, *size)
    }

    /// Undoes the scales of the drives through electrodes whose contacts changed, in a copy of the difference.
    pub(crate) fn even_out(&self, changed: &[Cause], difference: &mut Difference) {
        if let Some(contacts) = &self.contacts {
            contacts.even_out(changed, &self.imager.model_v, difference);
        }
    }
}
