//! Plain non-negative least squares (ridge 0): the active set method of Lawson and Hanson on the reduced rows, with few
//! looks at all the columns.
//!
//! A look computes the gradient of every column and keeps the most promising; columns enter one by one from those until
//! none of them promises much, and only then all are looked at again. The set of the frame before is the start of the
//! next.

use super::aligned::Aligned;
use super::columns::Columns;
use super::factor::dot;
use super::newton::Run;
use super::passive::Passive;
use pulp::{Simd, WithSimd};

/// Columns kept by a look.
const CANDIDATES: usize = 128;
/// A candidate enters while its gradient is at least this fraction of the largest at the look.
const PROMISING: f64 = 0.03;
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
/// Looks without progress after which rounding is taken to be the limit.
const MOST_STALLS: usize = 3;

/// The method with its state from solve to solve.
#[derive(Clone, Debug)]
pub(super) struct Plain {
    passive: Passive,
    gradient: Aligned,
    /// The gradient of what may still enter, 0 for the rest.
    outside: Aligned,
    /// Largest gradient of a column that is no member, or 0.
    worst_outside: f64,
    /// Gradient and column, the largest last.
    candidates: Vec<(f64, usize)>,
    refused: Vec<bool>,
    any_refused: bool,
}

impl Plain {
    /// No state yet.
    pub(super) fn new(columns: &Columns) -> Self {
        let cells = columns.cells();
        Self {
            passive: Passive::new(columns),
            gradient: Aligned::zeros(cells),
            outside: Aligned::zeros(cells),
            worst_outside: 0.0,
            candidates: Vec::with_capacity(cells),
            refused: vec![false; cells],
            any_refused: false,
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
    fn run_here(&mut self, columns: &Columns, b: &[f64], tolerance: f64) -> Run {
        self.refused.fill(false);
        self.any_refused = false;
        if self.passive.is_worn() {
            self.passive.rebuild(columns);
        }
        let most = MOST_ENTRIES * columns.cells();
        let mut steps = self.passive.refine(columns, b);
        let (mut least, mut stalls, mut exact) = (f64::INFINITY, 0, true);
        loop {
            self.passive.update(columns, b);
            let largest = self.look(columns);
            let (gap, residual) = (self.gap(), self.residual_norm());
            let optimal = self.candidates.is_empty() || largest <= 0.5 * tolerance;
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
                    self.passive.rebuild(columns);
                }
                steps += self.passive.refine(columns, b);
                exact = true;
                continue;
            }
            exact = false;
            while let Some((j, gradient)) = self.next(columns, b, (PROMISING * largest).max(0.5 * tolerance)) {
                steps += 1;
                if self.passive.enter(columns, b, j, gradient) {
                    if self.any_refused {
                        self.refused.fill(false);
                        self.any_refused = false;
                    }
                } else {
                    // Nothing gained: not again before something else has moved.
                    self.refused[j] = true;
                    self.any_refused = true;
                }
                if steps > most {
                    break;
                }
            }
        }
    }

    /// Computes every column's gradient and keeps the best as candidates, the least first; returns the largest, for columns of norm 1.
    #[inline(always)]
    fn look(&mut self, columns: &Columns) -> f64 {
        columns.dots(self.passive.residual(), &mut self.gradient);
        for (g, scale) in self.gradient.iter_mut().zip(self.passive.scales()) {
            *g *= scale;
        }
        // Members and refused columns are out of the question.
        self.outside.copy_from_slice(&self.gradient);
        for j in self.passive.members() {
            self.outside[*j] = 0.0;
        }
        self.worst_outside = self.outside.iter().copied().fold(0.0, f64::max);
        if self.any_refused {
            for (g, refused) in self.outside.iter_mut().zip(&self.refused) {
                if *refused {
                    *g = 0.0;
                }
            }
        }
        let largest = self.outside.iter().copied().fold(0.0, f64::max);
        self.candidates.clear();
        let limit = PROMISING * largest;
        let each = self.outside.iter().enumerate();
        self.candidates
            .extend(each.filter(|(_, g)| **g > 0.0 && **g >= limit).map(|(j, g)| (*g, j)));
        if self.candidates.len() > CANDIDATES {
            self.candidates
                .select_nth_unstable_by(CANDIDATES, |p, q| q.0.total_cmp(&p.0));
            self.candidates.truncate(CANDIDATES);
        }
        self.candidates.sort_unstable_by(|p, q| p.0.total_cmp(&q.0));
        largest
    }

    /// The candidate with the largest gradient, if that is above a limit, with the gradient as it is now.
    ///
    /// A gradient that was computed earlier stands for the present one until its candidate is the best of all: what enters takes
    /// from its neighbours, and hardly ever adds to one.
    #[inline(always)]
    fn next(&mut self, columns: &Columns, b: &[f64], limit: f64) -> Option<(usize, f64)> {
        while let Some((_, j)) = self.candidates.pop() {
            let now = self.passive.gradient(columns, b, j);
            if !(now > limit) {
                continue;
            }
            match self.candidates.last() {
                Some((other, _)) if now < *other => {
                    let place = self.candidates.partition_point(|(g, _)| *g < now);
                    self.candidates.insert(place, (now, j));
                }
                _ => return Some((j, now)),
            }
        }
        None
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
