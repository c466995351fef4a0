//! The presses of a fit as the terms of the maps see them.

use super::{Presses, Prior, symmetric_eigen};
use crate::learned::frame::Frame;
use crate::learned::orbits::Orbits;
use crate::learned::sensitivities::Sensitivities;
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

/// The presses as the terms see them, and what all measurements have in common.
pub(super) struct Design {
    /// Of the places, with the part of those of the presses before that is left.
    pub(super) here: DMatrix<f64>,
    /// For every turn that a measurement has: its number, the features turned back, and two products of them.
    pub(super) turns: Vec<(usize, Turn)>,
    /// Eigenvectors and eigenvalues of what the presses see of the own parts, in units of their prior.
    pub(super) vectors: DMatrix<f64>,
    pub(super) values: DVector<f64>,
    pub(super) own_root: f64,
    /// Precisions of the shared weights.
    pub(super) precisions: DVector<f64>,
}

/// Eigenvectors and eigenvalues of the columns' square, those without the ones that no row sees. Of fewer rows than columns they
/// follow from the rows' square.
fn seen(scaled: &DMatrix<f64>) -> Option<(DMatrix<f64>, DVector<f64>)> {
    let few = scaled.nrows() < scaled.ncols();
    let square = if few {
        scaled * scaled.transpose()
    } else {
        scaled.tr_mul(scaled)
    };
    let eigen = symmetric_eigen(square)?;
    let least = LEAST_SEEN * eigen.eigenvalues.max();
    let order: Vec<usize> = (0..eigen.eigenvalues.len())
        .filter(|k| eigen.eigenvalues[*k] > least)
        .collect();
    let values = eigen.eigenvalues.select_rows(&order);
    let mut vectors = eigen.eigenvectors.select_columns(&order);
    if few {
        vectors = scaled.tr_mul(&vectors);
        for (mut column, value) in vectors.column_iter_mut().zip(&values) {
            column /= value.sqrt();
        }
    }
    Some((vectors, values))
}

pub(super) struct Turn {
    pub(super) features: DMatrix<f64>,
    pub(super) square: DMatrix<f64>,
    /// In the directions of the eigenvectors.
    pub(super) seen: DMatrix<f64>,
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
        let felt: Vec<[f64; 2]> = (presses.places_mm.iter().zip(&presses.before_mm))
            .map(|(place, before)| frame.felt(*place, *before, prior.displaced))
            .collect();
        // What the press before left is a part of what it did.
        let of_presses = |turned: usize| {
            let back = |p: [f64; 2]| frame.turned_back(p, turned);
            let here = features(basis, felt.iter().map(|p| Some(back(*p))));
            here + features(basis, presses.before_mm.iter().map(|p| p.map(back))) * prior.memory
        };
        let here = of_presses(0);
        let own_root = prior.own.sqrt();
        let (vectors, values) = seen(&(&here * own_root))?;
        let to_seen = &here * own_root * &vectors;
        let mut numbers: Vec<usize> = orbits.members.iter().map(|m| m.turned).collect();
        numbers.sort_unstable();
        numbers.dedup();
        let turn = |turned: usize| {
            let features = of_presses(turned);
            Turn {
                square: features.tr_mul(&features),
                seen: to_seen.tr_mul(&features),
                features,
            }
        };
        Some(Self {
            turns: numbers.into_iter().map(|t| (t, turn(t))).collect(),
            here,
            values,
            vectors,
            own_root,
            precisions: precisions(prior),
        })
    }

    pub(super) fn turn(&self, turned: usize) -> &Turn {
        let place = self.turns.partition_point(|(t, _)| *t < turned);
        &self.turns[place].1
    }
}
