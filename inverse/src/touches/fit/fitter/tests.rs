//! The fitter on discs of the linear model itself, and on the nonlinear one.

use super::*;
use crate::touches::fit::disc::Disc;
use crate::touches::fit::frame_fit::{Start, fit};
use forward::{Drive, Pattern, Sheet};
use nalgebra::DVector;
use rand::{Rng, SeedableRng};
use rand_distr::StandardNormal;

fn fitter() -> Fitter {
    let pattern = Pattern::adjacent(16).unwrap();
    let imager = Arc::new(Imager::new(&Sheet::paper(), Drive::PAPER, pattern, 5.0).unwrap());
    Fitter::new(&imager, FitOptions::for_extent(97.5)).unwrap()
}

#[test]
fn two_of_which_one_is_too_strong_are_merged_where_they_weigh() {
    let disc = |x: f64, radius: f64, strength| Disc {
        at: [x, 3.0],
        radius,
        strength,
    };
    // 1.7 and 0.2 of their areas.
    let (strong, weak) = (
        disc(0.0, 5.0, 1.7 * std::f64::consts::PI * 25.0),
        disc(18.0, 12.0, 0.2 * std::f64::consts::PI * 144.0),
    );
    const TOO_STRONG: f64 = 1.55;
    let far = disc(-70.0, 12.0, 100.0);
    let discs: Discs = [strong, far, weak].into_iter().collect();
    let found = merged_if_strong(&discs, 12.5, TOO_STRONG).unwrap();
    assert_eq!(found.len(), 2);
    assert!(found.contains(&far));
    let one = found.iter().find(|d| **d != far).unwrap();
    let strength = strong.strength + weak.strength;
    assert!((one.strength - strength).abs() < 1e-9 && one.radius == 12.5);
    assert!((one.at[0] * strength - 18.0 * weak.strength).abs() < 1e-9 && (one.at[1] - 3.0).abs() < 1e-12);
    // Nobody near, or none too strong.
    assert!(merged_if_strong(&[strong, far].into_iter().collect(), 12.5, TOO_STRONG).is_none());
    assert!(merged_if_strong(&[weak, disc(10.0, 12.0, 100.0)].into_iter().collect(), 12.5, TOO_STRONG).is_none());
}

/// Discs of the linear model itself, with noise of one part in ten thousand of their response.
fn data(table: &ResponseTable, discs: &[Disc], seed: u64) -> (DVector<f64>, f64) {
    let n = table.length();
    let mut sum = DVector::zeros(n);
    for d in discs {
        let mut out: [Vec<f64>; 4] = std::array::from_fn(|_| vec![0.0; table.stride()]);
        let [a, b, c, e] = &mut out;
        table.at(d.at, d.radius, [a, b, c, e]);
        sum += DVector::from_column_slice(&out[0][..n]) * d.strength;
    }
    let sigma = if discs.is_empty() {
        1e-6
    } else {
        1e-4 * sum.norm() / (n as f64).sqrt()
    };
    let mut rng = rand::rngs::StdRng::seed_from_u64(seed);
    (sum.map(|v| v + sigma * rng.sample::<f64, _>(StandardNormal)), sigma)
}

fn fitted(f: &Fitter, values: &DVector<f64>, sigma: f64, threshold: f64, seeds: &[Disc]) -> Option<Fitted> {
    let frame = Frame {
        values: values.as_slice(),
        sigma,
        chi_square_threshold: threshold,
        error: 0.0,
        polarity: Polarity::Up,
        most_work: usize::MAX,
    };
    let mut found = Fitted::default();
    let start = Start {
        seeds: &mut || Some(seeds.iter().copied().collect()),
        before: None,
    };
    let model = DiscModel {
        table: f.volts(),
        prior: &f.prior,
        order: &f.options.order,
    };
    fit(model, frame, start, &mut Scratch::default(), &mut found)?;
    Some(found)
}

#[test]
fn discs_of_the_model_come_back() {
    let f = fitter();
    let truth = [
        Disc {
            at: [-30.0, 22.0],
            radius: 11.0,
            strength: 60.0,
        },
        Disc {
            at: [25.0, -41.0],
            radius: 14.0,
            strength: 90.0,
        },
    ];
    let (values, sigma) = data(f.volts(), &truth, 1);
    let prior = f.prior;
    let threshold = model_order::chi_square_threshold(f.volts(), &prior, 89.0);
    // From a wrong number of touches in wrong places.
    for seeds in [
        vec![],
        vec![[0.0, 0.0]],
        vec![[-25.0, 25.0], [30.0, -30.0], [60.0, 60.0]],
        // Ten of which most leave.
        (0..10)
            .map(|k| [-60.0 + 30.0 * f64::from(k % 5), 40.0 - 75.0 * f64::from(k / 5)])
            .collect(),
    ] {
        let seeds: Vec<Disc> = seeds.into_iter().map(|at| prior.seed(at)).collect();
        let found = fitted(&f, &values, sigma, threshold, &seeds).unwrap();
        assert_eq!(found.discs.len(), 2, "{seeds:?} {found:?}");
        for t in &truth {
            let near = found
                .discs
                .iter()
                .map(|d| (d.at[0] - t.at[0]).hypot(d.at[1] - t.at[1]))
                .fold(f64::INFINITY, f64::min);
            assert!(near < 0.02, "{seeds:?}: {near}");
        }
        assert!((0.5..1.5).contains(&found.misfit), "{}", found.misfit);
    }
}

