//! Non-negative least squares without a ridge: the active set method of Lawson and Hanson on the reduced rows, with few
//! searches of all columns.
//!
//! A search computes the gradient of every column and queues the most promising. Columns enter one by one until no
//! queued gradient is large, and only then all are searched again. Where the columns' products are not kept, searches
//! in single precision come first. The passive set of the frame before is the start of the next.

use crate::linalg::aligned::Aligned;
use crate::linalg::columns::Columns;
use crate::linalg::kernels::LANES;
use crate::linalg::vector::{dot_of_lanes, norm};
use crate::solvers::column_search::{ColumnSearch, ColumnSearchOptions};
use crate::solvers::passive_set::PassiveSet;
use crate::solvers::products::MOST_CELLS;
use crate::solvers::queue::Queue;
use crate::solvers::solution::Run;
use pulp::{Simd, WithSimd};

/// How an [`ActiveSet`] chooses the columns that enter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ActiveSetOptions {
    /// Least gradient of a column that enters, over the largest gradient of the search; from 0 to below 1.
    ///
    /// More searches all columns more often; less lets columns in that fall out again. The times are those of
    /// `cargo bench -p skin-inverse --bench solver`, rows "plain" (docs/solver.md); the tried values are not on record.
    pub(super) promising: f64,
    /// Of the search in single precision.
    pub(super) search: ColumnSearchOptions,
}

impl Default for ActiveSetOptions {
    fn default() -> Self {
        Self {
            promising: 0.03,
            search: ColumnSearchOptions::default(),
        }
    }
}

/// Least gradient that single precision tells from nothing, over the norm of the residual: 50 roundings of an `f32`.
const LEAST_SINGLE: f64 = 3e-6;
/// Entries for each column after which the method gives up. Solves take a few at most; the limit only ends a cycle.
const MOST_ENTRIES: usize = 10;
/// Rounding errors of a gradient, in units of the last place of the right-hand side.
const ROUNDINGS: f64 = 64.0;
/// Searches without progress after which rounding is taken to be the limit.
const MOST_STALLS: usize = 3;

/// The arguments of [`ActiveSet::run`], compiled for the vector unit at hand.
struct Dispatched<'a> {
    set: &'a mut ActiveSet,
    columns: &'a Columns,
    b: &'a [f64],
    tolerance: f64,
}

impl WithSimd for Dispatched<'_> {
    type Output = Run;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Run {
        self.set.run_here(simd, self.columns, self.b, self.tolerance)
    }
}

/// The method with its state from solve to solve.
#[derive(Clone, Debug)]
pub(super) struct ActiveSet {
    options: ActiveSetOptions,
    passive: PassiveSet,
    /// Gradients of all columns.
    gradient: Aligned,
    /// The same, 0 for the columns that may not enter.
    outside: Aligned,
    /// Largest gradient of a column that is no member, or 0.
    worst_outside: f64,
    queue: Queue,
    /// The search in single precision, for matrices whose products are not kept.
    single: Option<Box<ColumnSearch>>,
    /// Columns that gained nothing since something last moved.
    rejected: Vec<usize>,
}

impl ActiveSet {
    /// A method that has seen no frame.
    pub(super) fn new(columns: &Columns) -> Self {
        Self::with(columns, columns.cells() <= MOST_CELLS, ActiveSetOptions::default())
    }

    /// With the products of all columns, or with a search in single precision.
    fn with(columns: &Columns, products: bool, options: ActiveSetOptions) -> Self {
        let cells = columns.cells();
        let passive = PassiveSet::new(columns, products);
        Self {
            options,
            single: (!products).then(|| Box::new(ColumnSearch::new(columns, passive.scales(), options.search))),
            passive,
            gradient: Aligned::zeros(cells),
            outside: Aligned::zeros(cells),
            worst_outside: 0.0,
            queue: Queue::new(cells),
            rejected: Vec::with_capacity(cells),
        }
    }

    /// Forgets the last solve.
    pub(super) fn reset(&mut self) {
        self.passive.clear();
    }

    /// Norm of `b - A x`.
    pub(super) fn residual_norm(&self) -> f64 {
        dot_of_lanes(self.passive.residual(), self.passive.residual()).sqrt()
    }

    /// Norm of the first `rows` entries of `b - A x`.
    pub(super) fn residual_norm_of(&self, rows: usize) -> f64 {
        let residual = self.passive.residual();
        norm(residual.get(..rows).unwrap_or(residual))
    }

    /// Writes x, times `scale`.
    pub(super) fn write(&self, scale: f64, x: &mut [f64]) {
        for (j, value) in self.passive.members().iter().zip(self.passive.values()) {
            if let Some(x) = x.get_mut(*j) {
                *x = (value * self.passive.scales()[*j] * scale).clamp(0.0, f64::MAX);
            }
        }
    }

