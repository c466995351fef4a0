//! Whether an electrode slipped along the rim.
//!
//! A slip is a rise at one end of an electrode and a fall at the other, and a small touch there is much like it.

use super::{FrameSolver, Task};
use crate::linalg::basis::Basis;
use crate::linalg::vector::{dot, square};
use crate::quality::contact::Slip;
use crate::reference::noise::{NoiseEstimate, NoiseSource};
use crate::touches::fit::disc::Disc;
use crate::touches::fit::frame_fit::Fitted;
use crate::touches::fit::levenberg_marquardt::PARAMETERS;

/// Part of what a slip and the contact explain together that has to be the slip's: else the contact changed.
const OWN_PART: f64 = 0.5;

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
    /// The electrode that slipped, to first order and beside what its contact does.
    ///
    /// Where touches do not explain the frame, most of it is the slip, or most of what they leave. Where they do, the slip explains it better
    /// than those at the electrode, or than all. It does so by a margin, and by more than the model of touches may be wrong.
    pub(super) fn slipped(&mut self, task: Task, noise: NoiseEstimate) -> Option<usize> {
        let options = self.options.contacts;
        // What no candidate is made of needs no search.
        let is_known = !matches!(noise.source, NoiseSource::Residual { .. });
        if task.averaged.frames > 1 || !is_known || task.changed.len() >= options.most_contacts {
            return None;
        }
        let (fitter, contacts) = (self.fitter.as_ref()?, self.contacts.as_ref()?);
        let slips = &self.weightings.current()?.tables.as_ref()?.slips;
        let fitted = fitter.last();
        let n = fitted.residual_whitened.len();
        // Values that are no numbers are not fitted.
        let is_fitted = n >= self.reduced.len() && fitted.slopes.len() == PARAMETERS * n * fitted.all.len();
        if self.reduced.is_empty() || !(is_fitted || fitted.hopeless) {
            return None;
        }
        let best = |least: f64, of: &mut dyn FnMut(usize, &Slip) -> f64| {
            let new = slips.iter().enumerate();
            let new = new.filter(|(l, slip)| slip.is_told() && !task.changed.contains(l));
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
        // Those of another frame say nothing of this one.
        room.all.clear();
        if !explained {
            let most = best(options.of_frame * data, &mut |_, slip| along(slip));
            if most.is_some() || fitted.hopeless {
                return most;
            }
            least = options.of_frame * square(&fitted.residual_whitened);
            room.take(fitted);
        }
        let variance = noise.sigma.powi(2);
        let model = self.options.fit?.model_error.powi(2) * data / variance;
        best(least.max(options.margin + model), &mut |electrode, slip| {
            let is_near = |d: &Disc| contacts.is_at(electrode, d.at);
            let alone = room.lessened_by(slip, fitted, |_| true);
            if explained && !fitted.all.iter().any(is_near) {
                return alone;
            }
            alone.max(room.lessened_by(slip, fitted, is_near))
        })
    }
}

impl BesideTouches {
    /// Takes the touches of a frame as well.
    fn take(&mut self, fitted: &Fitted) {
        let slopes = fitted.slopes.chunks_exact(fitted.residual_whitened.len().max(1));
        slopes.for_each(|slope| self.all.add(slope));
    }

    /// By how much chi-square and the number of parameters fall with a slip, and what its contact does, in place of some touches; or beside all
    /// that were taken. Nothing where most of it is the contact's. Touches that stay give way to first order, with the slip as without.
    fn lessened_by(&mut self, slip: &Slip, fitted: &Fitted, in_place_of: impl Fn(&Disc) -> bool) -> f64 {
        let n = fitted.residual_whitened.len();
        let discs = || fitted.all.iter().zip(fitted.slopes.chunks_exact(PARAMETERS * n));
        let gone = PARAMETERS * discs().filter(|(disc, _)| in_place_of(disc)).count();
        self.stay.clear();
        if gone > 0 {
            for (_, slopes) in discs().filter(|(disc, _)| !in_place_of(disc)) {
                slopes.chunks_exact(n).for_each(|slope| self.stay.add(slope));
            }
        }
        let others = if gone > 0 { &self.stay } else { &self.all };
        self.left.clone_from(&fitted.residual_whitened);
        let before = others.outside(&mut self.left) + gone as f64;
        for (disc, slopes) in discs().filter(|(disc, _)| in_place_of(disc)) {
            let response = slopes[(PARAMETERS - 1) * n..].iter();
            let strength = disc.strength / fitted.sigma;
            self.left.iter_mut().zip(response).for_each(|(l, r)| *l += strength * r);
        }
        let without = others.outside(&mut self.left);
        self.contact.clear();
        let shapes = slip.contact.columns().chunks_exact(slip.beside.len().max(1));
        let directions = shapes.len() + 1;
        let mut with_contact = without;
        for (k, shape) in shapes.chain([slip.beside.as_slice()]).enumerate() {
            if k + 1 == directions {
                with_contact = self.contact.outside(&mut self.left);
            }
            self.slip.clear();
            self.slip.extend_from_slice(shape);
            self.slip.resize(n, 0.0);
            others.outside(&mut self.slip);
            self.contact.add(&self.slip);
        }
        let with_slip = self.contact.outside(&mut self.left);
        if with_contact - with_slip < OWN_PART * (without - with_slip) {
            return 0.0;
        }
        before - (with_slip + directions as f64)
    }
}
