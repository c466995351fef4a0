//! Whether an electrode slipped along the rim, or two leak into one another.
//!
//! A slip is a rise at one end of an electrode and a fall at the other. A small touch there is much like it. A leak is like falls between
//! the two.

use super::{FrameSolver, Task};
use crate::linalg::basis::Basis;
use crate::linalg::vector::{dot, square};
use crate::quality::contact::{Cause, RimShape};
use crate::reference::noise::{NoiseEstimate, NoiseSource};
use crate::touches::fit::frame_fit::Fitted;
use crate::touches::fit::levenberg_marquardt::PARAMETERS;

/// Part of what a slip and the contact explain together that has to be the slip's: else the contact changed.
const OWN_PART: f64 = 0.5;

/// What is at the rim beside touches, or in place of some.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AtRim {
    pub(crate) cause: Cause,
    /// By how much the cost of the frame falls with it, to first order, and what touches leave open. Of priors and of what is left open all
    /// touches have the same share. 0 where they explain the frame no worse.
    pub(crate) cost: f64,
    pub(crate) open: f64,
}

/// By how much chi-square and the number of parameters fall with a shape.
#[derive(Clone, Copy, Debug, Default)]
struct Lessened {
    by: f64,
    /// Whether most of it is the shape's, and not the contact's.
    by_own: bool,
}

/// Room for what touches leave with a slip or a leak in place of some of them. Nothing is allocated once it is as large as it gets.
#[derive(Debug, Default)]
pub(super) struct BesideTouches {
    /// The frame over its noise.
    frame: Vec<f64>,
    /// What is left by those that stay, of each choice that was asked for; and how many of them are of this frame.
    left_by: Vec<LeftBy>,
    asked: usize,
    /// What the contact does beside those that stay, the shape, and what is left.
    contact: Basis,
    shape: Vec<f64>,
    left: Vec<f64>,
}

/// What is left of a frame by some of its touches.
#[derive(Debug, Default)]
struct LeftBy {
    /// A bit of each touch that is gone, and whether what of all touches is not linear goes with them.
    gone: (u64, bool),
    /// Derivatives by those that stay.
    stay: Basis,
    /// Chi-square and the number of parameters with all touches; those that stay give way.
    before: f64,
    /// What is left without those that are gone, and its square.
    left: Vec<f64>,
    square: f64,
}

