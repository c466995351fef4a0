//! The loops of the touches' fit, with the vector unit found at run time.
//!
//! Columns are padded with zeros to a multiple of [`LANES`](crate::linalg::kernels::LANES).

use pulp::{Arch, Simd, WithSimd};

/// Weights of three neighbouring tabulated radii, and their derivatives by the radius.
#[derive(Clone, Copy, Debug)]
pub(super) struct Radii {
    /// Which is the first of them.
    pub(super) first: usize,
    pub(super) value: [f64; 3],
    pub(super) slope: [f64; 3],
}

/// The four by four nodes around a place: first column of each (row by row), weights of its columns and rows, and their
/// derivatives by the place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stencil {
    pub(super) columns: [usize; 16],
    pub(super) across: [f64; 4],
    pub(super) across_slope: [f64; 4],
    pub(super) up: [f64; 4],
    pub(super) up_slope: [f64; 4],
}

/// Interpolates a table of columns (a few radii at every node): the value and its derivatives by x, y and radius, each
/// of the length of a column.
pub(super) fn interpolate(arch: Arch, table: &[f64], radii: &Radii, stencil: &Stencil, out: [&mut [f64]; 4]) {
    arch.dispatch(Interpolate {
        table,
        radii,
        stencil,
        out,
    });
}

struct Interpolate<'a> {
    table: &'a [f64],
    radii: &'a Radii,
    stencil: &'a Stencil,
    out: [&'a mut [f64]; 4],
}

impl WithSimd for Interpolate<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self {
            table,
            radii,
            stencil,
            out,
        } = self;
        let rows = out[0].len();
        let [value, by_x, by_y, by_radius] = out.map(|o| S::as_mut_simd_f64s(o).0);
        let length = value.len();
        let (by_x, by_y, by_radius) = (&mut by_x[..length], &mut by_y[..length], &mut by_radius[..length]);
        let columns: [&[S::f64s]; 48] = std::array::from_fn(|k| {
            let start = (stencil.columns[k / 3] + radii.first + k % 3) * rows;
            &S::as_simd_f64s(&table[start..start + rows]).0[..length]
        });
        let zero = simd.splat_f64s(0.0);
        for i in 0..length {
            let mut sums = [zero; 4];
            for (row, (up, up_slope)) in stencil.up.iter().zip(&stencil.up_slope).enumerate() {
                let (mut here, mut here_x, mut here_radius) = (zero, zero, zero);
                for (k, (across, slope)) in stencil.across.iter().zip(&stencil.across_slope).enumerate() {
                    let (mut v, mut d) = (zero, zero);
                    for r in 0..3 {
                        let c = columns[12 * row + 3 * k + r][i];
                        v = simd.mul_add_e_f64s(c, simd.splat_f64s(radii.value[r]), v);
                        d = simd.mul_add_e_f64s(c, simd.splat_f64s(radii.slope[r]), d);
                    }
                    here = simd.mul_add_e_f64s(v, simd.splat_f64s(*across), here);
                    here_x = simd.mul_add_e_f64s(v, simd.splat_f64s(*slope), here_x);
                    here_radius = simd.mul_add_e_f64s(d, simd.splat_f64s(*across), here_radius);
                }
                let (up, up_slope) = (simd.splat_f64s(*up), simd.splat_f64s(*up_slope));
                for (sum, (part, weight)) in
                    sums.iter_mut()
                        .zip([(here, up), (here_x, up), (here, up_slope), (here_radius, up)])
                {
                    *sum = simd.mul_add_e_f64s(part, weight, *sum);
                }
            }
            [value[i], by_x[i], by_y[i], by_radius[i]] = sums;
        }
    }
}

/// Products of all columns with one another (lower triangle, `count x count`, column by column) and with a vector.
pub(super) fn normal(arch: Arch, columns: &[f64], vector: &[f64], products: &mut [f64], with_vector: &mut [f64]) {
    arch.dispatch(Normal {
        columns,
        vector,
        products,
        with_vector,
    });
}

struct Normal<'a> {
    columns: &'a [f64],
    vector: &'a [f64],
    products: &'a mut [f64],
    with_vector: &'a mut [f64],
}

impl WithSimd for Normal<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self {
            columns,
            vector,
            products,
            with_vector,
        } = self;
        let (rows, count) = (vector.len(), with_vector.len());
        let vector = S::as_simd_f64s(vector).0;
        let length = vector.len();
        let zero = simd.splat_f64s(0.0);
        let column = |j: usize| &S::as_simd_f64s(&columns[j * rows..(j + 1) * rows]).0[..length];
        // Columns come by fours: a touch has four.
        for first in (0..count).step_by(4) {
            let four: [&[S::f64s]; 4] = std::array::from_fn(|k| column(first + k));
            let mut sums = [zero; 4];
            for (i, v) in vector.iter().enumerate() {
                for (sum, c) in sums.iter_mut().zip(&four) {
                    *sum = simd.mul_add_e_f64s(c[i], *v, *sum);
                }
            }
            for (out, sum) in with_vector[first..first + 4].iter_mut().zip(sums) {
                *out = simd.reduce_sum_f64s(sum);
            }
            for j in 0..first + 4 {
                let other = column(j);
                let mut sums = [zero; 4];
                for (i, v) in other.iter().enumerate() {
                    for (sum, c) in sums.iter_mut().zip(&four) {
                        *sum = simd.mul_add_e_f64s(c[i], *v, *sum);
                    }
                }
                for (k, sum) in sums.into_iter().enumerate() {
                    products[j * count + first + k] = simd.reduce_sum_f64s(sum);
                }
            }
        }
    }
}

