//! A change of few equations as a correction to a factorisation (Woodbury 1950).
//!
//! The factor L of K0 is kept, and K = K0 + E D E^T, where E picks the changed unknowns J. Let A, B and C be the blocks of K0's
//! inverse between J and J, between J and the electrodes, and between the electrodes. The electrodes' block of K's inverse is
//! `C - B^T D (I + A D)^-1 B`. With `X = L^-1 E` and `Y = L^-1 E_electrodes` the three blocks are `X^T X`, `X^T Y` and `Y^T Y`.
//! A column of X is short: it starts at its own place in the elimination order and follows the tree to its root. Y is the
//! inverse of the factor's last corner. Corrections always start from the factorised state: errors do not build up.

use crate::cholesky::{BLOCK, Factor, Symbolic};
use nalgebra::DMatrix;

/// Most unknowns changed: the small dense system grows with their square in memory and their cube in time. More let such a
/// correction take longer than a factorisation; fewer factorise for small touches already.
const MOST: usize = 160;
/// Time of an operation of the triangular solves over one of the factorisation, as measured. More chooses the factorisation
/// earlier.
const WEIGHT: f64 = 0.5;
/// Largest condition of the small system: its relative error stays below this times 1e-16. Beyond, the sheet is factorised
/// anew. Less factorises more often; more lets through larger errors.
const MOST_CONDITION: f64 = 1e6;

/// The changed unknowns' part of the solutions.
pub(crate) struct Update {
    /// Changed unknowns, by position in elimination order.
    changed: Vec<usize>,
    /// `D (I + A D)^-1 B`, changed unknown by electrode.
    weights: DMatrix<f64>,
}

impl Update {
    /// The update from the factorised values to others, with the electrodes' block of the new inverse. None when
    /// there is no factorisation, or a new one is cheaper or safer.
    pub(crate) fn new(
        symbolic: &Symbolic,
        factor: &Factor,
        corner: &DMatrix<f64>,
        reference: &[f64],
        values: &[f64],
    ) -> Option<(Self, DMatrix<f64>)> {
        if reference.len() != values.len() {
            return None;
        }
        let (changed, d) = difference(symbolic, reference, values)?;
        let reach = symbolic.reach(&changed);
        if !worth_it(symbolic, &reach, changed.len()) {
            return None;
        }
        let (count, n, free) = (changed.len(), symbolic.unknowns(), corner.nrows());
        let mut rows: Vec<usize> = Vec::new();
        let mut blocks = Vec::new();
        for group in changed.chunks(BLOCK) {
            let mut x = vec![[0.0; BLOCK]; n];
            for (k, position) in group.iter().enumerate() {
                x[*position][k] = 1.0;
            }
            let reach = symbolic.reach(group);
            factor.forward_along(symbolic, &mut x, &reach);
            blocks.push(x);
        }
        for s in &reach {
            rows.extend(symbolic.supernode_columns(*s));
        }
        let mut a = DMatrix::zeros(count, count);
        let mut b = DMatrix::zeros(count, free);
        for (p, x) in blocks.iter().enumerate() {
            for (q, y) in blocks.iter().enumerate().take(p + 1) {
                let gram = products(x, y, &rows);
                for i in 0..BLOCK.min(count - p * BLOCK) {
                    for j in 0..BLOCK.min(count - q * BLOCK) {
                        a[(p * BLOCK + i, q * BLOCK + j)] = gram[i][j];
                        a[(q * BLOCK + j, p * BLOCK + i)] = gram[i][j];
                    }
                }
            }
            for i in 0..BLOCK.min(count - p * BLOCK) {
                for l in 0..free {
                    b[(p * BLOCK + i, l)] = (l..free).map(|r| x[n - free + r][i] * corner[(r, l)]).sum();
                }
            }
        }
        let small = DMatrix::identity(count, count) + a * &d;
        let size = norm(&small);
        let inverse = small.try_inverse()?;
        let condition = size * norm(&inverse);
        if condition.is_nan() || condition > MOST_CONDITION {
            return None;
        }
        let weights = d * (inverse * &b);
        let mut block = corner.transpose() * corner - b.transpose() * &weights;
        for i in 0..free {
            for j in 0..i {
                let mean = 0.5 * (block[(i, j)] + block[(j, i)]);
                block[(i, j)] = mean;
                block[(j, i)] = mean;
            }
        }
        Some((Self { changed, weights }, block))
    }

    /// How many unknowns' equations changed.
    pub(crate) fn unknowns(&self) -> usize {
        self.changed.len()
    }

    /// Adds to right-hand sides of the factorised system what makes its solutions those of the changed one, for electrodes
    /// `first..first + count`.
    pub(crate) fn load(&self, x: &mut [[f64; BLOCK]], first: usize, count: usize) {
        for (i, position) in self.changed.iter().enumerate() {
            for (k, x) in x[*position].iter_mut().enumerate().take(count) {
                *x -= self.weights[(i, first + k)];
            }
        }
    }
}

/// The unknowns whose equations differ, and the difference between them; None when they are many, or none.
fn difference(symbolic: &Symbolic, reference: &[f64], values: &[f64]) -> Option<(Vec<usize>, DMatrix<f64>)> {
    let mut entries = Vec::new();
    for ((column, row), (old, new)) in symbolic.pairs().zip(reference.iter().zip(values)) {
        if old != new {
            entries.push((column, row, new - old));
            if entries.len() > MOST * MOST {
                return None;
            }
        }
    }
    let mut changed: Vec<usize> = entries.iter().flat_map(|(c, r, _)| [*c, *r]).collect();
    changed.sort_unstable();
    changed.dedup();
    if changed.len() > MOST || changed.is_empty() {
        return None;
    }
    let at = |p: usize| changed.partition_point(|q| *q < p);
    let mut d = DMatrix::zeros(changed.len(), changed.len());
    for (column, row, value) in entries {
        d[(at(row), at(column))] = value;
        d[(at(column), at(row))] = value;
    }
    Some((changed, d))
}

/// Compares counts of operations: of the triangular solves and the products between their columns, and of a factorisation.
fn worth_it(symbolic: &Symbolic, reach: &[usize], unknowns: usize) -> bool {
    let blocks = unknowns.div_ceil(BLOCK) as f64;
    let (mut solve, mut rows) = (0.0, 0.0);
    for s in reach {
        let (columns, height) = symbolic.supernode_shape(*s);
        solve += (columns * height) as f64;
        rows += columns as f64;
    }
    let wide = BLOCK as f64 * blocks;
    let update = wide * solve + 0.5 * wide * wide * rows + 2.0 * (unknowns as f64).powi(3);
    let factorisation: f64 = (0..symbolic.supernodes())
        .map(|s| {
            let (columns, height) = symbolic.supernode_shape(s);
            0.5 * (columns * height * height) as f64
        })
        .sum();
    WEIGHT * update < factorisation
}

fn products(x: &[[f64; BLOCK]], y: &[[f64; BLOCK]], rows: &[usize]) -> [[f64; BLOCK]; BLOCK] {
    let mut out = [[0.0; BLOCK]; BLOCK];
    for row in rows {
        let (a, b) = (&x[*row], &y[*row]);
        if *b == [0.0; BLOCK] {
            continue;
        }
        for (sum, a) in out.iter_mut().zip(a) {
            for (s, b) in sum.iter_mut().zip(b) {
                *s += a * b;
            }
        }
    }
    out
}

/// Largest sum of magnitudes in a column.
fn norm(m: &DMatrix<f64>) -> f64 {
    m.column_iter()
        .map(|c| c.iter().map(|v| v.abs()).sum())
        .fold(0.0, f64::max)
}
