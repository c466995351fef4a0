//! A few columns side by side: row by row, [`WIDTH`] numbers to a row.

use pulp::{Arch, Simd, WithSimd};

/// Most columns of a block.
pub(crate) const WIDTH: usize = 16;

/// `W = L^-1 W` for the first `count` columns (more may be solved for) of `W`, with the factor of
/// [`dense::cholesky`](crate::linalg::dense::cholesky).
pub(crate) fn forward(arch: Arch, l: &[f64], inverse: &[f64], w: &mut [f64], count: usize) {
    arch.dispatch(Forward { l, inverse, w, count });
}

struct Forward<'a> {
    l: &'a [f64],
    inverse: &'a [f64],
    w: &'a mut [f64],
    count: usize,
}

impl WithSimd for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { l, inverse, w, count } = self;
        let mut first = 0;
        while first < count {
            if count - first > S::F64_LANES {
                solve::<S, 2>(simd, l, inverse, w, first);
                first += 2 * S::F64_LANES;
            } else {
                solve::<S, 1>(simd, l, inverse, w, first);
                first += S::F64_LANES;
            }
        }
    }
}

/// Columns from `first` on, `N` vectors of them.
#[inline(always)]
fn solve<S: Simd, const N: usize>(simd: S, l: &[f64], inverse: &[f64], w: &mut [f64], first: usize) {
    let rows = inverse.len();
    let (per_row, first) = (WIDTH / S::F64_LANES, first / S::F64_LANES);
    let w = S::as_mut_simd_f64s(w).0;
    for k in 0..rows {
        let (done, rest) = w.split_at_mut((k + 1) * per_row);
        let row = &mut done[k * per_row + first..][..N];
        let one_over = simd.splat_f64s(inverse[k]);
        let mut solved = [simd.splat_f64s(0.0); N];
        for (solved, row) in solved.iter_mut().zip(row) {
            *row = simd.mul_f64s(*row, one_over);
            *solved = *row;
        }
        for (row, l) in rest.chunks_exact_mut(per_row).zip(&l[k * rows + k + 1..(k + 1) * rows]) {
            let l = simd.splat_f64s(*l);
            for (row, solved) in row[first..first + N].iter_mut().zip(solved) {
                *row = simd.negate_mul_add_e_f64s(l, solved, *row);
            }
        }
    }
}

/// `out = W^T W`, row by row.
pub(crate) fn gram(arch: Arch, w: &[f64], out: &mut [f64]) {
    arch.dispatch(Gram { w, out });
}

struct Gram<'a> {
    w: &'a [f64],
    out: &'a mut [f64],
}

impl WithSimd for Gram<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for (block, out) in self.out.chunks_exact_mut(4 * WIDTH).enumerate() {
            for vector in 0..WIDTH / S::F64_LANES {
                let mut sums = [simd.splat_f64s(0.0); 4];
                for row in self.w.chunks_exact(WIDTH) {
                    let across = S::as_simd_f64s(row).0[vector];
                    for (sum, down) in sums.iter_mut().zip(&row[4 * block..4 * block + 4]) {
                        *sum = simd.mul_add_e_f64s(across, simd.splat_f64s(*down), *sum);
                    }
                }
                for (out, sum) in out.chunks_exact_mut(WIDTH).zip(sums) {
                    S::as_mut_simd_f64s(out).0[vector] = sum;
                }
            }
        }
    }
}

/// `out = W^T y`.
pub(crate) fn dots(arch: Arch, w: &[f64], y: &[f64], out: &mut [f64; WIDTH]) {
    arch.dispatch(Dots { w, y, out });
}

struct Dots<'a> {
    w: &'a [f64],
    y: &'a [f64],
    out: &'a mut [f64; WIDTH],
}

impl WithSimd for Dots<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let out = S::as_mut_simd_f64s(self.out).0;
        out.fill(simd.splat_f64s(0.0));
        for (row, y) in self.w.chunks_exact(WIDTH).zip(self.y) {
            let y = simd.splat_f64s(*y);
            for (out, w) in out.iter_mut().zip(S::as_simd_f64s(row).0) {
                *out = simd.mul_add_e_f64s(*w, y, *out);
            }
        }
    }
}

/// `y -= W z`.
pub(crate) fn subtract(arch: Arch, w: &[f64], z: &[f64; WIDTH], y: &mut [f64]) {
    arch.dispatch(Subtract { w, z, y });
}

struct Subtract<'a> {
    w: &'a [f64],
    z: &'a [f64; WIDTH],
    y: &'a mut [f64],
}

impl WithSimd for Subtract<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let z = S::as_simd_f64s(self.z).0;
        for (row, y) in self.w.chunks_exact(WIDTH).zip(self.y) {
            let mut sum = simd.splat_f64s(0.0);
            for (w, z) in S::as_simd_f64s(row).0.iter().zip(z) {
                sum = simd.mul_add_e_f64s(*w, *z, sum);
            }
            *y -= simd.reduce_sum_f64s(sum);
        }
    }
}
