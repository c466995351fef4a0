//! Whether an electrode slipped along the rim.
//!
//! A slip is a rise at one end of an electrode and a fall at the other, and a small touch there is much like it.

use super::{FrameSolver, Task};
use crate::linalg::basis::Basis;
use crate::linalg::vector::{dot, square};
use crate::quality::contact::Slip;
use crate::reference::noise::NoiseEstimate;
use crate::touches::fit::disc::Disc;
use crate::touches::fit::frame_fit::Fitted;
use crate::touches::fit::levenberg_marquardt::PARAMETERS;

/// Room for what touches leave with a slip beside them. Nothing is allocated once it is as large as it gets.
#[derive(Debug, Default)]
pub(super) struct BesideTouches {
    /// Derivatives by all touches, by those that stay, and beside them what the contact does.
    all: Basis,
    stay: Basis,
    contact: Basis,
    left: Vec<f64>,
    slip: Vec<f64>,
}

impl FrameSolver {
    /// The electrode that slipped, to first order and beside what its contact does. Most of a frame that touches do not explain is its
    /// slip, or most of what they leave. Or a frame that they explain is explained better by the slip than by the touches at the electrode,
    /// or than by all, by a margin and by more than the model of touches may be wrong.
    pub(super) fn slipped(&mut self, task: Task, noise: NoiseEstimate) -> Option<usize> {
        let (fitter, contacts) = (self.fitter.as_ref()?, self.contacts.as_ref()?);
        let slips = self.weightings.current_mut()?.slips(contacts, &self.imager);
        let fitted = fitter.last();
        let best = |least: f64, of: &mut dyn FnMut(usize, &Slip) -> f64| {
            let new = slips.iter().enumerate().filter(|(l, _)| !task.changed.contains(l));
            let better = new
                .map(|(l, slip)| (l, of(l, slip)))
                .filter(|(_, better)| *better > least);
            better
                .max_by(|a, b| a.1.total_cmp(&b.1))
                .map(|(electrode, _)| electrode)
        };
        let data = square(&self.reduced);
        let along = |slip: &Slip| dot(&slip.beside, &self.reduced).powi(2);
        let explained = !fitted.hopeless && fitter.options().explains(fitted.misfit, 1.0);
        let room = &mut self.beside_touches;
        let mut least = 0.0;
        if !explained {
            let most = best(self.options.contacts.of_frame * data, &mut |_, slip| along(slip));
            if most.is_some() || fitted.hopeless {
                return most;
            }
            least = self.options.contacts.of_frame * square(&fitted.residual_whitened);
            room.take(fitted);
        }
        let variance = noise.sigma.powi(2);
        let model = self.options.fit?.model_error.powi(2) * data / variance;
        best(
            least.max(self.options.contacts.margin + model),
            &mut |electrode, slip| {
                let is_near = |d: &Disc| contacts.is_at(electrode, d.at);
                if explained && !fitted.all.iter().any(is_near) {
                    let with_touches = square(&fitted.residual_whitened) + (PARAMETERS * fitted.all.len()) as f64;
                    return with_touches - ((data - along(slip)) / variance + 1.0);
                }
                room.lessened_by(slip, fitted, is_near)
            },
        )
    }
}

impl BesideTouches {
    /// Takes the touches of a frame.
    fn take(&mut self, fitted: &Fitted) {
        self.all.clear();
        let slopes = fitted.slopes.chunks_exact(fitted.residual_whitened.len().max(1));
        slopes.for_each(|slope| self.all.add(slope));
    }

    /// By how much chi-square and the number of parameters fall with a slip, and what its contact does, in place of some touches; or
    /// beside all of those taken. The others give way, to first order. What they would without a slip, beyond their limits, does not
    /// count.
    fn lessened_by(&mut self, slip: &Slip, fitted: &Fitted, in_place_of: impl Fn(&Disc) -> bool) -> f64 {
        let n = fitted.residual_whitened.len();
        self.left.clone_from(&fitted.residual_whitened);
        self.stay.clear();
        let mut gone = 0;
        for (disc, slopes) in fitted.all.iter().zip(fitted.slopes.chunks_exact(PARAMETERS * n)) {
            if in_place_of(disc) {
                let response = slopes[(PARAMETERS - 1) * n..].iter();
                let strength = disc.strength / fitted.sigma;
                self.left.iter_mut().zip(response).for_each(|(l, r)| *l += strength * r);
                gone += PARAMETERS;
            }
        }
        let (others, before) = if gone == 0 {
            (&self.all, self.all.outside(&mut self.left))
        } else {
            let discs = fitted.all.iter().zip(fitted.slopes.chunks_exact(PARAMETERS * n));
            for (_, slopes) in discs.filter(|(disc, _)| !in_place_of(disc)) {
                slopes.chunks_exact(n).for_each(|slope| self.stay.add(slope));
            }
            self.stay.outside(&mut self.left);
            (&self.stay, square(&fitted.residual_whitened) + gone as f64)
        };
        self.contact.clear();
        let length = slip.beside.len().max(1);
        let contact = slip.contact.columns().chunks_exact(length);
        let directions = contact.len() + 1;
        for shape in contact.chain([slip.beside.as_slice()]) {
            self.slip.clear();
            self.slip.extend_from_slice(shape);
            self.slip.resize(n, 0.0);
            others.outside(&mut self.slip);
            self.contact.add(&self.slip);
        }
        before - (self.contact.outside(&mut self.left) + directions as f64)
    }
}
