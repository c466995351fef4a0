//! The program of the board with sixteen channels on the emulated STM32H743, against the same firmware in process on the same
//! simulated electronics. `tests/boards.sh` builds the program and says where it is.

use crate::common::sixteen::{AWAKE_NS, Words, electronics, world};
use crate::common::{frames, hellos, program, sheet, touched};
use emulator::h743::chip::{INSTRUCTIONS_PER_SECOND, run_in};
use emulator::run::{Life, Outcome, Setup};
use firmware::settings::{self, Settings};
use firmware::{Excitation, Pace, Progress, Scan, Wiring};
use hil_sim::{Clock, FixedSheet, SimFrontEnd};
use protocol::{
    BoardError, Command, Frame, FromBoard, Outgoing, Plan, PlanError, Refusal, ResetCause, Sampling, Stored, ToBoard,
    Watch, Watching,
};

/// One period of the excitation, ns: 16 samples of 3392 ticks of 200 MHz.
const PERIOD_NS: f64 = 16.0 * 3392.0 / 0.2;

fn wiring() -> Wiring {
    Wiring {
        electrodes: 16,
        adc_bits: 16,
        in_turn: 8,
        skew_ticks: 200,
        ticks_per_sample: 3392,
    }
}

/// What the same firmware measures in process, the first sample of the first frame at a time.
fn in_process(plan: &Plan, first: u64, count: usize) -> Vec<Frame> {
    let clock = Clock::new();
    clock.advance(first - u64::from(plan.settle_quarters) * 4);
    let mut front = SimFrontEnd::new(electronics(), FixedSheet(sheet()), clock)
        .unwrap()
        .self_clocked();
    front.switch_on().unwrap();
    let mut scan = Scan::new();
    scan.wire(wiring());
    (0..count as u32)
        .map(|sequence| {
            scan.start(plan.recipe(), Pace::Ahead, 0, &mut front).unwrap();
            while nb::block!(scan.step(plan.recipe(), &mut front)).unwrap() != Progress::Complete {}
            let mut bytes = [0; protocol::MAX_FROM_BOARD_LEN];
            let frame = scan.frame(sequence, plan.id, plan.quadrature);
            let framed = protocol::encode(&Outgoing::Frame(frame), &mut bytes).unwrap();
            let mut decoder = protocol::Decoder::<{ protocol::MAX_FROM_BOARD_LEN }>::new();
            let mut out = None;
            decoder.push::<FromBoard>(framed, |m| out = Some(m.unwrap()));
            match out {
                Some(FromBoard::Frame(f)) => f,
                other => panic!("{other:?}"),
            }
        })
        .collect()
}

fn measured(plan: &Plan, count: usize, more: Vec<(u64, ToBoard)>, until_ns: u64) -> Outcome {
    let mut commands = vec![
        (AWAKE_NS, ToBoard::SetPlan(plan.clone())),
        (AWAKE_NS + 10_000_000, ToBoard::Start),
    ];
    commands.extend(more);
    let setup = Setup {
        commands,
        ..Setup::default()
    };
    run_in(&program("h743"), world(), setup, count, until_ns).unwrap()
}

#[test]
fn it_sends_the_frames_of_the_library_in_process_value_for_value() {
    let sequential = Plan {
        sampling: Sampling::Sequential,
        ..Plan::fast()
    };
    let quadrature = Plan {
        quadrature: true,
        ..Plan::fast()
    };
    for (plan, count) in [(Plan::fast(), 40), (quadrature, 20), (sequential, 2)] {
        let outcome = measured(&plan, count, Vec::new(), 2_000_000_000);
        let there = frames(&outcome);
        assert_eq!(there.len(), count, "{:?}", outcome.messages);
        assert_eq!((outcome.damaged, outcome.resets, outcome.without_break), (0, 0, 0));
        let here = in_process(&plan, there[0].time, count);
        for (here, there) in here.iter().zip(&there) {
            let same = here.values.iter().zip(&there.values).filter(|(a, b)| a == b).count();
            assert_eq!(here, there, "{same} of {} values alike", here.values.len());
        }
    }
}

