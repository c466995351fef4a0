//! Which electrode's contact may have changed: linear fits of contacts beside, or in place of, the touches of a fit.

use crate::linalg::basis::Basis;
use crate::quality::contact::options::ContactOptions;
use crate::quality::contact::shapes::Contacts;
use crate::reference::imager::Imager;
use crate::touches::fit::levenberg_marquardt::PARAMETERS;
use crate::touches::fit::{Disc, Fitted};
use nalgebra::DMatrix;

/// Standard deviations of chi-square that count as chance.
const CHANCE_SD: f64 = 3.0;

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
pub(crate) fn near(imager: &Imager, discs: &[Disc], options: &ContactOptions) -> bool {
    let reach = imager
        .electrodes_mm
        .iter()
        .map(|e| e[0].hypot(e[1]))
        .fold(0.0, f64::max);
    let of = |e: &[f64; 2]| {
        discs
            .iter()
            .any(|d| (d.at[0] - e[0]).hypot(d.at[1] - e[1]) < options.near[1] * reach)
    };
    imager.electrodes_mm.iter().any(of)
}

/// A contact that may have changed, in place of the touches within a distance of its electrode.
#[derive(Clone, Copy, Debug)]
struct Hypothesis {
    electrode: usize,
    /// The distance, over the sheet's reach.
    near: f64,
    /// Chi-square that the contact leaves by itself.
    residual: f64,
}

/// How well the touches of a fit explain its frame.
#[derive(Clone, Copy, Debug)]
struct Explained {
    /// Chi-square of the residual.
    square: f64,
    freedom: f64,
    /// How much more than its freedom chi-square is by chance.
    chance: f64,
    /// Whether noise explains the residual.
    by_noise: bool,
}

impl Explained {
    fn of(fitted: &Fitted, length: usize) -> Self {
        let square: f64 = fitted.left.iter().map(|v| v * v).sum();
        let freedom = (length as f64 - 3.0 * fitted.all.len() as f64).max(1.0);
        let chance = CHANCE_SD * (2.0 * freedom).sqrt();
        Self {
            square,
            freedom,
            chance,
            by_noise: square <= freedom + chance,
        }
    }
}

/// What small changes of contacts do to the reduced frame, and room to fit them.
#[derive(Clone, Debug)]
pub(crate) struct Candidates {
    options: ContactOptions,
    /// Columns, one after the other, and an orthonormal basis of them, for every electrode.
    signatures: Vec<(DMatrix<f64>, Basis)>,
    /// How far the sheet reaches, mm.
    reach_mm: f64,
    basis: Basis,
    /// A frame over its noise without the touches that stay, from the residual of the fit and from the data.
    residual: Vec<f64>,
    whole: Vec<f64>,
    hypotheses: Vec<Hypothesis>,
}

impl Candidates {
    /// `reduce` takes volts of the model to the reduced frame.
    pub(crate) fn new(contacts: &Contacts, imager: &Imager, reduce: impl Fn(&DMatrix<f64>) -> DMatrix<f64>) -> Self {
        let signature = |l: usize| {
            let columns = reduce(&contacts.small(imager, l));
            let mut basis = Basis::default();
            columns.column_iter().for_each(|c| basis.add(c.as_slice()));
            (columns, basis)
        };
        Self {
            options: contacts.options(),
            signatures: (0..contacts.electrodes()).map(signature).collect(),
            reach_mm: imager.reach_mm(),
            basis: Basis::default(),
            residual: Vec::new(),
            whole: Vec::new(),
            hypotheses: Vec::new(),
        }
    }

    /// The electrode whose contact explains a frame better than the touches near it, or the residual of all touches.
    /// `known` are left out already.
    pub(crate) fn best(&mut self, imager: &Imager, known: &[usize], judged: Judged) -> Option<usize> {
        let fitted = judged.fitted;
        let length = self.signatures.first()?.0.nrows();
        let explained = Explained::of(fitted, length);
        self.list(imager, known, judged, explained);
        let mut best: Option<(f64, usize)> = None;
        for k in 0..self.hypotheses.len().min(self.options.most_tries) {
            let hypothesis = self.hypotheses[k];
            if let Some(gain) = self.gain(imager, hypothesis, judged, explained)
                && best.is_none_or(|(most, _)| gain > most)
            {
                best = Some((gain, hypothesis.electrode));
            }
        }
        let poor = explained.square > self.options.unexplained * explained.freedom;
        let by_itself = || poor.then(|| self.by_itself(known, judged)).flatten();
        best.map(|(_, l)| l).or_else(by_itself)
    }

