//! The response of every measurement to a press, as a map over the sheet, from presses at known places.
//!
//! `y_c = f_c(q) + h_c(q') + noise`: f_c is the map of a measurement, h_c what the press before at q' left behind. Beforehand the maps of an
//! orbit, each turned back with its electrodes, are alike: their covariance depends on by how much they are turned against one
//! another. How alike is told by the presses. A mean that all share, slow changes around the sheet as of a material with a direction or of a
//! ring that is not quite in the middle, and what each has of its own are the terms of one Fourier series.
//!
//! A sum over an orbit with the phases of that series makes of the maps independent ones, so that the posterior is a small linear system for
//! each term. The variances of the terms, of the memory and of the noise have the largest evidence (Dempster, Laird and Rubin 1977). What
//! lies far outside is drawn in before each of a few repetitions (Huber's pseudo-values).

use super::disc::Disc;
use super::orbits::Orbits;
use crate::stats::median;
use nalgebra::{Cholesky, Complex, DMatrix, DVector, DVectorView, Dyn, SymmetricEigen};
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, SQRT_2, TAU};

/// Repetitions of the fit, and of the search for the prior's variances.
const REPETITIONS: usize = 3;
const STEPS: usize = 10;
/// Values beyond this many root mean squares of their orbit are drawn in.
const LARGEST: f64 = 6.0;
/// Residuals beyond this many standard deviations are drawn in (Huber 1981).
const HUBER: f64 = 3.0;
/// Least variance of anything: what no number of presses makes better.
const LEAST: f64 = 1e-4;
/// Length over which maps change, over the reach of the presses.
const LENGTH: f64 = 0.75;
/// Radius of the disc of the harmonics, over the reach of the presses, and their highest wave number over its inverse.
const RADIUS: f64 = 1.75;
const HIGHEST: f64 = 16.0;
/// Presses nearer than this part of the reach are one.
const NEAR: f64 = 0.22;

type Matrix = DMatrix<Complex<f64>>;

/// What is expected of the maps before any press. Variances are over the mean square of the values of an orbit.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Prior {
    /// Of the terms of the series around the orbit: what all share, then what changes once around, twice, and so on.
    ring: Vec<f64>,
    /// Of the memory of the press before.
    pub(super) memory: f64,
    /// Of the noise.
    noise: f64,
}

impl Prior {
    /// Before anything is known of it: maps are alike; what differs changes slowly around the sheet, or is of each alone.
    pub(super) fn new(turns: usize) -> Self {
        let term = |m: usize| {
            let slow = if m == 0 { 1.25 } else { 0.06 / (m * m) as f64 };
            0.25 + turns as f64 * slow
        };
        Self {
            ring: (0..=turns / 2).map(term).collect(),
            memory: 0.1,
            noise: 0.1,
        }
    }
}

/// Where the presses are, and how the electrodes go round.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Frame {
    /// Around what the sheet is turned.
    pub(super) centre_mm: [f64; 2],
    /// Distance of the farthest press from it.
    pub(super) reach_mm: f64,
    /// Whether the electrodes' numbers go round clockwise.
    pub(super) clockwise: bool,
}

impl Frame {
    fn disc(&self) -> Disc {
        Disc::new(self.centre_mm, RADIUS * self.reach_mm, HIGHEST)
    }
}

/// Presses to learn from: their places, for each the place of the one before, and a row of changes for each.
#[derive(Clone, Debug)]
pub(super) struct Presses {
    pub(super) places_mm: Vec<[f64; 2]>,
    pub(super) before_mm: Vec<Option<[f64; 2]>>,
    /// Presses x measurements; not a number where a value is missing.
    pub(super) changes: DMatrix<f64>,
}

impl Presses {
    /// Some of them, by their numbers.
    pub(super) fn select(&self, rows: &[usize]) -> Self {
        Self {
            places_mm: rows.iter().map(|k| self.places_mm[*k]).collect(),
            before_mm: rows.iter().map(|k| self.before_mm[*k]).collect(),
            changes: self.changes.select_rows(rows),
        }
    }

