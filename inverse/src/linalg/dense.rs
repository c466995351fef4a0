//! Symmetric updates, Cholesky factors and triangular solves of a size that fits the second level of cache.
//!
//! Matrices are square, `rows x rows` with `rows` a multiple of [`LANES`], column by column; only the lower triangle is
//! read or meant.

use crate::linalg::kernels::LANES;
use pulp::{Arch, Simd, WithSimd};

/// Columns of a tile, and of a panel of the factorisation.
const TILE: usize = 4;
const PANEL: usize = 8;
/// Columns packed before they are used: they fit the first level of cache.
pub(crate) const PACK: usize = 24;

/// `h += p p^T` or, with `MINUS`, `h -= p p^T` for `p` of `p.len() / rows` columns.
pub(crate) fn add_outer<const MINUS: bool>(arch: Arch, h: &mut [f64], rows: usize, p: &[f64]) {
    arch.dispatch(AddOuter::<MINUS> { h, rows, p, first: 0 });
}

struct AddOuter<'a, const MINUS: bool> {
    h: &'a mut [f64],
    rows: usize,
    p: &'a [f64],
    /// Column of the whole matrix at which `h` begins.
    first: usize,
}

impl<const MINUS: bool> WithSimd for AddOuter<'_, MINUS> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { h, rows, p, first } = self;
        for (k, block) in h.chunks_exact_mut(TILE * rows).enumerate() {
            let column = first + k * TILE;
            let vectors = rows / S::F64_LANES;
            let mut row = column / S::F64_LANES;
            while row + 3 <= vectors {
                tile::<S, MINUS, 3>(simd, block, rows, p, column, row);
                row += 3;
            }
            match vectors - row {
                2 => tile::<S, MINUS, 2>(simd, block, rows, p, column, row),
                1 => tile::<S, MINUS, 1>(simd, block, rows, p, column, row),
                _ => {}
            }
        }
    }
}

/// `N` vectors of rows by `TILE` columns of the update, in registers.
#[inline(always)]
fn tile<S: Simd, const MINUS: bool, const N: usize>(
    simd: S,
    block: &mut [f64],
    rows: usize,
    p: &[f64],
    column: usize,
    row: usize,
) {
    let mut sums = [[simd.splat_f64s(0.0); N]; TILE];
    for p in p.chunks_exact(rows) {
        let across = &p[column..column + TILE];
        let down = &S::as_simd_f64s(p).0[row..row + N];
        for (sums, across) in sums.iter_mut().zip(across) {
            let across = simd.splat_f64s(*across);
            for (sum, down) in sums.iter_mut().zip(down) {
                *sum = simd.mul_add_e_f64s(*down, across, *sum);
            }
        }
    }
    for (h, sums) in block.chunks_exact_mut(rows).zip(sums) {
        let h = &mut S::as_mut_simd_f64s(h).0[row..row + N];
        for (h, sum) in h.iter_mut().zip(sums) {
            *h = if MINUS {
                simd.sub_f64s(*h, sum)
            } else {
                simd.add_f64s(*h, sum)
            };
        }
    }
}

/// Replaces the lower triangle by its Cholesky factor and fills `inverse` with one over the factor's diagonal; entries of
/// the upper triangle become 0. False when the matrix is not positive definite.
pub(crate) fn cholesky(arch: Arch, l: &mut [f64], inverse: &mut [f64]) -> bool {
    arch.dispatch(Cholesky { l, inverse })
}

struct Cholesky<'a> {
    l: &'a mut [f64],
    inverse: &'a mut [f64],
}

impl WithSimd for Cholesky<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let Self { l, inverse } = self;
        let rows = inverse.len();
        for first in (0..rows).step_by(PACK) {
            let width = PACK.min(rows - first);
            let (panel, rest) = l[first * rows..].split_at_mut(width * rows);
            if !factor_panel(simd, panel, &mut inverse[first..first + width], rows, first) {
                return false;
            }
            AddOuter::<true> {
                h: rest,
                rows,
                p: panel,
                first: first + width,
            }
            .with_simd(simd);
        }
        true
    }
}

