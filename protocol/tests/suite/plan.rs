//! Plans: the order of their values, and what a board refuses.

use protocol::{Hello, Limits, Pair, Plan, PlanError, ResetCause, SCHEMA, Sampling, Slot, Version, text};

use std::collections::{BTreeSet, HashSet};

fn board(electrodes: u8) -> Hello {
    Hello {
        version: Version::CURRENT,
        schema: SCHEMA,
        git: text(""),
        firmware: text(""),
        board: text(""),
        serial: text(""),
        electrodes,
        samples_per_period: 16,
        timer_hz: 84_000_000,
        ticks_per_sample: 1425,
        adc_bits: 12,
        adc_span_uv: 3_300_000,
        excitation_uv: 2_250_000,
        gains_milli: [1000].into_iter().collect(),
        limits: Limits {
            slots: 32,
            values: 256,
            channels: 16,
            settle_quarters: 100,
            integrate_periods: 1000,
            amplitudes: 416,
            watch_slots: 8,
            watch_values: 48,
        },
        skew_ticks: 0,
        reset: ResetCause::Unknown,
        last_panic: text(""),
    }
}

#[test]
fn the_papers_plan_is_208_values_in_1248_periods() {
    let plan = Plan::paper();
    assert_eq!(plan.check(&board(16)), Ok(()));
    assert_eq!((plan.value_count(), plan.quarters()), (208, 4 * 1248));
    let list: Vec<_> = plan.measurements(16).collect();
    assert_eq!(list.len(), 208);
    let pair = |plus, minus| Pair { plus, minus };
    assert_eq!(list[0], (pair(0, 1), pair(3, 2)));
    assert_eq!(list[12], (pair(0, 1), pair(15, 14)));
    // The pair over the turn, (15, 0), touches neither electrode 1 nor 2 and has the highest number.
    assert_eq!(list[25], (pair(1, 2), pair(0, 15)));
    assert_eq!(list[207], (pair(15, 0), pair(14, 13)));
    for (drive, sense) in list {
        for e in [sense.plus, sense.minus] {
            assert!(e != drive.plus && e != drive.minus);
        }
    }
}

#[test]
fn the_fast_plan_is_the_same_values_in_32_periods() {
    let (fast, paper) = (Plan::fast(), Plan::paper());
    assert_eq!(fast.slots, paper.slots);
    assert_eq!(fast.quarters(), 4 * 32);
    assert_eq!(fast.sampling, Sampling::Simultaneous);
    assert_eq!(fast.check(&board(16)), Ok(()));
    let rate = board(16).excitation_hz() / (f64::from(fast.quarters()) / 4.0);
    assert!((rate - 115.1).abs() < 0.1, "{rate}");
}

/// Pairs of drive and sense that reciprocity joins, each once.
fn independent(plan: &Plan) -> BTreeSet<[(u8, u8); 2]> {
    let sorted = |p: Pair| (p.plus.min(p.minus), p.plus.max(p.minus));
    plan.measurements(16)
        .map(|(drive, sense)| {
            let mut both = [sorted(drive), sorted(sense)];
            both.sort_unstable();
            both
        })
        .collect()
}

#[test]
fn every_plan_takes_the_periods_that_physics_allows_it() {
    for (plan, values, quarters, known) in [
        (Plan::paper(), 208, 4 * 1248, 104),
        (Plan::sequential(), 208, 4 * 416, 104),
        (Plan::independent(), 104, 4 * 208, 104),
        (Plan::fast(), 208, 4 * 32, 104),
        (Plan::fastest(), 208, 4 * 20, 104),
        (Plan::fourteen(), 182, 70, 104),
        (Plan::with_drive_pairs(0), 224, 4 * 64, 120),
        (Plan::drive_pairs(16, 0), 16, 4 * 32, 16),
    ] {
        assert_eq!(plan.check(&board(16)), Ok(()));
        assert_eq!((plan.value_count(), plan.quarters()), (values, quarters), "{}", plan.id);
        assert_eq!(independent(&plan).len(), known, "{}", plan.id);
    }
    // Each pair of the independent plan comes once, and no 13 drives see all of them.
    assert_eq!(Plan::independent().measurements(16).count(), 104);
    let all = independent(&Plan::fast());
    for a in 0..16 {
        for b in 0..a {
            for c in 0..b {
                let mut plan = Plan::fast();
                let mut m = 0;
                plan.slots.retain(|_| {
                    m += 1;
                    ![a, b, c].contains(&(m - 1))
                });
                assert!(independent(&plan).len() < all.len());
            }
        }
    }
}

#[test]
fn any_list_of_pairs_is_a_plan() {
    // Pairs that nobody would think of, in an order that nobody would choose.
    let mut state = 12345u32;
    let mut random = |n: u32| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 16) % n
    };
    for _ in 0..1000 {
        let mut pair = || {
            let plus = random(16) as u8;
            let minus = (plus + 1 + random(15) as u8) % 16;
            Pair { plus, minus }
        };
        let list: Vec<(Pair, Pair)> = (0..32).map(|_| (pair(), pair())).collect();
        let plan = Plan {
            slots: list
                .iter()
                .map(|(drive, sense)| Slot {
                    drive: *drive,
                    sense_step: (16 + sense.plus - sense.minus) % 16,
                    sense: 1 << sense.minus,
                    gain: 0,
                })
                .collect(),
            ..Plan::fast()
        };
        assert_eq!(plan.check(&board(16)), Ok(()));
        assert!(plan.measurements(16).eq(list));
    }
}

