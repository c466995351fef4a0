//! The default noise is the paper's: its way of measuring has its signal to noise ratio.

use crate::common::Bench;
use forward::{Model, ModelOptions, Sheet};
use hil_sim::{Rubber, Scene, SimConfig, Touch};
use protocol::Plan;
use std::sync::Arc;

/// Frames of a plan in codes, under touches that are always there.
fn record(model: &Arc<Model>, plan: &Plan, touches: Vec<Touch>, duration_s: f64) -> Vec<Vec<f64>> {
    let config = SimConfig {
        plan: Some(plan.clone()),
        ..SimConfig::default()
    };
    let rubber = Rubber::on_model(Arc::clone(model), Scene::still(touches)).unwrap();
    let list = Bench::new(config, rubber).measured(duration_s);
    assert!(list.iter().all(|f| f.clipped.count() == 0));
    list.iter()
        .map(|f| f.values.iter().map(|v| v.codes()).collect())
        .collect()
}

fn mean(frames: &[Vec<f64>]) -> Vec<f64> {
    (0..frames[0].len())
        .map(|k| frames.iter().map(|f| f[k]).sum::<f64>() / frames.len() as f64)
        .collect()
}

/// `20 log10(||change of the mean|| / rms over the frames of ||noise||)`: the paper's figure of merit.
fn signal_to_noise_db(model: &Arc<Model>, plan: &Plan, count: usize) -> f64 {
    let period_s = 16.0 * 1425.0 / 84e6;
    let duration_s = f64::from(plan.quarters()) / 4.0 * period_s * (count as f64 + 0.5);
    let rest = record(model, plan, vec![], duration_s);
    let pressed = record(model, plan, vec![Touch::tip(0.0, 0.0, 25.0)], duration_s);
    let (a, b) = (mean(&rest), mean(&pressed));
    let signal2: f64 = a.iter().zip(&b).map(|(x, y)| (y - x).powi(2)).sum();
    let degrees = (rest.len() - 1) as f64;
    let noise2: f64 = rest
        .iter()
        .flat_map(|f| f.iter().zip(&a).map(|(x, y)| (x - y).powi(2)))
        .sum::<f64>()
        / degrees;
    10.0 * (signal2 / noise2).log10()
}

#[test]
fn the_papers_way_of_measuring_has_the_papers_27_db() {
    let model = Arc::new(Model::new(&Sheet::paper(), &ModelOptions::default()).unwrap());
    let paper = signal_to_noise_db(&model, &Plan::paper(), 40);
    println!("paper: {paper:.2} dB");
    assert!((paper - 27.0).abs() < 0.7, "{paper:.2} dB");

    // One period instead of six has sqrt(6) times the noise of the samples, 7.8 dB; the rounding of values, which is a part
    // of the paper's noise here, does not grow with it.
    let fast = signal_to_noise_db(&model, &Plan::fast(), 200);
    println!("fast: {fast:.2} dB");
    assert!((paper - fast - 7.6).abs() < 0.7, "{paper:.2} dB, {fast:.2} dB");
}
