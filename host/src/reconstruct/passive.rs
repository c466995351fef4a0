//! The passive set of plain non-negative least squares: a few columns, scaled to norm 1, with the inverse of the Cholesky
//! factor of their products as they come and go.
//!
//! With the inverse at hand nothing has to be solved for: when a column enters a set whose gradient is zero, the way to the
//! new least squares values is the inverse's last row.

use super::aligned::Aligned;
use super::columns::Columns;
use super::kernels::{LANES, padded};
use super::products::Products;

/// Least squared distance of a column of norm 1 from the span of those chosen before; a closer one is taken as dependent.
const LEAST_DISTANCE: f64 = 1e-13;
/// Share of the largest value at which a member has reached zero.
const REACHED: f64 = 1e-14;
/// Columns that came and went before the inverse is made afresh, so that rounding does not pile up.
const REFRESH: usize = 2000;

/// Columns chosen, their inverse factor and their values.
#[derive(Clone, Debug)]
pub(super) struct Passive {
    members: Vec<usize>,
    /// Values of the members, in units of columns of norm 1.
    values: Vec<f64>,
    /// Lower triangle, row by row with a stride; zero from the diagonal to the next multiple of [`LANES`].
    inverse: Aligned,
    stride: usize,
    most: usize,
    moves: usize,
    /// `b - A x`.
    residual: Aligned,
    /// One over the norms of all columns; 0 for a column of zeros.
    scales: Vec<f64>,
    products: Option<Products>,
    list: Vec<(usize, f64)>,
    /// Gradients of the members while all are on their way to 0.
    gradients: Vec<f64>,
    dots: Vec<f64>,
    right: Aligned,
    half: Aligned,
    step: Aligned,
}

