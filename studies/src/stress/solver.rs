//! Checks of the non-negative solver.

use crate::scene::rng;
use crate::stress::{Check, Effort, Verdict, random, random_b, stacked, violation};
use inverse::solvers::{Nnls, NnlsOptions, Problem, Solution, Status, lawson_hanson};
use nalgebra::{DMatrix, DVector};
use rand::Rng;

fn options(ridge: f64) -> NnlsOptions {
    NnlsOptions {
        ridge,
        tolerance: 1e-10,
        most_steps: 200,
    }
}

fn solve(a: &DMatrix<f64>, b: &DVector<f64>, ridge: f64) -> Solution {
    Nnls::new(options(ridge)).solve(&Problem::new(a, 0.0), b)
}

fn sound(s: &Solution) -> bool {
    s.x.iter().all(|x| *x >= 0.0 && x.is_finite()) && s.residual.is_finite() && !s.gap.is_nan()
}

fn off(x: &DVector<f64>, y: &DVector<f64>) -> f64 {
    (x - y).amax() / y.amax().max(f64::MIN_POSITIVE)
}

/// Data and matrix in any unit give the same picture.
pub(super) fn scales(effort: Effort) -> Verdict {
    let mut check = Check::new("scales of data and matrix from 1e-12 to 1e12 give the same x, scaled");
    let mut rng = rng(effort.seed);
    for case in 0..effort.problems {
        let (a, b) = (random(12, 30, &mut rng), random_b(12, &mut rng));
        let one = solve(&a, &b, 0.3);
        let [data, matrix] = [0; 2].map(|_| 10.0_f64.powf(rng.random_range(-12.0..12.0)));
        let scaled = solve(&(&a * matrix), &(&b * data), 0.3 * matrix);
        check.holds(scaled.status == Status::Converged && sound(&scaled), || {
            format!("case {case}")
        });
        check.most(off(&(scaled.x * (matrix / data)), &one.x), 1e-8, || {
            format!("case {case}")
        });
    }
    check.verdict()
}

/// Ridges from zero to one that suppresses everything: each solution is that of Lawson and Hanson with the ridge as
/// further rows.
pub(super) fn ridges(effort: Effort) -> Verdict {
    let mut check =
        Check::new("every ridge from 0 over 1e-300 to 1e300 gives Lawson-Hanson's solution, smaller for a larger one");
    let mut rng = rng(effort.seed + 1);
    let ladder = || {
        [0.0, 1e-300, 1e-20]
            .into_iter()
            .chain((-12..=12).map(|p| 10.0_f64.powi(p)))
            .chain([1e100, 1e300])
    };
    for case in 0..effort.problems / 10 + 1 {
        let (rows, cells) = [(30, 20), (12, 24)][case % 2];
        let (a, b) = (random(rows, cells, &mut rng).map(f64::abs), random_b(rows, &mut rng));
        let mut before = f64::INFINITY;
        for ridge in ladder() {
            let s = solve(&a, &b, ridge);
            let here = || format!("case {case}, ridge {ridge:e}, gap {:.0e}", s.gap);
            check.holds(s.status == Status::Converged && sound(&s), || {
                format!("{}: {:?}", here(), s.status)
            });
            check.holds(s.x.norm() <= before * (1.0 + 1e-6), || format!("{}: x grew", here()));
            before = s.x.norm();
            // The further rows of a tiny ridge are lost beside the matrix, those of a large one are all there is.
            if (1e-6..1e9).contains(&ridge) {
                let (whole, below) = stacked(&a, &b, ridge);
                check.most(off(&s.x, &lawson_hanson(&whole, &below).x), 2e-6, here);
            }
            if ridge < 1e9 {
                check.most(violation(&a, &b, &s.x, ridge), 1e-6, here);
            }
        }
    }
    check.verdict()
}

