//! Where the gradient is largest, in single precision: which column enters next needs no more, and half the memory is
//! looked at.
//!
//! Of all columns some form a pool, and of the pool a few, of which again some are looked at whenever something has moved.
//! What is not in the pool is not seen until all columns are looked at again.

use crate::linalg::aligned::Aligned;
use crate::linalg::columns::Columns;
use crate::linalg::kernels::{COLUMNS_AT_ONCE, SINGLE_LANES, dots_of_single, padded};

/// Most columns of which the next to enter is chosen before the pool is looked at again.
const FEW: usize = 192;
/// A column belongs to the pool when its gradient is above the largest times this: not below minus the largest.
const REACH: f32 = -1.0;

/// Columns scaled to norm 1, and which of them may enter.
#[derive(Clone, Debug)]
pub(super) struct Search {
    /// All columns, and one of zeros, with which lists are filled up to a multiple of [`COLUMNS_AT_ONCE`].
    columns: Aligned<f32>,
    residual: Aligned<f32>,
    all: Vec<u32>,
    pool: Vec<u32>,
    few: Vec<u32>,
    /// Of each [`COLUMNS_AT_ONCE`] of the few the largest gradient when last looked at.
    bounds: Vec<f32>,
    gradient: Aligned<f32>,
    order: Vec<(f32, u32)>,
    closed: Vec<bool>,
}

impl Search {
    /// `scales` are one over the columns' norms.
    pub(super) fn new(columns: &Columns, scales: &[f64]) -> Self {
        let (rows, cells) = (padded(columns.rows(), SINGLE_LANES), columns.cells());
        let mut single = Aligned::zeros(rows * (cells + 1));
        for (j, (to, scale)) in single.chunks_exact_mut(rows.max(1)).zip(scales).enumerate() {
            for (to, value) in to.iter_mut().zip(columns.column(j)) {
                *to = (value * scale) as f32;
            }
        }
        Self {
            columns: single,
            residual: Aligned::zeros(rows),
            all: (0..cells as u32).collect(),
            pool: Vec::with_capacity(cells + COLUMNS_AT_ONCE),
            few: Vec::with_capacity(FEW + COLUMNS_AT_ONCE),
            gradient: Aligned::zeros(padded(cells, COLUMNS_AT_ONCE)),
            order: Vec::with_capacity(cells),
            bounds: Vec::with_capacity(FEW),
            closed: vec![false; cells + 1],
        }
    }

    fn take(&mut self, residual: &[f64]) {
        for (to, from) in self.residual.iter_mut().zip(residual) {
            *to = *from as f32;
        }
    }

    /// Looks at all columns but those closed, and chooses the pool and the few; returns the largest gradient, or 0.
    #[inline(always)]
    pub(super) fn look_at_all(&mut self, columns: &Columns, residual: &[f64], closed: [&[usize]; 2]) -> f32 {
        self.take(residual);
        dots_of_single(
            columns.arch(),
            &self.columns,
            &self.all,
            &self.residual,
            &mut self.gradient,
        );
        let largest = self.choose_few(closed, false);
        let limit = REACH * largest;
        self.pool.clear();
        let each = self.gradient.iter().zip(&self.all);
        self.pool.extend(each.filter(|(g, _)| **g > limit).map(|(_, j)| *j));
        fill_up(&mut self.pool, self.all.len());
        largest
    }

    /// Looks at the pool but for the columns closed and chooses the few; returns the largest gradient, or 0.
    #[inline(always)]
    pub(super) fn look(&mut self, columns: &Columns, residual: &[f64], closed: [&[usize]; 2]) -> f32 {
        self.take(residual);
        let gradient = &mut self.gradient[..self.pool.len()];
        dots_of_single(columns.arch(), &self.columns, &self.pool, &self.residual, gradient);
        self.choose_few(closed, true)
    }

    /// Chooses the few of largest gradient.
    #[inline(always)]
    fn choose_few(&mut self, closed: [&[usize]; 2], pool: bool) -> f32 {
        for j in closed.into_iter().flatten() {
            self.closed[*j] = true;
        }
        let list = if pool { &self.pool } else { &self.all };
        self.order.clear();
        for (g, j) in self.gradient.iter().zip(list) {
            if *g > 0.0 && !self.closed[*j as usize] {
                self.order.push((*g, *j));
            }
        }
        for j in closed.into_iter().flatten() {
            self.closed[*j] = false;
        }
        if self.order.len() > FEW {
            self.order.select_nth_unstable_by(FEW, |p, q| q.0.total_cmp(&p.0));
            self.order.truncate(FEW);
        }
        self.order.sort_unstable_by(|p, q| q.0.total_cmp(&p.0));
        self.few.clear();
        self.few.extend(self.order.iter().map(|(_, j)| *j));
        fill_up(&mut self.few, self.all.len());
        self.bounds.clear();
        self.bounds
            .extend(self.order.iter().step_by(COLUMNS_AT_ONCE).map(|(g, _)| *g));
        self.bounds.first().copied().unwrap_or(0.0)
    }

    /// Of the few the column whose gradient is largest, if that is above a limit; none comes twice.
    ///
    /// What a group's largest gradient was stands for what it is until the group is the first: what enters takes from its
    /// neighbours, and hardly ever adds to one.
    #[inline(always)]
    pub(super) fn next(&mut self, columns: &Columns, residual: &[f64], limit: f32) -> Option<usize> {
        self.take(residual);
        let mut looked_at = None;
        loop {
            let (mut most, mut group) = (limit, None);
            for (k, bound) in self.bounds.iter().enumerate() {
                if *bound > most {
                    (most, group) = (*bound, Some(k));
                }
            }
            let group = group?;
            let few = &mut self.few[group * COLUMNS_AT_ONCE..][..COLUMNS_AT_ONCE];
            if let Some((place, of)) = looked_at
                && of == group
            {
                // The rest of the group is below; how far is seen when it comes first again.
                return Some(std::mem::replace(&mut few[place], self.all.len() as u32) as usize);
            }
            let now = &mut self.gradient[..COLUMNS_AT_ONCE];
            dots_of_single(columns.arch(), &self.columns, few, &self.residual, now);
            let (mut best, mut place) = (0.0, 0);
            for (k, g) in now.iter().enumerate() {
                if *g > best {
                    (best, place) = (*g, k);
                }
            }
            self.bounds[group] = best;
            looked_at = Some((place, group));
        }
    }
}

/// Fills a list up to a whole number of columns at once.
fn fill_up(list: &mut Vec<u32>, with: usize) {
    list.resize(padded(list.len(), COLUMNS_AT_ONCE), with as u32);
}
