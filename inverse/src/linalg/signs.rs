//! Which side of zero every cell is on, a vector at a time.

use pulp::{Arch, Simd, WithSimd, bytemuck};

/// `g += t q`; puts `(j, |g_j|)` of the entries that changed sides in the list and returns the largest entry, or 0.
pub(crate) fn advance(arch: Arch, g: &mut [f64], q: &[f64], t: f64, list: &mut Vec<(usize, f64)>) -> f64 {
    arch.dispatch(Advance { g, q, t, list })
}

struct Advance<'a> {
    g: &'a mut [f64],
    q: &'a [f64],
    t: f64,
    list: &'a mut Vec<(usize, f64)>,
}

impl WithSimd for Advance<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let Self { g, q, t, list } = self;
        list.clear();
        let one = simd.splat_f64s(1.0);
        let (zero, t) = (simd.splat_f64s(0.0), simd.splat_f64s(t));
        let mut largest = zero;
        let blocks = g.chunks_exact_mut(S::F64_LANES).zip(S::as_simd_f64s(q).0);
        for (block, (g, q)) in blocks.enumerate() {
            let Some(g) = S::as_mut_simd_f64s(g).0.first_mut() else {
                continue;
            };
            let (before, next) = (*g, simd.mul_add_e_f64s(t, *q, *g));
            *g = next;
            largest = simd.max_f64s(next, largest);
            let (was, is) = (simd.greater_than_f64s(before, zero), simd.greater_than_f64s(next, zero));
            let moved = simd.sub_f64s(simd.select_f64s(was, one, zero), simd.select_f64s(is, one, zero));
            if simd.reduce_max_f64s(simd.abs_f64s(moved)) > 0.0 {
                let moved = bytemuck::cast_slice::<S::f64s, f64>(std::slice::from_ref(&moved));
                let next = bytemuck::cast_slice::<S::f64s, f64>(std::slice::from_ref(&next));
                for (k, (moved, next)) in moved.iter().zip(next).enumerate() {
                    if *moved != 0.0 {
                        list.push((S::F64_LANES * block + k, next.abs()));
                    }
                }
            }
        }
        simd.reduce_max_f64s(largest)
    }
}

/// The positive entries.
pub(crate) fn positive(g: &[f64], list: &mut Vec<(usize, f64)>) {
    list.clear();
    list.extend(g.iter().copied().enumerate().filter(|(_, g)| *g > 0.0));
}

/// `a -= b`.
pub(crate) fn subtract(arch: Arch, a: &mut [f64], b: &[f64]) {
    arch.dispatch(Subtract { a, b });
}

struct Subtract<'a> {
    a: &'a mut [f64],
    b: &'a [f64],
}

impl WithSimd for Subtract<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for (a, b) in S::as_mut_simd_f64s(self.a).0.iter_mut().zip(S::as_simd_f64s(self.b).0) {
            *a = simd.sub_f64s(*a, *b);
        }
    }
}