impl FrameSolver {
    /// The electrode that slipped, to first order and beside what its contact does; or the leak.
    ///
    /// Where touches do not explain the frame, most of it may be that. Else it explains the frame better than all touches, or than those
    /// that are there; or it comes beside all. It has to do so by a margin, by more than the model of touches may be wrong, and by most of
    /// what they leave. Of several the most probable is taken: a touch that is not needed leaves open where it is. Nothing is, where that
    /// is a contact that changed.
    pub(super) fn at_rim(&mut self, task: Task, noise: NoiseEstimate) -> Option<AtRim> {
        let options = self.options.contacts;
        // What no candidate is made of needs no search.
        let is_known = !matches!(noise.source, NoiseSource::Residual { .. });
        if task.averaged.frames > 1 || !is_known || task.changed.len() >= options.most_contacts {
            return None;
        }
        let (fitter, contacts) = (self.fitter.as_ref()?, self.contacts.as_ref()?);
        let shapes = &self.weightings.current()?.tables.as_ref()?.rim;
        let fitted = fitter.last();
        let n = fitted.residual_whitened.len();
        // Values that are no numbers are not fitted.
        let is_fitted = n >= self.reduced.len() && fitted.slopes.len() == PARAMETERS * n * fitted.all.len();
        if self.reduced.is_empty() || !(is_fitted || fitted.hopeless) {
            return None;
        }
        let new = || shapes.iter().filter(|shape| !task.changed.contains(&shape.cause));
        let data = square(&self.reduced);
        let variance = noise.sigma.powi(2);
        let room = &mut self.beside_touches;
        let touches = fitted.all.len();
        let all = (1_u64 << touches) - 1;
        let near = |cause: Cause| {
            let at = fitted
                .all
                .iter()
                .enumerate()
                .filter(|(_, d)| contacts.is_at(cause, d.at));
            at.fold(0, |bits: u64, (k, _)| bits | 1 << k)
        };
        // What touches leave open, and what their priors cost.
        let part = |of: f64| of / touches.max(1) as f64;
        let priors = fitted.cost - square(&fitted.residual_whitened) - (PARAMETERS * touches) as f64;
        let (open, prior) = (part(fitted.open), part(priors));
        let found = |cause, by: f64, gone: u64| {
            let gone = f64::from(gone.count_ones());
            let (cost, open) = (by + prior * gone, open * gone);
            AtRim { cause, cost, open }
        };
        let most = |a: &AtRim, b: &AtRim| a.gain().total_cmp(&b.gain());
        if fitted.hopeless || !fitter.options().explains(fitted.misfit, 1.0) {
            let along = new().map(|shape| (shape, dot(&shape.beside, &self.reduced)));
            let along = along.filter(|(shape, along)| shape.may_be(*along));
            let along = along.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
            let along = along.filter(|(_, along)| along * along > options.of_frame * data);
            if let Some((shape, along)) = along.filter(|_| fitted.hopeless) {
                // The picture left less than touches.
                let by = (self.left - data + along * along) / variance - 1.0;
                return Some(found(shape.cause, by.max(0.0), 0));
            }
            if let Some((shape, _)) = along {
                room.take(&self.reduced, fitted);
                let near = near(shape.cause);
                let mut way = |gone, whole| {
                    let lessened = room.lessened_by(shape, fitted, (gone, whole));
                    found(shape.cause, lessened.by, gone)
                };
                let mut best = [way(all, true), way(0, false)].into_iter().max_by(most);
                if near > 0 && near < all {
                    let there = [way(near, true), way(near, false)];
                    best = best.into_iter().chain(there).max_by(most);
                }
                return best
                    .filter(|best| best.gain() > 0.0)
                    .or(Some(found(shape.cause, 0.0, 0)));
            }
            if fitted.hopeless {
                return None;
            }
        }
        let leaves = fitted.misfit > options.explained;
        room.take(&self.reduced, fitted);
        let left = square(&fitted.residual_whitened) - options.explained * self.reduced.len() as f64;
        let model = self.options.fit?.model_error.powi(2) * data / variance;
        let least = (options.of_frame * left).max(options.margin + model);
        // Of those beside all touches any may be it by chance.
        let least_beside = (options.of_frame * left).max(options.margin_accepted + model);
        let better = new().filter_map(|shape| {
            let near = near(shape.cause);
            let may_be_there = near > 0 && near < all && room.mimics(shape, fitted, near);
            let mut lessened = |gone, whole| (room.lessened_by(shape, fitted, (gone, whole)), gone);
            let alone = (all > 0).then(|| (lessened(all, true), least));
            let mut there = |whole| may_be_there.then(|| (lessened(near, whole), least));
            let there = [there(true), there(false)];
            let beside = leaves.then(|| (lessened(0, false), least_beside));
            let ways = there.into_iter().chain([alone, beside]).flatten();
            let better = ways.filter(|((lessened, _), least)| lessened.by > *least);
            let better = better.map(|((lessened, gone), _)| (found(shape.cause, lessened.by, gone), lessened.by_own));
            better.max_by(|(a, _), (b, _)| most(a, b))
        });
        let (best, by_own) = better.max_by(|(a, _), (b, _)| most(a, b))?;
        by_own.then_some(best)
    }
}

impl AtRim {
    /// By how much the frame is more probable with it, as twice the logarithm.
    fn gain(self) -> f64 {
        self.cost + self.open
    }
}

impl BesideTouches {
    /// Takes a frame.
    fn take(&mut self, reduced: &[f64], fitted: &Fitted) {
        self.frame.clear();
        self.frame.extend(reduced.iter().map(|v| v / fitted.sigma));
        self.frame.resize(fitted.residual_whitened.len(), 0.0);
        self.asked = 0;
    }