#[test]
fn n_electrodes_give_n_times_n_less_3_values() {
    for n in 4..=17u8 {
        let plan = Plan::adjacent(n).unwrap();
        assert_eq!(plan.value_count(), usize::from(n) * usize::from(n - 3));
    }
    assert_eq!(Plan::adjacent(3), Err(PlanError::Empty));
    let too_many = PlanError::Values { given: 270, most: 256 };
    assert_eq!(Plan::adjacent(18), Err(too_many));
    assert!(Plan::adjacent(33).is_err());
}

#[test]
fn the_drive_pairs_own_voltage_is_a_value_like_any_other() {
    let mut plan = Plan::fast();
    for (m, slot) in plan.slots.iter_mut().enumerate() {
        slot.sense = 1 << m;
    }
    assert_eq!(plan.check(&board(16)), Ok(()));
    let (drive, sense) = plan.measurements(16).nth(15).unwrap();
    assert_eq!((drive.plus, drive.minus), (sense.minus, sense.plus));
}

#[test]
fn refusals_name_the_slot() {
    let b = board(16);
    let with = |change: fn(&mut Plan)| {
        let mut plan = Plan::fast();
        change(&mut plan);
        plan.check(&b)
    };
    assert_eq!(with(|p| p.slots.clear()), Err(PlanError::Empty));
    assert_eq!(
        with(|p| p.slots[5].drive.minus = 16),
        Err(PlanError::Electrode {
            slot: 5,
            electrode: 16,
            count: 16
        })
    );
    assert_eq!(
        with(|p| p.slots[5].sense |= 1 << 20),
        Err(PlanError::Electrode {
            slot: 5,
            electrode: 20,
            count: 16
        })
    );
    assert_eq!(
        with(|p| p.slots[2].drive = Pair { plus: 3, minus: 3 }),
        Err(PlanError::SameElectrode { slot: 2, electrode: 3 })
    );
    assert_eq!(
        with(|p| p.slots[1].sense_step = 16),
        Err(PlanError::SenseStep {
            slot: 1,
            step: 16,
            count: 16
        })
    );
    assert_eq!(with(|p| p.slots[15].sense = 0), Err(PlanError::NoSense { slot: 15 }));
    assert_eq!(
        with(|p| p.slots[0].gain = 1),
        Err(PlanError::Gain {
            slot: 0,
            gain: 1,
            count: 1
        })
    );
    assert_eq!(
        with(|p| p.integrate_periods = 0),
        Err(PlanError::Integrate { given: 0, most: 1000 })
    );
    assert_eq!(
        with(|p| p.settle_quarters = 101),
        Err(PlanError::Settle { given: 101, most: 100 })
    );
    assert_eq!(
        with(|p| p.slots.iter_mut().for_each(|s| *s = Slot {
            sense: 0xFFFF_FFFF,
            ..*s
        })),
        Err(PlanError::Electrode {
            slot: 0,
            electrode: 31,
            count: 16
        })
    );
    let mut narrow = board(16);
    narrow.limits.channels = 1;
    assert_eq!(Plan::paper().check(&narrow), Ok(()));
    assert_eq!(
        Plan::fast().check(&narrow),
        Err(PlanError::Channels { needed: 16, count: 1 })
    );
    narrow.limits.slots = 8;
    assert_eq!(
        Plan::paper().check(&narrow),
        Err(PlanError::Slots { given: 16, most: 8 })
    );
    let quadrature = Plan {
        quadrature: true,
        ..Plan::with_drive_pairs(0)
    };
    let needed = PlanError::Quadrature { needed: 448, most: 416 };
    assert_eq!(quadrature.check(&b), Err(needed));
    let message = Plan::fast().check(&narrow).unwrap_err().to_string();
    assert!(message.contains("16") && message.contains('8'), "{message}");
}

#[test]
fn the_sparse_plan_fits_a_frame_on_every_board_and_measures_no_value_twice() {
    for electrodes in 4..=32 {
        let plan = Plan::sparse(electrodes).unwrap();
        let mut one_channel = board(electrodes);
        one_channel.limits.channels = 1;
        assert_eq!(plan.check(&one_channel), Ok(()), "{electrodes}");
        let list: HashSet<(Pair, Pair)> = plan.measurements(electrodes).collect();
        assert_eq!(list.len(), plan.value_count(), "{electrodes}");
        for (drive, sense) in &list {
            for e in [sense.plus, sense.minus] {
                assert!(e != drive.plus && e != drive.minus, "{electrodes}");
            }
        }
        // Every electrode is sensed as often as any other.
        let count = |e: u8| list.iter().filter(|(_, s)| s.plus == e || s.minus == e).count();
        assert!((0..electrodes).all(|e| count(e) == count(0)), "{electrodes}");
        // The nearest pairs and those at half the rim are measured both ways: more than the scales of all drives, which they
        // have to tell first.
        let turned = |p: Pair| Pair {
            plus: p.minus,
            minus: p.plus,
        };
        let joined = list.iter().filter(|(d, s)| list.contains(&(turned(*s), turned(*d))));
        let pairs = joined.count() / 2;
        let even = electrodes % 2 == 0;
        let expected = usize::from(electrodes) + if even { usize::from(electrodes / 2) } else { 0 };
        if electrodes > 17 {
            assert_eq!(pairs, expected, "{electrodes}");
        } else {
            assert_eq!(2 * pairs, plan.value_count(), "{electrodes}");
        }
    }
    let plan = Plan::sparse(32).unwrap();
    assert_eq!((plan.value_count(), plan.quarters()), (256, 4 * 320));
    let slots = |plan: Plan| plan.slots;
    assert_eq!(slots(Plan::sparse(17).unwrap()), slots(Plan::adjacent(17).unwrap()));
    assert!(Plan::sparse(33).is_err() && Plan::sparse(3).is_err());
}
