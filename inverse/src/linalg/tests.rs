//! The kernels on every vector unit of this machine, and without one, against plain sums.

use super::aligned::Aligned;
use super::{block, dense, kernels, signs};
use nalgebra::{Cholesky, DMatrix, DVector};
use pulp::Arch;
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};

/// Without a vector unit, and with each that the processor has.
pub(crate) fn units() -> Vec<Arch> {
    let mut out = vec![Arch::Scalar];
    #[cfg(target_arch = "x86_64")]
    {
        out.extend(pulp::x86::V3::try_new().map(Arch::V3));
        out.extend(pulp::x86::V4::try_new().map(Arch::V4));
    }
    #[cfg(target_arch = "aarch64")]
    out.push(Arch::new());
    out
}

fn random(rng: &mut StdRng, count: usize) -> Aligned {
    let mut out = Aligned::zeros(count);
    out.iter_mut().for_each(|v| *v = rng.random_range(-1.0..1.0));
    out
}

fn near(what: &str, arch: Arch, found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len(), "{what} {arch:?}");
    for (k, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((a - b).abs() < 1e-12, "{what} {arch:?} {k}: {a} {b}");
    }
}

/// Lengths of one, of several and of odd numbers of registers, and lists that are no multiple of the columns at once.
#[test]
fn products_and_sums_are_those_of_plain_loops_on_every_vector_unit() {
    let mut rng = StdRng::seed_from_u64(3);
    for rows in [8, 24, 48, 120] {
        let (cells, list) = (24, [3, 17, 0, 21, 8, 8, 11]);
        let columns = random(&mut rng, rows * cells);
        let v = random(&mut rng, rows);
        let matrix = DMatrix::from_column_slice(rows, cells, &columns);
        let products = matrix.tr_mul(&DVector::from_column_slice(&v));
        let sums: Vec<(usize, f64)> = list.iter().map(|j| (*j, 0.3 * *j as f64 - 2.0)).collect();
        let mut added = DVector::from_column_slice(&v);
        sums.iter().for_each(|(j, x)| added.axpy(*x, &matrix.column(*j), 1.0));
        let single: Vec<f32> = columns.iter().map(|v| *v as f32).collect();
        let v_single: Vec<f32> = v.iter().map(|v| *v as f32).collect();
        for arch in units() {
            let mut out = Aligned::zeros(cells);
            kernels::dots(arch, &columns, &v, &mut out);
            near("dots", arch, &out, products.as_slice());
            let mut of = vec![7.0];
            kernels::dots_of(arch, &columns, &list, &v, &mut of);
            near("dots_of", arch, &of, &list.map(|j| products[j]));
            let mut y = v.clone();
            kernels::add_columns(arch, &columns, &sums, &mut y);
            near("add_columns", arch, &y, added.as_slice());
            if rows % kernels::SINGLE_LANES == 0 {
                let eight: Vec<u32> = (4..12).collect();
                let mut out = [0.0; 8];
                kernels::dots_of_single(arch, &single, &eight, &v_single, &mut out);
                for (j, out) in eight.iter().zip(out) {
                    assert!((f64::from(out) - products[*j as usize]).abs() < 1e-4, "{arch:?} {j}");
                }
            }
        }
    }
}

