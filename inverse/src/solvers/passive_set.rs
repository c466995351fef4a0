//! The passive set of plain non-negative least squares: the columns whose x is positive, scaled to norm 1.
//!
//! The set keeps the inverse of the Cholesky factor of the columns' products. Nothing has to be solved for: when a
//! column enters a set whose gradient is zero, the step to the new least squares values is the inverse's last row.

use crate::linalg::aligned::Aligned;
use crate::linalg::columns::Columns;
use crate::linalg::kernels::{LANES, padded};
use crate::linalg::vector::dot_by_halves;
use crate::solvers::products::Products;
use pulp::Simd;

/// Least squared distance of a column of norm 1 from the span of the members. A closer column counts as dependent:
/// rounding is a good part of its distance.
const LEAST_DISTANCE: f64 = 1e-13;
/// Share of the largest value at which a member has reached zero, to rounding.
const ZERO: f64 = 1e-14;
/// Columns that came and went before the inverse is made afresh. Its rounding then stays small beside the tolerance;
/// the test of the inverse takes 3,000.
const REFRESH: usize = 2000;

/// The members, their inverse factor and their values.
#[derive(Clone, Debug)]
pub(super) struct PassiveSet {
    members: Vec<usize>,
    /// Values of the members, in units of columns of norm 1, and 0 from there on.
    values: Aligned,
    /// Inverse of the Cholesky factor: the lower triangle, row by row with a stride; zero beyond the diagonal.
    inverse: Aligned,
    stride: usize,
    /// Most members.
    capacity: usize,
    /// Columns that came and went since the inverse was made.
    moves: usize,
    /// `b - A x`.
    residual: Aligned,
    /// One over the norms of all columns; 0 for a column of zeros.
    scales: Vec<f64>,
    products: Option<Products>,
    /// `A^T b` where products are kept.
    projected: Aligned,
    list: Vec<(usize, f64)>,
    /// Gradients of the members while all are on their way to 0.
    gradients: Vec<f64>,
    dots: Vec<f64>,
    /// For every rotated row: its own share, that of the row carried, and its entry in the column that goes.
    rotations: Vec<[f64; 3]>,
    right: Aligned,
    /// `L^-1 right`.
    solved: Aligned,
    /// Step of the values.
    step: Aligned,
}

impl PassiveSet {
    /// The empty set, of at most as many columns as there are rows; with or without the products of all columns.
    pub(super) fn new(columns: &Columns, products: bool) -> Self {
        let capacity = columns.rows();
        let stride = padded(capacity, LANES) + LANES;
        let over = |n: &f64| if *n >= f64::MIN_POSITIVE { 1.0 / n } else { 0.0 };
        let scales: Vec<f64> = columns.norms().iter().map(over).collect();
        Self {
            members: Vec::with_capacity(capacity),
            values: Aligned::zeros(stride),
            inverse: Aligned::zeros(capacity * stride),
            stride,
            capacity,
            moves: 0,
            residual: Aligned::zeros(capacity),
            projected: Aligned::zeros(columns.cells()),
            products: products.then(|| Products::new(columns, &scales)),
            scales,
            list: Vec::with_capacity(capacity),
            gradients: Vec::with_capacity(capacity),
            dots: Vec::with_capacity(capacity),
            rotations: Vec::with_capacity(capacity),
            right: Aligned::zeros(stride),
            solved: Aligned::zeros(stride),
            step: Aligned::zeros(stride + LANES),
        }
    }

    /// Removes every member.
    pub(super) fn clear(&mut self) {
        self.members.clear();
        self.values.fill(0.0);
        self.moves = 0;
    }

    /// Columns in the set.
    #[inline(always)]
    pub(super) fn members(&self) -> &[usize] {
        &self.members
    }

    /// Their values, for columns of norm 1.
    #[inline(always)]
    pub(super) fn values(&self) -> &[f64] {
        &self.values[..self.members.len()]
    }

    /// `b - A x` as of the last [`PassiveSet::update`].
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

    /// Prepares for the right-hand side b.
    #[inline(always)]
    pub(super) fn begin(&mut self, columns: &Columns, b: &[f64]) {
        if self.products.is_some() {
            columns.dots(b, &mut self.projected);
            for (projected, scale) in self.projected.iter_mut().zip(&self.scales) {
                *projected *= scale;
            }
        }
    }

