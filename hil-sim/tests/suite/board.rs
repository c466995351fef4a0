//! A whole simulated board: real protocol bytes in simulated time.

use crate::common::{Bench, are_apart, disc, framed, frames};
use forward::{Drive, Pattern};
use hil_sim::{Electronics, FixedSheet, PERIOD_SAMPLES, Rubber, Scene, SimBoard, SimConfig, Touch, seconds};
use protocol::{Command, Frame, FromBoard, MAX_FROM_BOARD_LEN, Plan, ToBoard, Version, encode};

fn bench(seed: u64) -> Bench<FixedSheet> {
    let config = SimConfig {
        electronics: Electronics {
            seed,
            ..Electronics::default()
        },
        ..SimConfig::default()
    };
    Bench::new(config, FixedSheet(disc(16)))
}

#[test]
fn it_introduces_itself() {
    let said = bench(1).run(0.01);
    let [FromBoard::Hello(hello)] = &said[..] else {
        panic!("{said:?}")
    };
    assert_eq!(hello.version, Version::CURRENT);
    assert_eq!((hello.electrodes, hello.board.as_str()), (16, "skin-sim"));
    assert!((hello.excitation_hz() - 3684.21).abs() < 0.01);
    // 3.3 V over 4095 steps at a gain.
    let lsb = hello.volts_per_code(0).unwrap();
    let gain = f64::from(Electronics::default().gains_milli[0]) / 1000.0;
    assert!((lsb - 3.3 / 4095.0 / gain).abs() < 1e-9);
}

#[test]
fn the_fast_plan_runs_at_115_frames_a_second_without_loss() {
    let mut bench = bench(1);
    let list = bench.measured(2.0);
    // 32 periods a frame, exactly; the last is under way.
    let each = 32 * PERIOD_SAMPLES;
    assert!((list.len() as f64 - 2.0 / seconds(each)).abs() < 2.0, "{}", list.len());
    for (k, frame) in list.iter().enumerate() {
        assert_eq!(frame.sequence, k as u32);
    }
    are_apart(list.iter().map(|f| f.time), each);
    bench.send(&ToBoard::GetCounters);
    let counters = bench.run(0.02).into_iter().find_map(|m| match m {
        FromBoard::Counters(c) => Some(c),
        _ => None,
    });
    let c = counters.unwrap();
    assert_eq!(
        (c.dropped, c.overruns, c.front_end_faults, c.clipped, c.refused),
        (0, 0, 0, 0, 0)
    );
    assert!(c.frames >= list.len() as u32);
}

#[test]
fn the_papers_plan_takes_339_ms_a_frame() {
    let mut bench = bench(1);
    bench.send(&ToBoard::SetPlan(Plan::paper()));
    let list = bench.measured(2.0);
    let period_s = seconds(list[1].time - list[0].time);
    assert!((period_s - 0.339).abs() < 0.001, "{period_s}");
}