impl Passive {
    /// No column; at most as many as there are rows.
    pub(super) fn new(columns: &Columns) -> Self {
        let most = columns.rows();
        let stride = padded(most, LANES);
        Self {
            members: Vec::with_capacity(most),
            values: Vec::with_capacity(most),
            inverse: Aligned::zeros(most * stride),
            stride,
            most,
            moves: 0,
            residual: Aligned::zeros(most),
            scales: columns
                .norms()
                .iter()
                .map(|n| if *n >= f64::MIN_POSITIVE { 1.0 / n } else { 0.0 })
                .collect(),
            products: Products::new(columns),
            list: Vec::with_capacity(most),
            gradients: Vec::with_capacity(most),
            dots: Vec::with_capacity(most),
            right: Aligned::zeros(stride),
            half: Aligned::zeros(stride),
            step: Aligned::zeros(stride + LANES),
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

    /// One over the norm of every column; 0 for a column of zeros.
    #[inline(always)]
    pub(super) fn scales(&self) -> &[f64] {
        &self.scales
    }

    /// Computes the residual afresh.
    #[inline(always)]
    pub(super) fn update(&mut self, columns: &Columns, b: &[f64]) {
        self.list.clear();
        let each = self.members.iter().zip(&self.values);
        self.list.extend(each.map(|(j, x)| (*j, -x * self.scales[*j])));
        self.residual.copy_from_slice(b);
        columns.add(&self.list, &mut self.residual);
    }

    /// `a_j . (b - A x)` for a column scaled to norm 1 and the values as they are now.
    #[inline(always)]
    pub(super) fn gradient(&self, columns: &Columns, b: &[f64], j: usize) -> f64 {
        let Some(products) = &self.products else {
            return dot(columns.column(j), &self.residual) * self.scales[j];
        };
        // Four sums, so that none waits for the one before.
        let mut sums = [0.0; 4];
        let (members, rest) = self.members.as_chunks::<4>();
        let (values, values_of_rest) = self.values.as_chunks::<4>();
        for (members, values) in members.iter().zip(values) {
            for k in 0..4 {
                sums[k] += values[k] * products.of(members[k], j);
            }
        }
        for (member, value) in rest.iter().zip(values_of_rest) {
            sums[0] += value * products.of(*member, j);
        }
        dot(columns.column(j), b) * self.scales[j] - ((sums[0] + sums[1]) + (sums[2] + sums[3]))
    }

    /// Lets a column in whose gradient is this, above 0 while that of the members is 0, and goes to the least squares values; members
    /// that would fall below zero are taken out on the way. False when the column depends on those chosen, or nothing moves.
    #[inline(always)]
    pub(super) fn enter(&mut self, columns: &Columns, b: &[f64], j: usize, gradient: f64) -> bool {
        let moved = self.insert(columns, j) && self.go(j, gradient);
        if self.products.is_none() {
            self.update(columns, b);
        }
        moved
    }

    /// Goes to the least squares values after the j-th column has entered.
    #[inline(always)]
    fn go(&mut self, j: usize, gradient: f64) -> bool {
        let (mut left, mut moved) = (gradient, false);
        loop {
            let count = self.members.len();
            let row = &self.inverse[(count - 1) * self.stride..][..count];
            let scale = left * row[count - 1];
            for (step, r) in self.step.iter_mut().zip(row) {
                *step = scale * r;
            }
            let share = advance(&mut self.values, &self.step);
            moved |= share > 0.0;
            if !(share < 1.0) {
                return moved;
            }
            left *= 1.0 - share;
            self.take_out();
            if self.members.last() != Some(&j) {
                // It came no further than rounding.
                return false;
            }
        }
    }

    /// Adds a column with value 0; false when it depends on those chosen.
    #[inline(always)]
    fn insert(&mut self, columns: &Columns, j: usize) -> bool {
        let count = self.members.len();
        if count == self.most || !(self.scales[j] > 0.0) {
            return false;
        }
        if let Some(products) = &mut self.products {
            products.want(columns, &self.scales, j);
            for (right, member) in self.right.iter_mut().zip(&self.members) {
                *right = products.of(*member, j);
            }
        } else {
            columns.dots_of(&self.members, columns.column(j), &mut self.dots);
            for (right, (member, dot)) in self.right.iter_mut().zip(self.members.iter().zip(&self.dots)) {
                *right = dot * self.scales[*member] * self.scales[j];
            }
        }
        self.right[count..padded(count, LANES)].fill(0.0);
        self.halve();
        let distance = 1.0 - dot(&self.half[..padded(count, LANES)], &self.half[..padded(count, LANES)]);
        if !(distance > LEAST_DISTANCE) {
            return false;
        }
        self.back();
        let one_over = 1.0 / distance.sqrt();
        let row = &mut self.inverse[count * self.stride..][..padded(count + 1, LANES)];
        for (to, from) in row.iter_mut().zip(self.step.iter()) {
            *to = -from * one_over;
        }
        row[count] = one_over;
        self.members.push(j);
        self.values.push(0.0);
        self.moves += 1;
        true
    }

    /// `half = L^-1 right`.
    #[inline(always)]
    fn halve(&mut self) {
        let count = self.members.len();
        let rows = self.inverse.chunks_exact(self.stride.max(1)).take(count);
        for (k, (half, row)) in self.half.iter_mut().zip(rows).enumerate() {
            let length = padded(k + 1, LANES);
            *half = dot(&row[..length], &self.right[..length]);
        }
        self.half[count..padded(count, LANES)].fill(0.0);
    }

    /// `step = L^-T half`.
    #[inline(always)]
    fn back(&mut self) {
        let count = self.members.len();
        self.step[..padded(count + 1, LANES)].fill(0.0);
        let rows = self.inverse.chunks_exact(self.stride.max(1)).take(count);
        for (k, (half, row)) in self.half.iter().zip(rows).enumerate() {
            let length = padded(k + 1, LANES);
            for (step, r) in self.step[..length].iter_mut().zip(&row[..length]) {
                *step += half * r;
            }
        }
    }

    /// Takes the k-th column out.
    ///
    /// Rows are turned into one another so that the column of the inverse that goes becomes zero but for its last entry, which goes
    /// with its row.
    #[inline(always)]
    fn remove(&mut self, k: usize) {
        let (stride, last) = (self.stride, self.members.len() - 1);
        for i in k..last {
            let (upper, lower) = self.inverse.split_at_mut((i + 1) * stride);
            let length = padded(i + 2, LANES);
            let (upper, lower) = (&mut upper[i * stride..][..length], &mut lower[..length]);
            if i % LANES == LANES - 1 {
                // The upper row grows into a register that it did not use.
                upper[i + 1..].fill(0.0);
            }
            let (p, q) = (upper[k], lower[k]);
            let length = (p * p + q * q).sqrt();
            let (cos, sin) = (q / length, p / length);
            for (u, l) in upper.iter_mut().zip(lower) {
                (*u, *l) = (sin * *l - cos * *u, sin * *u + cos * *l);
            }
        }
        for i in k..last {
            let row = &mut self.inverse[i * stride..(i + 1) * stride];
            row.copy_within(k + 1..i + 2, k);
            row[i + 1..padded(i + 2, LANES)].fill(0.0);
        }
        self.members.remove(k);
        self.values.remove(k);
        if k < self.gradients.len() {
            self.gradients.remove(k);
        }
        self.moves += 1;
    }

    /// Goes to the least squares values of the members for a right-hand side, as a correction from the residual: what rounding left in
    /// the inverse shrinks from one call to the next. Those that reach zero on the way are taken out. Returns how often it solved.
    #[inline(always)]
    pub(super) fn refine(&mut self, columns: &Columns, b: &[f64]) -> usize {
        self.update(columns, b);
        columns.dots_of(&self.members, &self.residual, &mut self.gradients);
        for (gradient, j) in self.gradients.iter_mut().zip(&self.members) {
            *gradient *= self.scales[*j];
        }
        let mut solves = 0;
        loop {
            let count = self.members.len();
            self.right[..count].copy_from_slice(&self.gradients);
            self.right[count..padded(count, LANES)].fill(0.0);
            self.halve();
            self.back();
            solves += 1;
            let share = advance(&mut self.values, &self.step);
            if !(share < 1.0) {
                self.gradients.clear();
                return solves;
            }
            // A part of the way takes the same part of every member's gradient.
            for gradient in &mut self.gradients {
                *gradient *= 1.0 - share;
            }
            self.take_out();
        }
    }

    /// Whether so much came and went that rounding may have piled up in the inverse.
    pub(super) fn is_worn(&self) -> bool {
        self.moves > REFRESH
    }

    /// Makes the inverse afresh; a column that depends on the others goes.
    pub(super) fn rebuild(&mut self, columns: &Columns) {
        let count = self.members.len();
        self.list.clear();
        self.list.extend(self.members.drain(..).zip(self.values.drain(..)));
        for k in 0..count {
            let (j, value) = self.list[k];
            if self.insert(columns, j)
                && let Some(last) = self.values.last_mut()
            {
                *last = value;
            }
        }
        self.moves = 0;
    }

    /// Takes out the members that have reached zero.
    #[inline(always)]
    fn take_out(&mut self) {
        let limit = REACHED * self.values.iter().copied().fold(0.0, f64::max);
        for k in (0..self.members.len()).rev() {
            if !(self.values[k] > limit) {
                self.remove(k);
            }
        }
    }
}

/// Adds as much of a step as leaves no value below zero; returns its share, 1 for all of it.
#[inline(always)]
fn advance(values: &mut [f64], step: &[f64]) -> f64 {
    let mut share = 1.0_f64;
    for (value, change) in values.iter().zip(step) {
        if value + change <= 0.0 {
            share = share.min(-value / change);
        }
    }
    for (value, change) in values.iter_mut().zip(step) {
        *value += share * change;
    }
    share
}

/// Scalar product of slices of the same length, a multiple of [`LANES`].
#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; LANES];
    for (a, b) in a.as_chunks::<LANES>().0.iter().zip(b.as_chunks::<LANES>().0) {
        for k in 0..LANES {
            sums[k] += a[k] * b[k];
        }
    }
    // By halves, as a register is summed fastest.
    let fours: [f64; 4] = std::array::from_fn(|k| sums[k] + sums[k + 4]);
    (fours[0] + fours[2]) + (fours[1] + fours[3])
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use rand::{Rng, SeedableRng, rngs::StdRng};

    /// The inverse is that of the members' products, and the values are the least squares values, after any comings and goings.
    #[test]
    fn the_inverse_stays_that_of_the_members() {
        let mut rng = StdRng::seed_from_u64(5);
        let matrix = DMatrix::from_fn(24, 40, |_, _| rng.random_range(-0.3..1.0));
        let columns = Columns::new(&matrix, 1.0);
        let mut passive = Passive::new(&columns);
        let mut removed = 0;
        for _ in 0..3000 {
            let j = rng.random_range(0..40);
            if passive.members.len() > 20 || passive.members.contains(&j) {
                passive.remove(rng.random_range(0..passive.members.len()));
                removed += 1;
            } else {
                passive.insert(&columns, j);
            }
        }
        assert!(removed > 1000 && passive.is_worn());
        let count = passive.members.len();
        let chosen = DMatrix::from_columns(
            &passive
                .members
                .iter()
                .map(|j| matrix.column(*j).normalize())
                .collect::<Vec<_>>(),
        );
        let inverse = DMatrix::from_fn(count, count, |i, k| passive.inverse[i * passive.stride + k]);
        let one = &inverse * chosen.tr_mul(&chosen) * inverse.transpose();
        assert!((one - DMatrix::identity(count, count)).amax() < 1e-9);

        let b = DVector::from_fn(24, |_, _| rng.random_range(-1.0..1.0));
        // Values so large that none falls to zero on the way.
        let shift = DVector::from_element(count, 100.0);
        passive.values.fill(100.0);
        let right = &chosen * &shift + &b;
        let padded: Vec<f64> = right
            .iter()
            .copied()
            .chain(std::iter::repeat(0.0))
            .take(columns.rows())
            .collect();
        assert_eq!(passive.refine(&columns, &padded), 1);
        let expected = chosen.clone().svd(true, true).solve(&right, 0.0).unwrap();
        assert!((DVector::from_column_slice(&passive.values) - expected).amax() < 1e-9);
    }
}
