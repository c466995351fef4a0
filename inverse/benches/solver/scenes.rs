//! Frames of moving touches for timing: made with the nonlinear model on a finer mesh than the imager's.

use forward::{DiscTouch, Drive, MeshSizes, Model, Order, Pattern, Sheet, Solver, field};
use inverse::reference::imager::Imager;
use nalgebra::{DMatrix, DVector};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use rand_distr::StandardNormal;
use std::sync::Arc;

/// A sensitivity with a sequence of frames for it.
pub(crate) struct Scene {
    /// Volts for a unit relative rise, `values x cells`.
    pub(crate) sensitivity: DMatrix<f64>,
    /// Differences to the unpressed sheet, V: four touches that move 1 mm from frame to frame, with fresh noise.
    pub(crate) moving: Vec<DVector<f64>>,
    /// The first frame's touches at rest, with fresh noise.
    pub(crate) still: Vec<DVector<f64>>,
}

const RADIUS_MM: f64 = 12.5;
const RISE: f64 = 0.2;

/// The scene of a drive, cell size and signal to noise ratio (of the change, dB).
pub(crate) fn scene(drive: Drive, cell_mm: f64, frames: usize, snr_db: f64) -> Scene {
    let sheet = Sheet::paper();
    let pattern = Pattern::adjacent(16).unwrap();
    let imager = Imager::new(&sheet, drive, pattern.clone(), cell_mm).unwrap();
    let sizes = MeshSizes {
        largest_mm: 4.3,
        electrode_fraction: 0.02,
        electrode_most_mm: 1.0,
        growth: 0.45,
        circles: vec![],
    };
    let truth = Arc::new(Model::with_sizes(&sheet, &sizes, Order::Quadratic).unwrap());
    let mut solver = Solver::new(truth.clone()).unwrap();
    let base = DVector::from_vec(drive.frame_v(solver.electrode_matrix(), &pattern));
    let clean: Vec<DVector<f64>> = (0..frames)
        .map(|k| {
            solver
                .solve(&field::conductivity_of_discs(truth.mesh(), &touches(k)))
                .unwrap();
            DVector::from_vec(drive.frame_v(solver.electrode_matrix(), &pattern)) - &base
        })
        .collect();
    let sigma = clean[0].norm() / (base.len() as f64).sqrt() * 10.0_f64.powf(-snr_db / 20.0);
    let mut rng = StdRng::seed_from_u64(1);
    let mut noisy = |v: &DVector<f64>| v.map(|v| v + sigma * rng.sample::<f64, _>(StandardNormal));
    let moving = clean.iter().map(&mut noisy).collect();
    let still = clean.iter().map(|_| noisy(&clean[0])).collect();
    Scene {
        sensitivity: imager.sensitivity,
        moving,
        still,
    }
}

/// Four touches at least 50 mm apart that wander round the sheet, 1 mm a frame.
fn touches(frame: usize) -> Vec<DiscTouch> {
    let turn = frame as f64 / 48.0;
    (0..4)
        .map(|k| {
            let angle = turn + f64::from(k) * std::f64::consts::FRAC_PI_2;
            let radius = 52.0 + 16.0 * (0.37 * turn + f64::from(k)).sin();
            DiscTouch {
                centre_mm: [radius * angle.cos(), radius * angle.sin()],
                radius_mm: RADIUS_MM,
                rise: RISE,
            }
        })
        .collect()
}
