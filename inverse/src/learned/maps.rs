//! The response of every measurement to a press, as a map over the sheet, from presses at known places.
//!
//! `y_c = f_c(p) + λ f_c(q') + noise` with `f_c(q) = g_c f_k(R_c q) + r_c(q)`: what the press before at q' left behind is a part of what it
//! did, or it displaces where this one is felt, p. All measurements of an orbit share one map `f_k`, each turned with its electrodes and
//! with a gain `g_c` of its own, as contacts and amplifiers have. A sheet with a grain, as one of stripes, conducts better along it than
//! across: that changes a map with the cosine and the sine of twice the angle by which its electrodes are turned, to first order. The map
//! itself is one of the sheet that the grain's stretch makes even, where `R_c` turns the currents around the rim.
//! `r_c` is what is left of one measurement. All are Gaussian processes, with the covariance of what a rim can feel
//! ([`Sensitivities`]), and so is their posterior, in closed form. What lies far outside is drawn in before each of a few repetitions
//! (Huber's pseudo-values), and each measurement's noise follows from what is left.

mod design;
mod normal;

use self::design::{Design, GRAINED, features, precisions};
use self::normal::{Normal, Turned};
use super::frame::{Frame, MOST_DISPLACED, MOST_STRETCHED};
use super::orbits::Orbits;
use super::sensitivities::Sensitivities;
use crate::stats::median;
use nalgebra::{Complex, DMatrix, DVector, DVectorView, Matrix2};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// Repetitions of the fit.
const REPETITIONS: usize = 3;
/// Values beyond this many root mean squares of their orbit are drawn in.
const LARGEST: f64 = 6.0;
/// Residuals beyond this many standard deviations are drawn in (Huber 1981).
const HUBER: f64 = 3.0;
/// Noise variance of a measurement before anything is known of it, over the mean square of its orbit.
pub(super) const FIRST_NOISE: f64 = 0.1;
/// Least noise variance: what no number of presses makes better.
const LEAST_NOISE: f64 = 1e-4;
/// Presses that the noise of all measurements weighs as, in the noise of one.
const NOISE_WEIGHT: f64 = 8.0;
/// Presses nearer than this part of the reach are one.
const NEAR: f64 = 0.22;
/// Standard deviation of measurements' gains over those of their orbits, before anything is known and at most.
const GAIN_SD: f64 = 0.3;
/// Least variance of the gains: amplifiers agree no better.
const LEAST_GAIN_VARIANCE: f64 = 1e-6;

/// What is expected of the maps before any press. Variances are those in the middle, over the mean square of the values of an orbit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Prior {
    /// Variance of the maps that an orbit shares.
    pub(super) shared: f64,
    /// Variance of how these change with the direction of the drive, twice around; 0 where they do not.
    pub(super) grain: f64,
    /// Variance of what a measurement has of its own.
    pub(super) own: f64,
    /// Part of what the press before did that is in the change of the next.
    pub(super) memory: f64,
    /// Part of the press before's way from the middle by which the middle of the sheet is displaced.
    pub(super) displaced: f64,
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
    /// Noise variance of every measurement, over the square of its scale.
    pub(super) noise: Vec<f64>,
    basis: Sensitivities,
    /// Gain of every measurement over that of its orbit.
    gains: Vec<f64>,
    /// Their variance, as the presses tell it.
    gain_variance: f64,
    /// Weights of the maps over the scale, terms x orbits; below them, where maps change with the direction, those of the cosine and
    /// of the sine of twice the turn.
    shared: DMatrix<f64>,
    /// Terms x measurements.
    own: DMatrix<f64>,
    /// Those of every measurement's whole map.
    weights: DMatrix<f64>,
    /// Part of what the press before did that is in the change of the next.
    pub(super) memory: f64,
    /// Part of the press before's way from the middle by which the middle of the sheet is displaced.
    displaced: f64,
    /// Covariance of the weights of a measurement's own map that the presses leave, over its noise's variance.
    spread: DMatrix<f64>,
}