    /// Solves for a right-hand side of norm 1.
    ///
    /// The gap is the largest entry of `|min(x_j |a_j|, -g_j / |a_j|)|`, with the gradient `g = A^T (A x - b)`.
    ///
    /// A state that an earlier frame spoilt costs neither this frame nor a later one. Where nothing comes of a fresh one either, x is 0.
    pub(super) fn run(&mut self, columns: &Columns, b: &[f64], tolerance: f64) -> Run {
        let mut run = self.dispatch(columns, b, tolerance);
        if !self.residual_norm().is_finite() {
            self.reset();
            run = self.dispatch(columns, b, tolerance);
        }
        if !self.residual_norm().is_finite() {
            self.reset();
        }
        run
    }

    fn dispatch(&mut self, columns: &Columns, b: &[f64], tolerance: f64) -> Run {
        columns.arch().dispatch(Dispatched {
            set: self,
            columns,
            b,
            tolerance,
        })
    }

    #[inline(always)]
    fn run_here<S: Simd>(&mut self, simd: S, columns: &Columns, b: &[f64], tolerance: f64) -> Run {
        self.rejected.clear();
        if self.passive.needs_rebuild() {
            self.passive.rebuild(simd, columns);
        }
        let most = MOST_ENTRIES * columns.cells();
        self.passive.begin(columns, b);
        let mut steps = self.passive.refine(simd, columns, b);
        let (mut least, mut stalls, mut exact) = (f64::INFINITY, 0, true);
        loop {
            self.passive.update(columns, b);
            if steps <= most {
                let tried = self.search_single(simd, columns, b, tolerance, most);
                steps += tried;
                exact &= tried == 0;
            }
            let largest = self.search_all(columns);
            let (gap, residual) = (self.gap(), self.residual_norm());
            let optimal = largest <= 0.5 * tolerance;
            if exact {
                // Where the steps since the last exact residual gained nothing, rounding is the limit.
                stalls = if residual < least { 0 } else { stalls + 1 };
                least = least.min(residual);
            }
            let run = Run {
                steps,
                gap,
                rounding: ROUNDINGS * f64::EPSILON,
            };
            if optimal && gap <= tolerance || stalls >= MOST_STALLS || steps > most {
                return run;
            }
            if !optimal {
                let limit = (self.options.promising * largest).max(0.5 * tolerance);
                self.queue.fill(&self.outside, limit);
                while steps <= most
                    && let Some((j, gradient)) = self.queue.next(limit, |j| self.passive.gradient(columns, j))
                {
                    steps += 1;
                    self.enter(simd, columns, b, j, gradient);
                }
            }
            if steps > run.steps {
                exact = false;
                continue;
            }
            // None entered. Where the search saw one, it was rounding: its sums have another order.
            if gap <= tolerance {
                return run;
            }
            // What is left is rounding in the members' values. Where these are exact, it is in their factor.
            if exact {
                self.passive.rebuild(simd, columns);
            }
            steps += self.passive.refine(simd, columns, b);
            // What could not enter beside members that have gone now may.
            self.rejected.clear();
            exact = true;
        }
    }

    /// Lets columns in as long as single precision tells which; returns how many were tried.
    ///
    /// The residual is that of the present values, before and after.
    #[inline(always)]
    fn search_single<S: Simd>(&mut self, simd: S, columns: &Columns, b: &[f64], tolerance: f64, most: usize) -> usize {
        let Some(mut search) = self.single.take() else {
            return 0;
        };
        let least = (LEAST_SINGLE * self.residual_norm()).max(0.5 * tolerance) as f32;
        let mut tried = 0;
        let mut largest = search.search_all(columns, self.passive.residual(), self.excluded());
        while largest > least && tried <= most {
            let limit = least.max(self.options.promising as f32 * largest);
            let before = tried;
            while let Some(j) = search.next(columns, self.passive.residual(), limit) {
                tried += 1;
                let gradient = self.passive.gradient(columns, j);
                self.enter(simd, columns, b, j, gradient);
            }
            if tried == before {
                break;
            }
            largest = search.search_pool(columns, self.passive.residual(), self.excluded());
        }
        self.single = Some(search);
        tried
    }

    /// Columns that cannot enter now.
    fn excluded(&self) -> [&[usize]; 2] {
        [self.passive.members(), &self.rejected]
    }

    /// Lets a column in. A column that gains nothing is rejected until something else has moved.
    #[inline(always)]
    fn enter<S: Simd>(&mut self, simd: S, columns: &Columns, b: &[f64], j: usize, gradient: f64) {
        if gradient > 0.0 && self.passive.enter(simd, columns, b, j, gradient) {
            self.rejected.clear();
        } else {
            self.rejected.push(j);
        }
    }

    /// Computes every column's gradient; returns the largest of those that may enter, for columns of norm 1.
    #[inline(always)]
    fn search_all(&mut self, columns: &Columns) -> f64 {
        if !self.passive.gradients(columns, &mut self.gradient) {
            columns.dots(self.passive.residual(), &mut self.gradient);
            for (g, scale) in self.gradient.iter_mut().zip(self.passive.scales()) {
                *g *= scale;
            }
        }
        self.outside.copy_from_slice(&self.gradient);
        for j in self.passive.members() {
            self.outside[*j] = 0.0;
        }
        self.worst_outside = largest(&self.outside);
        if self.rejected.is_empty() {
            return self.worst_outside;
        }
        for j in &self.rejected {
            self.outside[*j] = 0.0;
        }
        largest(&self.outside)
    }

