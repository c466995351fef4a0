//! The Newton system `(rho^2 I + A_P A_P^T) d = f` for a set P of columns that changes from step to step.

use crate::linalg::aligned::Aligned;
use crate::linalg::block::{self, WIDTH};
use crate::linalg::columns::Columns;
use crate::linalg::dense::{PACK, add_outer, backward, cholesky, forward};

/// Columns by which P may differ from the factor's set before the factor is made again.
const MOST_PENDING: usize = WIDTH;
/// Least pivot of the small system, which is at most 1 for a column to take away; a smaller one costs digits.
const LEAST_PIVOT: f64 = 0.03;
/// Columns added and taken away before the sum is formed afresh, so that rounding does not pile up.
const REFRESH: usize = 50_000;

/// `A_P A_P^T` and its factor, kept up to date by the columns that enter and leave.
///
/// The factor belongs to the set at its last factorisation; a few columns more or less are brought in through the
/// formula of Sherman, Morrison and Woodbury.
#[derive(Clone, Debug)]
pub(super) struct Factor {
    /// Whether a column is in the sum.
    inside: Vec<bool>,
    /// Whether it is in P, and how many are.
    wanted: Vec<bool>,
    members: usize,
    gram: Aligned,
    /// Columns moved since the sum was last formed afresh.
    moved: usize,
    lower: Aligned,
    inverse: Vec<f64>,
    /// The ridge squared of `lower`; NaN when there is no factor.
    square: f64,
    /// Columns that differ, with +1 for one to add and -1 for one to take away.
    pending: Vec<(usize, f64)>,
    /// Where a pending column stands in the list.
    slots: Vec<usize>,
    /// The pending columns that `solved` and `small` belong to.
    prepared: Vec<(usize, f64)>,
    /// `L^-1 a` of the pending columns, row by row.
    solved: Aligned,
    /// Factor of the small system, row by row.
    small: Vec<f64>,
    pack: Aligned,
}

impl Factor {
    /// An empty set of the columns of a matrix.
    pub(super) fn new(columns: &Columns) -> Self {
        let (rows, cells) = (columns.rows(), columns.cells());
        Self {
            inside: vec![false; cells],
            wanted: vec![false; cells],
            members: 0,
            slots: vec![0; cells],
            gram: Aligned::zeros(rows * rows),
            moved: 0,
            lower: Aligned::zeros(rows * rows),
            inverse: vec![0.0; rows],
            square: f64::NAN,
            pending: Vec::with_capacity(cells),
            prepared: Vec::with_capacity(WIDTH),
            solved: Aligned::zeros(rows * WIDTH),
            small: vec![0.0; WIDTH * WIDTH],
            pack: Aligned::zeros(PACK * rows),
        }
    }

    /// Sets P to the columns with `g > 0`.
    pub(super) fn set(&mut self, g: &[f64]) {
        for (j, g) in g.iter().enumerate() {
            if self.wanted[j] != (*g > 0.0) {
                self.toggle(j);
            }
        }
    }

    /// Takes a column into P or out of it.
    pub(super) fn toggle(&mut self, j: usize) {
        self.wanted[j] = !self.wanted[j];
        self.members = if self.wanted[j] {
            self.members + 1
        } else {
            self.members - 1
        };
        if self.wanted[j] == self.inside[j] {
            let slot = self.slots[j];
            self.pending.swap_remove(slot);
            if let Some((moved, _)) = self.pending.get(slot) {
                self.slots[*moved] = slot;
            }
        } else {
            self.slots[j] = self.pending.len();
            self.pending.push((j, if self.inside[j] { -1.0 } else { 1.0 }));
        }
    }

    /// Prepares to solve for P. False when the system is not positive definite in rounding; one more try may then do.
    pub(super) fn prepare(&mut self, columns: &Columns, square: f64) -> bool {
        if self.square == square && self.pending.len() <= MOST_PENDING && self.prepare_small(columns) {
            return true;
        }
        if self.moved + self.pending.len() > REFRESH || self.pending.len() > self.members {
            self.forget();
        }
        self.moved += self.pending.len();
        self.accumulate::<false>(columns, 1.0);
        self.accumulate::<true>(columns, -1.0);
        for (j, sign) in self.pending.drain(..) {
            self.inside[j] = sign > 0.0;
        }
        self.prepared.clear();
        self.lower.copy_from_slice(&self.gram);
        for k in 0..columns.rows() {
            self.lower[k * (columns.rows() + 1)] += square;
        }
        let done = cholesky(columns.arch(), &mut self.lower, &mut self.inverse);
        self.square = if done { square } else { f64::NAN };
        if !done {
            // What rounding left of columns long gone may be the cause: the next sum is formed afresh.
            self.forget();
        }
        done
    }

    /// Makes the next preparation factorise, though few columns may have moved.
    pub(super) fn distrust(&mut self) {
        self.square = f64::NAN;
    }