/// A solution: what it says of the presses along the directions that they see, directions x measurements, and the degrees of freedom
/// that are left of every measurement.
struct Solved {
    along: DMatrix<f64>,
    freedom: Vec<f64>,
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
    /// Radius of the sheet, mm.
    pub radius_mm: f64,
    /// Whether the electrodes' numbers go round clockwise.
    pub clockwise: bool,
    /// Stretch by the sheet's grain, real and imaginary part. Its size is the difference over the sum of the half axes of an even sheet
    /// that responds alike. Its argument is twice the angle of the longer one. It is 0 where there is no grain, and in older files.
    #[serde(default)]
    pub stretch: [f64; 2],
    /// Root mean square of the changes of every measurement's orbit.
    pub scale: Vec<f64>,
    /// Gain of every measurement over that of its orbit.
    pub gains: Vec<f64>,
    /// Weights of the maps that orbits share: for every orbit those of the terms, over the scale. Where maps change with the
    /// direction, those of the cosine and of the sine of twice the turn follow.
    pub shared: Vec<Vec<f64>>,
    /// The same for what every measurement has of its own.
    pub own: Vec<Vec<f64>>,
    /// Part of what the press before did that is in the change of the next.
    pub memory: f64,
    /// Part of the press before's way from the middle by which the middle of the sheet is displaced.
    pub displaced: f64,
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

impl Maps {
    /// Learns the maps. `None` where the presses say nothing that could be solved for.
    pub(super) fn fit(presses: &Presses, frame: Frame, prior: Prior, orbits: &Orbits) -> Option<Self> {
        let (count, channels) = presses.changes.shape();
        let size = Sensitivities::len();
        let shared = precisions(prior).len();
        let mut maps = Self {
            frame,
            presses: count,
            scale: scales(&presses.changes, orbits),
            noise: vec![FIRST_NOISE; channels],
            gains: vec![1.0; channels],
            gain_variance: GAIN_SD * GAIN_SD,
            shared: DMatrix::zeros(shared, orbits.count),
            own: DMatrix::zeros(size, channels),
            weights: DMatrix::zeros(size, channels),
            memory: prior.memory,
            displaced: prior.displaced,
            spread: DMatrix::zeros(size, size),
            basis: frame.basis(),
            orbits: orbits.clone(),
        };
        let design = Design::new(presses, frame, prior, orbits, &maps.basis)?;
        let values = maps.over_scale(&presses.changes);
        let mut drawn_in = values.map(|v| if v.is_finite() { v } else { 0.0 });
        for _ in 0..REPETITIONS {
            let Solved { along, freedom } = maps.solve(&design, &drawn_in)?;
            let fitted = &design.seen * along;
            let mut noise = vec![0.0; channels];
            let middle = median(maps.noise.iter().copied());
            for c in 0..channels {
                let limit = HUBER * maps.noise[c].sqrt();
                let left = |k: usize| values[(k, c)] - fitted[(k, c)];
                let sum: f64 = (0..count)
                    .map(left)
                    .filter(|r| r.is_finite())
                    .map(|r| r.clamp(-limit, limit).powi(2))
                    .sum();
                noise[c] = ((sum + NOISE_WEIGHT * middle) / (freedom[c] + NOISE_WEIGHT)).max(LEAST_NOISE);
                let limit = HUBER * noise[c].sqrt();
                for k in 0..count {
                    let r = if left(k).is_finite() { left(k) } else { 0.0 };
                    drawn_in[(k, c)] = fitted[(k, c)] + r.clamp(-limit, limit);
                }
            }
            maps.noise = noise;
        }
        let middle = median(maps.noise.iter().copied());
        // What the presses tell of the prior's directions is taken off.
        let mut told = design.terms;
        for (mut column, value) in told.column_iter_mut().zip(&design.values) {
            column *= (prior.own / (value + middle)).sqrt();
        }
        maps.spread = (DMatrix::identity(size, size) - &told * told.transpose()) * (prior.own / middle);
        maps.weights = maps.whole();
        Some(maps)
    }

    fn over_scale(&self, changes: &DMatrix<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(changes.nrows(), changes.ncols(), |k, c| {
            let sign = if self.orbits.members[c].negative { -1.0 } else { 1.0 };
            // A value that is not a number stays one.
            (sign * changes[(k, c)] / self.scale[c]).clamp(-LARGEST, LARGEST)
        })
    }

