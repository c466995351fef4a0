//! Largest error over all 208 voltages for random disc touches of 25 mm, against a converged reference, three ways:
//! on the default mesh as it is, on the default mesh fitted to the touch, and on a mesh made for the touch.
//!
//!     cargo run --release -p skin-forward --example accuracy [touches [seed]]

use forward::field::conductivity_of_discs;
use forward::{DiscTouch, Drive, Model, ModelOptions, Pattern, Sheet, Solver};
use rand::{Rng, SeedableRng};
use std::sync::Arc;

type Error = Box<dyn std::error::Error>;

/// Edges along the touch for the reference, mm.
const REFERENCE_EDGE_MM: f64 = 0.8;

fn made_for(options: &ModelOptions, touch: &[DiscTouch]) -> Result<Solver, Error> {
    let model = Arc::new(Model::new(&Sheet::paper(), options)?);
    let conductivity = conductivity_of_discs(model.mesh(), touch);
    let mut solver = Solver::new(model)?;
    solver.solve(&conductivity)?;
    Ok(solver)
}

fn main() -> Result<(), Error> {
    let count = std::env::args().nth(1).map_or(Ok(100), |s| s.parse())?;
    let pattern = Pattern::adjacent(16)?;
    let frame = |s: &Solver| Drive::PAPER.frame_v(s.electrode_matrix(), &pattern);
    let error = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| (x / y - 1.0).abs()).fold(0.0, f64::max);
    let mut random = rand::rngs::StdRng::seed_from_u64(std::env::args().nth(2).map_or(Ok(1), |s| s.parse())?);
    let model = Arc::new(Model::new(&Sheet::paper(), &ModelOptions::default())?);
    let mut fixed = Solver::new(model.clone())?;
    let mut fitted = Solver::new(model.clone())?;
    println!("default mesh: {} nodes", model.mesh().nodes.len());
    let converged = ModelOptions {
        accuracy: 1e-4,
        ..ModelOptions::default()
    };
    let reference = frame(&made_for(&converged, &[])?);
    println!("untouched: {:.3} %", 100.0 * error(&frame(&fixed), &reference));
    println!("largest error, %: median, 95th percentile and worst of {count} touches");
    for rise in [0.2, 3.0] {
        let mut errors = [const { Vec::new() }; 3];
        for _ in 0..count {
            // Anywhere on the sheet, the whole disc on it.
            let r = random.random_range(0.0_f64..1.0).sqrt() * (97.5 - 12.5);
            let angle = random.random_range(0.0..std::f64::consts::TAU);
            let touch = [DiscTouch {
                centre_mm: [r * angle.cos(), r * angle.sin()],
                radius_mm: 12.5,
                rise,
            }];
            let circles = vec![(touch[0].centre_mm, touch[0].radius_mm, REFERENCE_EDGE_MM)];
            let reference = frame(&made_for(
                &ModelOptions {
                    circles,
                    ..converged.clone()
                },
                &touch,
            )?);
            fixed.solve(&conductivity_of_discs(model.mesh(), &touch))?;
            fitted.solve_touches(&touch)?;
            let own = made_for(&ModelOptions::for_touches(&touch), &touch)?;
            for (list, solver) in errors.iter_mut().zip([&fixed, &fitted, &own]) {
                list.push(100.0 * error(&frame(solver), &reference));
            }
        }
        for (name, list) in ["mesh as it is", "mesh fitted", "mesh of its own"]
            .iter()
            .zip(&mut errors)
        {
            list.sort_by(f64::total_cmp);
            let at = |share: f64| list[((list.len() - 1) as f64 * share).round() as usize];
            println!(
                "  {:+4.0} % {name:<16} {:.3} {:.3} {:.3}",
                100.0 * rise,
                at(0.5),
                at(0.95),
                at(1.0)
            );
        }
    }
    Ok(())
}
