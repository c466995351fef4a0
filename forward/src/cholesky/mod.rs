//! Sparse Cholesky factorisation of one pattern with many values: the symbolic part once, the numeric part as often as
//! the values change. The last unknowns, the electrodes, stay last. Their Schur complement is then a corner of the factor,
//! and the electrodes' own impedances need no solve at all.

mod factor;
mod portable;
mod structure;
mod symbolic;
mod tuned;

pub(crate) use factor::Factor;
pub(crate) use symbolic::Symbolic;

use thiserror::Error;

/// Why a factorisation failed.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum CholeskyError {
    /// The matrix is not positive definite to working precision.
    #[error(
        "the system is not positive definite at unknown {unknown}; \
         the conductivities or contact impedances span more than double precision can hold"
    )]
    NotPositiveDefinite {
        /// Where the pivot failed, in elimination order.
        unknown: usize,
    },
    /// No memory for the factor.
    #[error("no memory for the factor of {unknowns} unknowns; ask for less accuracy")]
    OutOfMemory {
        /// Size of the system.
        unknowns: usize,
    },
}

/// Columns of a right-hand side worked on at once.
pub(crate) const BLOCK: usize = 16;

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;
    use rand::{Rng, SeedableRng};

    /// A random sparse symmetric matrix, diagonally dominant.
    fn example(n: usize) -> (Vec<[usize; 2]>, DMatrix<f64>) {
        let mut rng = rand::rngs::StdRng::seed_from_u64(7);
        let mut pairs = Vec::new();
        let mut dense = DMatrix::identity(n, n);
        for _ in 0..3 * n {
            let (i, j) = (rng.random_range(0..n), rng.random_range(0..n));
            if i != j {
                let v = rng.random_range(-1.0..1.0);
                pairs.push([i, j]);
                dense[(i, j)] += v;
                dense[(j, i)] += v;
                dense[(i, i)] += 2.0;
                dense[(j, j)] += 2.0;
            }
        }
        (pairs, dense)
    }

    #[test]
    fn agrees_with_a_dense_factorisation() {
        let (n, keep) = (120, 7);
        let (pairs, dense) = example(n);
        let symbolic = Symbolic::new(n, keep, &pairs).unwrap();
        let mut values = vec![0.0; symbolic.values()];
        for i in 0..n {
            values[symbolic.slot(i, i)] = dense[(i, i)];
        }
        for [i, j] in &pairs {
            values[symbolic.slot(*i, *j)] = dense[(*i, *j)];
        }
        let mut factor = Factor::new(&symbolic).unwrap();
        for portably in [false, true] {
            if portably {
                factor.factorize_portably(&symbolic, &values).unwrap();
            } else {
                factor.factorize(&symbolic, &values).unwrap();
            }
            holds(&factor, &symbolic, &dense, keep);
        }
    }

    fn holds(factor: &Factor, symbolic: &Symbolic, dense: &DMatrix<f64>, keep: usize) {
        let n = dense.nrows();
        let inverse = dense.clone().try_inverse().unwrap();
        let corner = factor.corner(symbolic, keep);
        let schur = &corner * corner.transpose();
        let expected = inverse
            .view((n - keep, n - keep), (keep, keep))
            .clone_owned()
            .try_inverse()
            .unwrap();
        assert!((schur - expected).amax() < 1e-12);

        let mut x = vec![[0.0; BLOCK]; n];
        let columns: Vec<usize> = (0..BLOCK).map(|k| 5 * k).collect();
        for (k, i) in columns.iter().enumerate() {
            x[symbolic.position(*i)][k] = 1.0;
        }
        factor.forward_substitute(symbolic, &mut x, 0);
        factor.back_substitute(symbolic, &mut x);
        for (k, i) in columns.iter().enumerate() {
            for j in 0..n {
                let got = x[symbolic.position(j)][k];
                assert!((got - inverse[(j, *i)]).abs() < 1e-12);
            }
        }
    }

    /// Supernodes of one column to many, sparse and full: every step of the tuned factorisation.
    #[test]
    fn both_factorisations_agree_at_every_width() {
        let mut rng = rand::rngs::StdRng::seed_from_u64(8);
        for n in [1, 2, 5, 16, 33, 70, 130, 200, 300, 560] {
            for couplings in [2 * n, 8 * n, n * n] {
                let pairs: Vec<[usize; 2]> = (0..couplings)
                    .map(|_| [rng.random_range(0..n), rng.random_range(0..n)])
                    .filter(|[i, j]| i != j)
                    .collect();
                let symbolic = Symbolic::new(n, n / 9, &pairs).unwrap();
                let mut values = vec![0.0; symbolic.values()];
                for [i, j] in &pairs {
                    let v = rng.random_range(0.1..3.0);
                    values[symbolic.slot(*i, *j)] -= v;
                    values[symbolic.slot(*i, *i)] += v;
                    values[symbolic.slot(*j, *j)] += v;
                }
                for i in 0..n {
                    values[symbolic.slot(i, i)] += 0.1;
                }
                let (mut tuned, mut portable) = (Factor::new(&symbolic).unwrap(), Factor::new(&symbolic).unwrap());
                // Twice: nothing is left over from the first time.
                tuned.factorize(&symbolic, &values).unwrap();
                tuned.factorize(&symbolic, &values).unwrap();
                portable.factorize_portably(&symbolic, &values).unwrap();
                let (a, b) = (tuned.corner(&symbolic, n), portable.corner(&symbolic, n));
                assert!(
                    (&a - &b).amax() < 1e-12 * b.amax(),
                    "{n} unknowns, {couplings} couplings"
                );
                assert!(a.diagonal().min() > 0.0);
            }
        }
    }

    #[test]
    fn an_indefinite_matrix_is_an_error() {
        let symbolic = Symbolic::new(3, 1, &[[0, 1], [1, 2]]).unwrap();
        let mut values = vec![0.0; symbolic.values()];
        for i in 0..3 {
            values[symbolic.slot(i, i)] = 1.0;
        }
        values[symbolic.slot(0, 1)] = 2.0;
        let mut factor = Factor::new(&symbolic).unwrap();
        for result in [
            factor.factorize(&symbolic, &values),
            factor.factorize_portably(&symbolic, &values),
        ] {
            assert!(matches!(result, Err(CholeskyError::NotPositiveDefinite { .. })));
        }
    }
}
