//! Checks of all methods against that of Lawson and Hanson, where both solve the same problem.

use crate::scene::rng;
use crate::stress::{Check, Effort, Verdict, random, random_b, stacked};
use inverse::solvers::{
    Nnls, NnlsOptions, Problem, Solution, Status, discrepancy_ridge, lawson_hanson, pseudo_inverse, tikhonov,
};
use nalgebra::DVector;
use rand::Rng;

fn options(ridge: f64) -> NnlsOptions {
    NnlsOptions {
        ridge,
        tolerance: 1e-11,
        most_steps: 200,
    }
}

fn off(s: &Solution, reference: &Solution) -> f64 {
    (&s.x - &reference.x).amax() / reference.x.amax().max(1e-12)
}

/// More rows than columns: the plain solution is unique.
pub(super) fn plain(effort: Effort) -> Verdict {
    let mut check =
        Check::new("plain nnls equals Lawson-Hanson where the solution is unique, and its objective elsewhere");
    let mut rng = rng(effort.seed + 20);
    for case in 0..effort.problems {
        let cells = rng.random_range(1..40);
        let tall = Problem::new(&random(cells + 5, cells, &mut rng), 0.0);
        let b = random_b(cells + 5, &mut rng);
        let (ours, theirs) = (Nnls::new(options(0.0)).solve(&tall, &b), lawson_hanson(&tall, &b));
        check.holds(
            ours.status == Status::Converged && theirs.status == Status::Converged,
            || format!("case {case}"),
        );
        check.most(off(&ours, &theirs), 1e-6, || format!("case {case}"));
        let wide = Problem::new(&random(10, 25, &mut rng).abs(), 0.0);
        let b = random_b(10, &mut rng);
        let (ours, theirs) = (Nnls::new(options(0.0)).solve(&wide, &b), lawson_hanson(&wide, &b));
        check.most((ours.residual - theirs.residual).abs(), 1e-8, || {
            format!("case {case}, residual")
        });
    }
    check.verdict()
}

/// The ridge as further rows.
pub(super) fn ridged(effort: Effort) -> Verdict {
    let mut check = Check::new("nnls with a ridge equals Lawson-Hanson with the ridge as further rows");
    let mut rng = rng(effort.seed + 21);
    for case in 0..effort.problems / 3 + 1 {
        let (a, b) = (random(10, 30, &mut rng), random_b(10, &mut rng));
        let ridge = 10.0_f64.powf(rng.random_range(-2.0..1.0));
        let ours = Nnls::new(options(ridge)).solve(&Problem::new(&a, 0.0), &b);
        let (whole, below) = stacked(&a, &b, ridge);
        check.most(off(&ours, &lawson_hanson(&whole, &below)), 1e-7, || {
            format!("case {case}, ridge {ridge:e}")
        });
    }
    check.verdict()
}

/// Where the solution of the linear methods is not negative, all methods agree.
pub(super) fn linear(effort: Effort) -> Verdict {
    let mut check = Check::new("tikhonov and pseudo-inverse equal Lawson-Hanson where their answer is not negative");
    let mut rng = rng(effort.seed + 22);
    let mut case = 0;
    while case < effort.problems / 3 + 1 {
        let a = random(20, 12, &mut rng);
        let truth = DVector::from_fn(12, |_, _| rng.random_range(0.5..1.5));
        let b = &a * truth + random_b(20, &mut rng) * 0.02;
        let problem = Problem::new(&a, 0.0);
        let ridge = discrepancy_ridge(&problem, &b, 0.02 / 3.0_f64.sqrt());
        let (damped, plain) = (tikhonov(&problem, &b, ridge), pseudo_inverse(&problem, &b));
        if damped.x.min() < 0.0 || plain.x.min() < 0.0 {
            continue;
        }
        case += 1;
        let (whole, below) = stacked(&a, &b, ridge);
        check.most(off(&damped, &lawson_hanson(&whole, &below)), 1e-7, || {
            format!("case {case}, tikhonov")
        });
        check.most(off(&plain, &lawson_hanson(&problem, &b)), 1e-7, || {
            format!("case {case}, pseudo-inverse")
        });
    }
    check.verdict()
}

/// Every method on values that are not numbers and on scales of all sizes.
pub(super) fn rubbish(effort: Effort) -> Verdict {
    let mut check = Check::new("every method refuses NaN and infinity, and takes any scale of the data");
    let mut rng = rng(effort.seed + 23);
    type Solver = fn(&Problem, &DVector<f64>) -> Solution;
    let solvers: [(&str, Solver); 4] = [
        ("nnls", |p, b| Nnls::new(options(0.1)).solve(p, b)),
        ("lawson-hanson", lawson_hanson),
        ("tikhonov", |p, b| {
            tikhonov(p, b, discrepancy_ridge(p, b, 0.1 * b.amax()))
        }),
        ("pseudo-inverse", pseudo_inverse),
    ];
    for case in 0..effort.problems / 3 + 1 {
        let problem = Problem::new(&random(15, 10, &mut rng), 0.0);
        let b = random_b(15, &mut rng);
        for (name, solver) in solvers {
            let mut spoilt = b.clone();
            spoilt[case % 15] = if case % 2 == 0 { f64::NAN } else { f64::INFINITY };
            let s = solver(&problem, &spoilt);
            check.holds(s.status == Status::BadInput && s.x.amax() == 0.0, || {
                format!("{name}, case {case}")
            });
            let one = solver(&problem, &b);
            let scale = 10.0_f64.powf(rng.random_range(-12.0..12.0));
            let many = solver(&problem, &(&b * scale));
            check.most((many.x / scale - &one.x).amax() / one.x.amax().max(1e-12), 1e-7, || {
                format!("{name}, case {case}, scale {scale:e}")
            });
        }
    }
    check.verdict()
}
