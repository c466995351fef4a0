//! The reduced problem for one set of weights, and all that only depends on it.

use crate::linalg::basis::Basis;
use crate::pipeline::options::ReconstructorOptions;
use crate::quality::contact::{Cause, Contacts, RimShape};
use crate::quality::wild::Unreached;
use crate::reference::Difference;
use crate::reference::drift::{DriftShapes, Drifting};
use crate::reference::imager::Imager;
use crate::solvers::{Factored, Method, Nnls, NnlsOptions, Problem, Projector};
use crate::touches::fit::fitter::Fitter;
use crate::touches::fit::nuisance::{KnownCauses, Nuisances};
use crate::touches::fit::responses::ResponseTable;
use arrayvec::ArrayVec;
use nalgebra::{DMatrix, DVector};

/// What all problems for the same weights of the values have in common.
struct Whole {
    spread: Vec<f64>,
    /// The weighted sensitivity of all values, its columns scaled by the prior that all values give.
    factored: Factored,
    prior: DVector<f64>,
    /// The same with the prior that other values gave last.
    scaled: Option<(DVector<f64>, Factored)>,
}

/// Directions of all values below this part of [`ReconstructorOptions::drop`] are left out before any values are: what weights and
/// priors make of the others keeps to this.
const LEAST_DIRECTION: f64 = 0.3;

impl Whole {
    fn new(imager: &Imager, options: &ReconstructorOptions, spread: &[f64]) -> Self {
        let weights: Vec<f64> = spread.iter().map(|spread| 1.0 / spread).collect();
        let prior = prior(&imager.sensitivity, &weights, options);
        let mut a = imager.sensitivity.clone();
        for (mut column, prior) in a.column_iter_mut().zip(&prior) {
            let weighted = column.iter_mut().zip(&weights);
            weighted.for_each(|(v, weight)| *v *= weight * prior);
        }
        Self {
            spread: spread.to_vec(),
            factored: Factored::new(&a, LEAST_DIRECTION * options.drop),
            prior,
            scaled: None,
        }
    }

    /// The matrix with its columns scaled by this prior, in place of that of all values.
    fn with(&mut self, prior: &DVector<f64>) -> &Factored {
        if *prior == self.prior {
            return &self.factored;
        }
        let scaled = self.scaled.take().filter(|(of, _)| of == prior);
        let scaled = scaled.unwrap_or_else(|| {
            let scales: Vec<f64> = prior.iter().zip(&self.prior).map(|(own, all)| own / all).collect();
            (prior.clone(), self.factored.scaled(&scales))
        });
        &self.scaled.insert(scaled).1
    }
}

/// Expected rise of every cell over [`ReconstructorOptions::expected_rise`]: less of sensitive cells. Lawson-Hanson and the generalised
/// inverse are the plain methods, and expect the same of all.
fn prior(sensitivity: &DMatrix<f64>, weights: &[f64], options: &ReconstructorOptions) -> DVector<f64> {
    let depth = if is_ridged(options) { options.depth } else { 0.0 };
    let norm = |column: &[f64]| {
        column
            .iter()
            .zip(weights)
            .map(|(v, w)| (v * w).powi(2))
            .sum::<f64>()
            .sqrt()
    };
    let norms: Vec<f64> = sensitivity.column_iter().map(|c| norm(c.as_slice())).collect();
    let mut sorted = norms.clone();
    sorted.sort_by(f64::total_cmp);
    let median = sorted[sorted.len() / 2].max(f64::MIN_POSITIVE);
    let of = |norm: &f64| (norm / median).max(options.least_sensitivity).powf(-depth);
    DVector::from_iterator(norms.len(), norms.iter().map(of))
}

/// Whether the method solves with a ridge, and knows of drift.
fn is_ridged(options: &ReconstructorOptions) -> bool {
    matches!(options.method, Method::Nnls | Method::Tikhonov)
}