    /// `A^T (b - A x)` for columns scaled to norm 1, where products are kept.
    #[inline(always)]
    pub(super) fn gradients(&mut self, columns: &Columns, out: &mut [f64]) -> bool {
        let Some(products) = &self.products else {
            return false;
        };
        self.list.clear();
        let each = self.members.iter().zip(&self.values);
        self.list.extend(each.map(|(j, x)| (*j, -x)));
        out.copy_from_slice(&self.projected);
        products.add(columns, &self.list, out);
        true
    }

    /// `a_j . (b - A x)` for a column scaled to norm 1 and the values as they are now.
    #[inline(always)]
    pub(super) fn gradient(&self, columns: &Columns, j: usize) -> f64 {
        let Some(products) = &self.products else {
            return dot_by_halves(columns.column(j), &self.residual) * self.scales[j];
        };
        let row = products.of(j);
        // Four sums: none waits for the one before.
        let mut sums = [0.0; 4];
        let (members, rest) = self.members.as_chunks::<4>();
        let (values, values_of_rest) = self.values().as_chunks::<4>();
        for (members, values) in members.iter().zip(values) {
            for k in 0..4 {
                sums[k] += values[k] * row[members[k]];
            }
        }
        for (member, value) in rest.iter().zip(values_of_rest) {
            sums[0] += value * row[*member];
        }
        self.projected[j] - ((sums[0] + sums[1]) + (sums[2] + sums[3]))
    }

    /// Lets a column in and goes to the least squares values. `gradient` is the column's, above 0; that of the members
    /// is 0.
    ///
    /// Members that would fall below zero are removed on the way. False when the column depends on the members, or
    /// nothing moves.
    #[inline(always)]
    pub(super) fn enter<S: Simd>(&mut self, simd: S, columns: &Columns, b: &[f64], j: usize, gradient: f64) -> bool {
        let moved = self.insert(simd, columns, j) && self.go_to_least_squares(simd, j, gradient);
        if self.products.is_none() {
            self.update(columns, b);
        }
        moved
    }

    /// Goes to the least squares values after the j-th column has entered; whether anything moved.
    #[inline(always)]
    fn go_to_least_squares<S: Simd>(&mut self, simd: S, j: usize, gradient: f64) -> bool {
        let (mut remaining, mut moved) = (gradient, false);
        loop {
            let count = self.members.len();
            let row = &self.inverse[(count - 1) * self.stride..][..padded(count, LANES)];
            let scale = remaining * row[count - 1];
            for (step, r) in self.step.iter_mut().zip(row) {
                *step = scale * r;
            }
            let share = self.advance(simd);
            moved |= share > 0.0;
            if !(share < 1.0) {
                return moved;
            }
            remaining *= 1.0 - share;
            self.remove_zeros(simd);
            if self.members.last() != Some(&j) {
                // The column came no further than rounding.
                return false;
            }
        }
    }

    /// Adds a column with value 0; false when it depends on the members.
    #[inline(always)]
    fn insert<S: Simd>(&mut self, simd: S, columns: &Columns, j: usize) -> bool {
        let count = self.members.len();
        if count == self.capacity || !(self.scales[j] > 0.0) {
            return false;
        }
        if let Some(products) = &self.products {
            let row = products.of(j);
            for (right, member) in self.right.iter_mut().zip(&self.members) {
                *right = row[*member];
            }
        } else {
            columns.dots_of(&self.members, columns.column(j), &mut self.dots);
            for (right, (member, dot)) in self.right.iter_mut().zip(self.members.iter().zip(&self.dots)) {
                *right = dot * self.scales[*member] * self.scales[j];
            }
        }
        self.right[count..padded(count, LANES)].fill(0.0);
        self.apply_inverse(simd);
        let distance = 1.0
            - dot_by_halves(
                &self.solved[..padded(count, LANES)],
                &self.solved[..padded(count, LANES)],
            );
        if !(distance > LEAST_DISTANCE) {
            return false;
        }
        self.apply_inverse_transposed(simd);
        let one_over = 1.0 / distance.sqrt();
        let row = &mut self.inverse[count * self.stride..][..self.stride];
        let (start, rest) = row.split_at_mut(padded(count + 1, LANES));
        for (to, from) in start.iter_mut().zip(self.step.iter()) {
            *to = -from * one_over;
        }
        start[count] = one_over;
        rest.fill(0.0);
        self.members.push(j);
        self.moves += 1;
        true
    }