/// Factors the columns from `first` on, of which everything to the left has been taken away.
#[inline(always)]
fn factor_panel<S: Simd>(simd: S, panel: &mut [f64], inverse: &mut [f64], rows: usize, first: usize) -> bool {
    for start in (0..inverse.len()).step_by(PANEL) {
        let (left, right) = panel.split_at_mut(start * rows);
        let part = &mut right[..PANEL * rows];
        AddOuter::<true> {
            h: part,
            rows,
            p: left,
            first: first + start,
        }
        .with_simd(simd);
        let from = (first + start) / S::F64_LANES;
        for k in 0..PANEL {
            let row = first + start + k;
            let (before, this) = part.split_at_mut(k * rows);
            let this = &mut this[..rows];
            for before in before.chunks_exact(rows) {
                let factor = simd.splat_f64s(before[row]);
                let before = &S::as_simd_f64s(before).0[from..];
                let this = &mut S::as_mut_simd_f64s(this).0[from..];
                for (this, before) in this.iter_mut().zip(before) {
                    *this = simd.negate_mul_add_e_f64s(*before, factor, *this);
                }
            }
            let pivot = this[row];
            if !(pivot > 0.0 && pivot.is_finite()) {
                return false;
            }
            let one_over = 1.0 / pivot.sqrt();
            inverse[start + k] = one_over;
            this[..row].fill(0.0);
            let factor = simd.splat_f64s(one_over);
            for this in &mut S::as_mut_simd_f64s(this).0[from..] {
                *this = simd.mul_f64s(*this, factor);
            }
        }
    }
    true
}

/// `y = L^-1 y`.
pub(crate) fn forward(arch: Arch, l: &[f64], inverse: &[f64], y: &mut [f64]) {
    arch.dispatch(Triangular {
        l,
        inverse,
        y,
        backward: false,
    });
}

/// `y = L^-T y`.
pub(crate) fn backward(arch: Arch, l: &[f64], inverse: &[f64], y: &mut [f64]) {
    arch.dispatch(Triangular {
        l,
        inverse,
        y,
        backward: true,
    });
}

struct Triangular<'a> {
    l: &'a [f64],
    inverse: &'a [f64],
    y: &'a mut [f64],
    backward: bool,
}

impl WithSimd for Triangular<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self {
            l,
            inverse,
            y,
            backward,
        } = self;
        let rows = inverse.len();
        let blocks = rows / PANEL;
        for block in 0..blocks {
            let first = PANEL * if backward { blocks - 1 - block } else { block };
            let below = (first + PANEL) / S::F64_LANES;
            let mut columns: [&[f64]; PANEL] = [&[]; PANEL];
            let mut vectors: [&[S::f64s]; PANEL] = [&[]; PANEL];
            let these = l[first * rows..(first + PANEL) * rows].chunks_exact(rows);
            for ((column, vector), this) in columns.iter_mut().zip(&mut vectors).zip(these) {
                *column = this;
                *vector = &S::as_simd_f64s(this).0[below..];
            }
            let (own, rest) = y.split_at_mut(first + PANEL);
            let own = &mut own[first..];
            let rest = S::as_mut_simd_f64s(rest).0;
            if backward {
                let mut sums = [simd.splat_f64s(0.0); PANEL];
                for (i, y) in rest.iter().enumerate() {
                    for (sum, l) in sums.iter_mut().zip(&vectors) {
                        *sum = simd.mul_add_e_f64s(l[i], *y, *sum);
                    }
                }
                for (own, sum) in own.iter_mut().zip(sums) {
                    *own -= simd.reduce_sum_f64s(sum);
                }
                for k in (0..PANEL).rev() {
                    for i in k + 1..PANEL {
                        own[k] -= columns[k][first + i] * own[i];
                    }
                    own[k] *= inverse[first + k];
                }
            } else {
                for k in 0..PANEL {
                    own[k] *= inverse[first + k];
                    for i in k + 1..PANEL {
                        own[i] -= columns[k][first + i] * own[k];
                    }
                }
                let mut factors = [simd.splat_f64s(0.0); PANEL];
                for (factor, own) in factors.iter_mut().zip(&*own) {
                    *factor = simd.splat_f64s(*own);
                }
                for (i, y) in rest.iter_mut().enumerate() {
                    let mut sums = [*y, simd.splat_f64s(0.0)];
                    for (k, (l, factor)) in vectors.iter().zip(factors).enumerate() {
                        sums[k % 2] = simd.negate_mul_add_e_f64s(l[i], factor, sums[k % 2]);
                    }
                    *y = simd.add_f64s(sums[0], sums[1]);
                }
            }
        }
    }
}

const _: () = assert!(LANES.is_multiple_of(TILE) && LANES.is_multiple_of(PANEL));