    /// The gap of [`ActiveSet::run`], from the last search of all columns.
    #[inline(always)]
    fn gap(&self) -> f64 {
        if !self.residual_norm().is_finite() {
            return f64::INFINITY;
        }
        let members = self.passive.members().iter().zip(self.passive.values());
        members.fold(self.worst_outside, |gap, (j, value)| {
            gap.max(value.min(-self.gradient[*j]).abs())
        })
    }
}

/// The largest number above 0, or 0; the length is a multiple of [`LANES`].
#[inline(always)]
fn largest(numbers: &[f64]) -> f64 {
    let mut most = [0.0_f64; LANES];
    for numbers in numbers.as_chunks::<LANES>().0 {
        for (most, number) in most.iter_mut().zip(numbers) {
            *most = if number > most { *number } else { *most };
        }
    }
    most.into_iter().fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;
    use proptest::prelude::*;

    /// A right-hand side that is no number, between two frames, costs neither of them, nor what it makes of the members.
    #[test]
    fn a_spoilt_state_costs_no_later_frame() {
        let matrix = DMatrix::from_fn(32, 90, |i, j| ((3 * i + 7 * j + i * j) as f64 * 0.37).sin() + 0.3);
        let columns = Columns::new(&matrix, 1.0);
        let b: Vec<f64> = matrix.column(4).normalize().iter().copied().collect();
        for products in [true, false] {
            let mut set = ActiveSet::with(&columns, products, ActiveSetOptions::default());
            let solved = |set: &mut ActiveSet, b: &[f64]| {
                let run = set.run(&columns, b, 1e-10);
                let mut x = vec![0.0; 90];
                set.write(1.0, &mut x);
                (run.gap, x)
            };
            let (gap, first) = solved(&mut set, &b);
            assert!(gap <= 1e-10 && first.iter().any(|x| *x > 0.0));
            let (gap, none) = solved(&mut set, &[f64::NAN; 32]);
            assert!(gap == f64::INFINITY && none.iter().all(|x| *x == 0.0));
            let (gap, again) = solved(&mut set, &b);
            assert!(gap <= 1e-10, "{gap}");
            assert!(first.iter().zip(&again).all(|(a, b)| (a - b).abs() < 1e-9));
        }
    }

    proptest! {
        /// A solve ends where rounding alone decides whether a column is to enter: one that does not, never fails.
        #[test]
        fn a_solve_ends_where_rounding_decides(
            values in proptest::collection::vec(-0.3..1.0_f64, 32 * 90),
            b in proptest::collection::vec(-1.0..1.0_f64, 32),
            products: bool,
        ) {
            let columns = Columns::new(&DMatrix::from_vec(32, 90, values), 1.0);
            let norm = b.iter().map(|v| v * v).sum::<f64>().sqrt();
            let b: Vec<f64> = b.iter().map(|v| v / norm).collect();
            let mut set = ActiveSet::with(&columns, products, ActiveSetOptions::default());
            // Half of the tolerance is what is left, to a few units of the last place.
            set.run(&columns, &b, 0.2);
            let left = set.worst_outside;
            prop_assume!(left > 1e-12);
            for last_places in -8..9 {
                let tolerance = 2.0 * (left + f64::from(last_places) * f64::EPSILON / 8.0);
                let run = set.clone().run(&columns, &b, tolerance);
                prop_assert!(run.steps <= MOST_ENTRIES * 90 && run.gap <= tolerance);
            }
        }

        /// Which column enters first does not matter to the solution, nor how its gradient was computed.
        #[test]
        fn products_and_a_search_in_single_precision_find_the_same(
            values in proptest::collection::vec(-0.3..1.0_f64, 32 * 150),
            frames in proptest::collection::vec(proptest::collection::vec(-1.0..1.0_f64, 32), 3),
        ) {
            let columns = Columns::new(&DMatrix::from_vec(32, 150, values), 1.0);
            let [mut with, mut without] = [true, false].map(|products| ActiveSet::with(&columns, products, ActiveSetOptions::default()));
            for frame in frames {
                let norm = frame.iter().map(|v| v * v).sum::<f64>().sqrt();
                let b: Vec<f64> = frame.iter().map(|v| v / norm).collect();
                let [one, other] = [&mut with, &mut without].map(|plain| {
                    let run = plain.run(&columns, &b, 1e-11);
                    let mut x = vec![0.0; 150];
                    plain.write(1.0, &mut x);
                    (run.gap, plain.residual_norm(), x)
                });
                prop_assert!(one.0 <= 1e-11 && other.0 <= 1e-11);
                prop_assert!((one.1 - other.1).abs() < 1e-10);
            }
        }
    }
}