    /// `solved = L^-1 right`. Both are 0 from the number of members to the next multiple of [`LANES`].
    #[inline(always)]
    fn apply_inverse<S: Simd>(&mut self, simd: S) {
        let (count, width) = (self.members.len(), self.stride / S::F64_LANES);
        let (inverse, right) = (S::as_simd_f64s(&self.inverse).0, S::as_simd_f64s(&self.right).0);
        // Rows are taken in eights, all as long as the last of them.
        let blocks = self.solved.as_chunks_mut::<LANES>().0.iter_mut();
        for (block, solved) in blocks.enumerate().take(count.div_ceil(LANES)) {
            let length = (block + 1) * (LANES / S::F64_LANES);
            let right = &right[..length];
            let rows: [&[S::f64s]; LANES] = std::array::from_fn(|k| &inverse[(block * LANES + k) * width..][..length]);
            let mut sums = [simd.splat_f64s(0.0); LANES];
            for v in 0..length {
                for (sum, row) in sums.iter_mut().zip(&rows) {
                    *sum = simd.mul_add_e_f64s(row[v], right[v], *sum);
                }
            }
            for (solved, sum) in solved.iter_mut().zip(sums) {
                *solved = simd.reduce_sum_f64s(sum);
            }
        }
        self.solved[count..padded(count, LANES)].fill(0.0);
    }

    /// `step = L^-T half`, and zero to the end of the register after the last.
    #[inline(always)]
    fn apply_inverse_transposed<S: Simd>(&mut self, simd: S) {
        let (count, width) = (self.members.len(), self.stride / S::F64_LANES);
        let inverse = S::as_simd_f64s(&self.inverse).0;
        self.step[count..padded(count + 1, LANES)].fill(0.0);
        let steps = S::as_mut_simd_f64s(&mut self.step).0.iter_mut();
        for (v, step) in steps.enumerate().take(count.div_ceil(S::F64_LANES)) {
            // Several sums: none waits for the one before.
            let [mut p, mut q, mut r, mut t] = [simd.splat_f64s(0.0); 4];
            let first = v * S::F64_LANES;
            let (fours, rest) = self.solved[first..count].as_chunks::<4>();
            let mut rows = inverse[first * width..].chunks_exact(4 * width);
            for ([a, b, c, d], rows) in fours.iter().zip(rows.by_ref()) {
                p = simd.mul_add_e_f64s(rows[v], simd.splat_f64s(*a), p);
                q = simd.mul_add_e_f64s(rows[width + v], simd.splat_f64s(*b), q);
                r = simd.mul_add_e_f64s(rows[2 * width + v], simd.splat_f64s(*c), r);
                t = simd.mul_add_e_f64s(rows[3 * width + v], simd.splat_f64s(*d), t);
            }
            let rows = inverse[(count - rest.len()) * width..].chunks_exact(width);
            for (a, row) in rest.iter().zip(rows) {
                p = simd.mul_add_e_f64s(row[v], simd.splat_f64s(*a), p);
            }
            *step = simd.add_f64s(simd.add_f64s(p, q), simd.add_f64s(r, t));
        }
    }

