//! What holds for the solver on any data: optimality, scale, rubbish. Long runs and more: `studies::stress`.

use crate::solvers::{Nnls, NnlsOptions, Problem, Status, lawson_hanson, tikhonov};
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};

fn options(ridge: f64) -> NnlsOptions {
    NnlsOptions {
        ridge,
        tolerance: 1e-9,
        most_steps: 200,
    }
}

fn random(rows: usize, cells: usize, rng: &mut StdRng) -> DMatrix<f64> {
    DMatrix::from_fn(rows, cells, |_, _| rng.random_range(-1.0..1.0))
}

/// With a second set of columns, which do the opposite.
fn both_signs(a: &DMatrix<f64>, weight: f64) -> DMatrix<f64> {
    let mut both = a.clone().resize_horizontally(2 * a.ncols(), 0.0);
    both.columns_mut(a.ncols(), a.ncols()).copy_from(&(a * -weight));
    both
}

/// Largest `|min(x_j |a_j|, -g_j / |a_j|)|` over `|b|`, from the whole matrix.
fn violation(a: &DMatrix<f64>, b: &DVector<f64>, x: &DVector<f64>, ridge: f64) -> f64 {
    let gradient = a.tr_mul(&(b - a * x)) - x * (ridge * ridge);
    let each = a.column_iter().zip(x.iter().zip(&gradient)).map(|(c, (x, g))| {
        let norm = c.norm();
        if norm > 0.0 {
            (x * norm).min(-g / norm).abs()
        } else {
            x.abs()
        }
    });
    each.fold(0.0, f64::max) / b.norm().max(f64::MIN_POSITIVE)
}

proptest! {
    /// Without a ridge the answer is that of Lawson and Hanson wherever it is unique, from a cold start and a warm one.
    #[test]
    fn plain_problems_agree_with_lawson_hanson(seed in any::<u64>(), rows in 1..30_usize, cells in 1..30_usize) {
        let mut rng = StdRng::seed_from_u64(seed);
        let a = random(rows, cells, &mut rng);
        let problem = Problem::new(&a, 0.0);
        let mut solver = Nnls::new(options(0.0));
        for _ in 0..4 {
            let b = DVector::from_fn(rows, |_, _| rng.random_range(-1.0..1.0));
            let ours = solver.solve(&problem, &b);
            let theirs = lawson_hanson(&problem, &b);
            prop_assert_eq!(ours.status, Status::Converged);
            prop_assert!(ours.x.iter().all(|x| *x >= 0.0));
            prop_assert!((ours.residual - theirs.residual).abs() < 1e-7, "{} {}", ours.residual, theirs.residual);
            prop_assert!(violation(&a, &b, &ours.x, 0.0) < 1e-6);
        }
    }

    /// Columns twice, columns of zero, rows that say the same and rows that contradict each other.
    #[test]
    fn degenerate_problems_end_with_their_proof(seed in any::<u64>(), ridge in prop_oneof![Just(0.0), 1e-3..10.0_f64]) {
        let mut rng = StdRng::seed_from_u64(seed);
        let few = random(5, 8, &mut rng);
        let a = DMatrix::from_fn(12, 24, |i, j| match j % 6 {
            5 => 0.0,
            4 => -few[(i % 5, j % 4)],
            _ => few[(i % 5, j % 6 + 2 * (j % 2))],
        });
        let problem = Problem::new(&a, 0.0);
        prop_assert!(problem.rank() <= 5);
        let b = DVector::from_fn(12, |_, _| rng.random_range(-1.0..1.0));
        let s = Nnls::new(options(ridge)).solve(&problem, &b);
        prop_assert_eq!(s.status, Status::Converged);
        prop_assert!(s.x.iter().all(|x| *x >= 0.0 && x.is_finite()));
        prop_assert!(violation(&a, &b, &s.x, ridge) < 1e-6);
    }

    /// Where every direction can be cancelled by positive x, as with a voltage drive, plain least squares fits all of b.
    #[test]
    fn a_cone_that_is_the_whole_space_is_fitted(seed in any::<u64>()) {
        let mut rng = StdRng::seed_from_u64(seed);
        let problem = Problem::new(&both_signs(&random(10, 15, &mut rng), 0.7), 0.0);
        let b = DVector::from_fn(10, |_, _| rng.random_range(-1.0..1.0));
        let s = Nnls::new(options(0.0)).solve(&problem, &b);
        prop_assert_eq!(s.status, Status::Converged);
        prop_assert!(s.residual < 1e-7);
    }

    /// Cells that may rise and fall alike are those of ridge regression, which needs no search.
    #[test]
    fn without_a_sign_it_is_ridge_regression(seed in any::<u64>(), ridge in 1e-2..10.0_f64) {
        let mut rng = StdRng::seed_from_u64(seed);
        let a = random(8, 15, &mut rng);
        let b = DVector::from_fn(8, |_, _| rng.random_range(-1.0..1.0));
        let both = Nnls::new(options(ridge)).solve(&Problem::new(&both_signs(&a, 1.0), 0.0), &b);
        let linear = tikhonov(&Problem::new(&a, 0.0), &b, ridge);
        prop_assert!((both.x.rows(0, 15) - both.x.rows(15, 15) - &linear.x).amax() < 1e-6 * linear.x.amax().max(1e-3));
        prop_assert!((both.residual - linear.residual).abs() < 1e-6);
    }

    /// Whatever comes in, what goes out is finite, not negative, and either proven or said not to be.
    #[test]
    fn no_input_does_harm(
        seed in any::<u64>(),
        matrix_scale in -300..300_i32,
        data_scale in -320..300_i32,
        ridge in prop_oneof![
            Just(0.0), Just(f64::MIN_POSITIVE), Just(1e-12), Just(1.0), Just(1e12), Just(1e300), Just(-1.0),
            Just(f64::NAN), Just(f64::INFINITY)
        ],
        spoil in prop_oneof![Just(None), Just(Some(f64::NAN)), Just(Some(f64::INFINITY))],
        in_matrix in any::<bool>(),
    ) {
        let mut rng = StdRng::seed_from_u64(seed);
        let mut a = random(6, 9, &mut rng) * 10.0_f64.powi(matrix_scale);
        let mut b = DVector::from_fn(6, |_, _| rng.random_range(-1.0..1.0)) * 10.0_f64.powi(data_scale);
        if let Some(spoil) = spoil {
            if in_matrix { a[(2, 3)] = spoil } else { b[4] = spoil }
        }
        let problem = Problem::new(&a, 0.0);
        let mut solver = Nnls::new(options(ridge));
        for _ in 0..2 {
            let s = solver.solve(&problem, &b);
            prop_assert!(s.x.iter().all(|x| *x >= 0.0 && x.is_finite()), "{:?}", s.x);
            prop_assert!(s.residual.is_finite() && !s.gap.is_nan());
            let bad = spoil.is_some() || ridge.is_nan() || ridge < 0.0;
            prop_assert_eq!(s.status == Status::BadInput, bad);
        }
    }
}

