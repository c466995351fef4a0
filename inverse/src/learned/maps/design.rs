//! The presses of a fit as the terms of the maps see them.

use super::{Presses, Prior};
use crate::learned::frame::Frame;
use crate::learned::orbits::Orbits;
use crate::learned::sensitivities::Sensitivities;
use crate::linalg::eigen::symmetric_eigen;
use nalgebra::{DMatrix, DVector};

/// Directions of which presses see less than this part of what they see of the largest are not seen.
const LEAST_SEEN: f64 = 1e-10;

/// Parts of the weights that an orbit shares where maps change with the direction.
pub(super) const GRAINED: usize = 3;

/// Precisions of the weights that an orbit shares.
pub(super) fn precisions(prior: Prior) -> DVector<f64> {
    let size = Sensitivities::len();
    let parts = if prior.grain > 0.0 { GRAINED } else { 1 };
    DVector::from_fn(parts * size, |k, _| {
        if k < size { prior.shared } else { prior.grain }.recip()
    })
}

pub(super) fn features(basis: &Sensitivities, places: impl Iterator<Item = Option<[f64; 2]>>) -> DMatrix<f64> {
    let columns: Vec<DVector<f64>> = places
        .map(|place| {
            let mut column = DVector::zeros(Sensitivities::len());
            if let Some(place) = place {
                basis.values_at(place, column.as_mut_slice());
            }
            column
        })
        .collect();
    DMatrix::from_columns(&columns).transpose()
}

/// The presses as the terms see them: `here = seen terms^T`. A row of `here` has the features of a press's place and, of those of the
/// press before, the part that is left. Electrodes that are turned see the features, turned. So all measurements share the
/// directions that presses see, of which there are no more than terms.
pub(super) struct Design {
    /// Presses x directions, orthonormal, and transposed.
    pub(super) seen: DMatrix<f64>,
    pub(super) seen_transposed: DMatrix<f64>,
    /// Terms x directions.
    pub(super) terms: DMatrix<f64>,
    /// For every turn that a measurement has: its number, and the terms turned back.
    turns: Vec<(usize, DMatrix<f64>)>,
    /// Squares of the directions' sizes, times the prior variance of what a measurement has of its own.
    pub(super) values: DVector<f64>,
    /// That variance.
    pub(super) own: f64,
    /// Precisions of the shared weights.
    pub(super) precisions: DVector<f64>,
}

/// Orthonormal directions of rows that columns see, and their sizes squared, without those that are not seen. Of fewer rows than
/// columns they follow from the rows' square.
fn directions(here: &DMatrix<f64>) -> Option<(DMatrix<f64>, DVector<f64>)> {
    let few = here.nrows() < here.ncols();
    let transposed = here.transpose();
    let square = if few { here * &transposed } else { &transposed * here };
    let eigen = symmetric_eigen(square)?;
    let least = LEAST_SEEN * eigen.eigenvalues.max();
    let order: Vec<usize> = (0..eigen.eigenvalues.len())
        .filter(|k| eigen.eigenvalues[*k] > least)
        .collect();
    let values = eigen.eigenvalues.select_rows(&order);
    let mut vectors = eigen.eigenvectors.select_columns(&order);
    if !few {
        vectors = here * &vectors;
        for (mut column, value) in vectors.column_iter_mut().zip(&values) {
            column /= value.sqrt();
        }
    }
    Some((vectors, values))
}

/// Weights turned around the centre, column by column.
fn turned(weights: &DMatrix<f64>, angle: f64) -> DMatrix<f64> {
    let mut out = DMatrix::zeros(weights.nrows(), weights.ncols());
    for (from, mut to) in weights.column_iter().zip(out.column_iter_mut()) {
        Sensitivities::add_turned(from.as_slice(), angle, 1.0, to.as_mut_slice());
    }
    out
}

impl Design {
    /// `None` where the presses are beyond what can be computed with.
    pub(super) fn new(
        presses: &Presses,
        frame: Frame,
        prior: Prior,
        orbits: &Orbits,
        basis: &Sensitivities,
    ) -> Option<Self> {
        let felt = (presses.places_mm.iter().zip(&presses.before_mm))
            .map(|(place, before)| Some(frame.felt(*place, *before, prior.displaced)));
        let mut here = features(basis, felt);
        if prior.memory != 0.0 {
            // What the press before left is a part of what it did.
            here += features(basis, presses.before_mm.iter().copied()) * prior.memory;
        }
        let (seen, values) = directions(&here)?;
        let seen_transposed = seen.transpose();
        let terms = (&seen_transposed * &here).transpose();
        let mut numbers: Vec<usize> = orbits.members.iter().map(|m| m.turned).collect();
        numbers.sort_unstable();
        numbers.dedup();
        let turns = numbers.into_iter().map(|t| (t, turned(&terms, -frame.angle(t))));
        Some(Self {
            turns: turns.collect(),
            seen,
            seen_transposed,
            terms,
            values: values * prior.own,
            own: prior.own,
            precisions: precisions(prior),
        })
    }

    /// The terms turned back by so many electrodes.
    pub(super) fn turn(&self, turned: usize) -> &DMatrix<f64> {
        let place = self.turns.partition_point(|(t, _)| *t < turned);
        &self.turns[place].1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use forward::Pattern;
    use nalgebra::Complex;
    use rand::rngs::StdRng;
    use rand::{Rng, SeedableRng};

    #[test]
    fn what_presses_see_turned_is_what_turned_presses_see() {
        let orbits = Orbits::new(Pattern::adjacent(8).unwrap().measurements(), 8, 1);
        let mut random = StdRng::seed_from_u64(7);
        for (count, clockwise) in [(20, false), (120, true)] {
            let frame = Frame {
                centre_mm: [3.0, -2.0],
                reach_mm: 40.0,
                radius_mm: 50.0,
                electrodes: 8,
                clockwise,
                stretch: Complex::ZERO,
            };
            let prior = Prior {
                shared: 0.5,
                grain: 0.0,
                own: 0.06,
                memory: 0.2,
                displaced: 0.1,
            };
            let mut place = || [3.0, -2.0].map(|middle: f64| middle + random.random_range(-28.0..28.0));
            let places_mm: Vec<[f64; 2]> = (0..count).map(|_| place()).collect();
            let before_mm: Vec<Option<[f64; 2]>> = (0..count).map(|k| (k % 5 > 0).then(&mut place)).collect();
            let presses = Presses {
                changes: DMatrix::zeros(count, orbits.members.len()),
                places_mm: places_mm.clone(),
                before_mm: before_mm.clone(),
            };
            let basis = frame.basis();
            let design = Design::new(&presses, frame, prior, &orbits, &basis).unwrap();
            for turned in 0..8 {
                let (sin, cos) = (-frame.angle(turned)).sin_cos();
                let back = |[x, y]: [f64; 2]| {
                    let [x, y] = [x - 3.0, y + 2.0];
                    [3.0 + cos * x - sin * y, -2.0 + sin * x + cos * y]
                };
                let felt = (places_mm.iter().zip(&before_mm)).map(|(p, b)| Some(back(frame.felt(*p, *b, 0.1))));
                let left = features(&basis, before_mm.iter().map(|b| b.map(back))) * 0.2;
                let wanted = features(&basis, felt) + left;
                let found = &design.seen * design.turn(turned).transpose();
                assert!((&found - &wanted).norm() < 1e-4 * wanted.norm(), "{count} {turned}");
            }
        }
    }
}
