//! Time that each shortcut of the solver saves, and its cost in accuracy.

use crate::cost::{self, Happening};
use crate::error::StudyError;
use crate::scene::rng;
use crate::score::quantile;
use crate::screening::screen;
use crate::test_sheet::{TestSheet, imager, noise_v, noisy};
use forward::Drive;
use inverse::pipeline::{Reconstructor, ReconstructorOptions};
use inverse::reference::Reference;
use inverse::reference::noise::FrameNoise;
use inverse::solvers::{Method, Nnls, NnlsOptions, Problem};
use nalgebra::{DMatrix, DVector};
use rand::Rng;
use rand::rngs::StdRng;
use serde::Serialize;
use std::time::Instant;

/// A shortcut, or the way without it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Saving {
    /// Its name.
    pub name: String,
    /// Median time of a frame, us.
    pub median_us: f64,
    /// 99th percentile of the time, us.
    pub p99_us: f64,
    /// Newton steps of a frame, mean; `None` where nothing is solved.
    pub steps: Option<f64>,
    /// Rows of the matrix of the solve.
    pub rank: usize,
    /// Largest error of x, divided by the largest entry of x: worst of the frames, against the solution without
    /// shortcuts.
    pub error: f64,
}

/// Part of the cells that screening proves to be zero, after a number of Newton steps from the frame before.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Screening {
    /// Newton steps taken.
    pub steps: usize,
    /// Part of all cells that are known to be zero, mean over the frames.
    pub known: f64,
    /// Part of all cells that are zero in the solution.
    pub zero: f64,
}

/// Results.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Savings {
    /// Solves of four moving touches, and the gate.
    pub rows: Vec<Saving>,
    /// Cells that screening would exclude.
    pub screening: Vec<Screening>,
    /// Time of the one product of a step that screening could make cheaper, us.
    pub product_us: f64,
}

/// Number of runs through the sequence. The time of a frame is its least.
const RUNS: usize = 8;
/// Ridge, divided by the largest singular value: that of the usual picture at 27 dB.
const RIDGE: f64 = 0.003;

/// Frames as weighted differences, with the matrix.
struct Frames {
    sensitivity: DMatrix<f64>,
    differences: Vec<DVector<f64>>,
}

/// Measures on frames of four touches that move 1 mm a frame at 27 dB.
///
/// # Errors
/// [`StudyError`] where the sheet cannot be modelled.
pub fn savings(drive: Drive, frames: usize, seed: u64) -> Result<Savings, StudyError> {
    let mut rng = rng(seed);
    let imager = imager(drive, 5.0)?;
    let mut sheet = TestSheet::new(&imager, drive, 0.0, 0.0, &mut rng)?;
    let clean = cost::sequence(&mut sheet, Happening::Four, frames, 0.0, &mut rng)?;
    let base = sheet.baseline.clone();
    let sigma = noise_v(&clean[0], &base, 27.0);
    let given = Frames {
        sensitivity: imager.sensitivity.clone(),
        differences: clean
            .into_iter()
            .map(|v| noisy(v, sigma, &mut rng))
            .map(|v| DVector::from_iterator(v.len(), v.iter().zip(&base).map(|(a, b)| a - b)))
            .collect(),
    };
    let mut out = Savings {
        rows: solves(&given, &mut rng),
        ..Savings::default()
    };
    let problem = Problem::new(&given.sensitivity, 0.0);
    out.product_us = product_us(&problem);
    out.screening = screening(&given, &problem);
    for (name, false_alarm) in [("empty frame, gate", 1e-6), ("empty frame, no gate", 1.0)] {
        let usual = ReconstructorOptions::for_imager(&imager, Method::Nnls);
        let reference = Reference::new(imager.clone(), base.clone(), FrameNoise::of_frames(sigma))?;
        let mut r = Reconstructor::new(reference, ReconstructorOptions { false_alarm, ..usual });
        let mut times = Vec::new();
        for _ in 0..frames + 2 {
            let frame = sheet.empty(sigma, &mut rng);
            let start = Instant::now();
            r.frame(&frame)?;
            times.push(start.elapsed().as_secs_f64() * 1e6);
        }
        // The first two frames prepare the problem.
        times.drain(..2);
        out.rows.push(Saving {
            name: name.to_owned(),
            median_us: quantile(&times, 0.5),
            p99_us: quantile(&times, 0.99),
            steps: None,
            rank: r.rank().unwrap_or(0),
            error: 0.0,
        });
    }
    Ok(out)
}

/// How a solve starts.
#[derive(Clone, Copy, PartialEq)]
enum Start {
    Cold,
    Point,
    Warm,
}