    /// Removes the k-th member.
    ///
    /// Givens rotations of the rows make the column of the inverse that goes zero but for its last entry, which goes
    /// with its row. All rotations follow from that column beforehand, so that none waits for a root.
    #[inline(always)]
    fn remove<S: Simd>(&mut self, simd: S, k: usize) {
        let (stride, last) = (self.stride, self.members.len() - 1);
        // The row that is carried is the sum of all rows before, each times its entry in the column that goes, over the
        // length of these entries.
        self.rotations.clear();
        let first = self.inverse[k * stride + k];
        let mut square = first * first;
        for i in k + 1..=last {
            let entry = self.inverse[i * stride + k];
            self.rotations.push([square, 0.0, entry]);
            square += entry * entry;
        }
        for [keep, take, entry] in &mut self.rotations {
            let one_over = 1.0 / (*keep * (*keep + *entry * *entry)).sqrt();
            (*keep, *take) = (*keep * one_over, *entry * one_over);
        }
        // Entries behind the column that goes move up by one. In the first register, where the column was, some stay.
        let lanes = S::F64_LANES;
        let numbers: [f64; LANES] = std::array::from_fn(|n| n as f64);
        let order = S::as_simd_f64s(&numbers).0[0];
        for v in 0..=last / lanes {
            let start = v * lanes;
            let stays = simd.less_than_f64s(order, simd.splat_f64s(k as f64 - start as f64));
            let load = |inverse: &[f64], i: usize| {
                let row = &inverse[i * stride + start..][..lanes + 1];
                let (stay, behind) = (S::as_simd_f64s(&row[..lanes]).0[0], S::as_simd_f64s(&row[1..]).0[0]);
                simd.select_f64s(stays, stay, behind)
            };
            let top = k.max(start);
            let mut carried = simd.mul_f64s(
                simd.splat_f64s(if top == k { first } else { 0.0 }),
                load(&self.inverse, top),
            );
            for (i, [keep, take, entry]) in (top..last).zip(&self.rotations[top - k..]) {
                let lower = load(&self.inverse, i + 1);
                let taken = simd.mul_f64s(simd.splat_f64s(*take), carried);
                let upper = simd.mul_add_e_f64s(simd.splat_f64s(*keep), lower, simd.neg_f64s(taken));
                carried = simd.mul_add_e_f64s(simd.splat_f64s(*entry), lower, carried);
                S::as_mut_simd_f64s(&mut self.inverse[i * stride + start..][..lanes]).0[0] = upper;
            }
        }
        self.members.remove(k);
        self.values.copy_within(k + 1..last + 1, k);
        self.values[last] = 0.0;
        if k < self.gradients.len() {
            self.gradients.remove(k);
        }
        self.moves += 1;
    }

    /// Goes to the least squares values of the members for a right-hand side; returns the number of solves.
    ///
    /// The step is a correction from the true residual: the error of the inverse shrinks from one call to the next.
    /// Members that reach zero on the way are removed.
    #[inline(always)]
    pub(super) fn refine<S: Simd>(&mut self, simd: S, columns: &Columns, b: &[f64]) -> usize {
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
            self.apply_inverse(simd);
            self.apply_inverse_transposed(simd);
            solves += 1;
            let share = self.advance(simd);
            if !(share < 1.0) {
                self.gradients.clear();
                return solves;
            }
            // A part of the step takes the same part of every member's gradient.
            for gradient in &mut self.gradients {
                *gradient *= 1.0 - share;
            }
            self.remove_zeros(simd);
        }
    }

    /// Whether so many columns came and went that rounding may have piled up in the inverse.
    pub(super) fn needs_rebuild(&self) -> bool {
        self.moves > REFRESH
    }

    /// Makes the inverse afresh; a member that depends on the others is removed.
    #[inline(always)]
    pub(super) fn rebuild<S: Simd>(&mut self, simd: S, columns: &Columns) {
        let count = self.members.len();
        self.list.clear();
        self.list
            .extend(self.members.drain(..).zip(self.values.iter().copied()));
        self.values.fill(0.0);
        for k in 0..count {
            let (j, value) = self.list[k];
            if self.insert(simd, columns, j) {
                self.values[self.members.len() - 1] = value;
            }
        }
        self.moves = 0;
    }

    /// Takes as much of the step as leaves no value below zero; returns that share, 1 for the whole step. Of a part, what it ends at is
    /// zero, whatever rounding would leave.
    #[inline(always)]
    fn advance<S: Simd>(&mut self, simd: S) -> f64 {
        let length = padded(self.members.len(), LANES);
        let (values, step) = (
            S::as_mut_simd_f64s(&mut self.values[..length]).0,
            S::as_simd_f64s(&self.step[..length]).0,
        );
        let mut share = simd.splat_f64s(1.0);
        for (value, change) in values.iter().zip(step) {
            share = simd.min_f64s(share, until_zero(simd, *value, *change));
        }
        let share = simd.reduce_min_f64s(share);
        let by = simd.splat_f64s(share);
        for (value, change) in values.iter_mut().zip(step) {
            let next = simd.mul_add_e_f64s(by, *change, *value);
            let ends = simd.less_than_or_equal_f64s(until_zero(simd, *value, *change), by);
            let end = if share < 1.0 { simd.splat_f64s(0.0) } else { next };
            *value = simd.select_f64s(ends, end, next);
        }
        share
    }

    /// Removes the members that have reached zero.
    #[inline(always)]
    fn remove_zeros<S: Simd>(&mut self, simd: S) {
        let mut largest = [0.0; LANES];
        for values in self.values.as_chunks::<LANES>().0 {
            for (largest, value) in largest.iter_mut().zip(values) {
                *largest = if value > largest { *value } else { *largest };
            }
        }
        let limit = ZERO * largest.into_iter().fold(0.0, f64::max);
        for k in (0..self.members.len()).rev() {
            if !(self.values[k] > limit) {
                self.remove(simd, k);
            }
        }
    }
}

