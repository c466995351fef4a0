//! Parameters back from simulated recordings.

use super::*;
use rand::{Rng, SeedableRng};
use rand_distr::StandardNormal;

const AREA_MM2: f64 = 490.0;

/// A recording of a solid with noise of the rise, mm².
fn recording(solid: &Solid, force: impl Fn(f64) -> f64, noise_mm2: f64, seed: u64) -> Vec<Sample> {
    let mut rng = rand::rngs::StdRng::seed_from_u64(seed);
    let mut state = SolidState::default();
    let (mut samples, mut before) = (Vec::new(), 0.0);
    for k in 0..1500 {
        // Frames that come at times of their own.
        let time_s = 0.03 * f64::from(k) + 0.004 * f64::from(k % 3);
        let strain = state.press(&solid.step(time_s - before), force(time_s) / AREA_MM2);
        before = time_s;
        samples.push(Sample {
            time_s,
            force_n: force(time_s),
            total_mm2: AREA_MM2 * solid.rise(strain) + noise_mm2 * rng.sample::<f64, _>(StandardNormal),
            area_mm2: Some(AREA_MM2),
            used: true,
        });
    }
    samples
}

fn hold(t: f64) -> f64 {
    if (1.0..25.0).contains(&t) { 25.0 } else { 0.0 }
}

/// Several forces, as an exponent asks for.
fn stairs(t: f64) -> f64 {
    match t {
        t if t < 1.0 => 0.0,
        t if t < 10.0 => 8.0,
        t if t < 20.0 => 25.0,
        t if t < 30.0 => 14.0,
        _ => 0.0,
    }
}

fn solid(exponent: f64) -> Solid {
    Solid {
        delayed_ratio: 0.35,
        tau_s: 6.0,
        exponent,
        unit_rise_mpa: 0.2546,
    }
}

#[test]
fn without_noise_the_parameters_are_exact() {
    for (exponent, force) in [(1.0, hold as fn(f64) -> f64), (1.3, stairs), (0.8, stairs)] {
        let truth = solid(exponent);
        let found = fit(&recording(&truth, force, 0.0, 1), exponent != 1.0)
            .unwrap()
            .calibration;
        for (a, b) in logarithms(&found.solid).iter().zip(logarithms(&truth)) {
            assert!((a - b).abs() < 1e-6, "{found:?}");
        }
        assert!(found.force_sd_n < 1e-6);
    }
}

#[test]
fn the_standard_errors_are_those_of_repeated_recordings() {
    let (truth, mut over) = (solid(1.0), [0.0; 3]);
    let runs = 60;
    for seed in 0..runs {
        let f = fit(&recording(&truth, hold, 2.0, seed), false).unwrap();
        let (s, e) = (f.calibration.solid, f.errors);
        over[0] += ((s.unit_rise_mpa - truth.unit_rise_mpa) / e.unit_rise_mpa).powi(2);
        over[1] += ((s.delayed_ratio - truth.delayed_ratio) / e.delayed_ratio).powi(2);
        over[2] += ((s.tau_s - truth.tau_s) / e.tau_s).powi(2);
        assert!((f.residual_mm2 / 2.0 - 1.0).abs() < 0.1, "{}", f.residual_mm2);
        assert!((f.calibration.force_sd_n / (2.0 * 0.2546) - 1.0).abs() < 0.15);
    }
    // Chi-square with 60 degrees of freedom lies within 36 and 95 with 99.8 %.
    assert!(over.iter().all(|o| (36.0..95.0).contains(o)), "{over:?}");
}

#[test]
fn rubber_that_does_not_creep_has_no_delayed_part() {
    let truth = Solid {
        delayed_ratio: 0.0,
        ..solid(1.0)
    };
    let mut still = 0;
    for seed in 0..20 {
        let found = fit(&recording(&truth, hold, 2.0, seed), false);
        let Ok(found) = found else { continue };
        still += usize::from(found.calibration.solid.delayed_ratio < 0.01);
        assert!((found.calibration.solid.unit_rise_mpa / truth.unit_rise_mpa - 1.0).abs() < 0.02);
    }
    assert!(still >= 17, "{still}");
}

#[test]
fn what_a_recording_does_not_tell_is_refused_with_advice() {
    // Two seconds of six: the press is there, its end is not.
    let list = recording(&solid(1.0), hold, 2.0, 1);
    let until: Vec<Sample> = list.iter().filter(|s| s.time_s < 3.0).copied().collect();
    let refused = fit(&until, false).unwrap_err().to_string();
    assert!(refused.contains("hold the press for three time constants"), "{refused}");
    assert!(matches!(fit(&list[..20], false), Err(CalibrationError::TooFew { .. })));
    let upside_down: Vec<Sample> = list
        .iter()
        .map(|s| Sample {
            total_mm2: -s.total_mm2,
            ..*s
        })
        .collect();
    assert_eq!(fit(&upside_down, false), Err(CalibrationError::NoRise));
    // One force alone does not tell an exponent from a unit.
    let one = fit(&recording(&solid(1.0), hold, 2.0, 3), true);
    if let Err(e) = one {
        assert!(e.to_string().contains("more than one force"), "{e}");
    }
}