#[test]
fn lengths_that_do_not_fit_are_refused() {
    let mut rng = StdRng::seed_from_u64(1);
    let problem = Problem::new(&random(6, 9, &mut rng), 0.0);
    let mut x = [1.0; 9];
    let outcome = Nnls::new(options(0.1)).solve_into(&problem, &[1.0; 5], &mut x);
    assert_eq!((outcome.status, x), (Status::BadInput, [0.0; 9]));
    let outcome = Nnls::new(options(0.1)).solve_into(&problem, &[1.0; 6], &mut x[..8]);
    assert_eq!(outcome.status, Status::BadInput);
}

#[test]
fn another_problem_may_come_at_any_time() {
    let mut rng = StdRng::seed_from_u64(2);
    let problems: Vec<Problem> = [(6, 20), (12, 9), (12, 9)]
        .map(|(rows, cells)| Problem::new(&random(rows, cells, &mut rng), 0.0))
        .into();
    let mut solver = Nnls::new(options(0.1));
    for k in 0..30 {
        let problem = &problems[k % 3];
        solver.set_ridge([0.1, 0.0, 0.3][k / 2 % 3]);
        let b = DVector::from_fn(problem.rows(), |_, _| rng.random_range(-1.0..1.0));
        let warm = solver.solve(problem, &b);
        let cold = Nnls::new(solver.options()).solve(problem, &b);
        assert_eq!(warm.status, Status::Converged);
        assert!((warm.residual - cold.residual).abs() < 1e-7);
    }
}

#[test]
fn a_frame_allocates_nothing() {
    let mut rng = StdRng::seed_from_u64(3);
    // With the products of the columns and, above 512 cells, with a search in single precision.
    for (cells, ridge) in [(100, 0.3), (100, 0.0), (600, 0.0)] {
        let problem = Problem::new(&random(30, cells, &mut rng), 0.0);
        let mut x = vec![0.0; problem.cells()];
        let mut solver = Nnls::new(options(ridge));
        let frames: Vec<Vec<f64>> = (0..50)
            .map(|_| (0..30).map(|_| rng.random_range(-1.0..1.0)).collect())
            .collect();
        solver.solve_into(&problem, &frames[0], &mut x);
        let count = allocation_counter::measure(|| {
            for frame in &frames {
                solver.solve_into(&problem, frame, &mut x);
            }
        });
        assert_eq!(count.count_total, 0, "{cells} cells, ridge {ridge}");
    }
}