/// The shares of a step at which values reach zero, or 1.
#[inline(always)]
fn until_zero<S: Simd>(simd: S, value: S::f64s, change: S::f64s) -> S::f64s {
    let (zero, one) = (simd.splat_f64s(0.0), simd.splat_f64s(1.0));
    let falls = simd.less_than_or_equal_f64s(simd.add_f64s(value, change), zero);
    let down = simd.less_than_f64s(change, zero);
    let until = simd.div_f64s(value, simd.neg_f64s(change));
    simd.select_f64s(falls, simd.select_f64s(down, until, one), one)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use rand::rngs::StdRng;
    use rand::{Rng, SeedableRng};

    /// After any changes the inverse is that of the members' products, and the values are the least squares values.
    #[test]
    fn the_inverse_stays_that_of_the_members() {
        the_inverse_stays(pulp::Scalar, true);
        the_inverse_stays(pulp::Scalar, false);
        #[cfg(target_arch = "x86_64")]
        {
            if let Some(simd) = pulp::x86::V3::try_new() {
                the_inverse_stays(simd, true);
            }
            if let Some(simd) = pulp::x86::V4::try_new() {
                the_inverse_stays(simd, false);
            }
        }
    }

    /// A step that goes only a part of its way ends with a value that is zero, however large or small it was: it leaves the set.
    #[test]
    fn a_part_of_a_step_ends_at_a_zero() {
        ends_at_a_zero(pulp::Scalar);
        #[cfg(target_arch = "x86_64")]
        {
            if let Some(simd) = pulp::x86::V3::try_new() {
                ends_at_a_zero(simd);
            }
            if let Some(simd) = pulp::x86::V4::try_new() {
                ends_at_a_zero(simd);
            }
        }
    }

    fn ends_at_a_zero<S: Simd>(simd: S) {
        let mut rng = StdRng::seed_from_u64(6);
        let columns = Columns::new(&DMatrix::from_fn(24, 40, |_, _| rng.random_range(-0.3..1.0)), 1.0);
        let mut passive = PassiveSet::new(&columns, true);
        for j in 0..20 {
            assert!(passive.insert(simd, &columns, j));
        }
        for case in 0..1000 {
            let count = passive.members.len();
            for k in 0..count {
                passive.values[k] = 10f64.powi(rng.random_range(-12..3)) * rng.random_range(0.1..1.0);
                // In half of the cases all go to zero, at the same share but for rounding.
                let fall = if case % 2 == 0 {
                    1.7
                } else {
                    rng.random_range(-1.0..4.0)
                };
                passive.step[k] = -fall * passive.values[k];
            }
            let share = passive.advance(simd);
            let zeros = passive.values[..count].iter().filter(|v| **v == 0.0).count();
            assert!(passive.values.iter().all(|v| *v >= 0.0));
            assert_eq!(share < 1.0, zeros > 0, "{case}: {share} {zeros}");
        }
    }

    fn the_inverse_stays<S: Simd>(simd: S, products: bool) {
        let mut rng = StdRng::seed_from_u64(5);
        let matrix = DMatrix::from_fn(24, 40, |_, _| rng.random_range(-0.3..1.0));
        let columns = Columns::new(&matrix, 1.0);
        let mut passive = PassiveSet::new(&columns, products);
        let mut removed = 0;
        for _ in 0..3000 {
            let j = rng.random_range(0..40);
            if passive.members.len() > 20 || passive.members.contains(&j) {
                passive.remove(simd, rng.random_range(0..passive.members.len()));
                removed += 1;
            } else {
                passive.insert(simd, &columns, j);
            }
        }
        assert!(removed > 1000 && passive.needs_rebuild());
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
        passive.values[..count].fill(100.0);
        let right = &chosen * &shift + &b;
        let padded: Vec<f64> = right
            .iter()
            .copied()
            .chain(std::iter::repeat(0.0))
            .take(columns.rows())
            .collect();
        assert_eq!(passive.refine(simd, &columns, &padded), 1);
        let expected = chosen.clone().svd(true, true).solve(&right, 0.0).unwrap();
        assert!((DVector::from_column_slice(passive.values()) - expected).amax() < 1e-9);
    }
}
