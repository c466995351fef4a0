//! Laws of the solid and its inverse.

use super::*;
use proptest::prelude::*;

fn solids() -> impl Strategy<Value = Solid> {
    (0.0..3.0f64, 0.05..100.0f64, 0.5..2.0f64, 0.01..10.0f64).prop_map(
        |(delayed_ratio, tau_s, exponent, unit_rise_mpa)| Solid {
            delayed_ratio,
            tau_s,
            exponent,
            unit_rise_mpa,
        },
    )
}

/// Intervals of any length (s), and the pressure at their ends (MPa).
fn histories() -> impl Strategy<Value = Vec<(f64, f64)>> {
    let interval = prop_oneof![Just(0.0), 1e-6..1e-3f64, 1e-3..1.0f64, 1.0..1e3f64];
    proptest::collection::vec((interval, 0.0..1.0f64), 1..60)
}

proptest! {
    #[test]
    fn the_inverse_gives_back_any_history(solid in solids(), history in histories()) {
        let (mut rubber, mut filter) = (SolidState::default(), SolidState::default());
        for (dt_s, pressure) in history {
            let step = solid.step(dt_s);
            let strain = rubber.press(&step, pressure);
            let back = filter.pressure(&step, solid.strain_mpa(solid.rise(strain)));
            prop_assert!((back - pressure).abs() < 1e-12, "{back} {pressure}");
        }
    }

    #[test]
    fn how_an_interval_is_split_makes_no_difference(
        solid in solids(), start in 0.0..1.0f64, end in 0.0..1.0f64, at in 0.0..1.0f64, dt_s in 1e-4..50.0f64,
    ) {
        let mut whole = SolidState { pressure_mpa: start, delayed_mpa: 0.3 };
        let mut split = whole;
        let strain = whole.press(&solid.step(dt_s), end);
        split.press(&solid.step(at * dt_s), start + at * (end - start));
        let other = split.press(&solid.step(dt_s - at * dt_s), end);
        prop_assert!((strain - other).abs() < 1e-12);

        // The inverse too: it is given the strain that the solid has between.
        let mut filter = SolidState { pressure_mpa: start, delayed_mpa: 0.3 };
        let mut rubber = filter;
        for (dt_s, pressure) in [(at * dt_s, start + at * (end - start)), (dt_s - at * dt_s, end)] {
            let step = solid.step(dt_s);
            let strain = rubber.press(&step, pressure);
            filter.pressure(&step, strain);
        }
        prop_assert!((filter.pressure_mpa - end).abs() < 1e-12 && (filter.delayed_mpa - whole.delayed_mpa).abs() < 1e-12);
    }

    #[test]
    fn no_error_of_the_strain_grows_beyond_the_bound(
        solid in solids(), errors in proptest::collection::vec((1e-4..10.0f64, -1.0..1.0f64), 1..80),
    ) {
        let mut filter = SolidState::default();
        for (dt_s, error) in errors {
            let out = filter.pressure(&solid.step(dt_s), error);
            prop_assert!(out.abs() <= solid.worst_gain() + 1e-12, "{out} {}", solid.worst_gain());
        }
    }

    #[test]
    fn noise_comes_out_no_larger_than_it_went_in(
        solid in solids(), dt_s in 1e-4..10.0f64, noise in proptest::collection::vec(-1.0..1.0f64, 1..200),
    ) {
        let (mut filter, step) = (SolidState::default(), solid.step(dt_s));
        let power = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>();
        let out: Vec<f64> = noise.iter().map(|n| filter.pressure(&step, *n)).collect();
        prop_assert!(power(&out) <= power(&noise) * (1.0 + 1e-12));
    }
}

#[test]
fn a_hold_creeps_as_the_textbook_says_and_leaves_its_delayed_part() {
    let solid = Solid {
        delayed_ratio: 0.4,
        tau_s: 8.0,
        exponent: 1.0,
        unit_rise_mpa: 0.25,
    };
    let mut rubber = SolidState::default();
    assert_eq!(rubber.press(&solid.step(0.0), 0.05), 0.05);
    let held = rubber.press(&solid.step(12.0), 0.05);
    assert!((held - 0.05 * (1.0 + 0.4 * (1.0 - (-1.5_f64).exp()))).abs() < 1e-15);
    // Released at once, then left alone.
    let left = rubber.press(&solid.step(0.0), 0.0);
    assert!((left - 0.05 * 0.4 * (1.0 - (-1.5_f64).exp())).abs() < 1e-15);
    let later = rubber.press(&solid.step(16.0), 0.0);
    assert!((later / left - (-2.0_f64).exp()).abs() < 1e-12);
}

#[test]
fn the_exact_step_is_the_limit_of_small_ones() {
    // Against the differential equation itself, in small steps of the midpoint rule.
    let solid = Solid {
        delayed_ratio: 0.7,
        tau_s: 2.0,
        exponent: 1.0,
        unit_rise_mpa: 1.0,
    };
    for dt_s in [1e-3, 0.0199, 0.0201, 0.5, 7.0] {
        let mut exact = SolidState {
            pressure_mpa: 0.2,
            delayed_mpa: 0.05,
        };
        exact.press(&solid.step(dt_s), 0.9);
        let (n, mut q) = (20_000, 0.05);
        let small = dt_s / f64::from(n);
        for k in 0..n {
            let p = 0.2 + 0.7 * (f64::from(k) + 0.5) / f64::from(n);
            let slope = |q: f64| (0.7 * p - q) / 2.0;
            q += small * slope(q + 0.5 * small * slope(q));
        }
        assert!(
            (exact.delayed_mpa - q).abs() < 1e-8,
            "{dt_s}: {} {q}",
            exact.delayed_mpa
        );
    }
}

#[test]
fn nonsense_is_named() {
    let good = Solid {
        delayed_ratio: 0.3,
        tau_s: 5.0,
        exponent: 1.0,
        unit_rise_mpa: 0.25,
    };
    assert_eq!(good.check(), Ok(()));
    let bad = Solid { tau_s: 0.0, ..good };
    assert_eq!(
        bad.check().unwrap_err().to_string(),
        "tau_s is 0; give a positive number"
    );
    let bad = Solid {
        delayed_ratio: f64::NAN,
        ..good
    };
    assert!(bad.check().unwrap_err().to_string().contains("delayed_ratio"));
}
