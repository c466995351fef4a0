//! Kernel ridge regression from changes to places, or to what is left of them: plain learning.

use super::maps::matrix;
use crate::linalg::aligned::Aligned;
use crate::linalg::columns::Columns;
use crate::stats::median;
use nalgebra::{Cholesky, DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Regularisation that is tried, over the kernel's own value.
const RIDGES: [f64; 6] = [1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0];
/// Widths that are tried, over the median distance of two presses.
const WIDTHS: [f64; 4] = [0.5, 1.0, 2.0, 4.0];
/// Presses that width and ridge are chosen by.
const MOST_TO_CHOOSE: usize = 300;
/// Distances below, mm, are as good as none when errors are compared.
const NONE_MM: f64 = 1.0;

type Pairs = Vec<[f64; 2]>;

/// A regression with a Gaussian kernel and a constant (Saunders, Gammerman and Vovk 1998), its width and ridge chosen by leaving
/// one out. Large values are drawn in: each counts by the inverse hyperbolic sine over its usual size.
#[derive(Clone, Debug)]
pub struct KernelRidge {
    scale: Vec<f64>,
    /// The presses, and their squares.
    known: Columns,
    squares: Vec<f64>,
    width: f64,
    weights: Vec<[f64; 2]>,
}

/// [`KernelRidge`] as numbers, for a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StoredRidge {
    /// Usual size of every value.
    pub scale: Vec<f64>,
    /// Values of the presses that were learned from, over their sizes and drawn in.
    pub known: Vec<Vec<f64>>,
    /// Width of the kernel.
    pub width: f64,
    /// Weights of the presses, mm.
    pub weights: Vec<[f64; 2]>,
}

impl KernelRidge {
    /// Learns places, mm, from values, a list of the same length for every press. Returns also what is left of the place of each
    /// when it is left out. `None` for fewer than two presses.
    pub fn learn(values: &[&[f64]], places: &[[f64; 2]]) -> Option<(Self, Vec<[f64; 2]>)> {
        let count = values.len();
        if count < 2 || places.len() != count {
            return None;
        }
        let usual = |c: usize| median(values.iter().map(|v| v[c].abs()));
        let scale: Vec<f64> = (0..values[0].len()).map(|c| usual(c).max(f64::MIN_POSITIVE)).collect();
        let known: Vec<DVector<f64>> = values.iter().map(|v| drawn_in(v, &scale)).collect();
        // Width and ridge need fewer presses than places do.
        let some: Vec<usize> = (0..count).step_by(count.div_ceil(MOST_TO_CHOOSE)).collect();
        let (width, ridge) = choose(&known, places, &some)?;
        let all: Vec<usize> = (0..count).collect();
        let kernel = squares(&known, &all).map(|s| kernel(s, width));
        let (weights, left) = solve(kernel, ridge, places, &all)?;
        Some((Self::of(scale, &DMatrix::from_columns(&known), width, weights), left))
    }

    fn of(scale: Vec<f64>, known: &DMatrix<f64>, width: f64, weights: Pairs) -> Self {
        Self {
            scale,
            squares: known.column_iter().map(|k| k.norm_squared()).collect(),
            known: Columns::new(known, 1.0),
            width,
            weights,
        }
    }

    /// The place of a press, mm.
    pub fn predict(&self, values: &[f64]) -> [f64; 2] {
        let there = drawn_in(values, &self.scale);
        let mut padded = Aligned::zeros(self.known.rows());
        padded[..there.len()].copy_from_slice(there.as_slice());
        let mut products = Aligned::zeros(self.known.cells());
        self.known.dots(&padded, &mut products);
        let own = there.norm_squared();
        let mut place = [0.0; 2];
        for ((square, product), weights) in self.squares.iter().zip(&*products).zip(&self.weights) {
            let kernel = kernel((square + own - 2.0 * product).max(0.0), self.width);
            for (p, w) in place.iter_mut().zip(weights) {
                *p += kernel * w;
            }
        }
        place
    }

    /// The numbers that make it.
    pub fn stored(&self) -> StoredRidge {
        StoredRidge {
            scale: self.scale.clone(),
            known: (0..self.weights.len())
                .map(|k| self.known.column(k)[..self.scale.len()].to_vec())
                .collect(),
            width: self.width,
            weights: self.weights.clone(),
        }
    }

    /// What such numbers make, for so many values. `None` where they do not fit one another.
    pub fn restore(stored: &StoredRidge, channels: usize) -> Option<Self> {
        let known = matrix(&stored.known, channels, stored.weights.len())?;
        let positive = |v: &f64| *v > 0.0 && v.is_finite();
        let sound = stored.scale.len() == channels
            && stored.scale.iter().all(positive)
            && (1e-9..=1e9).contains(&stored.width)
            && stored.weights.iter().flatten().all(|w| w.abs() <= 1e9)
            && known.iter().all(|v| v.abs() <= 1e9);
        sound.then(|| Self::of(stored.scale.clone(), &known, stored.width, stored.weights.clone()))
    }
}

