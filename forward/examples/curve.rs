//! Draws error against time for element order and mesh size: a re-solve with a new factorisation of the paper's disc under
//! one touch of +300 %, against a converged reference; the best of many repetitions.
//!
//!     cargo run --release -p skin-forward --example curve [file, default docs/img/error-time.svg]

mod svg;

use forward::field::conductivity_of_discs;
use forward::{DiscTouch, Drive, MeshSizes, Model, ModelOptions, Order, Pattern, Sheet, Solver};
use std::sync::Arc;
use std::time::Instant;
use svg::{Anchor, Svg};

type Error = Box<dyn std::error::Error>;

const TOUCH: DiscTouch = DiscTouch {
    centre_mm: [42.0, 38.0],
    radius_mm: 12.5,
    rise: 3.0,
};
const REPEATS: usize = 25;
/// The default's sizes times these.
const FACTORS: [f64; 6] = [2.0, 1.6, 1.25, 1.0, 0.7, 0.5];

struct Point {
    nodes: usize,
    ms: f64,
    error: f64,
}

/// How the mesh relates to the touch, and whether it is graded.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Uniform,
    Cut,
    Fitted,
}

fn measure(order: Order, kind: Kind, factor: f64, reference: &[f64]) -> Result<Point, Error> {
    let sheet = Sheet::paper();
    let sizes = Model::sizes(&sheet, &ModelOptions::default())?;
    let sizes = match kind {
        Kind::Uniform => MeshSizes {
            // As many nodes as linear elements of 3 mm at factor 1.
            largest_mm: factor * if order == Order::Linear { 3.0 } else { 6.0 },
            electrode_fraction: 1.0,
            electrode_most_mm: factor * if order == Order::Linear { 3.0 } else { 6.0 },
            ..sizes
        },
        _ => {
            let f = factor * if order == Order::Linear { 0.5 } else { 1.0 };
            MeshSizes {
                largest_mm: f * sizes.largest_mm,
                electrode_fraction: f * f * sizes.electrode_fraction,
                growth: (f * sizes.growth).min(1.0),
                ..sizes
            }
        }
    };
    let model = Arc::new(Model::with_sizes(&sheet, &sizes, order)?);
    let mut solver = Solver::new(model.clone())?;
    let pattern = Pattern::adjacent(16)?;
    let mut best = f64::INFINITY;
    let none = vec![[1.0, 0.0, 1.0 + 1e-9]; model.mesh().triangles.len()];
    for _ in 0..REPEATS {
        solver.solve(&none)?;
        let start = Instant::now();
        if kind == Kind::Cut {
            solver.solve(&conductivity_of_discs(model.mesh(), &[TOUCH]))?;
        } else {
            solver.solve_touches(&[TOUCH])?;
        }
        best = best.min(start.elapsed().as_secs_f64());
    }
    let frame = Drive::PAPER.frame_v(solver.electrode_matrix(), &pattern);
    let error = frame.iter().zip(reference).map(|(a, b)| (a / b - 1.0).abs());
    Ok(Point {
        nodes: model.mesh().nodes.len(),
        ms: 1e3 * best,
        error: 100.0 * error.fold(0.0, f64::max),
    })
}

fn main() -> Result<(), Error> {
    let file = std::env::args()
        .nth(1)
        .unwrap_or_else(|| "docs/img/error-time.svg".to_owned());
    let options = ModelOptions {
        accuracy: 1e-5,
        ..ModelOptions::for_touches(&[TOUCH])
    };
    let model = Arc::new(Model::new(&Sheet::paper(), &options)?);
    let mut solver = Solver::new(model.clone())?;
    solver.solve(&conductivity_of_discs(model.mesh(), &[TOUCH]))?;
    let reference = Drive::PAPER.frame_v(solver.electrode_matrix(), &Pattern::adjacent(16)?);

    let (left, right, top, bottom) = (70.0, 700.0, 40.0, 440.0);
    // Two and a half decades of time, four of error.
    let x = |ms: f64| left + (ms.log10() + 0.7) / 2.4 * (right - left);
    let y = |error: f64| bottom - (error.log10() + 3.0) / 4.3 * (bottom - top);
    let mut out = Svg::new(940.0, 500.0);
    for ms in [0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0] {
        out.line(&[(x(ms), top), (x(ms), bottom)], "#ddd", 1.0);
        out.text(x(ms), bottom + 18.0, 12.0, Anchor::Middle, &format!("{ms}"));
    }
    for error in [0.001, 0.01, 0.1, 1.0, 10.0] {
        out.line(&[(left, y(error)), (right, y(error))], "#ddd", 1.0);
        out.text(left - 6.0, y(error) + 4.0, 12.0, Anchor::End, &format!("{error}"));
    }
    out.line(&[(left, y(0.1)), (x(3.0), y(0.1)), (x(3.0), bottom)], "#666", 1.5);
    out.text(x(3.0) - 4.0, bottom - 6.0, 11.0, Anchor::End, "wanted: 0.1 % in 3 ms");
    out.text(
        0.5 * (left + right),
        bottom + 40.0,
        13.0,
        Anchor::Middle,
        "re-solve with a new factorisation, ms",
    );
    out.text(
        left - 50.0,
        top - 16.0,
        13.0,
        Anchor::Start,
        "largest error of 208 voltages, %",
    );

    let families = [
        ("linear, uniform, fitted", Order::Linear, Kind::Uniform, "#bdbdbd"),
        ("quadratic, uniform, fitted", Order::Quadratic, Kind::Uniform, "#737373"),
        ("linear, graded, touch cut", Order::Linear, Kind::Cut, "#fdae61"),
        ("linear, graded, fitted", Order::Linear, Kind::Fitted, "#d7191c"),
        ("quadratic, graded, touch cut", Order::Quadratic, Kind::Cut, "#74add1"),
        ("quadratic, graded, fitted", Order::Quadratic, Kind::Fitted, "#2c5aa0"),
    ];
    for (row, (name, order, kind, colour)) in families.into_iter().enumerate() {
        let mut line = Vec::new();
        for factor in FACTORS {
            let p = measure(order, kind, factor, &reference)?;
            println!("{name:<30} {:>6} nodes {:>7.2} ms {:>8.4} %", p.nodes, p.ms, p.error);
            line.push((x(p.ms), y(p.error)));
        }
        out.line(&line, colour, 2.0);
        for (x, y) in &line {
            out.dot(*x, *y, 3.5, colour);
        }
        let at = top + 20.0 + 24.0 * row as f64;
        out.line(&[(right + 20.0, at), (right + 45.0, at)], colour, 3.0);
        out.text(right + 52.0, at + 4.0, 12.0, Anchor::Start, name);
    }
    std::fs::write(&file, out.finish())?;
    println!("{file}");
    Ok(())
}