#[test]
fn it_sends_115_frames_a_second_and_works_for_less_than_30_percent_of_the_time() {
    let plan = Plan::fast();
    let count = 60;
    let outcome = measured(&plan, count, Vec::new(), 2_000_000_000);
    let ends: Vec<u64> = outcome
        .messages
        .iter()
        .filter_map(|(at, m)| matches!(m, FromBoard::Frame(_)).then_some(*at))
        .collect();
    assert_eq!((ends.len(), outcome.damaged), (count, 0));
    let seconds = (ends[count - 1] - ends[0]) as f64 * 1e-9;
    let rate = (count - 1) as f64 / seconds;
    let work: u64 = outcome.work.iter().sum();
    // From the first command to the end.
    let share = work as f64 / (INSTRUCTIONS_PER_SECOND as f64 * seconds);
    let longest = outcome.work.iter().max().unwrap();
    let mut blocks = outcome.work.clone();
    blocks.sort_unstable();
    println!("median {} of {} blocks", blocks[blocks.len() / 2], blocks.len());
    println!(
        "{rate:.2} frames/s; {work} instructions of work, {:.1} %; longest {longest}",
        100.0 * share
    );
    // The light while it measures: a quarter of 2^28 cycles of 400 MHz on, and as long off.
    let [.., (on, _), (off, _)] = outcome.light[..] else {
        panic!("{:?}", outcome.light);
    };
    let light = (off - on) as f64 / INSTRUCTIONS_PER_SECOND as f64;
    println!("the light changes every {light:.4} s");
    assert!((light - 0.1678).abs() < 0.001, "{light}");
    // 32 periods of 3685.1 Hz; the source is looked at only every second.
    let theory = 1e9 / PERIOD_NS / 32.0;
    assert!((rate / theory - 1.0).abs() < 2e-4, "{rate} {theory}");
    assert!((115.0..115.3).contains(&rate), "{rate}");
    assert!(share < 0.3, "{share}");
    let sequence: Vec<u32> = frames(&outcome).iter().map(|f| f.sequence).collect();
    assert!(sequence.windows(2).all(|w| w[1] == w[0] + 1));
}

#[test]
fn plans_that_its_amplifiers_are_not_wired_for_are_refused_when_they_are_set() {
    let asked = |step, gain, sampling| {
        let mut plan = Plan {
            sampling,
            ..Plan::fast()
        };
        for slot in &mut plan.slots {
            (slot.sense_step, slot.gain) = (step, gain);
        }
        ToBoard::SetPlan(plan)
    };
    let at_once = Sampling::Simultaneous;
    let setup = Setup {
        commands: [
            asked(2, 0, at_once),
            asked(1, 1, at_once),
            asked(2, 1, Sampling::Sequential),
            asked(1, 0, at_once),
        ]
        .into_iter()
        .zip(1..)
        .map(|(command, k)| (AWAKE_NS + 5_000_000 * k, command))
        .collect(),
        ..Setup::default()
    };
    let outcome = run_in(&program("h743"), world(), setup, 1, AWAKE_NS + 30_000_000).unwrap();
    let refused = |step, gain| BoardError::Plan(PlanError::NotWired { slot: 0, step, gain });
    let answers: Vec<Result<(), BoardError>> = outcome
        .messages
        .into_iter()
        .filter_map(|(_, m)| match m {
            FromBoard::Error(e) => Some(Err(e)),
            FromBoard::Plan(_) => Some(Ok(())),
            _ => None,
        })
        .collect();
    assert_eq!(answers, [Err(refused(2, 0)), Err(refused(1, 1)), Ok(()), Ok(())]);
}

#[test]
fn planted_faults_of_routing_and_timing_are_found() {
    // What each must be found by; the emulation is the same to the last bit in every run.
    for (fault, expected) in [
        ("routing", "195 of 208 values alike"),
        ("break", "address lines changed under a closed switch"),
        // A window of seven quarter periods instead of eight, and periods that are a tick of 3392 short.
        ("settling", "0.8750 of its time"),
        ("timer", "0.9997 of its time"),
        // Its source is out of phase: it does not start.
        ("phase", "0 frames of 3"),
    ] {
        let found = faults(&format!("h743-fault-{fault}"));
        println!("{fault}: {found:?}");
        assert!(found.iter().any(|f| f.contains(expected)), "{fault}: {found:?}");
    }
    assert_eq!(faults("h743"), Vec::<String>::new());
}