    /// One solution for the posterior means, with the present noise. What a measurement has of its own is integrated out, which leaves
    /// the directions that presses see with the variances `values + noise` (generalised least squares).
    fn solve(&mut self, design: &Design, values: &DMatrix<f64>) -> Option<Solved> {
        let count = values.nrows() as f64;
        let told = &design.seen_transposed * values;
        let mut solved = Solved {
            along: DMatrix::zeros(told.nrows(), told.ncols()),
            freedom: vec![0.0; told.ncols()],
        };
        let mut own_along = solved.along.clone();
        let mut unlike = (0.0, 0.0);
        for (orbit, list) in self.orbits.lists().iter().enumerate() {
            let mut normal = Normal::new(Sensitivities::len(), &design.precisions);
            for alike in self.alike(list) {
                let parts = self.parts(self.orbits.members[alike[0]].turned);
                let members = alike.into_iter().map(|c| Turned {
                    terms: design.turn(self.orbits.members[c].turned),
                    weights: (design.values.iter())
                        .map(|v| (v + self.noise[c]).sqrt().recip())
                        .collect(),
                    gain: self.gains[c],
                    told: told.column(c).iter().copied().collect(),
                });
                normal.add(members, parts);
            }
            self.shared.set_column(orbit, &normal.solve()?);
            for &c in list {
                let map = design.turn(self.orbits.members[c].turned).tr_mul(&self.shared_by(c));
                let weights = design.values.map(|v| 1.0 / (v + self.noise[c]));
                let weighted = map.component_mul(&weights);
                let prior = self.gain_variance.recip();
                let along = weighted.dot(&told.column(c));
                let by = weighted.dot(&map).max(f64::MIN_POSITIVE);
                self.gains[c] = (along + prior) / (by + prior);
                // What the presses alone say, by how much of it is not their noise (DerSimonian and Laird 1986).
                let (off, noise_of) = ((along / by - 1.0).clamp(-1.0, 1.0), by.recip());
                let weight = (noise_of + self.gain_variance).powi(-2);
                unlike.0 += weight * (off * off - noise_of);
                unlike.1 += weight;
                let left = (told.column(c) - &map * self.gains[c]).component_mul(&weights);
                own_along.set_column(c, &(&left * design.own));
                solved
                    .along
                    .set_column(c, &(map * self.gains[c] + left.component_mul(&design.values)));
                let tied = design.values.dot(&weights);
                solved.freedom[c] = (count - tied).max(0.15 * count);
            }
        }
        self.own = &design.terms * own_along;
        let variance: f64 = unlike.0 / unlike.1;
        if variance.is_finite() {
            self.gain_variance = variance.clamp(LEAST_GAIN_VARIANCE, GAIN_SD * GAIN_SD);
        }
        Some(solved)
    }

    /// Measurements of an orbit by what they have of its parts.
    fn alike(&self, list: &[usize]) -> Vec<Vec<usize>> {
        if self.shared.nrows() == Sensitivities::len() {
            return vec![list.to_vec()];
        }
        let mut alike: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for &c in list {
            let direction = 2 * self.orbits.members[c].turned % self.frame.electrodes;
            alike.entry(direction).or_default().push(c);
        }
        alike.into_values().collect()
    }

    /// By what a measurement turned so far has the parts of what its orbit shares.
    fn parts(&self, turned: usize) -> Vec<f64> {
        let (sin, cos) = (2.0 * self.frame.angle(turned)).sin_cos();
        let all = [1.0, cos, sin];
        all[..self.shared.nrows() / Sensitivities::len()].to_vec()
    }

    /// Weights of what a measurement shares with its orbit, before they are turned.
    fn shared_by(&self, measurement: usize) -> DVector<f64> {
        let member = self.orbits.members[measurement];
        let shared = self.shared.column(member.orbit);
        let size = Sensitivities::len();
        let mut sum = DVector::zeros(size);
        for (k, part) in self.parts(member.turned).into_iter().enumerate() {
            sum.axpy(part, &shared.rows(k * size, size), 1.0);
        }
        sum
    }

    /// The change of a measurement by a press of the usual strength there, by what it shares with its orbit alone.
    pub(super) fn shared_at(&self, measurement: usize, place_mm: [f64; 2]) -> f64 {
        let member = self.orbits.members[measurement];
        let (mut here, mut weights) = (
            DVector::zeros(Sensitivities::len()),
            DVector::zeros(Sensitivities::len()),
        );
        self.basis.values_at(place_mm, here.as_mut_slice());
        let angle = self.frame.angle(member.turned);
        Sensitivities::add_turned(
            self.shared_by(measurement).as_slice(),
            angle,
            1.0,
            weights.as_mut_slice(),
        );
        let sign = if member.negative { -1.0 } else { 1.0 };
        sign * self.scale[measurement] * here.dot(&weights)
    }

    /// The change of every measurement by a press of the usual strength at each of some places: measurements x places.
    pub(super) fn at(&self, places_mm: &[[f64; 2]]) -> DMatrix<f64> {
        let places = places_mm.iter().copied().map(Some);
        let mut out = self.weights.tr_mul(&features(&self.basis, places).transpose());
        for mut column in out.column_iter_mut() {
            self.put_in_units(column.as_mut_slice());
        }
        out
    }

    /// Weights of every measurement's whole map, terms x measurements.
    fn whole(&self) -> DMatrix<f64> {
        let mut whole = self.own.clone();
        for (c, mut column) in whole.column_iter_mut().enumerate() {
            let angle = self.frame.angle(self.orbits.members[c].turned);
            let shared = self.shared_by(c);
            Sensitivities::add_turned(shared.as_slice(), angle, self.gains[c], column.as_mut_slice());
        }
        whole
    }

    /// Where a press is felt after the one before.
    pub(super) fn felt(&self, place_mm: [f64; 2], before_mm: Option<[f64; 2]>) -> [f64; 2] {
        self.frame.felt(place_mm, before_mm, self.displaced)
    }

