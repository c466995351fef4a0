//! The times that physics allows, reached to the sample.

use crate::common::{Bench, are_apart, disc};
use hil_sim::{Electronics, FixedSheet, SimConfig, TICKS_PER_SAMPLE, TIMER_HZ};
use protocol::{FromBoard, Plan, ToBoard, Value};

#[test]
fn every_plan_takes_its_time_to_the_timers_tick() {
    for (plan, periods, ms) in [
        (Plan::paper(), 1248.0, 339.0),
        (Plan::sequential(), 416.0, 113.0),
        (Plan::independent(), 208.0, 56.0),
        (Plan::fast(), 32.0, 8.7),
        (Plan::fastest(), 20.0, 5.4),
        (Plan::fourteen(), 17.5, 4.75),
        (Plan::with_drive_pairs(1), 64.0, 17.4),
        // The limit: 14 drives and no settling at all.
        (
            Plan {
                settle_quarters: 0,
                ..Plan::fourteen()
            },
            14.0,
            3.8,
        ),
    ] {
        let mut bench = Bench::new(SimConfig::default(), FixedSheet(disc(16)));
        bench.send(&ToBoard::SetPlan(plan.clone()));
        let list = bench.measured(ms * 4.2e-3 + 0.05);
        assert!(list.len() >= 4, "{}", list.len());
        // 84 MHz / 1425 a sample, 16 samples a period: 22,800 ticks a period.
        let ticks = (periods * 22_800.0) as u64;
        are_apart(list.iter().map(|f| f.time), ticks / u64::from(TICKS_PER_SAMPLE));
        assert!(list.windows(2).all(|w| w[1].sequence == w[0].sequence + 1));
        let time_ms = 1e3 * ticks as f64 / f64::from(TIMER_HZ);
        assert!((time_ms / ms - 1.0).abs() < 0.012, "{time_ms} {ms}");
        assert_eq!(list[0].values.len(), plan.value_count());
        assert_eq!(list[0].noise.len(), plan.slots.len());
    }
}

#[test]
fn the_fastest_plan_streams_for_ten_seconds_without_a_loss() {
    let config = SimConfig {
        plan: Some(Plan::fastest()),
        ..SimConfig::default()
    };
    let mut bench = Bench::new(config, FixedSheet(disc(16)));
    let list = bench.measured(10.0);
    assert!((1838..=1843).contains(&list.len()), "{}", list.len());
    assert!(list.windows(2).all(|w| w[1].sequence == w[0].sequence + 1));
    bench.send(&ToBoard::GetCounters);
    let said = bench.run(0.05);
    let counters = said.iter().find_map(|m| match m {
        FromBoard::Counters(c) => Some(c),
        _ => None,
    });
    let counters = counters.unwrap();
    assert_eq!((counters.dropped, counters.overruns, counters.clipped), (0, 0, 0));
}

#[test]
fn all_ways_of_measuring_agree_and_the_skew_of_channels_is_gone() {
    // One value after the other knows no skew; all at once has up to 21 degrees of it.
    let mean = |plan: Plan, skew_ticks| {
        let config = SimConfig {
            electronics: Electronics {
                skew_ticks,
                ..Electronics::default()
            },
            plan: Some(Plan {
                integrate_periods: 32,
                settle_quarters: 4,
                quadrature: true,
                ..plan
            }),
            ..SimConfig::default()
        };
        let list = Bench::new(config, FixedSheet(disc(16))).measured(4.0);
        list.into_iter().next_back().unwrap()
    };
    let (one, all, ideal) = (
        mean(Plan::sequential(), 60),
        mean(Plan::fast(), 60),
        mean(Plan::fast(), 0),
    );
    // Noise of 512 samples, both sides, and rounding: five standard deviations.
    let noise = (0.365f64.powi(2) + 1.0 / 12.0) * 2.0 / 512.0;
    let bound = 5.0 * (2.0 * noise).sqrt() + 1.0 / f64::from(Value::PER_CODE);
    for k in 0..208 {
        let reference = ideal.values[k].codes();
        for frame in [&one, &all] {
            assert!((frame.values[k].codes() - reference).abs() < bound, "{k}");
            assert!(
                frame.quadrature[k].codes().abs() < bound,
                "{k}: {}",
                frame.quadrature[k].codes()
            );
        }
    }
    // Left in, it would cost the last channels of each drive up to 7 %.
    let lost = 1.0 - (std::f64::consts::TAU / 16.0 * 15.0 * 60.0 / 1425.0).cos();
    assert!(lost > 0.03);
}

/// A board with two converters of 16 bits side by side measures the same volts as one of 12 bits that takes all channels in
/// turn, to what 12 bits cannot show; and codes, noise and self-test are told in the same units.
#[test]
fn sixteen_bits_and_two_converters_measure_the_same_volts() {
    let measured = |adc_bits, in_turn, skew_ticks| {
        let config = SimConfig {
            electronics: Electronics {
                adc_bits,
                in_turn,
                skew_ticks,
                ..Electronics::default()
            },
            plan: Some(Plan {
                integrate_periods: 32,
                settle_quarters: 4,
                quadrature: true,
                ..Plan::fast()
            }),
            ..SimConfig::default()
        };
        let mut bench = Bench::new(config, FixedSheet(disc(16)));
        bench.send(&ToBoard::Hello);
        let said = bench.run(0.05);
        let hello = said.iter().find_map(|m| match m {
            FromBoard::Hello(h) => Some(h.clone()),
            _ => None,
        });
        (hello.unwrap(), bench.measured(2.0).into_iter().next_back().unwrap())
    };
    let ((narrow, coarse), (wide, fine)) = (measured(12, 16, 60), measured(16, 8, 84));
    assert_eq!((narrow.adc_bits, wide.adc_bits), (12, 16));
    assert_eq!(
        (narrow.limits.integrate_periods, wide.limits.integrate_periods),
        (u16::MAX, 4095)
    );
    // A value's unit is the range's 65,536th, but for the one that is missing at its end.
    let unit_v = |hello: &protocol::Hello| hello.volts_per_code(0).unwrap() / 16.0;
    assert!((unit_v(&wide) / unit_v(&narrow) - 65_520.0 / 65_535.0).abs() < 1e-12);
    // As above, with 512 samples of each.
    let noise = (0.365f64.powi(2) + 1.0 / 12.0) * 2.0 / 512.0;
    let bound = (5.0 * (2.0 * noise).sqrt() + 1.0 / 16.0) * narrow.volts_per_code(0).unwrap();
    for k in 0..208 {
        let volts = |hello: &protocol::Hello, v: Value| v.codes() * hello.volts_per_code(0).unwrap();
        assert!(
            (volts(&wide, fine.values[k]) - volts(&narrow, coarse.values[k])).abs() < bound,
            "{k}"
        );
        assert!(
            fine.quadrature[k].codes().abs() * wide.volts_per_code(0).unwrap() < bound,
            "{k}"
        );
    }
    // The noise lacks the rounding to 12 bits: 0.365^2 and 1 / 12, less 1 / 12.
    let mean = |f: &protocol::Frame| f.noise.iter().map(|v| v.codes2()).sum::<f64>() / f.noise.len() as f64;
    let ratio = mean(&fine) / mean(&coarse);
    let expected = 0.365f64.powi(2) / (0.365f64.powi(2) + 1.0 / 12.0);
    // Variances are cut by up to an eighth.
    assert!((ratio / expected - 1.0).abs() < 0.13, "{ratio} {expected}");
}