/// `y += f x`, and the square of the outcome.
pub(super) fn add_scaled(arch: Arch, x: &[f64], f: f64, y: &mut [f64]) -> f64 {
    arch.dispatch(AddScaled { x, f, y })
}

struct AddScaled<'a> {
    x: &'a [f64],
    f: f64,
    y: &'a mut [f64],
}

impl WithSimd for AddScaled<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let (f, x) = (simd.splat_f64s(self.f), S::as_simd_f64s(self.x).0);
        let mut square = simd.splat_f64s(0.0);
        for (y, x) in S::as_mut_simd_f64s(self.y).0.iter_mut().zip(x) {
            *y = simd.mul_add_e_f64s(*x, f, *y);
            square = simd.mul_add_e_f64s(*y, *y, square);
        }
        simd.reduce_sum_f64s(square)
    }
}

/// `x . y`.
pub(super) fn dot(arch: Arch, x: &[f64], y: &[f64]) -> f64 {
    arch.dispatch(Dot { x, y })
}

struct Dot<'a> {
    x: &'a [f64],
    y: &'a [f64],
}

impl WithSimd for Dot<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let mut sums = [simd.splat_f64s(0.0); 2];
        let (x, y) = (S::as_simd_f64s(self.x).0, S::as_simd_f64s(self.y).0);
        for (k, (x, y)) in x.iter().zip(y).enumerate() {
            sums[k % 2] = simd.mul_add_e_f64s(*x, *y, sums[k % 2]);
        }
        simd.reduce_sum_f64s(simd.add_f64s(sums[0], sums[1]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::tests::units;

    /// On every vector unit of this machine, and without one, the loops do what their formulas say.
    #[test]
    fn loops_are_their_formulas_on_every_vector_unit() {
        let (rows, columns) = (24, 60);
        let table: Vec<f64> = (0..rows * columns).map(|k| (0.7 * k as f64).sin()).collect();
        let wave = |by: f64| std::array::from_fn(|k| (by * (k + 1) as f64).cos());
        let radii = Radii {
            first: 2,
            value: [0.2, 0.9, -0.1],
            slope: [-0.3, 0.1, 0.25],
        };
        let stencil = Stencil {
            columns: std::array::from_fn(|k| (7 * k) % 55),
            across: wave(0.3),
            across_slope: wave(0.5),
            up: wave(0.8),
            up_slope: wave(1.1),
        };
        let sum = |row: usize, of_radius: [f64; 3], across: [f64; 4], up: [f64; 4]| -> f64 {
            let node = |k: usize| -> f64 {
                let column = |r: usize| table[(stencil.columns[k] + radii.first + r) * rows + row];
                (0..3).map(|r| of_radius[r] * column(r)).sum()
            };
            (0..16).map(|k| across[k % 4] * up[k / 4] * node(k)).sum()
        };
        let (x, y) = (&table[..rows], &table[rows..2 * rows]);
        for arch in units() {
            let mut out: [Vec<f64>; 4] = std::array::from_fn(|_| vec![5.0; rows]);
            let [value, by_x, by_y, by_radius] = &mut out;
            interpolate(arch, &table, &radii, &stencil, [value, by_x, by_y, by_radius]);
            let Stencil {
                across,
                across_slope,
                up,
                up_slope,
                ..
            } = stencil;
            for row in 0..rows {
                let expected = [
                    sum(row, radii.value, across, up),
                    sum(row, radii.value, across_slope, up),
                    sum(row, radii.value, across, up_slope),
                    sum(row, radii.slope, across, up),
                ];
                for (k, (out, expected)) in out.iter().zip(expected).enumerate() {
                    assert!((out[row] - expected).abs() < 1e-12, "{arch:?} {k} {row}");
                }
            }
            let mut added = y.to_vec();
            let square = add_scaled(arch, x, -0.4, &mut added);
            let plain: Vec<f64> = x.iter().zip(y).map(|(x, y)| y - 0.4 * x).collect();
            assert!(added.iter().zip(&plain).all(|(a, b)| (a - b).abs() < 1e-14), "{arch:?}");
            assert!(
                (square - plain.iter().map(|v| v * v).sum::<f64>()).abs() < 1e-12,
                "{arch:?}"
            );
            let product: f64 = x.iter().zip(y).map(|(x, y)| x * y).sum();
            assert!((dot(arch, x, y) - product).abs() < 1e-12, "{arch:?}");
        }
    }
}