    /// How many.
    pub(super) fn len(&self) -> usize {
        self.places_mm.len()
    }
}

/// The maps of all measurements. Weights are in the unit of the changes.
#[derive(Clone, Debug)]
pub(super) struct Maps {
    pub(super) frame: Frame,
    /// Presses that they were learned from.
    presses: usize,
    pub(super) orbits: Orbits,
    /// Root mean square of the values of every measurement's orbit.
    pub(super) scale: Vec<f64>,
    /// Noise variance over the square of the scale.
    pub(super) noise: f64,
    disc: Disc,
    /// Weights of the maps, harmonics x measurements, over the scale.
    weights: DMatrix<f64>,
    /// The same of the memory.
    memory: DMatrix<f64>,
    /// Covariance of the weights that the presses leave, as a mean over an orbit, over the noise's variance.
    spread: DMatrix<f64>,
}

/// Maps as numbers, for a file. A matrix is a list of its columns.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StoredMaps {
    /// Presses that they were learned from.
    pub presses: usize,
    /// What the sheet is turned around, mm.
    pub centre_mm: [f64; 2],
    /// Farthest place from it, mm.
    pub reach_mm: f64,
    /// Whether the electrodes' numbers go round clockwise.
    pub clockwise: bool,
    /// Root mean square of the changes of every measurement's orbit.
    pub scale: Vec<f64>,
    /// Weights of the maps: for every measurement those of the harmonics, over the scale.
    pub weights: Vec<Vec<f64>>,
    /// The same for the memory of the press before.
    pub memory: Vec<Vec<f64>>,
    /// Covariance of the weights that the presses leave, over the noise's variance.
    pub spread: Vec<Vec<f64>>,
}

pub(super) fn columns(matrix: &DMatrix<f64>) -> Vec<Vec<f64>> {
    matrix.column_iter().map(|c| c.iter().copied().collect()).collect()
}

/// `None` where the columns do not have these lengths, or hold what is no number.
pub(super) fn matrix(columns: &[Vec<f64>], rows: usize, count: usize) -> Option<DMatrix<f64>> {
    let fits = columns.len() == count
        && columns
            .iter()
            .all(|c| c.len() == rows && c.iter().all(|v| v.is_finite()));
    fits.then(|| DMatrix::from_iterator(rows, count, columns.iter().flatten().copied()))
}

/// `None` where a number is not finite, of which the algorithm would not end.
pub(super) fn symmetric_eigen(matrix: DMatrix<f64>) -> Option<SymmetricEigen<f64, Dyn>> {
    matrix.iter().all(|v| v.is_finite()).then(|| matrix.symmetric_eigen())
}

/// Root mean square of values, those far outside drawn in; what is not a number does not count.
fn drawn_in_rms(values: &[f64]) -> f64 {
    let finite = || values.iter().filter(|v| v.is_finite());
    let count = finite().count().max(1) as f64;
    let mut rms = (finite().map(|v| v * v).sum::<f64>() / count).sqrt();
    for _ in 0..5 {
        let limit = HUBER * rms;
        rms = (finite().map(|v| v.clamp(-limit, limit).powi(2)).sum::<f64>() / count).sqrt();
    }
    rms
}

/// Places x harmonics; nothing where there is no place.
fn features(disc: &Disc, clockwise: bool, places: impl Iterator<Item = Option<[f64; 2]>>) -> DMatrix<f64> {
    let columns: Vec<DVector<f64>> = places
        .map(|place| {
            let mut column = DVector::zeros(disc.len());
            if let Some(place) = place {
                disc.values_at(place, clockwise, column.as_mut_slice());
            }
            column
        })
        .collect();
    DMatrix::from_columns(&columns).transpose()
}