/// Columns twice, columns of zero, few independent rows.
pub(super) fn degenerate(effort: Effort) -> Verdict {
    let mut check =
        Check::new("double and zero columns and any rank give a proven solution, equal columns equal shares");
    let mut rng = rng(effort.seed + 2);
    for case in 0..effort.problems {
        let rank = rng.random_range(0..8);
        let base = random(16, rank, &mut rng) * random(rank, 12, &mut rng);
        // Columns 12 to 23 are those before once more, the last four are zero.
        let a = DMatrix::from_fn(16, 28, |i, j| if j < 24 { base[(i, j % 12)] } else { 0.0 });
        let b = random_b(16, &mut rng);
        for ridge in [0.0, 0.1] {
            let s = solve(&a, &b, ridge);
            check.holds(s.status == Status::Converged && sound(&s), || {
                format!("case {case}, ridge {ridge}: {:?}", s.status)
            });
            check.most(violation(&a, &b, &s.x, ridge), 1e-7, || {
                format!("case {case}, ridge {ridge}")
            });
            check.holds(s.x.rows(24, 4).amax() == 0.0, || {
                format!("case {case}: a zero column has a value")
            });
            if ridge > 0.0 {
                let shares = (s.x.rows(0, 12) - s.x.rows(12, 12)).amax();
                check.most(shares, 1e-8 * s.x.amax(), || format!("case {case}: shares"));
            }
        }
    }
    check.verdict()
}

/// Frames that no rise explains, and frames that turn about from one to the next.
pub(super) fn contradictions(effort: Effort) -> Verdict {
    let mut check = Check::new("what only a fall explains gives x = 0; frames that turn about are solved");
    let mut rng = rng(effort.seed + 3);
    for case in 0..effort.problems {
        let a = random(12, 30, &mut rng).abs();
        let problem = Problem::new(&a, 0.0);
        let against = -(&a * random_b(30, &mut rng).abs());
        for ridge in [0.0, 0.2] {
            let mut solver = Nnls::new(options(ridge));
            for sign in [1.0, -1.0, 1.0, -1.0] {
                let b = &against * sign;
                let s = solver.solve(&problem, &b);
                check.holds(s.status == Status::Converged && sound(&s), || {
                    format!("case {case}: {:?}", s.status)
                });
                check.most(violation(&a, &b, &s.x, ridge), 1e-8, || {
                    format!("case {case}, ridge {ridge}, sign {sign}")
                });
                if sign > 0.0 {
                    check.holds(s.x.amax() == 0.0, || {
                        format!("case {case}: a rise explains nothing here")
                    });
                    check.most((s.residual - 1.0).abs(), 1e-12, || format!("case {case}: residual"));
                }
            }
        }
    }
    check.verdict()
}

/// Numbers that are none.
pub(super) fn rubbish(effort: Effort) -> Verdict {
    let mut check =
        Check::new("NaN and infinity are refused with x = 0, and the next frame is solved as if they had not come");
    let mut rng = rng(effort.seed + 4);
    for case in 0..effort.problems {
        let (a, b) = (random(12, 30, &mut rng), random_b(12, &mut rng));
        let problem = Problem::new(&a, 0.0);
        let bad = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY][case % 3];
        let mut solver = Nnls::new(options(0.2));
        let before = solver.solve(&problem, &b);
        let mut spoilt = b.clone();
        spoilt[case % 12] = bad;
        let s = solver.solve(&problem, &spoilt);
        check.holds(s.status == Status::BadInput && s.x.amax() == 0.0, || {
            format!("case {case}: data {bad}")
        });
        check.most(off(&solver.solve(&problem, &b).x, &before.x), 1e-9, || {
            format!("case {case}: after {bad}")
        });
        let mut spoilt = a.clone();
        spoilt[(case % 12, case % 30)] = bad;
        let s = solve(&spoilt, &b, 0.2);
        check.holds(s.status == Status::BadInput && s.x.amax() == 0.0, || {
            format!("case {case}: matrix {bad}")
        });
        for ridge in [f64::NAN, -1.0] {
            check.holds(solve(&a, &b, ridge).status == Status::BadInput, || {
                format!("ridge {ridge}")
            });
        }
    }
    check.verdict()
}

