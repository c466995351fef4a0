//! Which electrode's contact may have changed: told from a fit of touches by linear fits beside it.

use crate::quality::contact::{Basis, Contacts};
use crate::reference::imager::Imager;
use crate::touches::fit::levenberg_marquardt::PARAMETERS;
use crate::touches::fit::{Disc, Fitted};
use nalgebra::DMatrix;

/// Touches nearer to an electrode than these parts of the sheet's reach may be what its contact makes of the frame: those at it,
/// also those further off, all, none. One that is nearer than the second is reason to ask.
const NEAR: [f64; 5] = [0.15, 0.36, 0.6, f64::INFINITY, 0.0];
/// By how much chi-square and the number of parameters must be lower with a contact than with the touches in its place: in a linear fit
/// to be worth a try, or in a full one to stay believed, and in a full one to be believed.
const MARGIN: f64 = 4.0;
const MARGIN_AFTER: f64 = 12.0;
/// The same for a linear fit beside all touches: any of the electrodes may explain some noise.
const MARGIN_BESIDE: f64 = 30.0;
/// Where touches leave a frame unexplained, a contact may leave at most this part of that: what a wrong model leaves can be lessened
/// by a contact, but not made to go.
const OF_UNEXPLAINED: f64 = 0.15;
/// The same for one that is tried in place of all touches, some of which may be touches.
const OF_ALL: f64 = 0.5;
/// Mean squared misfit, in noise variances, from which contacts are asked after wherever the touches are.
pub(crate) const EXPLAINED: f64 = 1.3;
/// Mean squared misfit of touches, in noise variances, from which a contact is tried that leaves at most this part of the data.
const UNEXPLAINED: f64 = 4.0;
const OF_DATA: f64 = 0.7;
/// Without the others' freedom a contact leaves at most this many times what noise does, where touches explain the frame.
const QUICK: f64 = 3.0;
/// Most linear fits in a frame.
const MOST_TRIES: usize = 6;

/// A fit of touches, and what it is judged by.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Judged<'a> {
    /// The touches.
    pub(crate) fitted: &'a Fitted,
    /// Length of a column of its slopes.
    pub(crate) stride: usize,
    /// What was fitted, and the standard deviation of a value.
    pub(crate) data: &'a [f64],
    pub(crate) sigma: f64,
}

/// Whether any touch is so near to an electrode that it may be its contact.
pub(crate) fn near(imager: &Imager, discs: &[Disc]) -> bool {
    let reach = imager
        .electrodes_mm
        .iter()
        .map(|e| e[0].hypot(e[1]))
        .fold(0.0, f64::max);
    let of = |e: &[f64; 2]| {
        discs
            .iter()
            .any(|d| (d.at[0] - e[0]).hypot(d.at[1] - e[1]) < NEAR[1] * reach)
    };
    imager.electrodes_mm.iter().any(of)
}

/// What small changes of contacts do to the reduced frame, and room to fit them.
#[derive(Clone, Debug)]
pub(crate) struct Suspects {
    /// Columns, one after the other, and an orthonormal basis of them, for every electrode.
    signatures: Vec<(DMatrix<f64>, Basis)>,
    /// How far the sheet reaches, mm.
    reach_mm: f64,
    basis: Basis,
    left: Vec<f64>,
    whole: Vec<f64>,
    /// What a contact leaves by itself, the electrode, and which touches it replaces.
    tries: Vec<(f64, usize, f64)>,
}

impl Suspects {
    /// `reduce` takes volts of the model to the reduced frame.
    pub(crate) fn new(contacts: &Contacts, imager: &Imager, reduce: impl Fn(&DMatrix<f64>) -> DMatrix<f64>) -> Self {
        let signature = |l: usize| {
            let columns = reduce(&contacts.small(imager, l));
            let mut basis = Basis::default();
            columns.column_iter().for_each(|c| basis.add(c.as_slice()));
            (columns, basis)
        };
        Self {
            signatures: (0..contacts.electrodes()).map(signature).collect(),
            reach_mm: imager.reach_mm(),
            basis: Basis::default(),
            left: Vec::new(),
            whole: Vec::new(),
            tries: Vec::new(),
        }
    }