/// The presses as the harmonics see them.
struct Design {
    /// Presses x harmonics: of the places, and beside them of those of the presses before.
    real: DMatrix<f64>,
    /// The same with `exp(i n φ)` and `exp(-i n φ)` for cosine and sine of every order.
    turning: Matrix,
    /// Products of its columns, where there are more presses than columns.
    square: Option<Matrix>,
    /// Signed orders of its columns.
    orders: Vec<i32>,
    /// Variances of the weights of a process of variance one.
    variances: Vec<f64>,
    turns: usize,
}

/// What follows of one term of the sum over an orbit.
struct Term {
    /// Harmonics of both kinds x presses: what makes weights of values.
    gain: Matrix,
    prior: Vec<f64>,
    /// By how much the value of every press counts in what is said of it.
    leverage: Vec<f64>,
    /// How many terms it stands for: that of the opposite sense is its conjugate.
    counts: f64,
}

impl Design {
    fn new(presses: &Presses, frame: Frame, disc: &Disc, orbits: &Orbits) -> Self {
        let of = |places: Vec<Option<[f64; 2]>>| features(disc, frame.clockwise, places.into_iter());
        let (here, before) = (
            of(presses.places_mm.iter().map(|p| Some(*p)).collect()),
            of(presses.before_mm.clone()),
        );
        let size = disc.len();
        let mut real = DMatrix::zeros(presses.len(), 2 * size);
        real.columns_mut(0, size).copy_from(&here);
        real.columns_mut(size, size).copy_from(&before);
        let orders: Vec<i32> = disc.modes().iter().chain(disc.modes()).map(|m| m.order).collect();
        let turning = Matrix::from_fn(real.nrows(), real.ncols(), |k, p| match orders[p].signum() {
            1 => Complex::new(real[(k, p)], real[(k, p + 1)]) / SQRT_2,
            -1 => Complex::new(real[(k, p - 1)], -real[(k, p)]) / SQRT_2,
            _ => real[(k, p)].into(),
        });
        Self {
            square: (turning.nrows() > turning.ncols()).then(|| turning.adjoint() * &turning),
            variances: disc.matern(LENGTH * frame.reach_mm),
            turns: orbits.turns,
            real,
            turning,
            orders,
        }
    }

    fn size(&self) -> usize {
        self.variances.len()
    }

    /// Place in the series around the orbit of one of the harmonics in one of the sums.
    fn ring(&self, term: usize, order: i32) -> usize {
        let m = (term as i32 + order).rem_euclid(self.turns as i32) as usize;
        m.min(self.turns - m)
    }

    /// The terms up to half of the turns; the others are their conjugates.
    fn terms(&self, prior: &Prior) -> Option<Vec<Term>> {
        (0..=self.turns / 2).map(|t| self.term(t, prior)).collect()
    }

    fn term(&self, term: usize, prior: &Prior) -> Option<Term> {
        let size = self.size();
        let variance = |p: usize| {
            let whole = if p < size {
                prior.ring[self.ring(term, self.orders[p])]
            } else {
                prior.memory
            };
            whole * self.variances[p % size]
        };
        let variances: Vec<f64> = (0..2 * size).map(variance).collect();
        let scaled_adjoint = || {
            let mut out = self.turning.adjoint();
            for (mut row, v) in out.row_iter_mut().zip(&variances) {
                row *= Complex::from(*v);
            }
            out
        };
        let gain = if let Some(square) = &self.square {
            let roots: Vec<f64> = variances.iter().map(|v| v.sqrt()).collect();
            let mut normal = square.map_with_location(|i, j, v| v * (roots[i] * roots[j]));
            (0..2 * size).for_each(|p| normal[(p, p)] += prior.noise);
            let mut right = self.turning.adjoint();
            for (mut row, root) in right.row_iter_mut().zip(&roots) {
                row *= Complex::from(*root);
            }
            let factor = Cholesky::new(normal)?;
            let mut out = factor.solve(&right);
            for (mut row, root) in out.row_iter_mut().zip(&roots) {
                row *= Complex::from(*root);
            }
            out
        } else {
            let right = scaled_adjoint();
            let mut normal = &self.turning * &right;
            (0..normal.nrows()).for_each(|k| normal[(k, k)] += prior.noise);
            let factor = Cholesky::new(normal)?;
            factor.solve(&right.adjoint()).adjoint()
        };
        let leverage = (self.turning.row_iter().zip(gain.column_iter()))
            .map(|(row, column)| row.iter().zip(&column).map(|(r, g)| (r * g).re).sum())
            .collect();
        Some(Term {
            gain,
            prior: variances,
            leverage,
            counts: if term == 0 || 2 * term == self.turns { 1.0 } else { 2.0 },
        })
    }