/// What is wrong with a program's frames, if anything.
fn faults(name: &str) -> Vec<String> {
    let (plan, count) = (Plan::fast(), 3);
    let setup = Setup {
        commands: vec![
            (AWAKE_NS, ToBoard::SetPlan(plan.clone())),
            (AWAKE_NS + 10_000_000, ToBoard::Start),
        ],
        ..Setup::default()
    };
    let outcome = run_in(&program(name), world(), setup, count, AWAKE_NS + 100_000_000).unwrap();
    let mut found = Vec::new();
    let there = frames(&outcome);
    if there.len() != count {
        found.push(format!(
            "{} frames of {count}: {:?}",
            there.len(),
            outcome.messages.last()
        ));
    }
    if outcome.without_break > 0 {
        found.push("address lines changed under a closed switch".to_owned());
    }
    let ends = outcome
        .messages
        .iter()
        .filter(|(_, m)| matches!(m, FromBoard::Frame(_)));
    let ends: Vec<u64> = ends.map(|(at, _)| *at).collect();
    if let (&[first, .., last], [one, ..]) = (&ends[..], &there[..]) {
        let share = (last - first) as f64 / (count - 1) as f64 / (32.0 * PERIOD_NS);
        if (share - 1.0).abs() > 1e-4 {
            found.push(format!("a frame takes {share:.4} of its time"));
        }
        for (here, there) in in_process(&plan, one.time, count).iter().zip(&there) {
            let same = here.values.iter().zip(&there.values).filter(|(a, b)| a == b).count();
            if same < here.values.len() {
                found.push(format!("{same} of {} values alike", here.values.len()));
            }
        }
    }
    found
}

#[test]
fn a_program_that_hangs_is_restarted_by_the_watchdog() {
    // It hangs 0.34 s after its start, and its watchdog waits for 126 * 256 ticks of 32 kHz: 1.008 s.
    let outcome = run_in(&program("h743-fault-hang"), world(), Setup::default(), 1, 1_600_000_000).unwrap();
    let lives: Vec<(u64, ResetCause)> = outcome
        .messages
        .iter()
        .filter_map(|(at, m)| match m {
            FromBoard::Hello(h) => Some((*at, h.reset)),
            _ => None,
        })
        .collect();
    let causes: Vec<ResetCause> = lives.iter().map(|(_, cause)| *cause).collect();
    assert_eq!(
        causes,
        [ResetCause::PowerOn, ResetCause::Watchdog],
        "{:?}",
        outcome.messages
    );
    // The last feed is in the round before it hangs.
    let seconds = (lives[1].0 - lives[0].0) as f64 * 1e-9;
    println!("the second life begins {seconds:.3} s after the first");
    assert!((1.3..1.4).contains(&seconds), "{seconds}");
}

#[test]
fn it_says_who_it_is_and_passes_its_self_test() {
    let setup = Setup {
        commands: vec![(AWAKE_NS, ToBoard::Hello), (AWAKE_NS + 5_000_000, ToBoard::SelfTest)],
        ..Setup::default()
    };
    let outcome = run_in(&program("h743"), world(), setup, 1, 400_000_000).unwrap();
    let hello = hellos(&outcome)[0].clone();
    assert_eq!(
        (hello.board.as_str(), hello.reset),
        ("skin-stm32h743", ResetCause::PowerOn)
    );
    assert_eq!(
        (hello.adc_bits, hello.limits.channels, hello.limits.integrate_periods),
        (16, 16, 4095)
    );
    assert_eq!(hello.last_panic, "");
    let test = outcome.messages.iter().find_map(|(_, m)| match m {
        FromBoard::SelfTest(t) => Some(t.clone()),
        _ => None,
    });
    let test = test.unwrap_or_else(|| panic!("{:?}", outcome.messages));
    // The sheet of these tests is uneven on purpose.
    assert_eq!((test.failed, test.bent, test.suspect), (0, 0, 0), "{test:?}");
    assert!((985..=1015).contains(&test.source_permille), "{test:?}");
    println!("{} of {} bytes of stack used", outcome.stack, outcome.stack_size);
    assert!(outcome.stack + 1024 <= outcome.stack_size);
    assert!(outcome.gaps.is_empty(), "{:?}", outcome.gaps);
}

