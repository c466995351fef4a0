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
