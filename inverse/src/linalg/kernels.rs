//! The loops in which the solvers spend their time, compiled for the vector unit found at run time.
//!
//! Matrices are column by column, with a stride that is a multiple of [`LANES`]: no loop over numbers has a remainder.

use pulp::{Arch, Simd, WithSimd};

/// Lengths are padded to a multiple of so many `f64`: one register of the widest vector unit.
pub(crate) const LANES: usize = 8;

/// The same for `f32`.
pub(crate) const SINGLE_LANES: usize = 16;

/// Columns that [`dots`] takes at once. The number of columns is padded to a multiple of this.
pub(crate) const COLUMNS_AT_ONCE: usize = 8;

/// Next multiple of `step`.
pub(crate) const fn padded(length: usize, step: usize) -> usize {
    length.div_ceil(step) * step
}

/// `out_j = column_j . v`.
pub(crate) fn dots(arch: Arch, columns: &[f64], v: &[f64], out: &mut [f64]) {
    arch.dispatch(Dots { columns, v, out });
}

struct Dots<'a> {
    columns: &'a [f64],
    v: &'a [f64],
    out: &'a mut [f64],
}

impl WithSimd for Dots<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { columns, v, out } = self;
        let rows = v.len();
        let v = S::as_simd_f64s(v).0;
        for (block, out) in columns
            .chunks_exact(COLUMNS_AT_ONCE * rows)
            .zip(out.chunks_exact_mut(COLUMNS_AT_ONCE))
        {
            let mut sums = [simd.splat_f64s(0.0); COLUMNS_AT_ONCE];
            let c: [&[S::f64s]; COLUMNS_AT_ONCE] =
                std::array::from_fn(|k| &S::as_simd_f64s(&block[k * rows..(k + 1) * rows]).0[..v.len()]);
            for (i, v) in v.iter().enumerate() {
                for (sum, c) in sums.iter_mut().zip(&c) {
                    *sum = simd.mul_add_e_f64s(c[i], *v, *sum);
                }
            }
            for (out, sum) in out.iter_mut().zip(sums) {
                *out = simd.reduce_sum_f64s(sum);
            }
        }
    }
}

/// So many vectors, and so many columns, [`dots_with`] takes at once: each is read a quarter as often.
pub(crate) const VECTORS_AT_ONCE: usize = 4;

/// What [`dots`] tells of several vectors, one after the other.
pub(crate) fn dots_with(arch: Arch, columns: &[f64], vectors: [&[f64]; VECTORS_AT_ONCE], out: &mut [f64]) {
    arch.dispatch(DotsWith { columns, vectors, out });
}

struct DotsWith<'a> {
    columns: &'a [f64],
    vectors: [&'a [f64]; VECTORS_AT_ONCE],
    out: &'a mut [f64],
}

impl WithSimd for DotsWith<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        const AT_ONCE: usize = VECTORS_AT_ONCE;
        let Self { columns, vectors, out } = self;
        const { assert!(COLUMNS_AT_ONCE.is_multiple_of(AT_ONCE)) }
        let rows = vectors[0].len();
        let cells = out.len() / AT_ONCE;
        debug_assert_eq!(AT_ONCE * columns.len(), rows * out.len());
        let v: [&[S::f64s]; AT_ONCE] = vectors.map(|v| S::as_simd_f64s(&v[..rows]).0);
        let length = v[0].len();
        let v = v.map(|v| &v[..length]);
        for (block, columns) in columns.chunks_exact(AT_ONCE * rows).enumerate() {
            let mut sums = [[simd.splat_f64s(0.0); AT_ONCE]; AT_ONCE];
            let c: [&[S::f64s]; AT_ONCE] =
                std::array::from_fn(|k| &S::as_simd_f64s(&columns[k * rows..(k + 1) * rows]).0[..length]);
            for i in 0..length {
                for (sums, c) in sums.iter_mut().zip(&c) {
                    for (sum, v) in sums.iter_mut().zip(&v) {
                        *sum = simd.mul_add_e_f64s(c[i], v[i], *sum);
                    }
                }
            }
            for (k, sums) in sums.into_iter().enumerate() {
                for (of_vector, sum) in sums.into_iter().enumerate() {
                    out[of_vector * cells + block * AT_ONCE + k] = simd.reduce_sum_f64s(sum);
                }
            }
        }
    }
}

/// `out_k = column_j . v` for the k-th j of a list; `out` is emptied first.
pub(crate) fn dots_of(arch: Arch, columns: &[f64], list: &[usize], v: &[f64], out: &mut Vec<f64>) {
    arch.dispatch(DotsOf { columns, list, v, out });
}

struct DotsOf<'a> {
    columns: &'a [f64],
    list: &'a [usize],
    v: &'a [f64],
    out: &'a mut Vec<f64>,
}