#[test]
fn signs_and_their_changes_are_those_of_plain_loops_on_every_vector_unit() {
    let mut rng = StdRng::seed_from_u64(4);
    let (g, q) = (random(&mut rng, 40), random(&mut rng, 40));
    let t = 0.7;
    let moved = |g: f64, q: f64| (g + t * q > 0.0) != (g > 0.0);
    let next: Vec<f64> = g.iter().zip(&*q).map(|(g, q)| g + t * q).collect();
    let changed: Vec<usize> = (0..40).filter(|k| moved(g[*k], q[*k])).collect();
    assert!(changed.len() > 4);
    let sign = |k: &usize| if g[*k] > 0.0 { -1.0 } else { 1.0 };
    let share: f64 = changed.iter().map(|k| sign(k) * q[*k] * next[*k]).sum();
    let slope: f64 = changed.iter().map(|k| sign(k) * q[*k] * q[*k]).sum();
    for arch in units() {
        let (mut at, mut list) = (g.clone(), vec![(9, 9.0)]);
        let largest = signs::advance(arch, &mut at, &q, t, &mut list);
        near("advance", arch, &at, &next);
        assert!(
            (largest - next.iter().copied().fold(0.0, f64::max)).abs() < 1e-14,
            "{arch:?}"
        );
        let listed: Vec<usize> = list.iter().map(|(k, _)| *k).collect();
        assert_eq!(listed, changed, "{arch:?}");
        signs::subtract(arch, &mut at, &q);
        let less: Vec<f64> = next.iter().zip(&*q).map(|(n, q)| n - q).collect();
        near("subtract", arch, &at, &less);
        let (value, by) = kernels::crossings(arch, &g, &q, t);
        near("crossings", arch, &[value, by], &[share, slope]);
    }
}

#[test]
fn factors_and_their_solutions_are_those_of_nalgebra_on_every_vector_unit() {
    let mut rng = StdRng::seed_from_u64(5);
    for rows in [8, 32, 56, 104] {
        let p = random(&mut rng, rows * 16);
        let y = random(&mut rng, rows);
        let w = random(&mut rng, rows * block::WIDTH);
        let columns = DMatrix::from_column_slice(rows, 16, &p);
        let whole = &columns * columns.transpose() + DMatrix::identity(rows, rows);
        let factor = Cholesky::new(whole.clone()).unwrap();
        let right = DVector::from_column_slice(&y);
        let lower = factor.l();
        let half = lower.solve_lower_triangular(&right).unwrap();
        let of_block = DMatrix::from_row_slice(rows, block::WIDTH, &w);
        let solved = lower.solve_lower_triangular(&of_block).unwrap();
        for arch in units() {
            let mut l = Aligned::zeros(rows * rows);
            (0..rows).for_each(|k| l[k * rows + k] = 1.0);
            dense::add_outer::<false>(arch, &mut l, rows, &p);
            let found = DMatrix::from_column_slice(rows, rows, &l).lower_triangle();
            near("add_outer", arch, found.as_slice(), whole.lower_triangle().as_slice());
            let mut inverse = vec![0.0; rows];
            assert!(dense::cholesky(arch, &mut l, &mut inverse), "{arch:?}");
            near("cholesky", arch, &l, lower.as_slice());
            let mut z = y.clone();
            dense::forward(arch, &l, &inverse, &mut z);
            near("forward", arch, &z, half.as_slice());
            dense::backward(arch, &l, &inverse, &mut z);
            near("backward", arch, &z, factor.solve(&right).as_slice());

            let mut ws = w.clone();
            block::forward(arch, &l, &inverse, &mut ws, block::WIDTH);
            near("block forward", arch, &ws, solved.transpose().as_slice());
            let mut gram = Aligned::zeros(block::WIDTH * block::WIDTH);
            block::gram(arch, &w, &mut gram);
            near("gram", arch, &gram, of_block.tr_mul(&of_block).as_slice());
            let mut dots = [0.0; block::WIDTH];
            block::dots(arch, &w, &y, &mut dots);
            near("block dots", arch, &dots, of_block.tr_mul(&right).as_slice());
            let mut less = y.clone();
            block::subtract(arch, &w, &dots, &mut less);
            let expected = &right - &of_block * DVector::from_column_slice(&dots);
            near("block subtract", arch, &less, expected.as_slice());
        }
    }
}

/// A matrix that has no factor is said to have none, with any width of the vectors.
#[test]
fn what_is_not_positive_has_no_factor_on_any_vector_unit() {
    for arch in units() {
        let rows = 16;
        let mut l = Aligned::zeros(rows * rows);
        (0..rows).for_each(|k| l[k * rows + k] = if k == 11 { -1.0 } else { 1.0 });
        assert!(!dense::cholesky(arch, &mut l, &mut vec![0.0; rows]), "{arch:?}");
    }
}