#[test]
fn stored_settings_that_its_amplifiers_are_not_wired_for_do_not_stop_its_start() {
    let not_wired = |plan: bool| {
        let mut settings = Settings {
            autostart: true,
            excitation_permille: 900,
            plan: Plan::fast(),
            watch: Some(Watch::paper()),
        };
        let watch = settings.watch.as_mut().unwrap();
        let slots = if plan {
            &mut settings.plan.slots[..]
        } else {
            &mut watch.slots[..]
        };
        slots[0].sense_step = 2;
        settings
    };
    for plan in [true, false] {
        let mut memory = Words::erased();
        settings::save(&mut memory, &not_wired(plan)).unwrap();
        let setup = Setup {
            flash: memory.placed(),
            commands: vec![(AWAKE_NS, ToBoard::GetStatus), (AWAKE_NS + 5_000_000, ToBoard::Start)],
            ..Setup::default()
        };
        let outcome = run_in(&program("h743"), world(), setup, 2, AWAKE_NS + 200_000_000).unwrap();
        let status = outcome.messages.iter().find_map(|(_, m)| match m {
            FromBoard::Status(s) => Some(*s),
            _ => None,
        });
        // It starts as it was made, says that what is stored cannot be used, and measures when it is told to.
        let status = status.unwrap();
        assert_eq!((status.stored, status.running), (Stored::Unusable, false), "{plan}");
        assert_eq!(
            (frames(&outcome).len(), outcome.resets),
            (2, 0),
            "{:?}",
            outcome.messages
        );
        let failed = outcome.messages.iter().any(|(_, m)| matches!(m, FromBoard::Error(_)));
        assert!(!failed, "{:?}", outcome.messages);
    }
}

#[test]
fn it_starts_from_what_it_stored_watches_and_wakes_within_30_percent_of_the_time() {
    let (contact, count) = (40_000, 40);
    let save = AWAKE_NS + 30_000_000;
    let setup = Setup {
        commands: vec![
            (AWAKE_NS, ToBoard::SetPlan(Plan::fast())),
            (AWAKE_NS + 10_000_000, ToBoard::SetWatch(Some(Watch::paper()))),
            (AWAKE_NS + 20_000_000, ToBoard::SetAutostart(true)),
            (save, ToBoard::SaveSettings),
        ],
        last: Some(FromBoard::Ack(Command::SaveSettings)),
        // What is asked for while it sleeps and while it is awake: only a board at rest saves.
        lives: vec![Life {
            commands: vec![
                (AWAKE_NS, ToBoard::GetStatus),
                (600_000_000, ToBoard::SaveSettings),
                (800_000_000, ToBoard::SaveSettings),
            ],
            ..Life::default()
        }],
        ..Setup::default()
    };
    let outcome = run_in(
        &program("h743"),
        world().touched_at(contact, touched()),
        setup,
        count,
        3_000_000_000,
    )
    .unwrap();
    assert_eq!(outcome.lived[0].steps, 5, "{:?}", outcome.lived);
    let status = outcome.messages.iter().find_map(|(_, m)| match m {
        FromBoard::Status(s) => Some((s.running, s.autostart, s.stored)),
        _ => None,
    });
    assert_eq!(status, Some((true, true, Stored::InForce)));
    let refused = outcome
        .messages
        .iter()
        .filter(|(_, m)| matches!(m, FromBoard::Error(_)));
    let busy = FromBoard::Error(BoardError::Refused(Refusal::Busy));
    let refused: Vec<&FromBoard> = refused.map(|(_, m)| m).collect();
    assert_eq!(refused, [&busy, &busy], "{:?}", outcome.messages);
    let mut states: Vec<Watching> = outcome
        .messages
        .iter()
        .filter_map(|(_, m)| match m {
            FromBoard::Heartbeat(h) => Some(h.state),
            _ => None,
        })
        .collect();
    states.dedup();
    assert_eq!(
        states,
        [Watching::Learning, Watching::Asleep, Watching::Awake],
        "{:?}",
        outcome.messages
    );
    let list = frames(&outcome);
    assert_eq!(list.len(), count);
    assert!(list.windows(2).all(|w| w[1].sequence == w[0].sequence + 1));
    let ends: Vec<u64> = outcome
        .messages
        .iter()
        .filter_map(|(at, m)| matches!(m, FromBoard::Frame(_)).then_some(*at))
        .collect();
    // Awake, the watch looks at every eighth frame besides. There is work on every period.
    let seconds = (ends[count - 1] - ends[0]) as f64 * 1e-9;
    let blocks = (seconds * 1e9 / PERIOD_NS).round() as usize;
    let work: u64 = outcome.work[outcome.work.len() - blocks..].iter().sum();
    let share = work as f64 / (INSTRUCTIONS_PER_SECOND as f64 * seconds);
    println!("awake: {:.1} % of the time", 100.0 * share);
    assert!(share < 0.3, "{share}");
    // A rest of 10 periods and a scan of two drives at most after the contact.
    let latest = contact + ((10.0 + 2.0 * 1.25 + 2.0) * 16.0) as u64;
    assert!(
        (contact..=latest).contains(&list[0].time),
        "{contact} {} {latest}",
        list[0].time
    );
}