/// Data that are volts of the model.
struct Unreduced;

impl Reduce for Unreduced {
    fn reduce(&mut self, volts: &[f64], reduced: &mut Vec<f64>) {
        reduced.extend_from_slice(volts);
    }
}

/// Two strong touches side by side move and grow a little from frame to frame. The linearisation error is solved
/// for now and then, and the touches are where they would be without the frames before.
#[test]
fn the_linearisation_error_is_carried_from_frame_to_frame() {
    let (mut f, mut alone) = (fitter(), fitter());
    // What is counted are solutions, which multipoles would take the place of.
    (f.scattering, alone.scattering) = (Some(None), Some(None));
    let table = f.volts.clone();
    let mut nonlinear = NonlinearModel::new(&f.imager.model, f.imager.drive, &f.imager.pattern).unwrap();
    let at = |frame: usize| {
        let k = frame as f64;
        let disc = |x: f64, y, rise: f64| Disc {
            at: [x, y],
            radius: 12.5,
            strength: 2.0 * rise / (2.0 + rise) * std::f64::consts::PI * 12.5 * 12.5,
        };
        [
            disc(-20.0 + 0.2 * k, 30.0, 0.8 + 0.01 * k),
            disc(22.0, 30.0 - 0.1 * k, 0.8),
        ]
    };
    let mut rng = rand::rngs::StdRng::seed_from_u64(6);
    let (mut sigma, mut first) = (0.0, 0);
    for frame in 0..40 {
        let truth = at(frame);
        let mut values = nonlinear.linearisation_error_v(&table, &truth, true).unwrap();
        let (linear, _) = data(&table, &truth, 0);
        if frame == 0 {
            // The linearisation error comes to ten standard deviations.
            sigma = values.iter().map(|v| v * v).sum::<f64>().sqrt() / 10.0;
        }
        for (v, l) in values.iter_mut().zip(linear.iter()) {
            *v += l + sigma * rng.sample::<f64, _>(StandardNormal);
        }
        let noise = NoiseEstimate {
            sigma,
            source: NoiseSource::Known,
        };
        let fit = |fitter: &mut Fitter, patient| {
            let data = Data {
                table: &table,
                reduction: &mut Unreduced,
                beside: None,
                values: &values,
                noise,
                gain: 1.0,
                patient,
                corrected: true,
                unhurried: true,
                from_found: false,
                polarity: Polarity::Up,
            };
            fitter
                .fit(data, &mut || Some(truth.iter().map(|d| d.at).collect()))
                .unwrap()
                .clone()
        };
        let found = fit(&mut f, false);
        if frame == 1 {
            first = f.solutions;
        }
        assert_eq!(found.discs.len(), 2, "{frame}");
        alone.forget();
        let without = fit(&mut alone, true);
        for t in &found.touches {
            let near = without.touches.iter().map(|o| (t.x_mm - o.x_mm).hypot(t.y_mm - o.y_mm));
            let (off, sd) = (
                near.fold(f64::INFINITY, f64::min),
                t.x_sd_mm.unwrap().hypot(t.y_sd_mm.unwrap()),
            );
            assert!(frame == 0 || off < 0.7 * sd, "{frame}: {off} mm, {sd}");
        }
        assert!(frame == 0 || found.misfit < 1.5, "{frame}: {}", found.misfit);
    }
    let later = f.solutions - first;
    assert!(first <= 2 && (2..=33).contains(&later), "{first} and {later} solutions");
    assert!(
        alone.solutions > 2 * f.solutions,
        "{} without the frames before",
        alone.solutions
    );
    assert!(f.carried.error.is_some());
    f.forget();
    assert!(f.carried.error.is_none());
}

#[test]
fn noise_grows_no_touch() {
    let f = fitter();
    let threshold = model_order::chi_square_threshold(f.volts(), &f.prior, 89.0);
    for seed in 0..200 {
        let (values, sigma) = data(f.volts(), &[], seed);
        let seeds = [f.prior.seed([10.0, 20.0])];
        let found = fitted(&f, &values, sigma, threshold, &seeds).unwrap();
        assert!(found.touches.is_empty(), "{seed}: {:?}", found.touches);
    }
}

#[test]
fn numbers_that_are_none_end_without_a_fit() {
    let f = fitter();
    let values = DVector::from_element(f.volts().length(), f64::NAN);
    assert_eq!(fitted(&f, &values, 1.0, 30.0, &[]), None);
    assert_eq!(fitted(&f, &DVector::zeros(3), 1.0, 30.0, &[]), None);
}