    /// Whether a shape is most of what some touches do, those with a bit in `gone`: only then it may come in their place.
    fn mimics(&mut self, shape: &RimShape, fitted: &Fitted, gone: u64) -> bool {
        let n = self.frame.len();
        self.left.clear();
        self.left.resize(n, 0.0);
        for (k, disc) in fitted.all.iter().enumerate().filter(|(k, _)| gone >> k & 1 == 1) {
            let response = fitted.slopes[(PARAMETERS * (k + 1) - 1) * n..][..n].iter();
            let strength = disc.strength / fitted.sigma;
            self.left.iter_mut().zip(response).for_each(|(l, r)| *l += strength * r);
        }
        let [of_contact, own] = shape.along(&self.left);
        of_contact + own > OWN_PART * square(&self.left)
    }

    /// What falls with a shape, and what the contact does, in place of the touches that are `gone` (see [`LeftBy`]). Those that stay give
    /// way to first order, with the shape as without.
    fn lessened_by(&mut self, shape: &RimShape, fitted: &Fitted, gone: (u64, bool)) -> Lessened {
        let asked = self.left_by[..self.asked].iter().position(|by| by.gone == gone);
        let asked = asked.unwrap_or_else(|| {
            if self.asked == self.left_by.len() {
                self.left_by.push(LeftBy::default());
            }
            self.left_by[self.asked].take(&self.frame, fitted, gone);
            self.asked += 1;
            self.asked - 1
        });
        let by = &self.left_by[asked];
        if by.stay.columns().is_empty() {
            let [of_contact, own] = shape.along(&by.left);
            if own == 0.0 {
                return Lessened::default();
            }
            return Lessened {
                by: by.before - (by.square - of_contact - own + shape.directions() as f64),
                by_own: own >= OWN_PART * (of_contact + own),
            };
        }
        self.contact.clear();
        self.left.clone_from(&by.left);
        let of_contact = shape.contact.columns().chunks_exact(shape.beside.len().max(1));
        let directions = shape.directions();
        let mut with_contact = by.square;
        for (k, direction) in of_contact.chain([shape.beside.as_slice()]).enumerate() {
            if k + 1 == directions {
                with_contact = self.contact.outside(&mut self.left);
            }
            self.shape.clear();
            self.shape.extend_from_slice(direction);
            self.shape.resize(by.left.len(), 0.0);
            by.stay.outside(&mut self.shape);
            self.contact.add(&self.shape);
        }
        if !shape.may_be(dot(&self.shape, &self.left)) {
            return Lessened::default();
        }
        let with_shape = self.contact.outside(&mut self.left);
        Lessened {
            by: by.before - (with_shape + directions as f64),
            by_own: with_contact - with_shape >= OWN_PART * (by.square - with_shape),
        }
    }
}

impl LeftBy {
    /// Takes the touches of a frame, of which some are `gone`.
    fn take(&mut self, frame: &[f64], fitted: &Fitted, (gone, whole): (u64, bool)) {
        let n = frame.len();
        let discs = || {
            fitted
                .all
                .iter()
                .zip(fitted.slopes.chunks_exact(PARAMETERS * n))
                .enumerate()
        };
        let is_gone = |k: usize| gone >> k & 1 == 1;
        self.gone = (gone, whole);
        self.stay.clear();
        for (_, (_, slopes)) in discs().filter(|(k, _)| !is_gone(*k)) {
            slopes.chunks_exact(n).for_each(|slope| self.stay.add(slope));
        }
        self.left.clone_from(&fitted.residual_whitened);
        let parameters = PARAMETERS * gone.count_ones() as usize;
        self.before = self.stay.outside(&mut self.left) + parameters as f64;
        // What of the touches is not linear stays with those that stay, or goes with those that are gone.
        if whole {
            self.left.copy_from_slice(frame);
        }
        for (_, (disc, slopes)) in discs().filter(|(k, _)| is_gone(*k) != whole) {
            let response = slopes[(PARAMETERS - 1) * n..].iter();
            let strength = disc.strength / fitted.sigma;
            let strength = if whole { -strength } else { strength };
            self.left.iter_mut().zip(response).for_each(|(l, r)| *l += strength * r);
        }
        self.square = self.stay.outside(&mut self.left);
    }
}