#[test]
fn more_than_the_link_carries_costs_frames_and_nothing_else() {
    // Quadrature doubles the values, and no settling doubles the frames: 230 frames/s of 860 bytes on 100,000 bytes/s.
    let mut bench = bench(1);
    let plan = Plan {
        settle_quarters: 0,
        quadrature: true,
        ..Plan::fast()
    };
    bench.send(&ToBoard::SetPlan(plan));
    let list = bench.measured(2.0);
    let size = |f: &Frame| {
        encode(&FromBoard::Frame(f.clone()), &mut [0; MAX_FROM_BOARD_LEN])
            .unwrap()
            .len()
    };
    let bytes: usize = list.iter().map(size).sum();
    assert!((195_000..=200_000).contains(&bytes), "{bytes}");
    let lost: u32 = list.windows(2).map(|w| w[1].sequence - w[0].sequence - 1).sum();
    assert!(lost > 150, "{lost}");
    // The scan kept its pace.
    let last = list.last().unwrap();
    let first = &list[0];
    let frames = u64::from(last.sequence - first.sequence);
    let source = 4 * PERIOD_SAMPLES;
    assert_eq!(last.time - first.time, frames * 16 * PERIOD_SAMPLES + source);
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_seed_others() {
    let run = |seed| {
        let mut bench = bench(seed);
        bench.send(&ToBoard::Start);
        bench.board.run(0.5)
    };
    assert_eq!(run(3), run(3));
    assert_ne!(run(3), run(4));
}

#[test]
fn it_stops_and_falls_silent() {
    let mut bench = bench(1);
    bench.measured(0.1);
    bench.send(&ToBoard::Stop);
    let said = bench.run(0.05);
    assert!(said.contains(&FromBoard::Ack(Command::Stop)));
    assert!(bench.board.is_idle());
    assert!(bench.run(0.5).is_empty());
}

#[test]
fn eight_electrodes_are_as_good_as_sixteen() {
    let mut bench = Bench::new(SimConfig::default(), FixedSheet(disc(8)));
    let list = bench.measured(0.2);
    assert_eq!(list[0].values.len(), 8 * 5);
    assert!(SimBoard::new(SimConfig::default(), FixedSheet(disc(33))).is_err());
}

/// Through the multiplexers and the one channel each value is that of its own drive and sense pair: the measured ones hold against
/// those of the sheet, noise and rounding averaged out.
#[test]
fn thirty_two_electrodes_are_measured_one_pair_after_the_other() {
    let sheet = disc(32);
    let mut bench = Bench::new(SimConfig::default(), FixedSheet(sheet.clone()));
    let hello = bench.board.hello();
    assert_eq!((hello.electrodes, hello.limits.channels), (32, 1));
    let frames = bench.measured(2.0);
    let plan = Plan::sparse(32).unwrap();
    let pairs = plan
        .measurements(32)
        .map(|(drive, sense)| [drive, sense].map(|p| [p.plus, p.minus].map(usize::from)));
    let pattern = Pattern::from_pairs(32, pairs).unwrap();
    let lsb = hello.volts_per_code(0).unwrap();
    let truth = Drive::PAPER.frame_v(&sheet, &pattern);
    let n = frames.len() as f64;
    for (k, truth) in truth.iter().enumerate() {
        let mean = frames.iter().map(|f| f.values[k].codes()).sum::<f64>() / n * lsb;
        // A quarter period leaves some of the switch's transient; neighbouring values differ by a tenth and more.
        assert!((mean - truth).abs() < 0.01 * truth.abs() + lsb, "{k}: {mean} {truth}");
    }
}

#[test]
fn a_touch_that_comes_changes_the_values_when_it_comes() {
    let scene = Scene {
        touches: vec![Touch::finger(&[(0.5, 20.0, 10.0), (0.8, 20.0, 10.0)], 25.0, 0.1)],
        ..Scene::empty()
    };
    let config = SimConfig {
        electronics: Electronics {
            noise_codes: 0.3,
            ..Electronics::default()
        },
        ..SimConfig::default()
    };
    let rubber = Rubber::new(&forward::Sheet::paper(), scene.clone()).unwrap();
    let mut bench = Bench::new(config, rubber);
    let list = bench.measured(1.2);
    let mean = |from: f64, to: f64| -> Vec<f64> {
        let some: Vec<_> = list.iter().filter(|f| (from..to).contains(&seconds(f.time))).collect();
        (0..208)
            .map(|k| some.iter().map(|f| f.values[k].codes()).sum::<f64>() / some.len() as f64)
            .collect()
    };
    let distance = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum::<f64>().sqrt() };
    let (before, during, after) = (mean(0.05, 0.35), mean(0.52, 0.78), mean(0.95, 1.2));
    let (change, rest) = (distance(&during, &before), distance(&after, &before));
    assert!(change > 10.0 * rest, "{change} {rest}");
    assert_eq!(bench.board.sheet().scene().truth(0.65).len(), 1);
}

#[test]
fn a_flood_of_commands_does_not_stop_the_scan() {
    let mut bench = bench(1);
    bench.measured(0.05);
    let flood = framed(&ToBoard::GetCounters).repeat(300);
    bench.board.receive(&flood);
    let said = bench.run(0.2);
    let answers = said.iter().filter(|m| matches!(m, FromBoard::Counters(_))).count();
    let list = frames(said);
    assert!(answers > 100, "{answers}");
    assert!(list.len() > 15, "{}", list.len());
    let last = list.last().unwrap();
    let n = u64::from(last.sequence - list[0].sequence);
    assert_eq!(last.time - list[0].time, n * 32 * PERIOD_SAMPLES);
}
