//! The Newton system `(rho^2 I + A_P A_P^T) d = f`, rho the ridge, for a passive set P that changes from step to step.

use crate::linalg::aligned::Aligned;
use crate::linalg::block::{self, WIDTH};
use crate::linalg::columns::Columns;
use crate::linalg::dense::{PACK, add_outer, backward, cholesky, forward};

/// Columns by which P may differ from the factor's set before the factor is made again: one block.
const MOST_PENDING: usize = WIDTH;
/// Least pivot of the capacitance matrix. A pivot is at most 1 for a column to take away; a small one costs digits,
/// with 0.03 one or two of sixteen.
const LEAST_PIVOT: f64 = 0.03;
/// Columns added and taken away before the sum is formed afresh. Its rounding then stays far below the tolerance.
const REFRESH: usize = 50_000;

/// `A_P A_P^T` and its factor, kept up to date by the columns that enter and leave.
///
/// The factor belongs to the set at the last factorisation. A few columns more or less come in through the formula of
/// Sherman, Morrison and Woodbury, with its small "capacitance" matrix.
#[derive(Clone, Debug)]
pub(super) struct Factor {
    /// Whether a column is in the sum `gram`.
    in_sum: Vec<bool>,
    /// Whether a column is in P.
    in_set: Vec<bool>,
    /// Columns in P.
    members: usize,
    /// `A A^T` of the columns in the sum.
    gram: Aligned,
    /// Columns moved since the sum was last formed afresh.
    moved: usize,
    /// Cholesky factor of the sum with the ridge.
    lower: Aligned,
    /// One over the factor's diagonal.
    inverse: Vec<f64>,
    /// The squared ridge of `lower`; NaN when there is no factor.
    ridge_squared: f64,
    /// Columns by which P differs from the sum: +1 for one to add, -1 for one to take away.
    pending: Vec<(usize, f64)>,
    /// Index of a pending column in `pending`.
    slots: Vec<usize>,
    /// The pending columns that `solved` and `capacitance` belong to.
    prepared: Vec<(usize, f64)>,
    /// `L^-1 a` of the pending columns, row by row.
    solved: Aligned,
    /// Factor of the capacitance matrix, row by row.
    capacitance: Vec<f64>,
    /// Columns on their way into the sum.
    pack: Aligned,
}

impl Factor {
    /// The empty set of columns of a matrix.
    pub(super) fn new(columns: &Columns) -> Self {
        let (rows, cells) = (columns.rows(), columns.cells());
        Self {
            in_sum: vec![false; cells],
            in_set: vec![false; cells],
            members: 0,
            slots: vec![0; cells],
            gram: Aligned::zeros(rows * rows),
            moved: 0,
            lower: Aligned::zeros(rows * rows),
            inverse: vec![0.0; rows],
            ridge_squared: f64::NAN,
            pending: Vec::with_capacity(cells),
            prepared: Vec::with_capacity(WIDTH),
            solved: Aligned::zeros(rows * WIDTH),
            capacitance: vec![0.0; WIDTH * WIDTH],
            pack: Aligned::zeros(PACK * rows),
        }
    }

    /// Sets P to the columns with `g > 0`.
    pub(super) fn set(&mut self, g: &[f64]) {
        for (j, g) in g.iter().enumerate() {
            if self.in_set[j] != (*g > 0.0) {
                self.toggle(j);
            }
        }
    }

    /// Adds a column to P, or removes it.
    pub(super) fn toggle(&mut self, j: usize) {
        self.in_set[j] = !self.in_set[j];
        self.members = if self.in_set[j] {
            self.members + 1
        } else {
            self.members - 1
        };
        if self.in_set[j] == self.in_sum[j] {
            let slot = self.slots[j];
            self.pending.swap_remove(slot);
            if let Some((moved, _)) = self.pending.get(slot) {
                self.slots[*moved] = slot;
            }
        } else {
            self.slots[j] = self.pending.len();
            self.pending.push((j, if self.in_sum[j] { -1.0 } else { 1.0 }));
        }
    }

    /// Prepares to solve for P at a squared ridge. False when rounding makes the system not positive definite; a second
    /// try may then succeed.
    pub(super) fn prepare(&mut self, columns: &Columns, ridge_squared: f64) -> bool {
        if self.ridge_squared == ridge_squared
            && self.pending.len() <= MOST_PENDING
            && self.prepare_capacitance(columns)
        {
            return true;
        }
        if self.moved + self.pending.len() > REFRESH || self.pending.len() > self.members {
            self.clear_sum();
        }
        self.moved += self.pending.len();
        self.accumulate::<false>(columns, 1.0);
        self.accumulate::<true>(columns, -1.0);
        for (j, sign) in self.pending.drain(..) {
            self.in_sum[j] = sign > 0.0;
        }
        self.prepared.clear();
        self.lower.copy_from_slice(&self.gram);
        for k in 0..columns.rows() {
            self.lower[k * (columns.rows() + 1)] += ridge_squared;
        }
        let done = cholesky(columns.arch(), &mut self.lower, &mut self.inverse);
        self.ridge_squared = if done { ridge_squared } else { f64::NAN };
        if !done {
            // The rounding of columns long gone may be the cause: the next sum is formed afresh.
            self.clear_sum();
        }
        done
    }

    /// Makes the next preparation factorise, however few columns have moved.
    pub(super) fn invalidate(&mut self) {
        self.ridge_squared = f64::NAN;
    }

    /// Makes the sum and the factor NaN.
    #[cfg(test)]
    pub(super) fn spoil(&mut self) {
        self.gram.fill(f64::NAN);
        self.lower.fill(f64::NAN);
    }

