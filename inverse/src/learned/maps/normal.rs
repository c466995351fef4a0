//! Normal equations of the weights that an orbit shares.

use crate::linalg::dense::{add_outer, backward, cholesky, forward};
use crate::linalg::kernels::{LANES, add_columns, padded};
use nalgebra::{DMatrix, DVector};
use pulp::Arch;

/// A measurement whose weights are the orbit's, turned and times its gain.
pub(super) struct Turned<'a> {
    /// Its terms turned back, terms x directions.
    pub(super) terms: &'a DMatrix<f64>,
    /// One over the standard deviations along the directions.
    pub(super) weights: Vec<f64>,
    pub(super) gain: f64,
    /// What presses say of it along the directions.
    pub(super) told: Vec<f64>,
}

/// The equations. Every part of the weights begins at a multiple of [`LANES`].
pub(super) struct Normal {
    arch: Arch,
    terms: usize,
    parts: usize,
    precisions: DVector<f64>,
    /// Of lists of measurements the squares of their weighted terms, one after another, and what is along these.
    squares: Vec<f64>,
    along: Vec<f64>,
    /// What each list has of every part.
    shares: Vec<Vec<f64>>,
}

impl Normal {
    /// Of weights with so many terms and these precisions before any press: those of one part after another.
    pub(super) fn new(terms: usize, precisions: &DVector<f64>) -> Self {
        Self {
            arch: Arch::new(),
            terms,
            parts: precisions.len() / terms,
            precisions: precisions.clone(),
            squares: Vec::new(),
            along: Vec::new(),
            shares: Vec::new(),
        }
    }

    /// Rows of a part, and of all.
    fn rows(&self) -> [usize; 2] {
        let rows = padded(self.terms, LANES);
        [rows, self.parts * rows]
    }

    /// Adds measurements that have the same of every part.
    pub(super) fn add<'a>(&mut self, list: impl Iterator<Item = Turned<'a>>, shares: Vec<f64>) {
        let [rows, _] = self.rows();
        let (mut weighted, mut told) = (Vec::new(), Vec::new());
        for member in list {
            let columns = member.terms.column_iter().zip(member.weights.iter().zip(&member.told));
            for (term, (weight, value)) in columns {
                let scale = member.gain * weight;
                told.push((told.len(), weight * value));
                weighted.extend(term.iter().map(|t| scale * t));
                weighted.resize(told.len() * rows, 0.0);
            }
        }
        let (first, of_terms) = (self.squares.len(), self.along.len());
        self.squares.resize(first + rows * rows, 0.0);
        self.along.resize(of_terms + rows, 0.0);
        add_outer::<false>(self.arch, &mut self.squares[first..], rows, &weighted);
        add_columns(self.arch, &weighted, &told, &mut self.along[of_terms..]);
        self.shares.push(shares);
    }

    /// The sum of what the lists have, each times its share of two parts: of columns as long as `out`.
    fn sum(&self, columns: &[f64], share: impl Fn(&[f64]) -> f64, out: &mut [f64]) {
        let list: Vec<(usize, f64)> = self.shares.iter().map(|of| share(of)).enumerate().collect();
        add_columns(self.arch, columns, &list, out);
    }

    /// The weights. `None` where they are not determined.
    pub(super) fn solve(&self) -> Option<DVector<f64>> {
        let [rows, all] = self.rows();
        let (mut matrix, mut right) = (vec![0.0; all * all], vec![0.0; all]);
        let mut block = vec![0.0; rows * rows];
        for (j, right) in right.chunks_exact_mut(rows).enumerate() {
            self.sum(&self.along, |share| share[j], right);
            for i in j..self.parts {
                block.fill(0.0);
                self.sum(&self.squares, |share| share[i] * share[j], &mut block);
                for column in 0..rows {
                    // Of squares the lower half was made.
                    for row in 0..column {
                        block[column * rows + row] = block[row * rows + column];
                    }
                    let first = (j * rows + column) * all + i * rows;
                    matrix[first..first + rows].copy_from_slice(&block[column * rows..(column + 1) * rows]);
                }
            }
        }
        for row in 0..all {
            let (part, term) = (row / rows, row % rows);
            // The padding's weights are 0.
            let is_padding = term >= self.terms;
            matrix[row * (all + 1)] += if is_padding {
                1.0
            } else {
                self.precisions[part * self.terms + term]
            };
        }
        let mut inverse = vec![0.0; all];
        cholesky(self.arch, &mut matrix, &mut inverse).then_some(())?;
        forward(self.arch, &matrix, &inverse, &mut right);
        backward(self.arch, &matrix, &inverse, &mut right);
        let weights = right.chunks_exact(rows).flat_map(|part| &part[..self.terms]);
        Some(DVector::from_iterator(self.parts * self.terms, weights.copied()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Cholesky;

    #[test]
    fn the_weights_are_those_of_generalised_least_squares() {
        let (terms, directions) = (10, 7);
        let number = |k: usize| ((k * k + 3 * k) as f64 * 0.7).sin();
        let turns: Vec<DMatrix<f64>> = (0..4)
            .map(|m| DMatrix::from_fn(terms, directions, |i, j| number(i + 13 * j + 101 * m)))
            .collect();
        let weights = |m: usize| -> Vec<f64> { (0..directions).map(|k| 1.0 + 0.3 * number(k + m)).collect() };
        let told = |m: usize| -> Vec<f64> { (0..directions).map(|k| number(5 * k + m)).collect() };
        let gain = |m: usize| 0.5 + 0.4 * m as f64;
        for parts in [1, 3] {
            // The first two measurements are alike, and the last two.
            let of = |m: usize| [1.0, 0.4 - (m / 2) as f64, 0.9][..parts].to_vec();
            let precisions = DVector::from_fn(parts * terms, |k, _| 1.0 + (k % 3) as f64);
            let mut normal = Normal::new(terms, &precisions);
            for group in [[0, 1], [2, 3]] {
                let members = group.iter().map(|m| Turned {
                    terms: &turns[*m],
                    weights: weights(*m),
                    gain: gain(*m),
                    told: told(*m),
                });
                normal.add(members, of(group[0]));
            }
            let found = normal.solve().unwrap();
            let (mut matrix, mut right) = (DMatrix::from_diagonal(&precisions), DVector::zeros(parts * terms));
            for (m, turn) in turns.iter().enumerate() {
                let precision = DVector::from_vec(weights(m)).map(|w| w * w);
                let design = DMatrix::from_fn(directions, parts * terms, |d, k| {
                    gain(m) * of(m)[k / terms] * turn[(k % terms, d)]
                });
                let weighted = design.transpose() * DMatrix::from_diagonal(&precision);
                matrix += &weighted * &design;
                right += weighted * DVector::from_vec(told(m));
            }
            let wanted = Cholesky::new(matrix).unwrap().solve(&right);
            assert!(
                (&found - &wanted).norm() < 1e-10 * wanted.norm(),
                "{parts}: {found} {wanted}"
            );
        }
    }
}