    /// The electrode whose contact explains a frame better than the touches near it, or what all touches leave of it.
    pub(crate) fn suspect(&mut self, imager: &Imager, known: &[usize], judged: Judged) -> Option<usize> {
        let fitted = judged.fitted;
        let length = self.signatures.first()?.0.nrows();
        let square: f64 = fitted.residual_whitened.iter().map(|v| v * v).sum();
        let freedom = (length as f64 - 3.0 * fitted.all.len() as f64).max(1.0);
        let chance = 3.0 * (2.0 * freedom).sqrt();
        let explained = square <= freedom + chance;
        let reach = self.reach_mm;
        let apart = |d: &Disc, l: usize| {
            let at = imager.electrodes_mm[l];
            (d.at[0] - at[0]).hypot(d.at[1] - at[1]) / reach
        };
        let gone = |l: usize, near: f64| fitted.all.iter().filter(|d| apart(d, l) < near).count();
        self.tries.clear();
        for l in (0..self.signatures.len()).filter(|l| !known.contains(l)) {
            let mut replaced = usize::MAX;
            let close = gone(l, NEAR[1]);
            for near in NEAR {
                // In place of the touches near it; and where they leave something, beside them.
                let gone = gone(l, near);
                // What a touch at an electrode leaves may be its own doing.
                let beside = gone == 0 && (explained || close > 0);
                let far = explained && near > NEAR[1];
                if gone == replaced || beside || far {
                    continue;
                }
                replaced = gone;
                self.without(judged, |k| apart(&fitted.all[k], l) < near);
                let by_itself = &self.signatures[l].1;
                let left = by_itself
                    .outside(&mut self.left)
                    .min(by_itself.outside(&mut self.whole));
                if !explained || left < QUICK * freedom {
                    self.tries.push((left, l, near));
                }
            }
        }
        self.tries.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let mut best: Option<(f64, usize)> = None;
        for k in 0..self.tries.len().min(MOST_TRIES) {
            let (_, l, near) = self.tries[k];
            let gone = gone(l, near);
            let replaced = |k: usize| apart(&fitted.all[k], l) < near;
            self.basis.clear();
            for (k, columns) in fitted.slopes.chunks_exact(PARAMETERS * judged.stride).enumerate() {
                if !replaced(k) {
                    let columns = columns.chunks_exact(judged.stride);
                    columns.for_each(|c| self.basis.add(&c[..length]));
                }
            }
            // What the others could still make of what is left, had they not to be touches.
            self.left.clear();
            self.left.extend_from_slice(&fitted.residual_whitened[..length]);
            let without = self.basis.outside(&mut self.left);
            self.without(judged, replaced);
            let signature = &self.signatures[l].0;
            signature.column_iter().for_each(|c| self.basis.add(c.as_slice()));
            let with = self
                .basis
                .outside(&mut self.left)
                .min(self.basis.outside(&mut self.whole));
            let gain = without - with + (PARAMETERS * gone) as f64 - signature.ncols() as f64;
            let margin = if gone == 0 { MARGIN_BESIDE } else { MARGIN };
            let part = if gone == fitted.all.len() {
                OF_ALL
            } else {
                OF_UNEXPLAINED
            };
            let explains = explained || with - freedom - chance < part * (square - freedom);
            if gain > margin && explains && best.is_none_or(|(most, _)| gain > most) {
                best = Some((gain, l));
            }
        }
        let poor = square > UNEXPLAINED * freedom;
        let by_itself = || poor.then(|| self.by_itself(known, judged)).flatten();
        best.map(|(_, l)| l).or_else(by_itself)
    }

    /// The electrode whose contact alone takes away a good part of the data: where a fit found no touches that explain them, it says
    /// little.
    fn by_itself(&mut self, known: &[usize], judged: Judged) -> Option<usize> {
        let all: f64 = judged.data.iter().map(|v| v * v).sum();
        let mut best: Option<(f64, usize)> = None;
        for (l, (_, basis)) in self.signatures.iter().enumerate().filter(|(l, _)| !known.contains(l)) {
            self.whole.clear();
            self.whole.extend_from_slice(judged.data);
            let left = basis.outside(&mut self.whole);
            if left < OF_DATA * all && best.is_none_or(|(least, _)| left < least) {
                best = Some((left, l));
            }
        }
        best.map(|(_, l)| l)
    }

    /// The frame over its noise without the touches that stay, in two ways: from what the fit left, and from the data themselves. What
    /// the fit took off the data beyond the linear model belongs to touches that may not be there.
    fn without(&mut self, judged: Judged, replaced: impl Fn(usize) -> bool) {
        let Judged {
            fitted,
            stride,
            data,
            sigma,
        } = judged;
        self.left.clear();
        self.left.extend_from_slice(&fitted.residual_whitened[..data.len()]);
        self.whole.clear();
        self.whole.extend(data.iter().map(|v| v / sigma));
        for (k, columns) in fitted.slopes.chunks_exact(PARAMETERS * stride).enumerate() {
            let strength = fitted.all[k].strength / sigma;
            let answer = columns[3 * stride..][..data.len()].iter().map(|a| strength * a);
            if replaced(k) {
                self.left.iter_mut().zip(answer).for_each(|(l, a)| *l += a);
            } else {
                self.whole.iter_mut().zip(answer).for_each(|(l, a)| *l -= a);
            }
        }
    }
}

/// What a frame comes to with or without a contact.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Outcome {
    /// Chi-square and the number of parameters: of touches, and of directions left out.
    pub(crate) cost: f64,
    /// Mean square of the residual, in variances of the noise.
    pub(crate) misfit: f64,
    /// Chi-square that the model of touches may be wrong by.
    pub(crate) model: f64,
}

impl std::ops::Add for Outcome {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            cost: self.cost + other.cost,
            misfit: self.misfit + other.misfit,
            model: self.model + other.model,
        }
    }
}

impl Outcome {
    /// Of a sum over frames, what one comes to.
    pub(crate) fn mean_of(self, frames: usize) -> Self {
        let part = 1.0 / frames as f64;
        Self {
            cost: part * self.cost,
            misfit: part * self.misfit,
            model: part * self.model,
        }
    }

    /// Whether a contact that was believed still is.
    pub(crate) fn stays(self, without: Self) -> bool {
        self.cost + MARGIN + self.model < without.cost
    }

    /// Whether this, with a contact, is to be believed rather than that without.
    pub(crate) fn instead_of(self, without: Self) -> bool {
        let unexplained = |outcome: Self| (outcome.misfit - EXPLAINED).max(0.0);
        self.cost + MARGIN_AFTER + self.model < without.cost
            && unexplained(self) <= OF_UNEXPLAINED * unexplained(without)
    }
}
