//! Plain non-negative least squares (ridge 0): the active set method of Lawson and Hanson on the reduced rows, with few
//! looks at all the columns.
//!
//! A look computes the gradient of every column and keeps the most promising; columns enter one by one from those until
//! none of them promises much, and only then all are looked at again. Where the columns' products are not kept, looks in
//! single precision at some of the columns come first. The set of the frame before is the start of the next.

use crate::linalg::aligned::Aligned;
use crate::linalg::columns::Columns;
use crate::linalg::kernels::LANES;
use crate::solvers::column_search::Search;
use crate::solvers::factor::dot;
use crate::solvers::newton::Run;
use crate::solvers::passive_set::Passive;
use crate::solvers::products::MOST_CELLS;
use crate::solvers::queue::Queue;
use pulp::{Simd, WithSimd};

/// A column enters while its gradient is at least this fraction of the largest at the look.
const PROMISING: f64 = 0.03;
/// Least gradient that single precision tells from nothing, over the norm of the residual.
const SINGLE: f64 = 3e-6;
/// Entries for each column after which the method gives up.
const MOST_ENTRIES: usize = 10;

/// A run, to be compiled for the vector unit at hand.
struct Here<'a> {
    plain: &'a mut Plain,
    columns: &'a Columns,
    b: &'a [f64],
    tolerance: f64,
}

impl WithSimd for Here<'_> {
    type Output = Run;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Run {
        self.plain.run_here(simd, self.columns, self.b, self.tolerance)
    }
}

/// Rounding errors of a gradient, in units of the last place of the right-hand side.
const ROUNDINGS: f64 = 64.0;
/// Looks without progress after which rounding is taken to be the limit.
const MOST_STALLS: usize = 3;

/// The method with its state from solve to solve.
#[derive(Clone, Debug)]
pub(super) struct Plain {
    passive: Passive,
    /// Of all columns, and the same with 0 for those that may not enter.
    gradient: Aligned,
    outside: Aligned,
    /// Largest gradient of a column that is no member, or 0.
    worst_outside: f64,
    queue: Queue,
    /// For matrices whose products are not kept.
    search: Option<Box<Search>>,
    refused: Vec<usize>,
}

impl Plain {
    /// No state yet.
    pub(super) fn new(columns: &Columns) -> Self {
        Self::with(columns, columns.cells() <= MOST_CELLS)
    }

    /// With the products of all columns, or with a search in single precision.
    fn with(columns: &Columns, products: bool) -> Self {
        let cells = columns.cells();
        let passive = Passive::new(columns, products);
        Self {
            search: (!products).then(|| Box::new(Search::new(columns, passive.scales()))),
            passive,
            gradient: Aligned::zeros(cells),
            outside: Aligned::zeros(cells),
            worst_outside: 0.0,
            queue: Queue::new(cells),
            refused: Vec::with_capacity(cells),
        }
    }

    /// Forgets the last solve.
    pub(super) fn reset(&mut self) {
        self.passive.clear();
    }

    /// Norm of `b - A x`.
    pub(super) fn residual_norm(&self) -> f64 {
        dot(self.passive.residual(), self.passive.residual()).sqrt()
    }

    /// Norm of the first `rows` of it.
    pub(super) fn residual_norm_of(&self, rows: usize) -> f64 {
        let head = self.passive.residual().iter().take(rows);
        head.map(|r| r * r).sum::<f64>().sqrt()
    }

    /// Writes x, times `scale`.
    pub(super) fn write(&self, scale: f64, x: &mut [f64]) {
        for (j, value) in self.passive.members().iter().zip(self.passive.values()) {
            if let Some(x) = x.get_mut(*j) {
                *x = (value * self.passive.scales()[*j] * scale).clamp(0.0, f64::MAX);
            }
        }
    }

    /// Solves for a right-hand side of norm 1. The gap is the largest entry of `|min(x_j |a_j|, -g_j / |a_j|)|`, g the
    /// gradient `A^T (A x - b)`.
    pub(super) fn run(&mut self, columns: &Columns, b: &[f64], tolerance: f64) -> Run {
        columns.arch().dispatch(Here {
            plain: self,
            columns,
            b,
            tolerance,
        })
    }