/// The weighted and reduced problem for the values that take part, without what changed at the rim does.
pub(crate) struct Weighted {
    used: Vec<bool>,
    spread: Vec<f64>,
    /// What changed at the rim, whose shapes are left out.
    changed: Vec<Cause>,
    /// What says nothing of touches: drift, and those shapes.
    left_out: Basis,
    /// What drifts.
    drifting: Drifting,
    /// The same with its weighted shapes.
    known: KnownCauses,
    /// For pictures.
    pub(crate) pictures: Pictures,
    /// Onto the problem's rows.
    pub(crate) projector: Projector,
    /// Reduced responses to touches; made when a frame first needs them.
    pub(crate) tables: Option<Tables>,
    /// What tells wild values; made when a frame first needs it.
    unreached: Option<Unreached>,
}

/// What pictures are solved with.
pub(crate) struct Pictures {
    /// The problem, with columns scaled by `prior`.
    pub(crate) problem: Problem,
    /// Expected rise of every cell over [`ReconstructorOptions::expected_rise`].
    pub(crate) prior: DVector<f64>,
    /// The part of the problem that the solve uses, and the ridge that it was made for.
    pub(crate) solving: Option<(f64, Problem)>,
    /// Solves for pictures, each from the one before.
    pub(crate) nnls: Nnls,
    /// The last two for pictures that no touches are looked for in: where touches begin does not depend on who wants to see one.
    shown: Option<Box<Shown>>,
}

/// What such pictures are solved with.
struct Shown {
    solving: Option<(f64, Problem)>,
    nnls: Nnls,
}

/// Reduced responses.
pub(crate) struct Tables {
    /// To touches.
    pub(crate) touches: ResponseTable,
    /// Of what is left out; none where the method knows of no drift.
    pub(crate) nuisances: Option<Nuisances>,
    /// To slips of electrodes, and leaks; none where contacts are not looked for.
    pub(crate) rim: Vec<RimShape>,
}

impl Weighted {
    fn new(
        whole: &mut Whole,
        imager: &Imager,
        options: &ReconstructorOptions,
        drift: Option<&DriftShapes>,
        contacts: Option<&mut Contacts>,
        difference: &Difference,
        (drifting, changed): (Drifting, &[Cause]),
    ) -> Self {
        let mut left_out = Basis::default();
        let drift = drift.filter(|_| is_ridged(options));
        if let Some(drift) = drift {
            drift.add_to(drifting, &mut left_out, |k| weight(difference, k));
        }
        let mut known = KnownCauses::default();
        if let Some(contacts) = contacts {
            for cause in changed {
                if let Some(shapes) = contacts.shapes(imager, *cause) {
                    match cause {
                        Cause::Contact(electrode) => known.contacts.push(*electrode),
                        Cause::Leak(pair) => known
                            .leaks
                            .push((*pair, known.shapes.len() / difference.used.len().max(1))),
                    }
                    let shapes = weighed(shapes, &difference.used, &difference.spread);
                    shapes.column_iter().for_each(|c| left_out.add(c.as_slice()));
                    known.shapes.extend_from_slice(shapes.as_slice());
                }
            }
        }
        let leave_out = |columns: &mut DMatrix<f64>| {
            for (mut row, _) in columns.row_iter_mut().zip(&difference.used).filter(|(_, used)| !**used) {
                row.fill(0.0);
            }
            left_out.outside_all(columns);
        };
        let weights: Vec<f64> = (0..difference.used.len()).map(|k| weight(difference, k)).collect();
        let prior = prior(&imager.sensitivity, &weights, options);
        let problem = whole.with(&prior).problem(leave_out, options.drop);
        Self {
            used: difference.used.clone(),
            spread: difference.spread.clone(),
            changed: changed.to_vec(),
            left_out,
            drifting,
            known,
            projector: Projector::new(&problem, problem.rank()),
            pictures: Pictures {
                problem,
                prior,
                solving: None,
                nnls: Nnls::new(NnlsOptions {
                    ridge: 1.0,
                    tolerance: options.tolerance,
                    most_steps: options.most_steps,
                })
                // Where the noise is small beside what the picture leaves, it is as exact as rounding lets it be: more takes seconds.
                .with_rounding(true),
                shown: None,
            },
            tables: None,
            unreached: None,
        }
    }

