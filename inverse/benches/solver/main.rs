//! Time of the non-negative solver, with the floor beside it: `cargo bench -p host --bench solver`.
//!
//! Before Criterion's figures it prints the percentiles over the frames of a sequence. With `SKIN_BENCH_PROBLEMS` set to
//! a folder it writes the problems and its solutions there for `benches/peers/peers.py` and stops.

#![allow(clippy::unwrap_used, clippy::expect_used)]

mod npy;
mod scenes;

use criterion::Criterion;
use forward::Drive;
use inverse::solvers::{Nnls, NnlsOptions, Outcome, Problem, Status, lawson_hanson};
use nalgebra::{DMatrix, DVector};
use scenes::{Scene, scene};
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

const FRAMES: usize = 120;
/// A frame's time is the least of as many runs through the whole sequence: what other programs take is no part of it.
const RUNS: usize = 12;
const CURRENT: Drive = Drive::Current { amplitude_a: 1e-3 };

/// Drive, size of a cell (mm), signal to noise ratio (dB), ridge over the largest singular value, and rank dropped below
/// this fraction of the ridge (0 for none).
struct Case {
    name: &'static str,
    drive: Drive,
    cell_mm: f64,
    snr_db: f64,
    ridge: f64,
    drop: f64,
}

const fn case(name: &'static str, drive: Drive, cell_mm: f64, snr_db: f64, ridge: f64, drop: f64) -> Case {
    Case {
        name,
        drive,
        cell_mm,
        snr_db,
        ridge,
        drop,
    }
}

const CASES: [Case; 10] = [
    case("voltage_5mm_27dB_ridge0.003", Drive::PAPER, 5.0, 27.0, 0.003, 0.0),
    case("voltage_5mm_27dB_ridge0.01", Drive::PAPER, 5.0, 27.0, 0.01, 0.0),
    case(
        "voltage_5mm_27dB_ridge0.01_drop",
        Drive::PAPER,
        5.0,
        27.0,
        0.01,
        1.0 / 30.0,
    ),
    case("voltage_5mm_60dB_ridge0.01", Drive::PAPER, 5.0, 60.0, 0.01, 0.0),
    case("current_5mm_27dB_ridge0.01", CURRENT, 5.0, 27.0, 0.01, 0.0),
    case("current_10mm_27dB_plain", CURRENT, 10.0, 27.0, 0.0, 0.0),
    case("current_10mm_60dB_plain", CURRENT, 10.0, 60.0, 0.0, 0.0),
    case("current_5mm_27dB_plain", CURRENT, 5.0, 27.0, 0.0, 0.0),
    case("current_5mm_60dB_plain", CURRENT, 5.0, 60.0, 0.0, 0.0),
    case("voltage_10mm_27dB_plain", Drive::PAPER, 10.0, 27.0, 0.0, 0.0),
];

impl Case {
    fn problem(&self, scene: &Scene) -> (Problem, NnlsOptions) {
        let problem = Problem::new(&scene.sensitivity, self.drop * self.ridge);
        let ridge = self.ridge * problem.singular()[0];
        let tolerance = if self.ridge > 0.0 { 1e-8 } else { 1e-9 };
        (
            problem,
            NnlsOptions {
                ridge,
                tolerance,
                most_steps: 100,
            },
        )
    }
}

fn main() {
    let folder = std::env::var_os("SKIN_BENCH_PROBLEMS");
    let mut criterion = Criterion::default().configure_from_args();
    for case in &CASES {
        let scene = scene(case.drive, case.cell_mm, FRAMES, case.snr_db);
        let (problem, options) = case.problem(&scene);
        if let Some(folder) = &folder {
            write(Path::new(folder), case, &scene, &problem, options).expect("the folder can be written to");
            continue;
        }
        println!("{}: rank {}, {} cells", case.name, problem.rank(), problem.cells());
        percentiles("cold", &problem, options, &scene.moving, true);
        percentiles("moving", &problem, options, &scene.moving, false);
        percentiles("still", &problem, options, &scene.still, false);
        measure(&mut criterion, case, &scene, &problem, options);
    }
    if folder.is_none() {
        criterion.final_summary();
    }
}

/// Prints median and 99th percentile over the frames, us.
fn percentiles(what: &str, problem: &Problem, options: NnlsOptions, frames: &[DVector<f64>], cold: bool) {
    let mut x = vec![0.0; problem.cells()];
    let mut best = vec![f64::INFINITY; frames.len()];
    let (mut gap, mut steps, mut unproven) = (0.0_f64, 0, 0);
    for _ in 0..RUNS {
        let mut solver = Nnls::new(options);
        solver.solve_into(problem, frames[0].as_slice(), &mut x);
        for (b, best) in frames.iter().zip(&mut best).skip(1) {
            if cold {
                solver.reset();
            }
            let start = Instant::now();
            let outcome: Outcome = solver.solve_into(problem, b.as_slice(), &mut x);
            *best = best.min(start.elapsed().as_secs_f64() * 1e6);
            gap = gap.max(outcome.gap);
            steps += outcome.iterations;
            unproven += usize::from(outcome.status != Status::Converged);
        }
    }
    best.remove(0);
    best.sort_by(f64::total_cmp);
    println!(
        "  {what:<7} median {:6.0} us, 99th percentile {:6.0} us, {:5.1} iterations, largest gap {gap:.0e}, unproven {unproven}",
        best[best.len() / 2],
        best[best.len() * 99 / 100],
        steps as f64 / (RUNS * best.len()) as f64,
    );
}