    /// Makes P the empty set, as if there had been no other.
    pub(super) fn clear(&mut self) {
        self.in_set.fill(false);
        self.members = 0;
        self.clear_sum();
        self.prepared.clear();
    }

    /// Empties the sum; all of P is pending again.
    pub(super) fn clear_sum(&mut self) {
        self.in_sum.fill(false);
        self.gram.fill(0.0);
        self.moved = 0;
        self.ridge_squared = f64::NAN;
        self.pending.clear();
        for (j, _) in self.in_set.iter().enumerate().filter(|(_, in_set)| **in_set) {
            self.slots[j] = self.pending.len();
            self.pending.push((j, 1.0));
        }
    }

    /// Adds or takes away the pending columns of one sign.
    fn accumulate<const MINUS: bool>(&mut self, columns: &Columns, sign: f64) {
        let rows = columns.rows();
        let mut chosen = self.pending.iter().filter(|(_, s)| *s == sign);
        loop {
            let mut count = 0;
            for ((j, _), to) in chosen.by_ref().take(PACK).zip(self.pack.chunks_exact_mut(rows)) {
                to.copy_from_slice(columns.column(*j));
                count += 1;
            }
            if count == 0 {
                return;
            }
            add_outer::<MINUS>(columns.arch(), &mut self.gram, rows, &self.pack[..count * rows]);
        }
    }

    /// The capacitance matrix `S + W^T W` with `W = L^-1 A_pending` and the signs S, factored as `U^T D^-1 U`, D the
    /// diagonal of U.
    fn prepare_capacitance(&mut self, columns: &Columns) -> bool {
        if self.pending == self.prepared {
            return true;
        }
        self.prepared.clear();
        let arch = columns.arch();
        // Vectors hold more columns than are pending. Those of an earlier set would be solved for again and again, and
        // grow without end.
        self.solved.fill(0.0);
        for (k, (j, _)) in self.pending.iter().enumerate() {
            for (row, value) in self.solved.chunks_exact_mut(WIDTH).zip(columns.column(*j)) {
                row[k] = *value;
            }
        }
        block::forward(arch, &self.lower, &self.inverse, &mut self.solved, self.pending.len());
        block::gram(arch, &self.solved, &mut self.capacitance);
        for (k, (_, sign)) in self.pending.iter().enumerate() {
            self.capacitance[k * WIDTH + k] += sign;
        }
        let count = self.pending.len();
        for k in 0..count {
            let pivot = self.capacitance[k * WIDTH + k];
            // A column that alone holds up a direction would be taken away by a division by nearly nothing.
            if !(pivot.abs() > LEAST_PIVOT && pivot.is_finite()) {
                return false;
            }
            for i in k + 1..count {
                let factor = self.capacitance[k * WIDTH + i] / pivot;
                for j in i..count {
                    let value = factor * self.capacitance[k * WIDTH + j];
                    self.capacitance[i * WIDTH + j] -= value;
                }
            }
        }
        self.prepared.extend_from_slice(&self.pending);
        true
    }

    /// Solves in place for the set prepared last.
    pub(super) fn solve(&self, columns: &Columns, y: &mut [f64]) {
        let (arch, count) = (columns.arch(), self.pending.len());
        forward(arch, &self.lower, &self.inverse, y);
        if count > 0 {
            let mut z = [0.0; WIDTH];
            block::dots(arch, &self.solved, y, &mut z);
            for k in 0..count {
                for i in k + 1..count {
                    z[i] -= self.capacitance[k * WIDTH + i] / self.capacitance[k * WIDTH + k] * z[k];
                }
            }
            for k in (0..count).rev() {
                let known: f64 = (k + 1..count).map(|i| self.capacitance[k * WIDTH + i] * z[i]).sum();
                z[k] = (z[k] - known) / self.capacitance[k * WIDTH + k];
            }
            z[count..].fill(0.0);
            block::subtract(arch, &self.solved, &z, y);
        }
        backward(arch, &self.lower, &self.inverse, y);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use rand::rngs::StdRng;
    use rand::{Rng, SeedableRng};

    /// The solution is that of the set, in however many steps the set came about.
    #[test]
    fn any_number_of_small_changes_solves_for_the_set() {
        let mut rng = StdRng::seed_from_u64(4);
        let (rows, cells, ridge_squared) = (32, 96, 1e-4);
        let a = DMatrix::from_fn(rows, cells, |i, _| rng.random_range(-0.1..0.1) * 0.8_f64.powi(i as i32));
        let columns = Columns::new(&a, 1.0);
        let mut factor = Factor::new(&columns);
        for round in 0..4000 {
            // Now and then more columns than the formula takes, so that the factor is made again. Then a few, then the
            // same three.
            let (moves, among) = match round % 1000 {
                0 => (40, cells),
                1..500 => (rng.random_range(1..6), cells),
                _ => (1, 3),
            };
            for _ in 0..moves {
                factor.toggle(rng.random_range(0..among));
            }
            assert!(
                factor.prepare(&columns, ridge_squared) || factor.prepare(&columns, ridge_squared),
                "round {round}"
            );
            let right = DVector::from_fn(rows, |_, _| rng.random_range(-1.0..1.0));
            let mut y = Aligned::zeros(rows);
            y.copy_from_slice(right.as_slice());
            factor.solve(&columns, &mut y);
            let y = DVector::from_column_slice(&y);
            let mut again = &y * ridge_squared;
            for (j, _) in factor.in_set.iter().enumerate().filter(|(_, in_set)| **in_set) {
                again += a.column(j) * a.column(j).dot(&y);
            }
            assert!((again - &right).norm() < 1e-6 * right.norm(), "round {round}");
        }
    }
}