/// A converter that overruns in the tenth frame is started again, with the source; and a request of the DAC is left over then,
/// which puts the sine a step of its table ahead.
fn restarted(name: &str, stale: bool) -> Vec<Frame> {
    let commands = vec![
        (AWAKE_NS, ToBoard::SetPlan(Plan::fast())),
        (AWAKE_NS + 10_000_000, ToBoard::Start),
    ];
    let run = |world, count| {
        let setup = Setup {
            commands: commands.clone(),
            ..Setup::default()
        };
        run_in(&program(name), world, setup, count, 1_000_000_000).unwrap()
    };
    let mut world = world();
    let at = frames(&run(self::world(), 1))[0].time + 9 * 512 + 8;
    world.overrun_at = Some(at);
    world.stale_request_at = stale.then_some(at);
    let outcome = run(world, 20);
    assert_eq!(outcome.resets, 0, "{:?}", outcome.messages);
    let after: Vec<Frame> = frames(&outcome).into_iter().filter(|f| f.time > at).collect();
    assert!(after.len() > 5, "{}", after.len());
    after
}

#[test]
fn after_a_restart_of_the_converters_the_values_are_what_they_were() {
    // As it is, and with a request left over.
    for stale in [false, true] {
        for there in restarted("h743", stale) {
            let here = &in_process(&Plan::fast(), there.time, 1)[0];
            // The noise is another one after a restart: some 0.2 codes a value. A step of the table is up to 128.
            for (a, b) in here.values.iter().zip(&there.values) {
                let difference = (a.sixteenths() - b.sixteenths()).abs();
                assert!(difference < 24, "{stale}: {difference} sixteenths of a code");
            }
        }
    }
    // Without the mend a request that is left over shifts the source, and the frames are some 8 % off.
    for there in restarted("h743-fault-request", true) {
        let here = &in_process(&Plan::fast(), there.time, 1)[0];
        let ratio = f64::from(there.values[5].sixteenths()) / f64::from(here.values[5].sixteenths());
        assert!((ratio - (std::f64::consts::TAU / 16.0).cos()).abs() < 0.02, "{ratio}");
    }
}

#[test]
fn front_end_clock_and_memory_keep_their_duties_on_the_chip() {
    // It has said everything within 0.2 s.
    let outcome = run_in(&program("h743-laws"), world(), Setup::default(), 1, 250_000_000).unwrap();
    let hellos = hellos(&outcome);
    assert_eq!(hellos.len(), 1, "{:?} {}", outcome.messages, outcome.resets);
    assert_eq!((hellos[0].board.as_str(), hellos[0].last_panic.as_str()), ("laws", ""));
    assert_eq!((outcome.resets, outcome.without_break), (0, 0));
    let said = outcome.messages.iter().map(|(at, _)| at / 1_000_000);
    println!(
        "{} of {} bytes of stack used; said after {:?} ms",
        outcome.stack,
        outcome.stack_size,
        said.collect::<Vec<_>>()
    );
}

#[test]
fn an_overrun_of_a_converter_costs_one_frame() {
    let commands = vec![
        (AWAKE_NS, ToBoard::SetPlan(Plan::fast())),
        (AWAKE_NS + 10_000_000, ToBoard::Start),
        (AWAKE_NS + 250_000_000, ToBoard::GetCounters),
    ];
    let run = |world, count| {
        let setup = Setup {
            commands: commands.clone(),
            ..Setup::default()
        };
        run_in(&program("h743"), world, setup, count, 1_000_000_000).unwrap()
    };
    // Half a period into the tenth frame: between two windows an overrun costs nothing.
    let mut world = world();
    world.overrun_at = Some(frames(&run(self::world(), 1))[0].time + 9 * 512 + 8);
    let outcome = run(world, 40);
    let sequence: Vec<u32> = frames(&outcome).iter().map(|f| f.sequence).collect();
    let gaps = sequence.windows(2).filter(|w| w[1] == w[0] + 2).count();
    assert_eq!((sequence.len(), gaps, outcome.resets), (40, 1, 0), "{sequence:?}");
    let counted = outcome.messages.iter().find_map(|(_, m)| match m {
        FromBoard::Counters(c) => Some((c.overruns, c.front_end_faults)),
        _ => None,
    });
    assert_eq!(counted, Some((1, 0)));
}