    /// The sum over every orbit with the phases of a term: presses x orbits.
    fn summed(&self, slots: &DMatrix<f64>, term: usize) -> Matrix {
        let turns = self.turns;
        Matrix::from_fn(slots.nrows(), slots.ncols() / turns, |k, o| {
            (0..turns)
                .map(|t| self.phase(term, t).conj() * slots[(k, o * turns + t)])
                .sum::<Complex<f64>>()
        })
    }

    /// Over the root of the turns, so that sums of independent values have the variance of each.
    fn phase(&self, term: usize, turn: usize) -> Complex<f64> {
        let angle = TAU * (term * turn % self.turns) as f64 / self.turns as f64;
        Complex::from_polar((self.turns as f64).sqrt().recip(), angle)
    }

    /// Weights of all maps of the orbits, harmonics of both kinds x slots, from those of the sums.
    fn weights(&self, terms: &[(Matrix, f64)]) -> DMatrix<f64> {
        let (turns, orbits) = (self.turns, terms.first().map_or(0, |(w, _)| w.ncols()));
        let mut out = DMatrix::zeros(self.orders.len(), orbits * turns);
        for (term, (weights, counts)) in terms.iter().enumerate() {
            for t in 0..turns {
                let phase = self.phase(term, t);
                for o in 0..orbits {
                    let mut column = out.column_mut(o * turns + t);
                    for (p, order) in self.orders.iter().enumerate().filter(|(_, order)| **order >= 0) {
                        let mut weight = phase * weights[(p, o)];
                        let (next, single) = (p + usize::from(*order > 0), *counts < 1.5);
                        if !single {
                            weight += (phase * weights[(next, o)]).conj();
                        }
                        if *order == 0 {
                            column[p] += weight.re;
                        } else {
                            column[p] += SQRT_2 * weight.re;
                            column[next] -= SQRT_2 * weight.im;
                        }
                    }
                }
            }
        }
        out
    }

    /// Covariance of the weights of a map that the presses leave, as a mean over an orbit, in the real harmonics.
    fn spread(&self, terms: &[Term]) -> DMatrix<f64> {
        let size = self.size();
        let mut mean = Matrix::zeros(size, size);
        for term in terms {
            let mut told = self.turning.columns(0, size).into_owned();
            for (mut column, v) in told.column_iter_mut().zip(&term.prior) {
                column *= Complex::from(*v);
            }
            let weight = term.counts / self.turns as f64;
            mean -= term.gain.rows(0, size) * told * Complex::from(weight);
            (0..size).for_each(|p| mean[(p, p)] += weight * term.prior[p]);
        }
        let to_real = Matrix::from_fn(size, size, |p, q| match self.orders[p].signum() {
            1 if q == p => Complex::new(1.0 / SQRT_2, 0.0),
            1 if q == p + 1 => Complex::new(0.0, 1.0 / SQRT_2),
            -1 if q + 1 == p => Complex::new(1.0 / SQRT_2, 0.0),
            -1 if q == p => Complex::new(0.0, -1.0 / SQRT_2),
            0 if q == p => Complex::new(1.0, 0.0),
            _ => Complex::new(0.0, 0.0),
        });
        let real = (to_real.transpose() * mean * to_real.conjugate()).map(|v| v.re);
        (&real + real.transpose()) * 0.5
    }
}

