//! What the forward model costs on a machine that has other work to do: the least time passed of many repetitions, and
//! (on Linux) the mean time on the processor. On an idle machine `cargo bench -p skin-forward` tells more.
//!
//!     cargo run --release -p skin-forward --example costs [repetitions, default 60]

use forward::field::conductivity_of_discs;
use forward::{CellGrid, DiscTouch, Drive, Mesh, Model, ModelOptions, Pattern, Sensitivity, Sheet, Solver};
use std::sync::Arc;
use std::time::Instant;

type Outcome = Result<(), Box<dyn std::error::Error>>;

const TOUCH: DiscTouch = DiscTouch {
    centre_mm: [35.0, 20.0],
    radius_mm: 12.5,
    rise: 3.0,
};

/// Seconds that this thread has been on a processor.
fn on_processor() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    let nanoseconds: f64 = text.split_whitespace().next()?.parse().ok()?;
    Some(1e-9 * nanoseconds)
}

fn best(name: &str, repeats: usize, mut work: impl FnMut() -> Outcome) -> Outcome {
    let before = on_processor();
    let mut best = f64::INFINITY;
    for _ in 0..repeats {
        let start = Instant::now();
        work()?;
        best = best.min(start.elapsed().as_secs_f64());
    }
    let used = before.zip(on_processor());
    let mean = used.map_or_else(String::new, |(a, b)| format!("{:>8.3}", 1e3 * (b - a) / repeats as f64));
    println!("{name:<46} {:>8.3} {mean}", 1e3 * best);
    Ok(())
}

fn main() -> Outcome {
    let repeats = std::env::args().nth(1).map_or(Ok(60), |s| s.parse())?;
    let (sheet, options) = (Sheet::paper(), ModelOptions::default());
    let pattern = Pattern::adjacent(16)?;
    let model = Arc::new(Model::new(&sheet, &options)?);
    let elements = model.mesh().triangles.len();
    println!("{} nodes, {elements} elements", model.mesh().nodes.len());
    println!("{:<46} {:>8} {:>8}", "ms", "least", "mean cpu");
    let sizes = Model::sizes(&sheet, &options)?;
    let grid = CellGrid::new(model.geometry(), 5.0)?;
    let mut solver = Solver::new(model.clone())?;

    best("mesh", repeats, || {
        Mesh::new(model.geometry(), &sizes, options.order)?;
        Ok(())
    })?;
    best("model: mesh, integrals, elimination order", repeats, || {
        Model::new(&sheet, &options)?;
        Ok(())
    })?;
    best("solver: assembly, factorisation, 16 electrodes", repeats, || {
        Solver::new(model.clone())?;
        Ok(())
    })?;
    best("sensitivity of 1184 cells", repeats, || {
        Sensitivity::by_cell(&solver, &grid);
        Ok(())
    })?;
    for (name, options) in [
        ("set-up, all of it", options.clone()),
        ("set-up for a touch", ModelOptions::for_touches(&[TOUCH])),
    ] {
        best(name, repeats, || {
            let model = Arc::new(Model::new(&sheet, &options)?);
            let mut solver = Solver::new(model.clone())?;
            if !options.touches.is_empty() {
                solver.solve(&conductivity_of_discs(model.mesh(), &options.touches))?;
            }
            let grid = CellGrid::new(model.geometry(), 5.0)?;
            let sensitivity = Sensitivity::by_cell(&solver, &grid);
            sensitivity.matrix_v(Drive::PAPER, solver.electrode_matrix(), &pattern);
            Ok(())
        })?;
    }
    let mut k = 0.0;
    best("re-solve, every element changed", repeats, || {
        k += 1e-6;
        solver.solve(&vec![[1.0 + k, 0.0, 1.0]; elements])?;
        Ok(())
    })?;
    let mut portable = Solver::portable(model.clone())?;
    best("re-solve, alike on every machine", repeats, || {
        k += 1e-6;
        portable.solve(&vec![[1.0 + k, 0.0, 1.0]; elements])?;
        Ok(())
    })?;
    best("re-solve, mesh fitted to a touch", repeats, || {
        k += 0.01;
        let centre_mm = [60.0 * k.cos(), 60.0 * k.sin()];
        solver.solve_touches(&[DiscTouch { centre_mm, ..TOUCH }])?;
        Ok(())
    })?;
    let unpressed = vec![[1.0, 0.0, 1.0]; elements];
    let far = |e: &usize| {
        let [x, y] = model.mesh().corners(*e)[0];
        (x - 35.0).hypot(y - 20.0)
    };
    let mut near: Vec<usize> = (0..elements).collect();
    near.sort_by(|a, b| far(a).total_cmp(&far(b)));
    for count in [1, 4, 16, 32, 64] {
        let mut solver = Solver::new(model.clone())?;
        best(&format!("re-solve, {count} elements changed"), repeats, || {
            k += 1e-6;
            let mut conductivity = unpressed.clone();
            for e in &near[..count] {
                conductivity[*e] = [1.2 + k, 0.0, 1.2 + k];
            }
            solver.solve(&conductivity)?;
            Ok(())
        })?;
        println!("  {:?}", solver.work());
    }
    Ok(())
}
