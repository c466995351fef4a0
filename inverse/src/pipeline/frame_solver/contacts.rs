//! What a frame that was solved says of contacts.

use super::{FrameSolver, Task};
use crate::pipeline::result::FrameResult;
use crate::quality::contact::{Contacts, Evidence};
use crate::reference::Difference;
use crate::reference::drift::{ContactChange, Drifting};
use crate::reference::noise::{NoiseEstimate, NoiseSource};
use crate::touches::fit::fitter::Beside;

/// A contact that may have changed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Candidate {
    pub(crate) electrode: usize,
    /// Whether its change is small: estimated beside touches, which are right.
    pub(crate) linear: bool,
    /// Whether it slipped along the rim: its shapes are those of its change.
    pub(crate) slips: bool,
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

    /// An electrode whose contact changed more than the others in the frame solved last, beside its touches; or one that would
    /// explain the frame alone, without touches. `known` ones are left out. `drifting`: beside what the result was found.
    pub(crate) fn candidate(&self, known: &[usize], drifting: Drifting, result: &FrameResult) -> Option<Candidate> {
        // An estimate of the noise by a few directions is not good enough to blame a contact.
        if matches!(result.noise?.source, NoiseSource::Residual { .. }) {
            return None;
        }
        let new = |electrode: &usize| !known.contains(electrode);
        let beside = result
            .drift
            .contact
            .filter(|c| self.is_fault(c))
            .map(|c| c.electrode)
            .filter(new);
        let contact = self.alone.filter(new);
        // What drifts more rarely than contacts do is much like a slip.
        let beside_drift = [drifting, Drifting::Contacts, Drifting::Common];
        let slipped = beside_drift.iter().find_map(|d| self.slipped[d.index()]).filter(new);
        let alone = contact.or(slipped);
        // What is found beside touches that do not explain the frame is worth less than what the frame says without them.
        let most = self.options.contacts.explained;
        let linear = !result.changed || result.misfit.is_some_and(|misfit| misfit <= most);
        let electrode = if linear { beside.or(alone) } else { alone.or(beside) }?;
        let linear = linear && beside.is_some();
        let is_contact = contact == Some(electrode) || beside == Some(electrode);
        let slips = !is_contact && slipped == Some(electrode);
        Some(Candidate {
            electrode,
            linear,
            slips,
        })
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

    /// Undoes the scales of the drives through these electrodes, in a copy of the difference.
    pub(crate) fn even_out(&self, changed: &[usize], difference: &mut Difference) {
        if let Some(contacts) = &self.contacts {
            contacts.even_out(changed, &self.imager.model_v, difference);
        }
    }
}