fn measure(criterion: &mut Criterion, case: &Case, scene: &Scene, problem: &Problem, options: NnlsOptions) {
    let mut group = criterion.benchmark_group(case.name);
    let mut x = vec![0.0; problem.cells()];
    let mut solver = Nnls::new(options);
    let mut frames = scene.moving.iter().cycle();
    group.bench_function("cold", |bencher| {
        bencher.iter(|| {
            solver.reset();
            frames.next().map(|b| solver.solve_into(problem, b.as_slice(), &mut x))
        });
    });
    // There and back again, so that every frame is a neighbour of the one before.
    let mut there_and_back = scene.moving.iter().chain(scene.moving.iter().rev()).cycle();
    group.bench_function("warm_moving", |bencher| {
        bencher.iter(|| {
            there_and_back
                .next()
                .map(|b| solver.solve_into(problem, b.as_slice(), &mut x))
        });
    });
    let mut still = scene.still.iter().cycle();
    group.bench_function("warm_still", |bencher| {
        bencher.iter(|| still.next().map(|b| solver.solve_into(problem, b.as_slice(), &mut x)));
    });
    // Noise alone: the difference of two frames of the same touches.
    let noise: Vec<DVector<f64>> = scene
        .still
        .windows(2)
        .map(|two| (&two[1] - &two[0]) * 0.5_f64.sqrt())
        .collect();
    let mut empty = noise.iter().cycle();
    group.bench_function("warm_empty", |bencher| {
        bencher.iter(|| empty.next().map(|b| solver.solve_into(problem, b.as_slice(), &mut x)));
    });
    let (rows, cells) = problem.padded();
    let (r, mut out) = (vec![1.0; rows], vec![0.0; cells]);
    group.bench_function("floor_one_product", |bencher| {
        bencher.iter(|| problem.back_project(black_box(&r), black_box(&mut out)));
    });
    group.finish();
}

/// Writes the reduced matrix, ten reduced frames, the ridge, the solutions with the median times of a cold and a warm solve,
/// the time of one product (us), and for plain problems what Lawson-Hanson says and takes.
fn write(folder: &Path, case: &Case, scene: &Scene, problem: &Problem, options: NnlsOptions) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    let frames = &scene.moving[..10];
    let reduced: Vec<DVector<f64>> = frames.iter().map(|b| problem.reduce(b).0).collect();
    let mut solver = Nnls::new(options);
    let solutions: Vec<DVector<f64>> = frames.iter().map(|b| solver.solve(problem, b).x).collect();
    let times = [true, false].map(|cold| {
        let mut x = vec![0.0; problem.cells()];
        let mut best = vec![f64::INFINITY; frames.len()];
        for _ in 0..RUNS {
            for (b, best) in frames.iter().zip(&mut best) {
                if cold {
                    solver.reset();
                }
                let start = Instant::now();
                solver.solve_into(problem, b.as_slice(), &mut x);
                *best = best.min(start.elapsed().as_secs_f64() * 1e6);
            }
        }
        best.sort_by(f64::total_cmp);
        best[best.len() / 2]
    });
    let file = |part: &str| folder.join(format!("{}_{part}.npy", case.name));
    npy::write(&file("a"), problem.a())?;
    npy::write(&file("b"), &DMatrix::from_columns(&reduced))?;
    npy::write(&file("x"), &DMatrix::from_columns(&solutions))?;
    npy::write(&file("ridge"), &DMatrix::from_element(1, 1, options.ridge))?;
    npy::write(&file("us"), &DMatrix::from_row_slice(1, 2, &times))?;
    npy::write(&file("floor"), &DMatrix::from_element(1, 1, floor_us(problem)))?;
    if options.ridge > 0.0 {
        return Ok(());
    }
    let mut best = vec![f64::INFINITY; frames.len()];
    let mut solutions = Vec::new();
    for (b, best) in frames.iter().zip(&mut best) {
        let begin = Instant::now();
        let mut solution = DVector::zeros(0);
        while solution.is_empty() || begin.elapsed().as_secs_f64() < 0.1 {
            let start = Instant::now();
            solution = lawson_hanson(problem, b).x;
            *best = best.min(start.elapsed().as_secs_f64() * 1e6);
        }
        solutions.push(solution);
    }
    best.sort_by(f64::total_cmp);
    npy::write(&file("x.lawson-hanson"), &DMatrix::from_columns(&solutions))?;
    npy::write(
        &file("us.lawson-hanson"),
        &DMatrix::from_element(1, 1, best[best.len() / 2]),
    )
}

/// Least time of one product of the transposed matrix with a vector, us.
fn floor_us(problem: &Problem) -> f64 {
    let (rows, cells) = problem.padded();
    let (r, mut out) = (vec![1.0; rows], vec![0.0; cells]);
    let mut best = f64::INFINITY;
    for _ in 0..3000 {
        let start = Instant::now();
        problem.back_project(black_box(&r), black_box(&mut out));
        best = best.min(start.elapsed().as_secs_f64() * 1e6);
    }
    best
}