    fn is_for(&self, difference: &Difference, (drifting, changed): (Drifting, &[Cause])) -> bool {
        self.used == difference.used
            && self.spread == difference.spread
            && self.drifting == drifting
            && self.changed == changed
    }

    /// Weight of value k: 0 where it takes no part.
    pub(crate) fn weight(&self, k: usize) -> f64 {
        if self.used[k] { 1.0 / self.spread[k] } else { 0.0 }
    }

    /// How many directions say nothing of touches.
    pub(crate) fn directions(&self) -> usize {
        self.left_out.columns().len() / self.used.len().max(1)
    }

    /// Weighs values, V of the model, without what says nothing of touches. Those that take no part are 0.
    pub(crate) fn outside(&self, values: &mut [f64]) {
        for (k, value) in values.iter_mut().enumerate() {
            *value *= self.weight(k);
        }
        self.left_out.outside(values);
    }

    /// What neither touches nor drift reach: all but the drift, and the directions of the largest singular values (a part `reached`).
    pub(crate) fn unreached(&mut self, reached: usize) -> &Unreached {
        self.unreached.get_or_insert_with(|| {
            let values = self.used.len();
            let problem = &self.pictures.problem;
            let basis = (0..reached.min(problem.rank())).map(|k| problem.direction(k));
            Unreached::outside(&self.used, self.left_out.columns().chunks(values).chain(basis))
        })
    }

    /// Weighs a difference into `values`, without what says nothing of touches, and reduces it into `reduced`.
    pub(crate) fn reduce(&mut self, difference: &Difference, values: &mut Vec<f64>, reduced: &mut Vec<f64>) {
        values.clear();
        values.extend(difference.y.iter().zip(&difference.spread).map(|(y, s)| y / s));
        self.left_out.outside(values);
        reduced.clear();
        reduced.extend_from_slice(self.projector.project(|to| to[..values.len()].copy_from_slice(values)));
    }

    /// Reduces the responses to touches, once: all `at_once`, or most when a touch first comes near.
    pub(crate) fn tabulate(
        &mut self,
        fitter: &Fitter,
        drift: Option<&DriftShapes>,
        contacts: Option<(&Contacts, &Imager)>,
        at_once: bool,
    ) {
        if self.tables.is_none() {
            let weights: Vec<f64> = (0..self.used.len()).map(|k| self.weight(k)).collect();
            let directions = self.left_out.columns();
            let left_out = (self.drifting, &self.known);
            let nuisances = |d| Nuisances::new(d, left_out, directions, &weights, (fitter.volts(), at_once));
            let reduction = self.pictures.problem.reduction(&weights);
            self.tables = Some(Tables {
                rim: contacts.map_or_else(Vec::new, |(contacts, imager)| contacts.rim_shapes(imager, &reduction)),
                touches: fitter.volts().reduced(&reduction, at_once),
                nuisances: drift
                    .filter(|_| self.drifting != Drifting::Nothing && !directions.is_empty())
                    .map(nuisances),
            });
        }
    }
}

impl Pictures {
    /// Makes a picture that no touches are looked for in.
    pub(crate) fn beside<R>(&mut self, make: impl FnOnce(&mut Self) -> R) -> R {
        let mut shown = self.shown.take().unwrap_or_else(|| {
            Box::new(Shown {
                solving: None,
                nnls: self.nnls.anew(),
            })
        });
        let mut exchange = |pictures: &mut Self| {
            std::mem::swap(&mut pictures.solving, &mut shown.solving);
            std::mem::swap(&mut pictures.nnls, &mut shown.nnls);
        };
        exchange(self);
        let made = make(self);
        exchange(self);
        self.shown = Some(shown);
        made
    }

    /// Starts the next picture without the last one.
    fn forget(&mut self) {
        self.nnls.reset();
        if let Some(shown) = &mut self.shown {
            shown.nnls.reset();
        }
    }