    /// Lists the hypotheses that are worth a fit, those that explain most by themselves first.
    fn list(&mut self, imager: &Imager, known: &[usize], judged: Judged, explained: Explained) {
        let (fitted, reach) = (judged.fitted, self.reach_mm);
        let within = |l: usize, near: f64| fitted.all.iter().filter(|d| apart(imager, d, l, reach) < near).count();
        self.hypotheses.clear();
        for l in (0..self.signatures.len()).filter(|l| !known.contains(l)) {
            let mut before = usize::MAX;
            let close = within(l, self.options.near[1]);
            for near in self.options.near {
                // In place of the touches near it; and where they leave something, beside them.
                let replaced = within(l, near);
                // A touch at an electrode may itself be what leaves it.
                let beside = replaced == 0 && (explained.by_noise || close > 0);
                let far = explained.by_noise && near > self.options.near[1];
                if replaced == before || beside || far {
                    continue;
                }
                before = replaced;
                self.without(judged, |k| apart(imager, &fitted.all[k], l, reach) < near);
                let by_itself = &self.signatures[l].1;
                let residual = by_itself
                    .outside(&mut self.residual)
                    .min(by_itself.outside(&mut self.whole));
                if !explained.by_noise || residual < self.options.quick * explained.freedom {
                    self.hypotheses.push(Hypothesis {
                        electrode: l,
                        near,
                        residual,
                    });
                }
            }
        }
        self.hypotheses
            .sort_unstable_by(|a, b| a.residual.total_cmp(&b.residual));
    }

    /// By how much a hypothesis lowers the cost in a linear fit beside the touches that stay; none where that is not enough.
    fn gain(&mut self, imager: &Imager, h: Hypothesis, judged: Judged, explained: Explained) -> Option<f64> {
        let (fitted, reach) = (judged.fitted, self.reach_mm);
        let length = judged.data.len();
        let replaced = |k: usize| apart(imager, &fitted.all[k], h.electrode, reach) < h.near;
        let count = (0..fitted.all.len()).filter(|k| replaced(*k)).count();
        self.basis.clear();
        for (k, columns) in fitted.slopes.chunks_exact(PARAMETERS * judged.stride).enumerate() {
            if !replaced(k) {
                let columns = columns.chunks_exact(judged.stride);
                columns.for_each(|c| self.basis.add(&c[..length]));
            }
        }
        // What the others could still make of the residual, had they not to be touches.
        self.residual.clear();
        self.residual.extend_from_slice(&fitted.left[..length]);
        let without = self.basis.outside(&mut self.residual);
        self.without(judged, replaced);
        let signature = &self.signatures[h.electrode].0;
        signature.column_iter().for_each(|c| self.basis.add(c.as_slice()));
        let with = self
            .basis
            .outside(&mut self.residual)
            .min(self.basis.outside(&mut self.whole));
        let gain = without - with + (PARAMETERS * count) as f64 - signature.ncols() as f64;
        let margin = if count == 0 {
            self.options.margin_beside
        } else {
            self.options.margin
        };
        let part = if count == fitted.all.len() {
            self.options.of_all
        } else {
            self.options.of_unexplained
        };
        let Explained {
            square,
            freedom,
            chance,
            by_noise,
        } = explained;
        let explains = by_noise || with - freedom - chance < part * (square - freedom);
        (gain > margin && explains).then_some(gain)
    }

    /// The electrode whose contact alone takes away a good part of the data: where a fit found no touches that explain them,
    /// its residual says little.
    fn by_itself(&mut self, known: &[usize], judged: Judged) -> Option<usize> {
        let all: f64 = judged.data.iter().map(|v| v * v).sum();
        let mut best: Option<(f64, usize)> = None;
        for (l, (_, basis)) in self.signatures.iter().enumerate().filter(|(l, _)| !known.contains(l)) {
            self.whole.clear();
            self.whole.extend_from_slice(judged.data);
            let residual = basis.outside(&mut self.whole);
            if residual < self.options.of_data * all && best.is_none_or(|(least, _)| residual < least) {
                best = Some((residual, l));
            }
        }
        best.map(|(_, l)| l)
    }

    /// The frame over its noise without the touches that stay, in two ways: from the residual of the fit, and from the data.
    /// The nonlinear correction of the data belongs to touches that may not be there.
    fn without(&mut self, judged: Judged, replaced: impl Fn(usize) -> bool) {
        let Judged {
            fitted,
            stride,
            data,
            sigma,
        } = judged;
        self.residual.clear();
        self.residual.extend_from_slice(&fitted.left[..data.len()]);
        self.whole.clear();
        self.whole.extend(data.iter().map(|v| v / sigma));
        for (k, columns) in fitted.slopes.chunks_exact(PARAMETERS * stride).enumerate() {
            let strength = fitted.all[k].strength / sigma;
            let response = columns[3 * stride..][..data.len()].iter().map(|a| strength * a);
            if replaced(k) {
                self.residual.iter_mut().zip(response).for_each(|(l, a)| *l += a);
            } else {
                self.whole.iter_mut().zip(response).for_each(|(l, a)| *l -= a);
            }
        }
    }
}

/// Distance of a touch from an electrode, over the sheet's reach.
fn apart(imager: &Imager, disc: &Disc, electrode: usize, reach_mm: f64) -> f64 {
    let at = imager.electrodes_mm[electrode];
    (disc.at[0] - at[0]).hypot(disc.at[1] - at[1]) / reach_mm
}