/// A list of presses as orbits have them: presses x (orbits x turns), over the scale; not a number where there is none.
fn in_slots(presses: &Presses, orbits: &Orbits, scale: &[f64]) -> DMatrix<f64> {
    let turns = orbits.turns;
    DMatrix::from_fn(presses.len(), orbits.count * turns, |k, slot| {
        let there = &orbits.slots[slot / turns][slot % turns];
        let value = |(c, negative): &(usize, bool)| {
            let v = (presses.changes[(k, *c)] / scale[*c]).clamp(-LARGEST, LARGEST);
            if *negative { -v } else { v }
        };
        // A mean of none is no number.
        there.iter().map(value).sum::<f64>() / there.len() as f64
    })
}

/// One fit of all maps with a prior.
struct Fit {
    terms: Vec<Term>,
    /// Weights of the sums.
    sums: Vec<(Matrix, f64)>,
    /// Of the maps: harmonics of both kinds x slots.
    weights: DMatrix<f64>,
    /// Mean square of what is left, and by how much more it is than if nothing had been learned of it.
    left: f64,
}

impl Fit {
    fn new(
        design: &Design,
        values: &DMatrix<f64>,
        drawn_in: &mut DMatrix<f64>,
        prior: &Prior,
        repetitions: usize,
    ) -> Option<Self> {
        let terms = design.terms(prior)?;
        let leverage = (0..values.nrows()).map(|k| {
            let sum: f64 = terms.iter().map(|t| t.counts * t.leverage[k]).sum();
            sum / design.turns as f64
        });
        let leverage = leverage.sum::<f64>() / values.nrows() as f64;
        let mut fit = Self {
            sums: Vec::new(),
            weights: DMatrix::zeros(0, 0),
            left: 0.0,
            terms,
        };
        for _ in 0..repetitions {
            let sum = |(t, term): (usize, &Term)| (&term.gain * design.summed(drawn_in, t), term.counts);
            fit.sums = fit.terms.iter().enumerate().map(sum).collect();
            fit.weights = design.weights(&fit.sums);
            let fitted = &design.real * &fit.weights;
            let freedom = (1.0 - leverage).max(0.15);
            let (mut square, mut count) = (0.0, 0.0);
            for (slot, column) in values.column_iter().enumerate() {
                let left = |k: usize| column[k] - fitted[(k, slot)];
                let limit = HUBER * prior.noise.sqrt();
                let finite = || (0..column.len()).map(left).filter(|r| r.is_finite());
                let there = finite().count() as f64;
                let sum: f64 = finite().map(|r| r.clamp(-limit, limit).powi(2)).sum();
                let limit = HUBER * (sum / (freedom * there.max(1.0))).max(LEAST).sqrt();
                for k in 0..column.len() {
                    let r = if left(k).is_finite() {
                        left(k).clamp(-limit, limit)
                    } else {
                        0.0
                    };
                    drawn_in[(k, slot)] = fitted[(k, slot)] + r;
                    square += r * r;
                }
                count += there;
            }
            fit.left = square / count.max(1.0) + prior.noise * leverage;
        }
        Some(fit)
    }

    /// A prior of more evidence: each variance is the mean square that the posterior expects.
    fn better(&self, design: &Design, prior: &Prior) -> Prior {
        let size = design.size();
        let orbits = self.sums.first().map_or(0, |(w, _)| w.ncols()) as f64;
        let mut ring = vec![(0.0, 0.0); prior.ring.len()];
        let mut memory = (0.0, 0.0);
        for (t, (term, (weights, counts))) in self.terms.iter().zip(&self.sums).enumerate() {
            for p in 0..2 * size {
                let told: f64 = (term.gain.row(p).iter().zip(&design.turning.column(p)))
                    .map(|(g, x)| (g * x).re)
                    .sum();
                let square: f64 = weights.row(p).iter().map(|w| w.norm_sqr()).sum();
                let expected = counts * (square + orbits * term.prior[p] * (1.0 - told)) / design.variances[p % size];
                let sum = if p < size {
                    &mut ring[design.ring(t, design.orders[p])]
                } else {
                    &mut memory
                };
                sum.0 += expected;
                sum.1 += counts * orbits;
            }
        }
        let mean = |(sum, count): (f64, f64)| (sum / count).max(LEAST);
        Prior {
            ring: ring.into_iter().map(mean).collect(),
            memory: mean(memory),
            noise: self.left.max(LEAST),
        }
    }
}

