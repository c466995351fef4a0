//! The board's programs on the emulated chip, against the same firmware in process on the same simulated electronics.
//! `tests/boards.sh` builds the programs and says where they are.

use crate::common::{AWAKE_NS, frames, hellos, in_process, in_process_with, program, sheet};
use emulator::run::{Outcome, Setup, run, run_in};
use emulator::world::World;
use hil_sim::Electronics;
use protocol::{FromBoard, Plan, ResetCause, Sampling, ToBoard};

/// Instructions that the work on a block may take: a twentieth of the cycles of one period at 168 MHz, which is the
/// time between blocks when nothing settles, at 1.4 cycles an instruction.
const BUDGET: u64 = (0.05 * 16.0 * 2850.0 / 1.4) as u64;

fn start(name: &str, plan: &Plan, frames: usize, until_ns: u64) -> Outcome {
    let commands = vec![
        (AWAKE_NS, ToBoard::SetPlan(plan.clone())),
        (AWAKE_NS + 10_000_000, ToBoard::Start),
    ];
    run(
        &program(name),
        Electronics::drawn_board(),
        sheet(),
        commands,
        frames,
        until_ns,
    )
    .unwrap()
}

fn plans() -> [Plan; 2] {
    let settled = Plan {
        sampling: Sampling::Sequential,
        quadrature: true,
        ..Plan::fast()
    };
    [settled, Plan::paper()]
}

/// What is wrong with a program's frames, if anything: everything that a planted fault can be found by.
fn faults(name: &str, plan: &Plan) -> Vec<String> {
    let count = 3;
    let period_ns = 16.0 * 1425.0 / 84e-3;
    let until = AWAKE_NS + ((count as f64 + 1.5) * f64::from(plan.quarters()) / 4.0 * period_ns) as u64 + 100_000_000;
    let outcome = start(name, plan, count, until);
    let mut found = Vec::new();
    let mut expect = |ok: bool, what: String| {
        if !ok {
            found.push(what);
        }
    };
    let there = frames(&outcome);
    expect(
        there.len() == count,
        format!("{} frames of {count}: {:?}", there.len(), outcome.messages.last()),
    );
    expect(outcome.damaged == 0, format!("{} damaged messages", outcome.damaged));
    expect(outcome.resets == 0, format!("{} resets", outcome.resets));
    expect(
        outcome.without_break == 0,
        format!("{} address lines changed under a closed switch", outcome.without_break),
    );
    // The first trigger came when the board was up, some milliseconds after power.
    let rate = outcome.triggers as f64 / outcome.end_ns as f64 * 1425.0 / 84e-3;
    expect(
        (0.99..=1.0).contains(&rate),
        format!("samples at {rate:.4} of their rate"),
    );
    if let (Some(first), Some(last)) = (there.first(), there.last()) {
        let (a, b) = (&outcome.messages, plan.quarters());
        let at = |sequence| {
            let found = a
                .iter()
                .find(|(_, m)| matches!(m, FromBoard::Frame(f) if f.sequence == sequence));
            found.map_or(0, |(at, _)| *at)
        };
        let (ns, frames) = (at(last.sequence) - at(first.sequence), last.sequence - first.sequence);
        let expected = f64::from(frames) * f64::from(b) / 4.0 * period_ns;
        expect(
            (ns as f64 / expected - 1.0).abs() < 4e-4,
            format!("{frames} frames took {ns} ns, not {expected:.0}"),
        );
        // Without settling the first value of all still shows what was connected before the start, which differs.
        let comparable = usize::from(plan.settle_quarters == 0);
        for (here, there) in in_process(plan, first.time, count).iter().zip(&there).skip(comparable) {
            let same = here.values.iter().zip(&there.values).filter(|(a, b)| a == b).count();
            expect(
                here == there,
                format!(
                    "frame {}: {same} of {} values alike, time {} and {}",
                    there.sequence,
                    here.values.len(),
                    here.time,
                    there.time
                ),
            );
        }
    }
    found
}

#[test]
fn every_chips_program_measures_what_the_firmware_measures_in_process_value_for_value() {
    // The last speaks over the Nucleo's own serial port.
    for name in ["f446", "f427", "f405", "st-link"] {
        for plan in plans() {
            assert_eq!(faults(name, &plan), Vec::<String>::new(), "{name}, {:?}", plan.id);
        }
    }
}

