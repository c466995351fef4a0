//! Plain non-negative least squares (ridge 0): the active set method of Lawson and Hanson on the reduced rows, with few
//! looks at all the columns.
//!
//! A look computes the gradient of every column and keeps the most promising; columns enter one by one from those until
//! none of them promises much, and only then all are looked at again. The set of the frame before is the start of the
//! next.

use super::columns::Columns;
use super::factor::dot;
use super::newton::Run;
use super::passive::Passive;
use pulp::{Simd, WithSimd};

/// Columns kept by a look.
const CANDIDATES: usize = 64;
/// A candidate enters while its gradient is at least this fraction of the largest at the look.
const PROMISING: f64 = 0.1;
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
    fn with_simd<S: Simd>(self, _: S) -> Run {
        self.plain.run_here(self.columns, self.b, self.tolerance)
    }
}

/// Rounding errors of a gradient, in units of the last place of the right-hand side.
const ROUNDINGS: f64 = 64.0;

/// The method with its state from solve to solve.
#[derive(Clone, Debug)]
pub(super) struct Plain {
    passive: Passive,
    gradient: Vec<f64>,
    candidates: Vec<usize>,
    products: Vec<f64>,
    refused: Vec<bool>,
    inside: Vec<bool>,
    list: Vec<(usize, f64)>,
}

impl Plain {
    /// No state yet.
    pub(super) fn new(columns: &Columns) -> Self {
        let cells = columns.cells();
        Self {
            passive: Passive::new(columns),
            gradient: vec![0.0; cells],
            candidates: Vec::with_capacity(cells),
            products: Vec::with_capacity(cells),
            refused: vec![false; cells],
            inside: vec![false; cells],
            list: Vec::with_capacity(cells),
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
    pub(super) fn write(&self, columns: &Columns, scale: f64, x: &mut [f64]) {
        for (j, value) in self.passive.members().iter().zip(self.passive.values()) {
            if let Some(x) = x.get_mut(*j) {
                *x = (value / columns.norms()[*j] * scale).clamp(0.0, f64::MAX);
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
    fn run_here(&mut self, columns: &Columns, b: &[f64], tolerance: f64) -> Run {
        let mut steps = self.passive.restart(columns, b, &mut self.list);
        self.refused.fill(false);
        self.inside.fill(false);
        for j in self.passive.members() {
            self.inside[*j] = true;
        }
        let most = MOST_ENTRIES * columns.cells();
        loop {
            self.passive.refine(columns, b, &mut self.list);
            let largest = self.look(columns);
            let gap = self.gap(columns);
            if self.candidates.is_empty() || largest <= 0.5 * tolerance || steps > most {
                return Run {
                    steps,
                    gap,
                    rounding: ROUNDINGS * f64::EPSILON,
                };
            }
            while let Some(j) = self.next(columns, (PROMISING * largest).max(0.5 * tolerance)) {
                steps += 1;
                let before = self.residual_norm();
                let solves = if self.passive.insert(columns, j) {
                    self.passive.settle(columns, b, &mut self.list)
                } else {
                    0
                };
                steps += solves;
                self.inside.fill(false);
                for j in self.passive.members() {
                    self.inside[*j] = true;
                }
                // Nothing gained by rounding: not again before something else has moved.
                if solves == 0 || self.residual_norm() >= before {
                    self.refused[j] = true;
                } else {
                    self.refused.fill(false);
                }
                if steps > most {
                    break;
                }
            }
        }
    }

    /// Computes every column's gradient and keeps the best as candidates; returns the largest over its column's norm.
    #[inline(always)]
    fn look(&mut self, columns: &Columns) -> f64 {
        columns.dots(self.passive.residual(), &mut self.gradient);
        self.candidates.clear();
        let mut largest = 0.0_f64;
        for (j, (g, norm)) in self.gradient.iter_mut().zip(columns.norms()).enumerate() {
            *g = if *norm > 0.0 { *g / norm } else { 0.0 };
            if *g > 0.0 && !self.inside[j] && !self.refused[j] {
                largest = largest.max(*g);
                self.candidates.push(j);
            }
        }
        let gradient = &self.gradient;
        self.candidates.retain(|j| gradient[*j] >= PROMISING * largest);
        if self.candidates.len() > CANDIDATES {
            self.candidates
                .select_nth_unstable_by(CANDIDATES, |i, j| gradient[*j].total_cmp(&gradient[*i]));
            self.candidates.truncate(CANDIDATES);
        }
        largest
    }

    /// The candidate with the largest gradient now, if that is above a limit.
    #[inline(always)]
    fn next(&mut self, columns: &Columns, limit: f64) -> Option<usize> {
        let (inside, refused) = (&self.inside, &self.refused);
        self.candidates.retain(|j| !inside[*j] && !refused[*j]);
        columns.dots_of(&self.candidates, self.passive.residual(), &mut self.products);
        let mut best = (limit, None);
        for (j, product) in self.candidates.iter().zip(&self.products) {
            let g = product / columns.norms()[*j];
            if g > best.0 {
                best = (g, Some(*j));
            }
        }
        best.1
    }

    /// See [`Plain::run`]; from the gradient of the last look.
    #[inline(always)]
    fn gap(&self, columns: &Columns) -> f64 {
        let mut gap = 0.0_f64;
        for (j, g) in self.gradient.iter().enumerate().take(columns.cells()) {
            if !self.inside[j] {
                gap = gap.max(*g);
            }
        }
        for (j, value) in self.passive.members().iter().zip(self.passive.values()) {
            gap = gap.max(value.min(-self.gradient[*j]).abs());
        }
        gap
    }
}