impl Maps {
    /// The prior of the largest evidence, near enough. `None` where the presses are beyond what can be computed with.
    pub(super) fn prior(presses: &Presses, frame: Frame, orbits: &Orbits) -> Option<Prior> {
        let design = Design::new(presses, frame, &frame.disc(), orbits);
        let values = in_slots(presses, orbits, &scales(&presses.changes, orbits));
        let mut drawn_in = values.map(|v| if v.is_finite() { v } else { 0.0 });
        let mut prior = Prior::new(orbits.turns);
        for _ in 0..STEPS {
            prior = Fit::new(&design, &values, &mut drawn_in, &prior, 1)?.better(&design, &prior);
        }
        Some(prior)
    }

    /// Learns the maps. `None` where the presses say nothing that could be solved for.
    pub(super) fn fit(presses: &Presses, frame: Frame, prior: &Prior, orbits: &Orbits) -> Option<Self> {
        let disc = frame.disc();
        let design = Design::new(presses, frame, &disc, orbits);
        let scale = scales(&presses.changes, orbits);
        let values = in_slots(presses, orbits, &scale);
        let mut drawn_in = values.map(|v| if v.is_finite() { v } else { 0.0 });
        let fit = Fit::new(&design, &values, &mut drawn_in, prior, REPETITIONS)?;
        let slots: Vec<usize> = orbits.members.iter().map(|m| orbits.slot(m)).collect();
        let of_measurements = fit.weights.select_columns(&slots);
        let size = disc.len();
        Some(Self {
            frame,
            presses: presses.len(),
            orbits: orbits.clone(),
            scale,
            noise: prior.noise,
            weights: of_measurements.rows(0, size).into_owned(),
            memory: of_measurements.rows(size, size).into_owned(),
            spread: design.spread(&fit.terms) / prior.noise,
            disc,
        })
    }

    fn features(&self, places: impl Iterator<Item = Option<[f64; 2]>>) -> DMatrix<f64> {
        features(&self.disc, self.frame.clockwise, places)
    }

    /// The change of every measurement by a press of the usual strength at each of some places: measurements x places.
    pub(super) fn at(&self, places_mm: &[[f64; 2]]) -> DMatrix<f64> {
        let mut out = self
            .weights
            .tr_mul(&self.features(places_mm.iter().map(|p| Some(*p))).transpose());
        for mut column in out.column_iter_mut() {
            self.put_in_units(column.as_mut_slice());
        }
        out
    }

    /// What a press there leaves behind for the next one.
    pub(super) fn memory_of(&self, place_mm: Option<[f64; 2]>) -> DVector<f64> {
        let Some(place) = place_mm else {
            return DVector::zeros(self.scale.len());
        };
        let mut there = DVector::zeros(self.disc.len());
        self.disc.values_at(place, self.frame.clockwise, there.as_mut_slice());
        let mut left = self.memory.tr_mul(&there);
        self.put_in_units(left.as_mut_slice());
        left
    }

    /// Distance below which maps cannot tell two presses from one between them, mm: a part of the length over which they change, or
    /// the distance from one known press to the next, where that is farther.
    pub(super) fn near_mm(&self) -> f64 {
        self.frame.reach_mm * (PI / self.presses as f64).sqrt().max(NEAR)
    }

    /// Variance of the maps at some places, over the noise's.
    pub(super) fn uncertainty(&self, places_mm: &[[f64; 2]]) -> Vec<f64> {
        let there = self.features(places_mm.iter().map(|p| Some(*p)));
        let along = &there * &self.spread;
        (along.row_iter().zip(there.row_iter()))
            .map(|(a, t)| a.dot(&t).max(0.0))
            .collect()
    }

