//! Which touches the watch sees: its visibility by the forward model, all over the sheet.

use crate::common::visibility::{Bench, least};
use hil_sim::Electronics;
use protocol::{Plan, Watch};

#[test]
fn the_watch_sees_a_touch_anywhere_nearly_as_well_as_the_whole_plan() {
    for (name, electronics) in [
        ("sixteen_channels", Electronics::default()),
        ("drawn_sixteen", Electronics::drawn_sixteen()),
    ] {
        sees_nearly_all(name, &Bench::new(&electronics));
    }
}

fn sees_nearly_all(name: &str, bench: &Bench) {
    let (watch, plan) = (Watch::paper(), Plan::fastest());
    let (few, all) = (bench.visibility(watch.recipe()), bench.visibility(plan.recipe()));
    println!(
        "{name}: least visible touch of 25 N, in noise: watch {:.0}, whole plan {:.0}; medians {:.0}, {:.0}",
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
    for electronics in [Electronics::default(), Electronics::drawn_sixteen()] {
        let bench = Bench::new(&electronics);
        for codes in bench.resting_codes(&Bench::pattern(Watch::paper().recipe().measurements(16))) {
            assert!(codes > 200.0 && codes < 0.9 * 2047.5, "{codes}");
        }
    }
}

#[test]
fn the_sequential_watch_sees_a_touch_anywhere_better_than_all_neighbouring_pairs() {
    // The drawn board has a tenth less of it: its converter's noise and its switches are larger.
    for (name, electronics, times) in [
        ("sixteen_channels", Electronics::default(), 25.0),
        ("drawn_board", Electronics::drawn_board(), 20.0),
    ] {
        sees_better(name, &Bench::new(&electronics), times);
    }
}

/// The least visible touch is so many times the threshold.
fn sees_better(name: &str, bench: &Bench, times: f64) {
    let (watch, plan) = (Watch::sequential(), Plan::sequential());
    let (few, all) = (bench.visibility(watch.recipe()), bench.visibility(plan.recipe()));
    println!(
        "{name}: least visible touch of 25 N, in noise: sequential watch {:.0}, whole plan {:.0}; medians {:.0}, {:.0}",
        least(&few),
        least(&all),
        median(&few),
        median(&all)
    );
    assert!(least(&few) > least(&all), "{} {}", least(&few), least(&all));
    // Eight values in the time of eight of the plan's 208.
    assert_eq!((watch.recipe().value_count(), watch.recipe().quarters()), (8, 40));
    let values = watch.recipe().value_count() as f64;
    let threshold = ((f64::from(watch.threshold) / 256.0 - 1.0) * values).sqrt();
    assert!(least(&few) > times * threshold, "{} {threshold}", least(&few));
    for codes in bench.resting_codes(&Bench::pattern(watch.recipe().measurements(16))) {
        assert!(codes.abs() < 0.9 * 2047.5, "{codes}");
    }
    // Turned by two electrodes it is itself, and half of it is half blind.
    let mut half = watch.clone();
    half.slots.truncate(4);
    assert!(least(&bench.visibility(half.recipe())) < 0.75 * least(&few));
}