impl WithSimd for DotsOf<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { columns, list, v, out } = self;
        let rows = v.len();
        let v = S::as_simd_f64s(v).0;
        out.clear();
        let (fours, rest) = list.as_chunks::<4>();
        for four in fours {
            let c: [&[S::f64s]; 4] =
                std::array::from_fn(|k| &S::as_simd_f64s(&columns[four[k] * rows..][..rows]).0[..v.len()]);
            let mut sums = [simd.splat_f64s(0.0); 4];
            for (i, v) in v.iter().enumerate() {
                for (sum, c) in sums.iter_mut().zip(&c) {
                    *sum = simd.mul_add_e_f64s(c[i], *v, *sum);
                }
            }
            for sum in sums {
                out.push(simd.reduce_sum_f64s(sum));
            }
        }
        for j in rest {
            let mut sum = simd.splat_f64s(0.0);
            let column = S::as_simd_f64s(&columns[j * rows..(j + 1) * rows]).0;
            for (c, v) in column.iter().zip(v) {
                sum = simd.mul_add_e_f64s(*c, *v, sum);
            }
            out.push(simd.reduce_sum_f64s(sum));
        }
    }
}

/// `y += sum of x_j column_j` over a list of `(j, x_j)`.
pub(crate) fn add_columns(arch: Arch, columns: &[f64], list: &[(usize, f64)], y: &mut [f64]) {
    arch.dispatch(AddColumns { columns, list, y });
}

struct AddColumns<'a> {
    columns: &'a [f64],
    list: &'a [(usize, f64)],
    y: &'a mut [f64],
}

impl WithSimd for AddColumns<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { columns, list, y } = self;
        let rows = y.len();
        let y = S::as_mut_simd_f64s(y).0;
        let length = y.len();
        let (fours, rest) = list.as_chunks::<4>();
        for four in fours {
            let [a, b, c, d]: [&[S::f64s]; 4] =
                std::array::from_fn(|k| &S::as_simd_f64s(&columns[four[k].0 * rows..][..rows]).0[..length]);
            let mut by = [simd.splat_f64s(0.0); 4];
            for (by, (_, x)) in by.iter_mut().zip(four) {
                *by = simd.splat_f64s(*x);
            }
            let [p, q, r, s] = by;
            for i in 0..length {
                let lower = simd.mul_add_e_f64s(b[i], q, simd.mul_f64s(a[i], p));
                let upper = simd.mul_add_e_f64s(d[i], s, simd.mul_add_e_f64s(c[i], r, y[i]));
                y[i] = simd.add_f64s(lower, upper);
            }
        }
        for (j, x) in rest {
            let (a, p) = (
                S::as_simd_f64s(&columns[j * rows..(j + 1) * rows]).0,
                simd.splat_f64s(*x),
            );
            for i in 0..length {
                y[i] = simd.mul_add_e_f64s(a[i], p, y[i]);
            }
        }
    }
}

/// The same of columns in single precision, padded to a multiple of [`SINGLE_LANES`]: what is added is summed in single precision.
pub(crate) fn add_columns_single(arch: Arch, columns: &[f32], list: &[(usize, f64)], y: &mut [f64]) {
    arch.dispatch(AddColumnsSingle { columns, list, y });
}

struct AddColumnsSingle<'a> {
    columns: &'a [f32],
    list: &'a [(usize, f64)],
    y: &'a mut [f64],
}

/// Registers that are summed at once.
const REGISTERS: usize = 8;

impl WithSimd for AddColumnsSingle<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { columns, list, y } = self;
        let rows = padded(y.len(), SINGLE_LANES);
        let lanes = S::F32_LANES;
        let mut room = [0.0_f32; REGISTERS * SINGLE_LANES];
        for (block, y) in y.chunks_mut(REGISTERS * lanes).enumerate() {
            let from = block * REGISTERS * lanes;
            let many = (rows - from).min(REGISTERS * lanes);
            let mut sums = [simd.splat_f32s(0.0); REGISTERS];
            for (j, x) in list {
                let by = simd.splat_f32s(*x as f32);
                let column = S::as_simd_f32s(&columns[j * rows + from..][..many]).0;
                // A whole block stays in registers, the last one need not.
                if let Ok(column) = <&[S::f32s; REGISTERS]>::try_from(column) {
                    for (sum, v) in sums.iter_mut().zip(column) {
                        *sum = simd.mul_add_e_f32s(*v, by, *sum);
                    }
                } else {
                    for (sum, v) in sums.iter_mut().zip(column) {
                        *sum = simd.mul_add_e_f32s(*v, by, *sum);
                    }
                }
            }
            let of_block = S::as_mut_simd_f32s(&mut room[..REGISTERS * lanes]).0;
            of_block.iter_mut().zip(sums).for_each(|(to, sum)| *to = sum);
            y.iter_mut().zip(&room).for_each(|(y, v)| *y += f64::from(*v));
        }
    }
}

/// `out_k = column_j . v` for the k-th j of a list, in single precision. The list's length is a multiple of
/// [`COLUMNS_AT_ONCE`].
pub(crate) fn dots_of_single(arch: Arch, columns: &[f32], list: &[u32], v: &[f32], out: &mut [f32]) {
    arch.dispatch(DotsOfSingle { columns, list, v, out });
}

struct DotsOfSingle<'a> {
    columns: &'a [f32],
    list: &'a [u32],
    v: &'a [f32],
    out: &'a mut [f32],
}

