//! What the board does about faults of its own, of its source and of the line.

use crate::common::{Bench, are_apart, disc};
use firmware::settings::{self, Settings};
use hil_sim::{Electronics, Fault, FixedSheet, Flash, SimConfig};
use protocol::{BoardError, Frame, FrameError, FromBoard, Notice, Plan, ResetCause, Status, Stored, ToBoard, Watch};

fn notices(said: &[FromBoard]) -> Vec<Notice> {
    let notice = |m: &FromBoard| match m {
        FromBoard::Notice(n) => Some(*n),
        _ => None,
    };
    said.iter().filter_map(notice).collect()
}

fn frames(said: &[FromBoard]) -> Vec<&Frame> {
    let mut out = Vec::new();
    for message in said {
        if let FromBoard::Frame(frame) = message {
            out.push(frame);
        }
    }
    out
}

/// A board with stored settings that make it start by itself.
fn life(reset: ResetCause, scratch: u32) -> Bench<FixedSheet> {
    let mut flash = Flash::new(2048);
    let stored = Settings {
        autostart: true,
        excitation_permille: 700,
        plan: Plan::fourteen(),
        watch: None,
    };
    settings::save(&mut flash, &stored).unwrap();
    let config = SimConfig {
        flash: Some(flash),
        reset,
        scratch,
        ..SimConfig::default()
    };
    Bench::new(config, FixedSheet(disc(16)))
}

/// What is noticed at its start and whether it measures then; its status with what is noticed before it.
fn beginning(bench: &mut Bench<FixedSheet>) -> (Vec<Notice>, bool, Status) {
    let said = bench.run(0.1);
    bench.send(&ToBoard::GetStatus);
    let asked = bench.run(0.05);
    let status = asked.iter().find_map(|m| match m {
        FromBoard::Status(s) => Some(*s),
        _ => None,
    });
    assert_eq!(notices(&said), notices(&asked));
    (notices(&said), !frames(&said).is_empty(), status.unwrap())
}

#[test]
fn resets_by_faults_of_its_own_make_it_careful_until_it_has_measured_for_half_a_minute() {
    use ResetCause::{BrownOut, Panic, Pin, PowerOn, Watchdog};
    let mut scratch = 0xDEAD_BEEF;
    for (reset, resets) in [
        (PowerOn, 0),
        (Watchdog, 1),
        (Panic, 2),
        (BrownOut, 2),
        (Watchdog, 3),
        (Panic, 4),
    ] {
        let mut bench = life(reset, scratch);
        let (said, measures, status) = beginning(&mut bench);
        let settings = resets < 3;
        let careful = (resets > 0).then_some(Notice::Careful { resets, settings });
        assert_eq!(said, Vec::from_iter(careful), "{reset:?}");
        assert_eq!((measures, status.running), (resets == 0, resets == 0), "{reset:?}");
        let in_force = if settings {
            (700, Stored::InForce)
        } else {
            (1000, Stored::Unread)
        };
        assert_eq!((status.excitation_permille, status.stored), in_force, "{reset:?}");
        scratch = bench.board.scratch();
    }
    // What somebody does to it clears the count.
    for reset in [PowerOn, Pin] {
        assert!(beginning(&mut life(reset, scratch)).1);
    }
    // So does measuring, of half a minute without a stop.
    let mut bench = life(Watchdog, scratch);
    bench.send(&ToBoard::Start);
    let measured = |bench: &mut Bench<FixedSheet>, seconds| (0..seconds).for_each(|_| drop(bench.run(1.0)));
    measured(&mut bench, 20);
    bench.send(&ToBoard::Stop);
    bench.run(0.1);
    bench.send(&ToBoard::Start);
    measured(&mut bench, 29);
    let kept = bench.board.scratch();
    assert_eq!(beginning(&mut life(Watchdog, kept)).0.len(), 1);
    measured(&mut bench, 3);
    let (said, ..) = beginning(&mut life(Watchdog, bench.board.scratch()));
    let careful = Notice::Careful {
        resets: 1,
        settings: true,
    };
    assert_eq!(said, [careful]);
    assert_ne!(kept, bench.board.scratch());
}

#[test]
fn a_board_that_sleeps_lives_a_good_life_too() {
    let mut bench = life(ResetCause::Watchdog, 0);
    bench.send(&ToBoard::SetWatch(Some(Watch::paper())));
    bench.send(&ToBoard::Start);
    let before = bench.board.scratch();
    (0..32).for_each(|_| drop(bench.run(1.0)));
    assert_ne!(before, bench.board.scratch());
}

/// What a listener gets: when the frame before it was measured, s.
fn told(bench: &mut Bench<FixedSheet>, seconds: u32) -> (Vec<(f64, Notice)>, Vec<Frame>) {
    let (mut out, mut all, mut now_s) = (Vec::new(), Vec::new(), 0.0);
    for _ in 0..seconds * 10 {
        for message in bench.run(0.1) {
            match message {
                FromBoard::Notice(n) => out.push((now_s, n)),
                FromBoard::Frame(f) => {
                    now_s = f.time as f64 * 1425.0 / 84e6;
                    all.push(f);
                }
                _ => {}
            }
        }
    }
    (out, all)
}