    /// Leaves nothing of the sum and the factor that is a number.
    #[cfg(test)]
    pub(super) fn spoil(&mut self) {
        self.gram.fill(f64::NAN);
        self.lower.fill(f64::NAN);
    }

    /// Empties the sum; all of P is pending again.
    pub(super) fn forget(&mut self) {
        self.inside.fill(false);
        self.gram.fill(0.0);
        self.moved = 0;
        self.square = f64::NAN;
        self.pending.clear();
        for (j, _) in self.wanted.iter().enumerate().filter(|(_, wanted)| **wanted) {
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

    /// The small system `S + W^T W`, `W = L^-1 A_pending`, S the signs, as `U^T D^-1 U` with D on the diagonal of U.
    fn prepare_small(&mut self, columns: &Columns) -> bool {
        if self.pending == self.prepared {
            return true;
        }
        self.prepared.clear();
        let arch = columns.arch();
        // Vectors hold more columns than there are: what an earlier set left there would grow without end, solved for again
        // and again.
        self.solved.fill(0.0);
        for (k, (j, _)) in self.pending.iter().enumerate() {
            for (row, value) in self.solved.chunks_exact_mut(WIDTH).zip(columns.column(*j)) {
                row[k] = *value;
            }
        }
        block::forward(arch, &self.lower, &self.inverse, &mut self.solved, self.pending.len());
        block::gram(arch, &self.solved, &mut self.small);
        for (k, (_, sign)) in self.pending.iter().enumerate() {
            self.small[k * WIDTH + k] += sign;
        }
        let count = self.pending.len();
        for k in 0..count {
            let pivot = self.small[k * WIDTH + k];
            // Taking away a column that alone holds up a direction divides by next to nothing.
            if !(pivot.abs() > LEAST_PIVOT && pivot.is_finite()) {
                return false;
            }
            for i in k + 1..count {
                let factor = self.small[k * WIDTH + i] / pivot;
                for j in i..count {
                    let value = factor * self.small[k * WIDTH + j];
                    self.small[i * WIDTH + j] -= value;
                }
            }
        }
        self.prepared.extend_from_slice(&self.pending);
        true
    }

    /// Solves in place for the set last prepared.
    pub(super) fn solve(&self, columns: &Columns, y: &mut [f64]) {
        let (arch, count) = (columns.arch(), self.pending.len());
        forward(arch, &self.lower, &self.inverse, y);
        if count > 0 {
            let mut z = [0.0; WIDTH];
            block::dots(arch, &self.solved, y, &mut z);
            for k in 0..count {
                for i in k + 1..count {
                    z[i] -= self.small[k * WIDTH + i] / self.small[k * WIDTH + k] * z[k];
                }
            }
            for k in (0..count).rev() {
                let known: f64 = (k + 1..count).map(|i| self.small[k * WIDTH + i] * z[i]).sum();
                z[k] = (z[k] - known) / self.small[k * WIDTH + k];
            }
            z[count..].fill(0.0);
            block::subtract(arch, &self.solved, &z, y);
        }
        backward(arch, &self.lower, &self.inverse, y);
    }
}

/// Scalar product in eight sums, so that the compiler can use the vector unit.
#[inline(always)]
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    for (a, b) in a.as_chunks::<8>().0.iter().zip(b.as_chunks::<8>().0) {
        for k in 0..8 {
            sums[k] += a[k] * b[k];
        }
    }
    sums.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use rand::rngs::StdRng;
    use rand::{Rng, SeedableRng};

    /// However the set came about, in however many steps, the solution is that of the set.
    #[test]
    fn any_number_of_small_changes_solves_for_the_set() {
        let mut rng = StdRng::seed_from_u64(4);
        let (rows, cells, square) = (32, 96, 1e-4);
        let a = DMatrix::from_fn(rows, cells, |i, _| rng.random_range(-0.1..0.1) * 0.8_f64.powi(i as i32));
        let columns = Columns::new(&a, 1.0);
        let mut factor = Factor::new(&columns);
        for round in 0..4000 {
            // Now and then more than the formula takes, so that the factor follows; then a few, then the same three for long.
            let (moves, among) = match round % 1000 {
                0 => (40, cells),
                1..500 => (rng.random_range(1..6), cells),
                _ => (1, 3),
            };
            for _ in 0..moves {
                factor.toggle(rng.random_range(0..among));
            }
            assert!(
                factor.prepare(&columns, square) || factor.prepare(&columns, square),
                "round {round}"
            );
            let right = DVector::from_fn(rows, |_, _| rng.random_range(-1.0..1.0));
            let mut y = Aligned::zeros(rows);
            y.copy_from_slice(right.as_slice());
            factor.solve(&columns, &mut y);
            let y = DVector::from_column_slice(&y);
            let mut again = &y * square;
            for (j, _) in factor.wanted.iter().enumerate().filter(|(_, wanted)| **wanted) {
                again += a.column(j) * a.column(j).dot(&y);
            }
            assert!((again - &right).norm() < 1e-6 * right.norm(), "round {round}");
        }
    }
}
