//! Which touches the watch sees: its visibility by the forward model, all over the sheet.
#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

use forward::{CellGrid, Drive, Geometry, Measurement, Model, ModelOptions, Pattern, Sensitivity, Sheet, Solver};
use hil_sim::Electronics;
use protocol::{Plan, Recipe, Value, Watch};
use std::sync::Arc;

/// The paper's touch: 25 N on 25 mm raise the resistivity by a fifth.
const RISE: f64 = 0.2;
const RADIUS_MM: f64 = 12.5;

/// Noise of one value of one period, codes: 16 samples with white noise and rounding, and the rounding of the value.
fn noise_codes(electronics: &Electronics) -> f64 {
    let sample = electronics.noise_codes.powi(2) + 1.0 / 12.0;
    let step = 1.0 / f64::from(Value::PER_CODE);
    (sample * 2.0 / 16.0 + step * step / 12.0).sqrt()
}

struct Bench {
    sensitivity: Sensitivity,
    solver: Solver,
    centres: Vec<[f64; 2]>,
    codes_per_volt: f64,
    noise: f64,
}

impl Bench {
    fn new() -> Self {
        let sheet = Sheet::paper();
        let model = Arc::new(Model::new(&sheet, &ModelOptions::default()).unwrap());
        let solver = Solver::new(model).unwrap();
        let grid = CellGrid::new(&Geometry::new(&sheet).unwrap(), 5.0).unwrap();
        let electronics = Electronics::default();
        let gain = f64::from(electronics.gains_milli[0]) / 1000.0;
        Self {
            sensitivity: Sensitivity::by_cell(&solver, &grid),
            centres: (0..grid.len()).map(|k| grid.centre(k)).collect(),
            solver,
            codes_per_volt: gain / electronics.adc_span_v * 4095.0,
            noise: noise_codes(&electronics),
        }
    }

    fn pattern(&self, recipe: Recipe<'_>) -> Pattern {
        let pair = |p: protocol::Pair| forward::Pair::new(p.plus.into(), p.minus.into());
        let list = recipe.measurements(16).map(|(drive, sense)| Measurement {
            drive: pair(drive),
            sense: pair(sense),
        });
        Pattern::from_list(16, list.collect()).unwrap()
    }

    /// Norm of the change of all values over their noise, for the paper's touch wherever it lies on the sheet whole.
    fn visibility(&self, recipe: Recipe<'_>) -> Vec<f64> {
        let pattern = self.pattern(recipe);
        let z = self.solver.electrode_matrix();
        let matrix = self.sensitivity.matrix_v(Drive::PAPER, z, &pattern) * (self.codes_per_volt / self.noise);
        let inside = |p: &&[f64; 2]| p[0].hypot(p[1]) <= 97.5 - RADIUS_MM;
        let seen = |p: &[f64; 2]| {
            let mut sum = nalgebra::DVector::zeros(pattern.len());
            for (k, c) in self.centres.iter().enumerate() {
                if (c[0] - p[0]).hypot(c[1] - p[1]) < RADIUS_MM {
                    sum += matrix.column(k) * RISE;
                }
            }
            sum.norm()
        };
        self.centres.iter().filter(inside).map(seen).collect()
    }
}

fn least(list: &[f64]) -> f64 {
    list.iter().copied().fold(f64::INFINITY, f64::min)
}

#[test]
fn the_watch_sees_a_touch_anywhere_nearly_as_well_as_the_whole_plan() {
    let bench = Bench::new();
    let (watch, plan) = (Watch::paper(), Plan::fastest());
    let (few, all) = (bench.visibility(watch.recipe()), bench.visibility(plan.recipe()));
    println!(
        "least visible touch of 25 N, in noise: watch {:.0}, whole plan {:.0}; medians {:.0}, {:.0}",
        least(&few),
        least(&all),
        median(&few),
        median(&all)
    );
    assert!(least(&few) > 0.75 * least(&all), "{} {}", least(&few), least(&all));
    // A threshold of 6.25 on the mean square is passed from (6.25 - 1) * 12 = 63 = 7.9^2 on: 25 N are sixteen times that.
    let values = watch.recipe().value_count() as f64;
    let threshold = ((f64::from(watch.threshold) / 256.0 - 1.0) * values).sqrt();
    assert!(least(&few) > 15.0 * threshold, "{} {threshold}", least(&few));
    // Neither drive alone does: each is half blind somewhere.
    for slot in 0..2 {
        let mut one = watch.clone();
        one.slots.swap_remove(slot);
        assert!(least(&bench.visibility(one.recipe())) < 0.8 * least(&few));
    }
}

fn median(list: &[f64]) -> f64 {
    let mut list = list.to_vec();
    list.sort_by(f64::total_cmp);
    list[list.len() / 2]
}

#[test]
fn the_watch_stays_inside_the_converters_range() {
    let bench = Bench::new();
    let pattern = bench.pattern(Watch::paper().recipe());
    let frame = Drive::PAPER.frame_v(bench.solver.electrode_matrix(), &pattern);
    for v in frame.iter() {
        let codes = v * bench.codes_per_volt;
        assert!(codes > 200.0 && codes < 0.9 * 2047.5, "{codes}");
    }
}
