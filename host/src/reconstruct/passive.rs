//! The passive set of plain non-negative least squares: a few columns, scaled to norm 1, with the Cholesky factor of their
//! products as they come and go.

use super::aligned::Aligned;
use super::columns::Columns;

/// Least squared distance of a column of norm 1 from the span of those chosen before; a closer one is taken as dependent.
const LEAST_DISTANCE: f64 = 1e-13;

/// Columns chosen, their factor and their values.
#[derive(Clone, Debug)]
pub(super) struct Passive {
    members: Vec<usize>,
    /// Values of the members, in units of columns of norm 1.
    values: Vec<f64>,
    /// Lower triangle, row by row with a stride of `most`.
    factor: Vec<f64>,
    most: usize,
    /// `b - A x`.
    residual: Aligned,
    target: Vec<f64>,
    products: Vec<f64>,
}

impl Passive {
    /// No column; at most as many as there are rows.
    pub(super) fn new(columns: &Columns) -> Self {
        let most = columns.rows();
        Self {
            members: Vec::with_capacity(most),
            values: Vec::with_capacity(most),
            factor: vec![0.0; most * most],
            most,
            residual: Aligned::zeros(most),
            target: Vec::with_capacity(most),
            products: Vec::with_capacity(most),
        }
    }

    /// Takes every column out.
    pub(super) fn clear(&mut self) {
        self.members.clear();
        self.values.clear();
    }

    /// Indices of the columns.
    #[inline(always)]
    pub(super) fn members(&self) -> &[usize] {
        &self.members
    }

    /// Their values, for columns of norm 1.
    #[inline(always)]
    pub(super) fn values(&self) -> &[f64] {
        &self.values
    }

    /// `b - A x` as of the last [`Passive::update`].
    #[inline(always)]
    pub(super) fn residual(&self) -> &[f64] {
        &self.residual
    }

    /// Computes the residual afresh.
    #[inline(always)]
    pub(super) fn update(&mut self, columns: &Columns, b: &[f64], list: &mut Vec<(usize, f64)>) {
        list.clear();
        list.extend(
            self.members
                .iter()
                .zip(&self.values)
                .map(|(j, x)| (*j, -x / columns.norms()[*j])),
        );
        self.residual.copy_from_slice(b);
        columns.add(list, &mut self.residual);
    }

    /// Adds a column with value 0; false when it depends on those chosen.
    #[inline(always)]
    pub(super) fn insert(&mut self, columns: &Columns, j: usize) -> bool {
        let (count, norms) = (self.members.len(), columns.norms());
        if count == self.most || !(norms[j] > 0.0) {
            return false;
        }
        let column = columns.column(j);
        let (above, row) = self.factor.split_at_mut(count * self.most);
        let mut left = 1.0;
        columns.dots_of(&self.members, column, &mut self.products);
        let chosen = self
            .members
            .iter()
            .zip(&self.products)
            .zip(above.chunks_exact(self.most));
        for (k, ((member, product), above)) in chosen.enumerate() {
            let product = product / (norms[*member] * norms[j]);
            row[k] = (product - dot_short(&above[..k], &row[..k])) / above[k];
            left -= row[k] * row[k];
        }
        if !(left > LEAST_DISTANCE) {
            return false;
        }
        row[count] = left.sqrt();
        self.members.push(j);
        self.values.push(0.0);
        true
    }

    /// Takes the k-th column out.
    #[inline(always)]
    fn remove(&mut self, k: usize) {
        self.members.remove(k);
        self.values.remove(k);
        let most = self.most;
        for row in k..self.members.len() {
            let (to, from) = self.factor.split_at_mut((row + 1) * most);
            to[row * most..row * most + row + 2].copy_from_slice(&from[..row + 2]);
        }
        // What sticks out above the diagonal is turned back in, two columns at a time.
        for column in k..self.members.len() {
            let pair = &self.factor[column * most + column..][..2];
            let length = (pair[0] * pair[0] + pair[1] * pair[1]).sqrt();
            let (cos, sin) = (pair[0] / length, pair[1] / length);
            for row in self.factor.chunks_exact_mut(most).take(self.members.len()).skip(column) {
                let (p, q) = (row[column], row[column + 1]);
                row[column] = cos * p + sin * q;
                row[column + 1] = cos * q - sin * p;
            }
        }
    }