    /// Makes the part of the problem ready that a solve with this ridge uses: without directions below a part of it. One that was made
    /// for a ridge about as large serves as well. Which one does not depend on earlier frames where each stands `alone`.
    pub(crate) fn prepare(&mut self, ridge: f64, drop_below_ridge: f64, alone: bool) {
        let fraction = drop_below_ridge * ridge / self.problem.singular().max();
        let serves = match &self.solving {
            Some((_, known)) if alone => known.rank() == self.problem.rank_without(fraction),
            // A ridge estimated from frame after frame scatters; a larger one loses less by what is left out, not more.
            Some((made_for, _)) => (0.5..8.0).contains(&(ridge / made_for)),
            None => false,
        };
        if !serves {
            self.solving = Some((ridge, self.problem.without(fraction)));
        }
    }

    /// Makes a solution of the scaled problem relative rises.
    pub(crate) fn scale(&self, x: &mut [f64]) {
        x.iter_mut().zip(&self.prior).for_each(|(x, prior)| *x *= prior);
    }
}

fn weight(difference: &Difference, k: usize) -> f64 {
    if difference.used[k] {
        1.0 / difference.spread[k]
    } else {
        0.0
    }
}

/// Volts of the model (a frame in each column) over the spread of the values, 0 for those that are not used.
fn weighed(volts: &DMatrix<f64>, used: &[bool], spread: &[f64]) -> DMatrix<f64> {
    DMatrix::from_fn(volts.nrows(), volts.ncols(), |k, c| {
        if used[k] { volts[(k, c)] / spread[k] } else { 0.0 }
    })
}

/// How many problems of tables are kept: for five ways to drift, with all values and without those of an electrode, and for two with a
/// contact. Where that electrode is open in every frame, each frame needs the first ten.
const MOST_KEPT: usize = 12;

/// The same of a sequence, in which it is left out once it is known: for every way to drift, and for one with a contact.
const MOST_KEPT_OF_SEQUENCE: usize = 6;

/// The same of frames with many values, in which nothing rare is looked for: a problem takes 200 MB.
const MOST_KEPT_OF_MANY: usize = 2;

fn most_kept(imager: &Imager, options: &ReconstructorOptions) -> usize {
    match (imager.is_searched(), options.sequence) {
        (true, false) => MOST_KEPT,
        (true, true) => MOST_KEPT_OF_SEQUENCE,
        (false, _) => MOST_KEPT_OF_MANY,
    }
}

/// The problems used last, the last first.
#[derive(Default)]
pub(crate) struct Weightings {
    whole: Option<Whole>,
    kept: ArrayVec<Weighted, MOST_KEPT>,
}

impl Weightings {
    /// The problem in use.
    pub(crate) fn current(&self) -> Option<&Weighted> {
        self.kept.first()
    }

    /// The problem in use, to be changed.
    pub(crate) fn current_mut(&mut self) -> Option<&mut Weighted> {
        self.kept.first_mut()
    }

    /// Starts the next picture of every problem without the last one.
    pub(crate) fn forget(&mut self) {
        self.kept.iter_mut().for_each(|weighted| weighted.pictures.forget());
    }

    /// Makes the problem for the values of a difference the one in use. How many were made anew for that: 0 or 1.
    pub(crate) fn switch(
        &mut self,
        imager: &Imager,
        options: &ReconstructorOptions,
        drift: Option<&DriftShapes>,
        contacts: Option<&mut Contacts>,
        difference: &Difference,
        left_out: (Drifting, &[Cause]),
    ) -> usize {
        match self.kept.iter().position(|w| w.is_for(difference, left_out)) {
            Some(place) => {
                self.kept[..=place].rotate_right(1);
                0
            }
            None => {
                self.kept.truncate(most_kept(imager, options) - 1);
                let whole = self.whole.take().filter(|whole| whole.spread == difference.spread);
                let mut whole = whole.unwrap_or_else(|| Whole::new(imager, options, &difference.spread));
                let new = Weighted::new(&mut whole, imager, options, drift, contacts, difference, left_out);
                self.whole = Some(whole);
                self.kept.insert(0, new);
                1
            }
        }
    }
}