fn solves(given: &Frames, rng: &mut StdRng) -> Vec<Saving> {
    let full = Problem::new(&given.sensitivity, 0.0);
    let reference = solutions(&full, given, full.singular()[0] * RIDGE);
    // Rows that differ by a millionth cannot be compressed, and change nothing else.
    let jitter = 1e-6 * given.sensitivity.amax();
    let rough = given.sensitivity.map(|v| v + jitter * rng.random_range(-1.0..1.0));
    let mut rows = Vec::new();
    let mut add = |name: String, problem: &Problem, start: Start| {
        rows.push(timed(
            name,
            problem,
            given,
            full.singular()[0] * RIDGE,
            start,
            &reference,
        ));
    };
    add("all 208 rows, warm".into(), &Problem::new(&rough, 0.0), Start::Warm);
    add("row space, cold".into(), &full, Start::Cold);
    add("row space, warm set".into(), &full, Start::Point);
    add("row space, warm set and factor".into(), &full, Start::Warm);
    for part in [0.01, 1.0 / 30.0, 0.1, 0.3] {
        let dropped = Problem::new(&given.sensitivity, part * RIDGE);
        add(format!("below {part:.2} ridge dropped, warm"), &dropped, Start::Warm);
    }
    rows
}

fn options(ridge: f64) -> NnlsOptions {
    NnlsOptions {
        ridge,
        tolerance: 1e-8,
        most_steps: 60,
    }
}

fn solutions(problem: &Problem, given: &Frames, ridge: f64) -> Vec<DVector<f64>> {
    let mut solver = Nnls::new(NnlsOptions {
        tolerance: 1e-11,
        ..options(ridge)
    });
    given.differences.iter().map(|b| solver.solve(problem, b).x).collect()
}

fn timed(
    name: String,
    problem: &Problem,
    given: &Frames,
    ridge: f64,
    start: Start,
    reference: &[DVector<f64>],
) -> Saving {
    let mut x = DVector::zeros(problem.cells());
    let mut best = vec![f64::INFINITY; given.differences.len()];
    let (mut error, mut steps) = (0.0_f64, 0);
    for run in 0..RUNS {
        let mut solver = Nnls::new(options(ridge));
        for ((b, best), reference) in given.differences.iter().zip(&mut best).zip(reference) {
            match start {
                Start::Cold => solver.reset(),
                Start::Point => solver.reset_factor(),
                Start::Warm => (),
            }
            let begin = Instant::now();
            let outcome = solver.solve_into(problem, b.as_slice(), x.as_mut_slice());
            *best = best.min(begin.elapsed().as_secs_f64() * 1e6);
            if run == 0 {
                steps += outcome.iterations;
                error = error.max((&x - reference).amax() / reference.amax());
            }
        }
    }
    // The first frame of a warm run is a cold one.
    best.remove(0);
    Saving {
        name,
        median_us: quantile(&best, 0.5),
        p99_us: quantile(&best, 0.99),
        steps: Some(steps as f64 / given.differences.len() as f64),
        rank: problem.rank(),
        error,
    }
}

fn product_us(problem: &Problem) -> f64 {
    let (rows, cells) = problem.padded();
    let (r, mut out) = (vec![1.0; rows], vec![0.0; cells]);
    let mut best = f64::INFINITY;
    for _ in 0..1000 {
        let start = Instant::now();
        problem.back_project(std::hint::black_box(&r), std::hint::black_box(&mut out));
        best = best.min(start.elapsed().as_secs_f64() * 1e6);
    }
    best
}

/// Numbers of steps after which screening is measured.
const STEPS: [usize; 6] = [0, 1, 2, 3, 4, 5];

fn screening(given: &Frames, problem: &Problem) -> Vec<Screening> {
    let ridge = problem.singular()[0] * RIDGE;
    let mut warm = Nnls::new(options(ridge));
    let mut out = STEPS.map(|steps| Screening {
        steps,
        known: 0.0,
        zero: 0.0,
    });
    let mut started = false;
    let frames = (given.differences.len() - 1) as f64;
    for b in &given.differences {
        let (small, _) = problem.reduce(b);
        let partial: Vec<Option<DVector<f64>>> = STEPS
            .iter()
            .map(|steps| {
                let mut solver = warm.clone();
                solver.set_most_steps(*steps);
                solver.solve(problem, b);
                solver.dual()
            })
            .collect();
        let x = warm.solve(problem, b).x;
        if std::mem::replace(&mut started, true) {
            let zero = x.iter().filter(|x| **x == 0.0).count() as f64;
            for (out, partial) in out.iter_mut().zip(&partial) {
                let known = partial.as_ref().map(|r| screen(problem, &small, ridge, r).zero);
                let part = known.iter().flatten().filter(|z| **z).count() as f64;
                out.known += part / problem.cells() as f64 / frames;
                out.zero += zero / problem.cells() as f64 / frames;
            }
        }
    }
    out.to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The test is on the error of the picture, not on times.
    #[test]
    fn shortcuts_change_nothing_but_dropping_which_changes_little() {
        let s = savings(Drive::PAPER, 6, 3).unwrap();
        assert_eq!(s.rows.len(), 10);
        assert_eq!(s.rows[0].rank, 208);
        assert!(
            s.rows[1..4].iter().all(|r| r.rank == 118 && r.error < 1e-6),
            "{:#?}",
            s.rows
        );
        assert!(s.rows[0].error < 0.02, "{:#?}", s.rows[0]);
        let dropped = &s.rows[4..8];
        assert!(dropped.windows(2).all(|w| w[1].rank <= w[0].rank), "{dropped:#?}");
        assert!(dropped[0].error < 0.02, "{dropped:#?}");
        assert!(s.screening.iter().all(|s| s.known <= s.zero), "{:#?}", s.screening);
    }
}