/// Numbers next to zero.
pub(super) fn denormals(effort: Effort) -> Verdict {
    let mut check = Check::new("denormal data and matrices give something finite and not negative");
    let mut rng = rng(effort.seed + 5);
    for case in 0..effort.problems {
        let (a, b) = (random(12, 30, &mut rng), random_b(12, &mut rng));
        for (matrix, data) in [
            (1.0, 1e-310),
            (1.0, 5e-324),
            (1e-310, 1.0),
            (1e-310, 1e-310),
            (1e-160, 1e-310),
        ] {
            for ridge in [0.0, 0.3 * matrix, 0.3] {
                let s = solve(&(&a * matrix), &(&b * data), ridge);
                check.holds(sound(&s) && s.status != Status::BadInput, || {
                    format!(
                        "case {case}: matrix {matrix:e}, data {data:e}, ridge {ridge:e}: {:?}",
                        s.status
                    )
                });
            }
        }
        // Entries of which some only are denormal are as good as zero.
        let mut mixed = b.clone();
        let mut zeroed = b;
        for k in 0..4 {
            mixed[k] *= 1e-310;
            zeroed[k] = 0.0;
        }
        check.most(off(&solve(&a, &mixed, 0.3).x, &solve(&a, &zeroed, 0.3).x), 1e-9, || {
            format!("case {case}: mixed")
        });
    }
    check.verdict()
}

/// Data and matrix rounded to 32 bits move x by no more than theory allows. The objective is `ridge^2`-strongly convex:
/// `|x' - x|` is at most the change of its gradient at x, divided by `ridge^2`.
pub(super) fn single_precision(effort: Effort) -> Verdict {
    let mut check = Check::new("data and matrix of 32 bits change x by no more than strong convexity allows");
    let mut rng = rng(effort.seed + 6);
    for case in 0..effort.problems {
        let (a, b) = (random(12, 30, &mut rng), random_b(12, &mut rng));
        let (a32, b32) = (a.map(|v| f64::from(v as f32)), b.map(|v| f64::from(v as f32)));
        let ridge = 10.0_f64.powf(rng.random_range(-2.0..0.5));
        let (x, x32) = (solve(&a, &b, ridge).x, solve(&a32, &b32, ridge).x);
        let change = (a32.tr_mul(&(&a32 * &x - &b32)) - a.tr_mul(&(&a * &x - &b))).norm() / (ridge * ridge);
        check.most((&x32 - &x).norm(), change + 1e-8 * x.norm(), || {
            format!("case {case}, ridge {ridge:e}")
        });
    }
    check.verdict()
}

/// A frame that wanders without end, warm from the first to the last.
pub(super) fn wandering(effort: Effort) -> Verdict {
    let mut check =
        Check::new("long warm runs do not drift: every frame is proven, and now and then equals a cold solve");
    let mut rng = rng(effort.seed + 7);
    let (rows, cells) = (24, 90);
    let a = DMatrix::from_fn(rows, cells, |i, _| {
        rng.random_range(-1.0..1.0) * 0.6_f64.powi(i as i32 / 2)
    });
    let problem = Problem::new(&a, 0.0);
    let norm = problem.singular()[0];
    let mut warm = Nnls::new(NnlsOptions {
        tolerance: 1e-9,
        ..options(0.01 * norm)
    });
    let mut b = vec![0.0; rows];
    let (mut x, mut cold_x) = (vec![0.0; cells], vec![0.0; cells]);
    for frame in 0..effort.wandering {
        for b in &mut b {
            *b = 0.9 * *b + rng.random_range(-1.0..1.0);
        }
        if frame % 100 == 0 {
            warm.set_ridge(norm * 10.0_f64.powf(rng.random_range(-2.5..-1.0)));
        }
        let outcome = warm.solve_into(&problem, &b, &mut x);
        check.holds(outcome.status == Status::Converged, || {
            format!("frame {frame}: {outcome:?}")
        });
        if frame % 997 == 0 || frame + 10 > effort.wandering {
            Nnls::new(warm.options()).solve_into(&problem, &b, &mut cold_x);
            let largest = cold_x.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
            let apart = x.iter().zip(&cold_x).fold(0.0_f64, |m, (p, q)| m.max((p - q).abs()));
            check.most(apart / largest, 1e-6, || format!("frame {frame}"));
        }
        if frame % 99_991 == 0 {
            let right = DVector::from_column_slice(&b);
            let (whole, below) = stacked(&a, &right, warm.options().ridge);
            let reference = lawson_hanson(&whole, &below);
            check.most(off(&DVector::from_column_slice(&x), &reference.x), 1e-6, || {
                format!("frame {frame}, Lawson-Hanson")
            });
        }
    }
    check.verdict()
}
