//! Search for the column of largest gradient, in single precision.
//!
//! Single precision decides only which column enters next, and is half the memory to read. A search of all columns
//! makes a pool of those that may yet enter. Of the pool the best form a shortlist, in groups of [`COLUMNS_AT_ONCE`]. A
//! group is searched again when it comes to the front. Columns outside the pool are not seen until all columns are
//! searched again.

use crate::linalg::aligned::Aligned;
use crate::linalg::columns::Columns;
use crate::linalg::kernels::{COLUMNS_AT_ONCE, SINGLE_LANES, dots_of_single, padded};

/// How many columns a [`ColumnSearch`] looks at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ColumnSearchOptions {
    /// Most columns of the shortlist.
    ///
    /// More keeps more columns up to date after every step; less searches the pool more often. Fewer and more were
    /// tried and left (docs/solver.md, "What falls short"); the times are those of `cargo bench -p skin-inverse --bench
    /// solver`, rows "plain" with 1184 cells.
    pub(super) shortlist: usize,
    /// Least gradient of a column of the pool, over the largest gradient; -1 to 1.
    ///
    /// More makes the pool smaller, and all columns are searched more often; less makes the search of the pool longer.
    /// -1 leaves out the columns whose gradient is below minus the largest. Chosen with the shortlist; no table is on
    /// record.
    pub(super) reach: f32,
}

impl Default for ColumnSearchOptions {
    fn default() -> Self {
        Self {
            shortlist: 192,
            reach: -1.0,
        }
    }
}

/// Columns scaled to norm 1, and which of them may enter.
#[derive(Clone, Debug)]
pub(super) struct ColumnSearch {
    options: ColumnSearchOptions,
    /// All columns, and one of zeros, which fills lists up to a multiple of [`COLUMNS_AT_ONCE`].
    columns: Aligned<f32>,
    residual: Aligned<f32>,
    all: Vec<u32>,
    pool: Vec<u32>,
    shortlist: Vec<u32>,
    /// The largest gradient of each group of the shortlist when last computed.
    bounds: Vec<f32>,
    gradient: Aligned<f32>,
    order: Vec<(f32, u32)>,
    excluded: Vec<bool>,
}

impl ColumnSearch {
    /// `scales` are one over the columns' norms.
    pub(super) fn new(columns: &Columns, scales: &[f64], options: ColumnSearchOptions) -> Self {
        let (rows, cells) = (padded(columns.rows(), SINGLE_LANES), columns.cells());
        let mut single = Aligned::zeros(rows * (cells + 1));
        for (j, (to, scale)) in single.chunks_exact_mut(rows.max(1)).zip(scales).enumerate() {
            for (to, value) in to.iter_mut().zip(columns.column(j)) {
                *to = (value * scale) as f32;
            }
        }
        Self {
            options,
            columns: single,
            residual: Aligned::zeros(rows),
            all: (0..cells as u32).collect(),
            pool: Vec::with_capacity(cells + COLUMNS_AT_ONCE),
            shortlist: Vec::with_capacity(options.shortlist + COLUMNS_AT_ONCE),
            gradient: Aligned::zeros(padded(cells, COLUMNS_AT_ONCE)),
            order: Vec::with_capacity(cells),
            bounds: Vec::with_capacity(options.shortlist),
            excluded: vec![false; cells + 1],
        }
    }

    /// Copies the residual in single precision.
    fn take(&mut self, residual: &[f64]) {
        for (to, from) in self.residual.iter_mut().zip(residual) {
            *to = *from as f32;
        }
    }

    /// Searches all columns but those excluded, and chooses the pool and the shortlist; returns the largest gradient,
    /// or 0.
    #[inline(always)]
    pub(super) fn search_all(&mut self, columns: &Columns, residual: &[f64], excluded: [&[usize]; 2]) -> f32 {
        self.take(residual);
        dots_of_single(
            columns.arch(),
            &self.columns,
            &self.all,
            &self.residual,
            &mut self.gradient,
        );
        let largest = self.choose_shortlist(excluded, false);
        let limit = self.options.reach * largest;
        self.pool.clear();
        let each = self.gradient.iter().zip(&self.all);
        self.pool.extend(each.filter(|(g, _)| **g > limit).map(|(_, j)| *j));
        fill_up(&mut self.pool, self.all.len());
        largest
    }