    /// Where a press is that is felt there after the one before, and the covariance of the place by that of where it is felt, mm².
    pub(super) fn pressed(
        &self,
        felt_mm: [f64; 2],
        covariance_mm2: Matrix2<f64>,
        before_mm: Option<[f64; 2]>,
    ) -> ([f64; 2], Matrix2<f64>) {
        let (place, slope) = self.frame.pressed(felt_mm, before_mm, self.displaced);
        let unknown = match before_mm {
            Some(_) => 0.0,
            None => self.frame.unknown_mm2(felt_mm, self.displaced),
        };
        let covariance = slope * covariance_mm2 * slope.transpose() + Matrix2::identity() * unknown;
        (place, covariance)
    }

    /// What a press there leaves behind for the next one.
    pub(super) fn memory_of(&self, place_mm: Option<[f64; 2]>) -> DVector<f64> {
        match place_mm {
            Some(place) if self.memory != 0.0 => self.at(&[place]).column(0) * self.memory,
            _ => DVector::zeros(self.scale.len()),
        }
    }

    /// Distance below which maps cannot tell two presses from one between them, mm: a part of the reach, or
    /// the distance from one known press to the next, where that is farther.
    pub(super) fn near_mm(&self) -> f64 {
        self.frame.reach_mm * (PI / self.presses as f64).sqrt().max(NEAR)
    }

    /// Variance of the maps there, over the noise's.
    pub(super) fn uncertainty(&self, place_mm: [f64; 2]) -> f64 {
        let mut here = DVector::zeros(Sensitivities::len());
        self.basis.values_at(place_mm, here.as_mut_slice());
        (&self.spread * &here).dot(&here).max(0.0)
    }

    /// The numbers that make them.
    pub(super) fn stored(&self) -> StoredMaps {
        StoredMaps {
            presses: self.presses,
            centre_mm: self.frame.centre_mm,
            reach_mm: self.frame.reach_mm,
            radius_mm: self.frame.radius_mm,
            clockwise: self.frame.clockwise,
            stretch: [self.frame.stretch.re, self.frame.stretch.im],
            scale: self.scale.clone(),
            gains: self.gains.clone(),
            shared: columns(&self.shared),
            own: columns(&self.own),
            memory: self.memory,
            displaced: self.displaced,
            spread: columns(&self.spread),
        }
    }

    /// Maps of such numbers. `None` where their lengths do not fit one another.
    pub(super) fn restore(stored: &StoredMaps, electrodes: usize, orbits: Orbits) -> Option<Self> {
        let frame = Frame {
            centre_mm: stored.centre_mm,
            reach_mm: stored.reach_mm,
            radius_mm: stored.radius_mm,
            electrodes,
            clockwise: stored.clockwise,
            stretch: Complex::new(stored.stretch[0], stored.stretch[1]),
        };
        // Squares of what is in the frames' unit are numbers too.
        let positive = |v: &f64| (1e-150..=1e150).contains(v);
        let weights = [&stored.shared, &stored.own, &stored.spread];
        let small = |v: &f64| v.abs() <= 1e24;
        // As long as a sheet may be.
        let sound = (1e-3..=1e6).contains(&stored.reach_mm)
            && (1.0..=10.0).contains(&(stored.radius_mm / stored.reach_mm))
            && stored.centre_mm.iter().all(|v| v.abs() <= 1e6)
            && stored.memory.abs() <= 1.0
            && frame.stretch.norm() <= MOST_STRETCHED
            && stored.displaced.abs() <= MOST_DISPLACED
            && stored.scale.iter().all(positive)
            && weights.into_iter().flatten().flatten().all(small);
        sound.then_some(())?;
        let (size, channels) = (Sensitivities::len(), orbits.members.len());
        let gains = stored.gains.len() == channels && stored.gains.iter().all(|g| g.abs() <= 1e24);
        (gains && stored.scale.len() == channels).then_some(())?;
        let mut maps = Self {
            frame,
            presses: stored.presses.max(1),
            scale: stored.scale.clone(),
            noise: vec![FIRST_NOISE; channels],
            gains: stored.gains.clone(),
            gain_variance: GAIN_SD * GAIN_SD,
            shared: matrix(&stored.shared, size, orbits.count)
                .or_else(|| matrix(&stored.shared, GRAINED * size, orbits.count))?,
            own: matrix(&stored.own, size, channels)?,
            memory: stored.memory,
            displaced: stored.displaced,
            spread: matrix(&stored.spread, size, size)?,
            basis: frame.basis(),
            weights: DMatrix::zeros(size, channels),
            orbits,
        };
        maps.weights = maps.whole();
        Some(maps)
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