/// The ideal electronics with the drawn circuit's gains: without noise and transients every frame is the one before.
#[test]
fn on_ideal_electronics_it_measures_the_same_again_and_again() {
    let drawn = Electronics::drawn_board();
    let ideal = Electronics {
        one_channel: true,
        source_gain_milli: drawn.source_gain_milli,
        gains_milli: drawn.gains_milli,
        skew_ticks: drawn.skew_ticks,
        ..Electronics::ideal()
    };
    let [plan, _] = plans();
    let commands = vec![
        (AWAKE_NS, ToBoard::SetPlan(plan.clone())),
        (AWAKE_NS + 10_000_000, ToBoard::Start),
    ];
    let outcome = run(&program("f446"), ideal.clone(), sheet(), commands, 2, 1_000_000_000).unwrap();
    let there = frames(&outcome);
    assert_eq!(there, in_process_with(ideal, sheet(), &plan, there[0].time, 2));
    assert_eq!(there[0].values, there[1].values);
    let drawn = in_process(&plan, there[0].time, 2);
    assert_ne!(drawn[0].values, drawn[1].values);
}

#[test]
fn planted_faults_of_routing_and_timing_are_found() {
    let [plan, _] = plans();
    // What each must be found by; the emulation is the same to the last bit in every run.
    for (name, expected) in [
        ("fault-routing", "frame 1: 195 of 208 values alike"),
        ("fault-break", "address lines changed under a closed switch"),
        // A window of seven quarter periods instead of eight.
        ("fault-settling", "2 frames took 197"),
        ("fault-timer", "2 frames took 2256"),
        // Its source is out of phase: it does not start.
        ("fault-phase", "0 frames of 3"),
    ] {
        let found = faults(name, &plan);
        println!("{name}: {found:?}");
        assert!(found.iter().any(|f| f.contains(expected)), "{name}: {found:?}");
    }
}

#[test]
fn the_work_on_a_block_takes_under_a_twentieth_of_its_time() {
    let [settled, paper] = plans();
    for (plan, name) in [(settled, "with settling"), (paper, "without")] {
        let mut work = start("f446", &plan, 2, 2_000_000_000).work;
        work.sort_unstable();
        let (median, longest) = (work[work.len() / 2], work[work.len() - 1]);
        let mean = work.iter().sum::<u64>() / work.len() as u64;
        println!(
            "{name}: {} blocks, {median} instructions, {mean} with all else, {longest} at the end of a frame",
            work.len()
        );
        assert!(median <= BUDGET, "{median} of {BUDGET}");
        // What the end of a frame takes (it is packed and summed) must not cost a sample: the ring holds three periods
        // more.
        assert!(longest as f64 * 1.4 < 3.0 * 16.0 * 2850.0, "{longest}");
    }
}

/// Bytes of flash from its start to the end of the image, and bytes of RAM, the stack included: from the program's own
/// segments and its first stack pointer. The linker has refused more than 144 KiB and 8 KiB already.
#[test]
fn the_image_fits_what_the_papers_controller_had() {
    use object::{Object, ObjectSection, SectionKind};
    for name in ["f446", "f427", "f405"] {
        let bytes = std::fs::read(program(name)).unwrap();
        let file = object::File::parse(&*bytes).unwrap();
        let (mut code, mut data, mut flash_end, mut ram_end) = (0, 0, 0x0800_0000, 0x2000_0000);
        for section in file.sections() {
            let (start, end) = (section.address(), section.address() + section.size());
            match section.kind() {
                SectionKind::Text | SectionKind::ReadOnlyData if start >= 0x0800_0000 && start < 0x2000_0000 => {
                    code += section.size();
                    flash_end = flash_end.max(end);
                }
                SectionKind::Data => (data, ram_end) = (data + section.size(), ram_end.max(end)),
                SectionKind::UninitializedData => ram_end = ram_end.max(end),
                _ => {}
            }
        }
        // The first values of the variables are behind the code.
        let (flash, ram) = (flash_end - 0x0800_0000 + data, ram_end - 0x2000_0000);
        println!(
            "{name}: {code} bytes of program and constants, {data} of first values, to {flash} of flash, {ram} bytes of RAM with the stack"
        );
        assert!(flash <= 144 * 1024 && ram <= 8 * 1024);
    }
}