    /// Searches the pool but for the columns excluded, and chooses the shortlist; returns the largest gradient, or 0.
    #[inline(always)]
    pub(super) fn search_pool(&mut self, columns: &Columns, residual: &[f64], excluded: [&[usize]; 2]) -> f32 {
        self.take(residual);
        let gradient = &mut self.gradient[..self.pool.len()];
        dots_of_single(columns.arch(), &self.columns, &self.pool, &self.residual, gradient);
        self.choose_shortlist(excluded, true)
    }

    /// Chooses the columns of largest gradient as the shortlist; returns the largest gradient, or 0.
    #[inline(always)]
    fn choose_shortlist(&mut self, excluded: [&[usize]; 2], pool: bool) -> f32 {
        for j in excluded.into_iter().flatten() {
            self.excluded[*j] = true;
        }
        let list = if pool { &self.pool } else { &self.all };
        self.order.clear();
        for (g, j) in self.gradient.iter().zip(list) {
            if *g > 0.0 && !self.excluded[*j as usize] {
                self.order.push((*g, *j));
            }
        }
        for j in excluded.into_iter().flatten() {
            self.excluded[*j] = false;
        }
        if self.order.len() > self.options.shortlist {
            self.order
                .select_nth_unstable_by(self.options.shortlist, |p, q| q.0.total_cmp(&p.0));
            self.order.truncate(self.options.shortlist);
        }
        self.order.sort_unstable_by(|p, q| q.0.total_cmp(&p.0));
        self.shortlist.clear();
        self.shortlist.extend(self.order.iter().map(|(_, j)| *j));
        fill_up(&mut self.shortlist, self.all.len());
        self.bounds.clear();
        self.bounds
            .extend(self.order.iter().step_by(COLUMNS_AT_ONCE).map(|(g, _)| *g));
        self.bounds.first().copied().unwrap_or(0.0)
    }

    /// The column of the shortlist whose gradient is largest, if that is above a limit. No column comes twice.
    ///
    /// The largest gradient that a group had stands for the present one until the group comes to the front: a column
    /// that enters takes from its neighbours, and hardly ever adds to one.
    #[inline(always)]
    pub(super) fn next(&mut self, columns: &Columns, residual: &[f64], limit: f32) -> Option<usize> {
        self.take(residual);
        let mut computed = None;
        loop {
            let (mut most, mut group) = (limit, None);
            for (k, bound) in self.bounds.iter().enumerate() {
                if *bound > most {
                    (most, group) = (*bound, Some(k));
                }
            }
            let group = group?;
            let shortlist = &mut self.shortlist[group * COLUMNS_AT_ONCE..][..COLUMNS_AT_ONCE];
            if let Some((place, of)) = computed
                && of == group
            {
                // The rest of the group is below. How far, is computed when the group comes to the front again.
                return Some(std::mem::replace(&mut shortlist[place], self.all.len() as u32) as usize);
            }
            let now = &mut self.gradient[..COLUMNS_AT_ONCE];
            dots_of_single(columns.arch(), &self.columns, shortlist, &self.residual, now);
            let (mut best, mut place) = (0.0, 0);
            for (k, g) in now.iter().enumerate() {
                if *g > best {
                    (best, place) = (*g, k);
                }
            }
            self.bounds[group] = best;
            computed = Some((place, group));
        }
    }
}

/// Fills a list up to a whole number of columns at once.
fn fill_up(list: &mut Vec<u32>, with: usize) {
    list.resize(padded(list.len(), COLUMNS_AT_ONCE), with as u32);
}