    #[inline(always)]
    fn run_here<S: Simd>(&mut self, simd: S, columns: &Columns, b: &[f64], tolerance: f64) -> Run {
        self.refused.clear();
        if self.passive.is_worn() {
            self.passive.rebuild(simd, columns);
        }
        let most = MOST_ENTRIES * columns.cells();
        self.passive.begin(columns, b);
        let mut steps = self.passive.refine(simd, columns, b);
        let (mut least, mut stalls, mut exact) = (f64::INFINITY, 0, true);
        loop {
            self.passive.update(columns, b);
            if steps <= most {
                let tried = self.search(simd, columns, b, tolerance, most);
                steps += tried;
                exact &= tried == 0;
            }
            let largest = self.look(columns);
            let (gap, residual) = (self.gap(), self.residual_norm());
            let optimal = largest <= 0.5 * tolerance;
            if exact {
                // Where the steps since then gained nothing, rounding is the limit.
                stalls = if residual < least { 0 } else { stalls + 1 };
                least = least.min(residual);
            }
            if optimal && gap <= tolerance || stalls >= MOST_STALLS || steps > most {
                return Run {
                    steps,
                    gap,
                    rounding: ROUNDINGS * f64::EPSILON,
                };
            }
            if optimal {
                // What is left is rounding in the members' values, and if not there, in their factor.
                if exact {
                    self.passive.rebuild(simd, columns);
                }
                steps += self.passive.refine(simd, columns, b);
                exact = true;
                continue;
            }
            exact = false;
            let limit = (PROMISING * largest).max(0.5 * tolerance);
            self.queue.fill(&self.outside, limit);
            while steps <= most
                && let Some((j, gradient)) = self.queue.next(limit, |j| self.passive.gradient(columns, j))
            {
                steps += 1;
                self.enter(simd, columns, b, j, gradient);
            }
        }
    }

    /// Lets columns in as long as single precision tells which; returns how many were tried. The residual is that of the
    /// present values before and after.
    #[inline(always)]
    fn search<S: Simd>(&mut self, simd: S, columns: &Columns, b: &[f64], tolerance: f64, most: usize) -> usize {
        let Some(mut search) = self.search.take() else {
            return 0;
        };
        let least = (SINGLE * self.residual_norm()).max(0.5 * tolerance) as f32;
        let mut tried = 0;
        let mut largest = search.look_at_all(columns, self.passive.residual(), self.closed());
        while largest > least && tried <= most {
            let limit = least.max(PROMISING as f32 * largest);
            while let Some(j) = search.next(columns, self.passive.residual(), limit) {
                tried += 1;
                let gradient = self.passive.gradient(columns, j);
                self.enter(simd, columns, b, j, gradient);
            }
            largest = search.look(columns, self.passive.residual(), self.closed());
        }
        self.search = Some(search);
        tried
    }

    /// Columns that cannot enter now.
    fn closed(&self) -> [&[usize]; 2] {
        [self.passive.members(), &self.refused]
    }

    /// Lets a column in; one that gains nothing is refused until something else has moved.
    #[inline(always)]
    fn enter<S: Simd>(&mut self, simd: S, columns: &Columns, b: &[f64], j: usize, gradient: f64) {
        if gradient > 0.0 && self.passive.enter(simd, columns, b, j, gradient) {
            self.refused.clear();
        } else {
            self.refused.push(j);
        }
    }

    /// Computes every column's gradient; returns the largest of those that may enter, for columns of norm 1.
    #[inline(always)]
    fn look(&mut self, columns: &Columns) -> f64 {
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
        if self.refused.is_empty() {
            return self.worst_outside;
        }
        for j in &self.refused {
            self.outside[*j] = 0.0;
        }
        largest(&self.outside)
    }

    /// See [`Plain::run`]; from the last look.
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

/// The largest number above 0, or 0.
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

    proptest! {
        /// Which column enters first does not matter to the solution, nor how its gradient was computed.
        #[test]
        fn products_and_a_search_in_single_precision_find_the_same(
            values in proptest::collection::vec(-0.3..1.0_f64, 32 * 150),
            frames in proptest::collection::vec(proptest::collection::vec(-1.0..1.0_f64, 32), 3),
        ) {
            let columns = Columns::new(&DMatrix::from_vec(32, 150, values), 1.0);
            let [mut with, mut without] = [true, false].map(|products| Plain::with(&columns, products));
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