impl WithSimd for DotsOfSingle<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { columns, list, v, out } = self;
        let rows = v.len();
        let v = S::as_simd_f32s(v).0;
        let (eights, _) = list.as_chunks::<COLUMNS_AT_ONCE>();
        for (eight, out) in eights.iter().zip(out.as_chunks_mut::<COLUMNS_AT_ONCE>().0) {
            let mut sums = [simd.splat_f32s(0.0); COLUMNS_AT_ONCE];
            let c: [&[S::f32s]; COLUMNS_AT_ONCE] =
                std::array::from_fn(|k| &S::as_simd_f32s(&columns[eight[k] as usize * rows..][..rows]).0[..v.len()]);
            for (i, v) in v.iter().enumerate() {
                for (sum, c) in sums.iter_mut().zip(&c) {
                    *sum = simd.mul_add_e_f32s(c[i], *v, *sum);
                }
            }
            for (out, sum) in out.iter_mut().zip(sums) {
                *out = simd.reduce_sum_f32s(sum);
            }
        }
    }
}

/// Share of the entries that change sign between g and `g + t q` in the derivative of `1/2 |max(0, g + t q)|^2` with
/// respect to t, and the slope of that share. The rest of the derivative is the straight line that it has at t = 0.
pub(crate) fn crossings(arch: Arch, g: &[f64], q: &[f64], t: f64) -> (f64, f64) {
    arch.dispatch(Crossings { g, q, t })
}

struct Crossings<'a> {
    g: &'a [f64],
    q: &'a [f64],
    t: f64,
}

impl WithSimd for Crossings<'_> {
    type Output = (f64, f64);

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> (f64, f64) {
        let (g, q) = (S::as_simd_f64s(self.g).0, S::as_simd_f64s(self.q).0);
        let (zero, t) = (simd.splat_f64s(0.0), simd.splat_f64s(self.t));
        let (mut value, mut slope) = (zero, zero);
        for (g, q) in g.iter().zip(q) {
            let at = simd.mul_add_e_f64s(*q, t, *g);
            let (before, after) = (simd.greater_than_f64s(*g, zero), simd.greater_than_f64s(at, zero));
            // +q for an entry that became positive, -q for one that ceased to be, 0 for the rest.
            let came = simd.select_f64s(before, zero, *q);
            let went = simd.select_f64s(before, simd.neg_f64s(*q), zero);
            let moved = simd.select_f64s(after, came, went);
            value = simd.mul_add_e_f64s(at, moved, value);
            slope = simd.mul_add_e_f64s(*q, moved, slope);
        }
        (simd.reduce_sum_f64s(value), simd.reduce_sum_f64s(slope))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Several vectors at once give the same, to the last digit.
    #[test]
    fn dots_of_vectors_at_once_are_those_of_each() {
        let arch = Arch::new();
        for (rows, cells) in [(8, 8), (24, 16), (208, 120)] {
            let columns: Vec<f64> = (0..rows * cells).map(|k| (0.7 * k as f64).sin()).collect();
            let vectors: [Vec<f64>; VECTORS_AT_ONCE] =
                std::array::from_fn(|j| (0..rows).map(|k| (1.3 * k as f64 + j as f64).cos()).collect());
            let mut at_once = vec![0.0; VECTORS_AT_ONCE * cells];
            let mut each = at_once.clone();
            dots_with(arch, &columns, vectors.each_ref().map(Vec::as_slice), &mut at_once);
            for (v, out) in vectors.iter().zip(each.chunks_exact_mut(cells)) {
                dots(arch, &columns, v, out);
            }
            assert!(at_once.iter().all(|v| *v != 0.0));
            assert_eq!(at_once, each);
        }
    }

    /// Sums in single precision are those in double, to its rounding: for every length of columns and of the list.
    #[test]
    fn single_precision_sums_what_double_does() {
        let arch = Arch::new();
        for length in [0, 8, 16, 24, 120, 128, 136, 280] {
            let (stride, columns) = (padded(length, SINGLE_LANES), 12);
            let value = |k: usize, j: usize| (0.7 * k as f64 + 1.3 * j as f64).sin();
            let double: Vec<f64> = (0..columns * length).map(|i| value(i % length, i / length)).collect();
            let mut single = vec![0.0_f32; columns * stride];
            for (j, column) in single.chunks_exact_mut(stride.max(1)).enumerate() {
                column[..length]
                    .iter_mut()
                    .enumerate()
                    .for_each(|(k, v)| *v = value(k, j) as f32);
            }
            for count in [0, 1, 4, 9] {
                let list: Vec<(usize, f64)> = (0..count).map(|k| ((5 * k) % columns, 0.3 - 0.1 * k as f64)).collect();
                let (mut a, mut b) = (vec![1.0; length], vec![1.0; length]);
                add_columns(arch, &double, &list, &mut a);
                add_columns_single(arch, &single, &list, &mut b);
                assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-6), "{length} {count}");
                assert!(count == 0 || length == 0 || a != vec![1.0; length]);
            }
        }
    }
}
