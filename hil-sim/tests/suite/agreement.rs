//! The simulated voltages against a way to them that shares nothing with the simulator: finite volumes on a polar grid.

use crate::common::Bench;
use crate::theory::polar::{COUNT, RADIUS_MM, polar};
use forward::{Drive, ElectrodeMatrix, Pattern, Sheet};
use hil_sim::{Material, Rubber, Scene, Shape, SheetModel, SimConfig, Touch};
use protocol::Plan;
use std::f64::consts::{PI, TAU};

/// The paper's disc with electrodes of a quarter of the pitch (9.57 mm), as the polar grid has them.
fn sheet() -> Sheet {
    Sheet::disc(2.0 * RADIUS_MM, COUNT, TAU * RADIUS_MM / 64.0, 1.0, 1000.0)
}

/// A flat tip over half the radius that raises the resistivity by so much.
fn pressed(rise: f64) -> Scene {
    let (radius_mm, material) = (0.5 * RADIUS_MM, Material::default());
    let force_n = rise / material.rise(1.0) * PI * radius_mm * radius_mm;
    Scene::still(vec![Touch::still(Shape::Disc, radius_mm, 0.0, 0.0, force_n)])
}

fn frame(z: &ElectrodeMatrix) -> Vec<f64> {
    Drive::PAPER.frame_v(z, &Pattern::adjacent(COUNT).unwrap())
}

/// The polar grid's limit of each voltage under such a tip: Aitken's extrapolation of three grids.
fn independent(rise: f64) -> Vec<f64> {
    let grids = [32, 64, 128].map(|cells| frame(&polar(cells, 1.0, 0.5, 1.0 / (1.0 + rise))));
    (0..grids[0].len())
        .map(|k| {
            let [coarse, middle, fine] = [0, 1, 2].map(|g: usize| grids[g][k]);
            let (first, second) = (middle - coarse, fine - middle);
            fine - second * second / (second - first)
        })
        .collect()
}

fn largest(pairs: impl Iterator<Item = (f64, f64)>) -> f64 {
    pairs.map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f64::max)
}

#[test]
fn the_sheets_voltages_agree_with_a_polar_grid_within_a_thousandth() {
    for rise in [0.0, 0.2, 1.0] {
        let mut rubber = Rubber::new(&sheet(), pressed(rise)).unwrap();
        let simulated = frame(rubber.electrode_matrix(0.0).unwrap());
        let error = largest(simulated.into_iter().zip(independent(rise)));
        println!("+{:.0} %: {error:.1e}", 100.0 * rise);
        assert!(error < 1e-3, "{rise}: {error:.1e}");
    }
}

/// All the way: what the firmware measures on the simulated electronics, noise and rounding averaged out.
#[test]
fn the_boards_voltages_agree_with_a_polar_grid_within_a_thousandth() {
    let config = SimConfig {
        plan: Some(Plan::fast()),
        ..SimConfig::default()
    };
    let mut bench = Bench::new(config, Rubber::new(&sheet(), pressed(0.2)).unwrap());
    let lsb = bench.board.hello().volts_per_code(0).unwrap();
    let frames = bench.measured(8.0);
    let n = frames.len() as f64;
    let truth = independent(0.2);
    // 0.17 codes of noise and rounding a frame; five standard errors.
    let spread = 5.0 * 0.17 / n.sqrt() * lsb;
    let mut worst = 0.0_f64;
    for (k, truth) in truth.iter().enumerate() {
        let mean = frames.iter().map(|f| f.values[k].codes()).sum::<f64>() / n * lsb;
        let off = (mean - truth).abs();
        worst = worst.max(off / truth);
        assert!(off < 1e-3 * truth + spread, "{k}: {mean} {truth}");
    }
    println!("{n} frames: {worst:.1e}, noise of the mean up to {:.1e} V", spread);
}