fn started(electronics: Electronics, faults: &[&str], permille: u16, plan: Plan) -> Bench<FixedSheet> {
    let config = SimConfig {
        electronics,
        faults: faults.iter().map(|f| f.parse().unwrap()).collect::<Vec<Fault>>(),
        ..SimConfig::default()
    };
    let mut bench = Bench::new(config, FixedSheet(disc(16)));
    bench.send(&ToBoard::SetPlan(plan));
    bench.send(&ToBoard::SetExcitation(permille));
    bench.send(&ToBoard::Start);
    bench
}

#[test]
fn a_source_that_sags_is_told_every_second_and_that_it_is_right_again() {
    for (electronics, plan) in [
        (Electronics::default(), Plan::fast()),
        (Electronics::drawn_board(), Plan::sequential_fast()),
    ] {
        for part in [0.97, 0.7, 0.0] {
            let sag = format!("source_sags:{part}@2+3");
            let mut bench = started(electronics.clone(), &[&sag], 800, plan.clone());
            let (list, frames) = told(&mut bench, 8);
            let off = list
                .iter()
                .filter(|(_, n)| matches!(n, Notice::Source { right: false, .. }));
            assert_eq!((off.count(), list.len()), (3, 4), "{list:?}");
            for (at, (time_s, notice)) in list.iter().enumerate() {
                let Notice::Source {
                    permille,
                    began_permille,
                    right,
                } = *notice
                else {
                    panic!("{list:?}")
                };
                let frame_s = 0.1;
                let seconds = at as f64 + 2.0;
                assert!((seconds..=seconds + 1.0 + frame_s).contains(time_s), "{list:?}");
                assert_eq!(right, at == 3, "{list:?}");
                let now = 800.0 * if right { 1.0 } else { part };
                // Rounding, and the parts' tolerance, which are the same all the time.
                assert!((f64::from(began_permille) - 800.0).abs() < 12.0, "{list:?}");
                assert!((f64::from(permille) - now).abs() < 12.0, "{list:?}");
            }
            // No frame is lost by it.
            assert!(frames.windows(2).all(|w| w[1].sequence == w[0].sequence + 1));
        }
    }
}

#[test]
fn a_good_source_is_never_told_and_costs_four_periods_a_second() {
    for (electronics, plan) in [
        (Electronics::default(), Plan::fast()),
        (Electronics::drawn_board(), Plan::sequential_fast()),
    ] {
        let frame_samples = u64::from(plan.quarters()) * 4;
        for (permille, faults) in [(1000, &[][..]), (100, &[]), (1000, &["source_sags:0.99@1"])] {
            let mut bench = started(electronics.clone(), faults, permille, plan.clone());
            let (list, frames) = told(&mut bench, 10);
            assert_eq!(list, [], "{permille}");
            let checks = are_apart(frames.iter().map(|f| f.time), frame_samples);
            assert!((9..=10).contains(&checks), "{checks}");
        }
    }
}

#[test]
fn noise_on_the_line_takes_no_frame_and_is_counted() {
    // What answers most: an empty message at every second byte. And bytes of which some end a message.
    let mut state = 1u32;
    let mut any = move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    let worst: Vec<u8> = [1, 0].repeat(500);
    let random: Vec<u8> = (0..999).map(|_| any()).chain([0]).collect();
    for (name, noise) in [("1, 0", worst), ("random", random)] {
        let mut bench = Bench::new(SimConfig::default(), FixedSheet(disc(16)));
        // 85 % of the line are frames.
        bench.send(&ToBoard::SetPlan(Plan::fastest()));
        bench.send(&ToBoard::Start);
        bench.run(0.1);
        let seconds = 4;
        let mut said = Vec::new();
        // All that the line carries, 1000 bytes in 10 ms.
        for _ in 0..100 * seconds {
            bench.board.receive(&noise);
            said.extend(bench.run(0.01));
        }
        said.extend(bench.run(1.5));
        let frames = frames(&said);
        assert!(frames.windows(2).all(|w| w[1].sequence == w[0].sequence + 1), "{name}");
        assert!(frames.len() > 184 * seconds, "{name}: {}", frames.len());
        let refused = |m: &&FromBoard| matches!(m, FromBoard::Error(BoardError::Command(_)));
        let answered = said.iter().filter(refused).count();
        let passed: Vec<u32> = notices(&said)
            .iter()
            .map(|n| match n {
                Notice::PassedOver { count } => *count,
                other => panic!("{other:?}"),
            })
            .collect();
        // Nine a second, each of 12 bytes at most: a thousandth of the line.
        assert!(
            answered + passed.len() <= 9 * (seconds + 1),
            "{name}: {answered} {passed:?}"
        );
        // All of it is told, and counted.
        let counters = bench.board.counters().clone();
        let told = answered as u32 + passed.iter().sum::<u32>();
        println!(
            "{name}: {} messages a second that cannot be read, {answered} answered in {seconds} s, {passed:?} passed over; {} frames",
            told / seconds as u32,
            frames.len()
        );
        assert_eq!(
            (counters.refused, counters.dropped, counters.overruns),
            (told, 0, 0),
            "{name}"
        );
        assert!(told > 500, "{name}");
        // A single one is answered as ever.
        bench.board.receive(&[5, 1, 2, 3, 4, 0]);
        let answer = FromBoard::Error(BoardError::Command(FrameError::Short));
        assert!(bench.run(0.05).contains(&answer), "{name}");
    }
}