    /// Gain of every measurement: its map, turned back, along the mean of its orbit, over that mean.
    pub(super) fn gains(&self) -> Vec<f64> {
        let turns = self.orbits.turns;
        let turned_back = |c: usize| {
            let member = self.orbits.members[c];
            let angle = TAU * (self.orbits.slot(&member) % turns) as f64 / turns as f64;
            let mut out = self.weights.column(c).into_owned();
            for (p, mode) in self.disc.modes().iter().enumerate().filter(|(_, m)| m.order > 0) {
                let (sin, cos) = (f64::from(mode.order) * angle).sin_cos();
                let [a, b] = [out[p], out[p + 1]];
                (out[p], out[p + 1]) = (cos * a + sin * b, cos * b - sin * a);
            }
            out
        };
        let mut gains = vec![1.0; self.scale.len()];
        for list in self.orbits.lists() {
            let maps: Vec<DVector<f64>> = list.iter().map(|c| turned_back(*c)).collect();
            let mean = maps.iter().fold(DVector::zeros(self.disc.len()), |sum, m| sum + m) / maps.len() as f64;
            for (c, map) in list.iter().zip(&maps) {
                gains[*c] = map.dot(&mean) / mean.norm_squared().max(f64::MIN_POSITIVE);
            }
        }
        gains
    }

    /// The numbers that make them.
    pub(super) fn stored(&self) -> StoredMaps {
        StoredMaps {
            presses: self.presses,
            centre_mm: self.frame.centre_mm,
            reach_mm: self.frame.reach_mm,
            clockwise: self.frame.clockwise,
            scale: self.scale.clone(),
            weights: columns(&self.weights),
            memory: columns(&self.memory),
            spread: columns(&self.spread),
        }
    }

    /// Maps of such numbers. `None` where their lengths do not fit one another.
    pub(super) fn restore(stored: &StoredMaps, orbits: Orbits) -> Option<Self> {
        let frame = Frame {
            centre_mm: stored.centre_mm,
            reach_mm: stored.reach_mm,
            clockwise: stored.clockwise,
        };
        // Squares of what is in the frames' unit are numbers too.
        let positive = |v: &f64| (1e-150..=1e150).contains(v);
        let weights = [&stored.weights, &stored.memory, &stored.spread];
        let small = |v: &f64| v.abs() <= 1e24;
        // As long as a sheet may be.
        let sound = (1e-3..=1e6).contains(&stored.reach_mm)
            && stored.centre_mm.iter().all(|v| v.abs() <= 1e6)
            && stored.scale.iter().all(positive)
            && weights.into_iter().flatten().flatten().all(small);
        let disc = sound.then(|| frame.disc())?;
        let (size, channels) = (disc.len(), orbits.members.len());
        (stored.scale.len() == channels).then_some(())?;
        Some(Self {
            frame,
            presses: stored.presses.max(1),
            scale: stored.scale.clone(),
            noise: Prior::new(1).noise,
            weights: matrix(&stored.weights, size, channels)?,
            memory: matrix(&stored.memory, size, channels)?,
            spread: matrix(&stored.spread, size, size)?,
            disc,
            orbits,
        })
    }

    fn put_in_units(&self, values: &mut [f64]) {
        for ((v, scale), member) in values.iter_mut().zip(&self.scale).zip(&self.orbits.members) {
            *v *= if member.negative { -scale } else { *scale };
        }
    }
}

/// Root mean square of every orbit, for each of its measurements.
fn scales(changes: &DMatrix<f64>, orbits: &Orbits) -> Vec<f64> {
    let mut scale = vec![0.0; changes.ncols()];
    for list in orbits.lists() {
        let columns: Vec<DVectorView<'_, f64>> = list.iter().map(|c| changes.column(*c)).collect();
        let values: Vec<f64> = columns.iter().flat_map(|c| c.iter().copied()).collect();
        let rms = drawn_in_rms(&values).max(f64::MIN_POSITIVE);
        list.iter().for_each(|c| scale[*c] = rms);
    }
    scale
}