    /// The least squares values of the members into `target`, as a correction from the residual: rounding in the factor
    /// shrinks from one call to the next. `only_last` when the residual is orthogonal to all members but the last.
    #[inline(always)]
    fn aim(&mut self, columns: &Columns, only_last: bool) {
        let (count, most, norms) = (self.members.len(), self.most, columns.norms());
        let first = if only_last { count.saturating_sub(1) } else { 0 };
        self.target.clear();
        self.target.resize(first, 0.0);
        columns.dots_of(&self.members[first..], &self.residual, &mut self.products);
        for (k, (j, product)) in self.members[first..].iter().zip(&self.products).enumerate() {
            let k = first + k;
            let row = &self.factor[k * most..k * most + k + 1];
            let value = (product / norms[*j] - dot_short(&row[first..k], &self.target[first..])) / row[k];
            self.target.push(value);
        }
        for k in (0..count).rev() {
            let row = &self.factor[k * most..k * most + k + 1];
            let value = self.target[k] / row[k];
            self.target[k] = value;
            for (target, l) in self.target.iter_mut().zip(&row[..k]) {
                *target -= l * value;
            }
        }
        for (target, value) in self.target.iter_mut().zip(&self.values) {
            *target += value;
        }
    }

    /// Goes to the least squares values as far as no value falls below zero, and takes out those that reach it, until
    /// none is in the way. Returns how often it solved.
    ///
    /// When the column that entered last would fall at once, it is there by rounding only: it is taken out, and the
    /// answer is 0.
    #[inline(always)]
    pub(super) fn settle(&mut self, columns: &Columns, b: &[f64], list: &mut Vec<(usize, f64)>) -> usize {
        let mut solves = 0;
        let entering = self.members.last().copied();
        loop {
            self.aim(columns, self.members.last().copied() == entering);
            solves += 1;
            if solves == 1 && self.values.last() == Some(&0.0) && !self.target.last().is_some_and(|t| *t > 0.0) {
                self.remove(self.members.len() - 1);
                return 0;
            }
            let mut step = 1.0_f64;
            for (value, target) in self.values.iter().zip(&self.target) {
                if *target <= 0.0 {
                    step = step.min(value / (value - target));
                }
            }
            for (value, target) in self.values.iter_mut().zip(&self.target) {
                *value = if step < 1.0 {
                    *value + step * (target - *value)
                } else {
                    *target
                };
            }
            let blocked = step < 1.0;
            if blocked {
                self.take_out(1e-14);
            }
            self.update(columns, b, list);
            if !blocked {
                return solves;
            }
        }
    }

    /// Solves once more for the present members from the residual, for the last digits.
    #[inline(always)]
    pub(super) fn refine(&mut self, columns: &Columns, b: &[f64], list: &mut Vec<(usize, f64)>) {
        self.aim(columns, false);
        if self.target.iter().all(|t| *t > 0.0) {
            self.values.copy_from_slice(&self.target);
            self.update(columns, b, list);
        }
    }

    /// Starts a new right-hand side from the columns of the last: those that would fall below zero are taken out, all at
    /// once, until none would. Returns how often it solved.
    #[inline(always)]
    pub(super) fn restart(&mut self, columns: &Columns, b: &[f64], list: &mut Vec<(usize, f64)>) -> usize {
        let mut solves = 0;
        while !self.members.is_empty() {
            self.update(columns, b, list);
            self.aim(columns, false);
            solves += 1;
            let fine = self.target.iter().all(|t| *t > 0.0);
            self.values.copy_from_slice(&self.target);
            if fine {
                break;
            }
            self.take_out(0.0);
        }
        self.update(columns, b, list);
        solves
    }

    /// Takes out the columns whose value is at most `least` times the largest.
    #[inline(always)]
    fn take_out(&mut self, least: f64) {
        let limit = least * self.values.iter().copied().fold(0.0, f64::max);
        for k in (0..self.members.len()).rev() {
            if !(self.values[k] > limit) {
                self.remove(k);
            }
        }
    }
}

#[inline(always)]
fn dot_short(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len().min(b.len());
    let (whole_a, rest_a) = a[..n].as_chunks::<8>();
    let (whole_b, rest_b) = b[..n].as_chunks::<8>();
    let mut sums = [0.0; 8];
    for (a, b) in whole_a.iter().zip(whole_b) {
        for k in 0..8 {
            sums[k] += a[k] * b[k];
        }
    }
    let rest: f64 = rest_a.iter().zip(rest_b).map(|(a, b)| a * b).sum();
    rest + sums.iter().sum::<f64>()
}