#[test]
fn nothing_is_used_that_the_emulated_chip_has_not() {
    let [plan, _] = plans();
    let outcome = start("f427", &plan, 2, 2_000_000_000);
    assert_eq!(outcome.gaps, Vec::<String>::new());
}

#[test]
fn the_stack_has_room_to_spare() {
    let [plan, _] = plans();
    let mut commands = vec![(AWAKE_NS, ToBoard::SelfTest)];
    let more = [
        ToBoard::SetPlan(plan),
        ToBoard::SaveSettings,
        ToBoard::SelfTest,
        // Here it is restarted. What the emulated flash memory was told to keep it does not hold, so that the board
        // begins as it was made.
        ToBoard::GetPlan,
        ToBoard::SelfTest,
        ToBoard::GetCounters,
        ToBoard::Hello,
        ToBoard::Start,
    ];
    let at = |k: u64| AWAKE_NS + k * 200_000_000;
    commands.extend((1..).map(at).zip(more));
    let restart = at(3) + 150_000_000;
    let outcome = run_in(
        &program("f446"),
        World::new(Electronics::drawn_board(), sheet()),
        Setup {
            commands,
            restart: Some(restart),
            ..Setup::default()
        },
        2,
        3_000_000_000,
    )
    .unwrap();
    let tests = outcome
        .messages
        .iter()
        .filter(|(_, m)| matches!(m, FromBoard::SelfTest(_)));
    assert_eq!(
        (outcome.damaged, outcome.resets, tests.count(), frames(&outcome).len()),
        (0, 1, 3, 2),
        "{:?}",
        outcome.messages
    );
    let causes: Vec<ResetCause> = hellos(&outcome).iter().map(|h| h.reset).collect();
    assert_eq!(causes, [ResetCause::PowerOn, ResetCause::Pin, ResetCause::Pin]);
    println!("{} of {} bytes of stack used", outcome.stack, outcome.stack_size);
    assert!(outcome.stack > 0 && outcome.stack + 256 <= outcome.stack_size);
}

/// The frame under way is lost and counted; the next one comes as if nothing had been.
#[test]
fn an_overrun_of_the_converter_costs_one_frame() {
    let [plan, _] = plans();
    let mut world = World::new(Electronics::drawn_board(), sheet());
    // Within the first frame, which takes 6656 samples from the 1932nd on.
    world.overrun_at = Some(4000);
    let commands = vec![
        (AWAKE_NS, ToBoard::SetPlan(plan)),
        (AWAKE_NS + 10_000_000, ToBoard::Start),
        (AWAKE_NS + 250_000_000, ToBoard::GetCounters),
    ];
    let setup = Setup {
        commands,
        ..Setup::default()
    };
    let outcome = run_in(&program("f446"), world, setup, 2, 1_000_000_000).unwrap();
    let sequences: Vec<u32> = frames(&outcome).iter().map(|f| f.sequence).collect();
    assert_eq!((sequences, outcome.resets), (vec![1, 2], 0), "{:?}", outcome.messages);
    let counted = outcome.messages.iter().find_map(|(_, m)| match m {
        FromBoard::Counters(c) => Some((c.overruns, c.front_end_faults)),
        _ => None,
    });
    assert_eq!(counted, Some((1, 0)));
}

#[test]
fn a_panic_is_told_after_the_restart() {
    let outcome = run(
        &program("fault-panic"),
        Electronics::drawn_board(),
        sheet(),
        Vec::new(),
        1,
        100_000_000,
    )
    .unwrap();
    // It panics once; the introduction after that tells of it.
    assert_eq!(outcome.resets, 1);
    let hellos = hellos(&outcome);
    let [hello] = &hellos[..] else {
        panic!("{hellos:?}");
    };
    assert_eq!(hello.reset, ResetCause::Panic);
    assert!(
        hello.last_panic.contains("panic_record.rs") && hello.last_panic.ends_with("planted"),
        "{}",
        hello.last_panic
    );
}