/// Squared distances of some presses.
fn squares(known: &[DVector<f64>], some: &[usize]) -> DMatrix<f64> {
    DMatrix::from_fn(some.len(), some.len(), |i, j| {
        (&known[some[i]] - &known[some[j]]).norm_squared()
    })
}

/// Width and ridge that leave least of presses that are left out.
fn choose(known: &[DVector<f64>], places: &[[f64; 2]], some: &[usize]) -> Option<(f64, f64)> {
    let squares = squares(known, some);
    let mut sorted: Vec<f64> = squares.iter().copied().filter(|s| *s > 0.0).collect();
    sorted.sort_by(f64::total_cmp);
    let typical = sorted.get(sorted.len() / 2)?.sqrt();
    let mut best: Option<(f64, f64, f64)> = None;
    for width in WIDTHS.map(|w| w * typical) {
        let kernel = squares.map(|s| kernel(s, width));
        for ridge in RIDGES {
            let Some((_, left)) = solve(kernel.clone(), ridge, places, some) else {
                continue;
            };
            let loss = left.iter().map(loss).sum();
            if best.is_none_or(|(least, ..)| loss < least) {
                best = Some((loss, width, ridge));
            }
        }
    }
    best.map(|(_, width, ridge)| (width, ridge))
}

/// Weights of some presses, and what is left of the place of each when it is left out: its weight over the diagonal of the
/// inverse.
fn solve(mut kernel: DMatrix<f64>, ridge: f64, places: &[[f64; 2]], some: &[usize]) -> Option<(Pairs, Pairs)> {
    for k in 0..some.len() {
        kernel[(k, k)] += ridge;
    }
    let inverse = Cholesky::new(kernel)?.inverse();
    let weights = &inverse * DMatrix::from_fn(some.len(), 2, |k, a| places[some[k]][a]);
    let left = |k: usize| [0, 1].map(|a| weights[(k, a)] / inverse[(k, k)]);
    let left = (0..some.len()).map(left).collect();
    Some((weights.row_iter().map(|r| [r[0], r[1]]).collect(), left))
}

fn kernel(square: f64, width: f64) -> f64 {
    1.0 + (-0.5 * square / (width * width)).exp()
}

/// What an error costs: the logarithm of its square, so that no single one decides.
pub(super) fn loss(left: &[f64; 2]) -> f64 {
    (left[0] * left[0] + left[1] * left[1] + NONE_MM * NONE_MM).ln()
}

/// A value that is missing is taken for none.
fn drawn_in(values: &[f64], scale: &[f64]) -> DVector<f64> {
    let one = |(v, s): (&f64, &f64)| if v.is_finite() { (v / s).asinh() } else { 0.0 };
    DVector::from_iterator(values.len(), values.iter().zip(scale).map(one))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_depends_smoothly_on_a_place_tells_it() {
        let places: Vec<[f64; 2]> = (0..49)
            .map(|k| [f64::from(k % 7) * 10.0 - 30.0, f64::from(k / 7) * 10.0 - 30.0])
            .collect();
        let of = |p: [f64; 2]| vec![(p[0] / 30.0).sin(), (p[1] / 30.0).sin(), (p[0] + p[1]) / 40.0];
        let values: Vec<Vec<f64>> = places.iter().map(|p| of(*p)).collect();
        let slices: Vec<&[f64]> = values.iter().map(Vec::as_slice).collect();
        let (ridge, left) = KernelRidge::learn(&slices, &places).unwrap();
        for place in [[3.0, 4.0], [-17.0, 22.0]] {
            let found = ridge.predict(&of(place));
            assert!((found[0] - place[0]).hypot(found[1] - place[1]) < 0.5, "{found:?}");
        }
        assert!(KernelRidge::learn(&slices[..1], &places[..1]).is_none());
        // What is said to be left of one that is left out is left.
        let others = |list: &[usize]| -> Vec<[f64; 2]> { list.iter().map(|k| places[*k]).collect() };
        let rows: Vec<usize> = (0..49).filter(|k| *k != 24).collect();
        let without: Vec<&[f64]> = rows.iter().map(|k| slices[*k]).collect();
        let (alone, _) = KernelRidge::learn(&without, &others(&rows)).unwrap();
        let found = alone.predict(&values[24]);
        assert!(
            (0..2).all(|a| (places[24][a] - found[a] - left[24][a]).abs() < 0.1),
            "{found:?} {left:?}"
        );
        let stored = KernelRidge::restore(&ridge.stored(), 3).unwrap();
        assert_eq!(stored.predict(&values[3]), ridge.predict(&values[3]));
    }
}
