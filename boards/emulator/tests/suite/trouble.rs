//! The board's program where something around it is not as it should be, and with one channel's watch: on the emulated
//! chip. `tests/boards.sh` builds the programs and says where they are.

use crate::common::{AWAKE_NS, frames, hellos, program, sheet, touched};
use emulator::run::{Outcome, Setup, run_in};
use emulator::world::World;
use firmware::settings::Settings;
use hil_sim::Electronics;
use protocol::{FromBoard, Plan, ResetCause, Status, Stored, ToBoard, Watch, Watching};

/// One period of the excitation, ns.
const PERIOD_NS: f64 = 16.0 * 1425.0 / 84e-3;

fn world() -> World {
    World::new(Electronics::drawn_board(), sheet())
}

fn states(outcome: &Outcome) -> Vec<(u64, Watching)> {
    let beat = |(at, m): &(u64, FromBoard)| match m {
        FromBoard::Heartbeat(h) => Some((*at, h.state)),
        _ => None,
    };
    let mut list: Vec<_> = outcome.messages.iter().filter_map(beat).collect();
    list.dedup_by_key(|(_, state)| *state);
    list
}

#[test]
fn with_one_channel_it_learns_sleeps_and_wakes_with_the_next_value() {
    // A whole period to settle, so that nothing rings and the frames can be compared.
    let (plan, watch) = (Plan::sequential(), Watch::sequential());
    // It has learned from 128 scans of 10 periods half a second after the start, and sleeps; then the touch.
    let contact = 40_000;
    let setup = Setup {
        commands: vec![
            (AWAKE_NS, ToBoard::SetPlan(plan.clone())),
            (AWAKE_NS + 10_000_000, ToBoard::SetWatch(Some(watch))),
            (AWAKE_NS + 20_000_000, ToBoard::Start),
            (AWAKE_NS + 780_000_000, ToBoard::GetCounters),
        ],
        ..Setup::default()
    };
    let outcome = run_in(
        &program("f446"),
        world().touched_at(contact, touched()),
        setup,
        2,
        2_000_000_000,
    )
    .unwrap();
    let kinds: Vec<Watching> = states(&outcome).iter().map(|(_, s)| *s).collect();
    use Watching::{Asleep, Awake, Learning};
    assert_eq!(kinds, [Learning, Asleep, Awake], "{:?}", outcome.messages);
    let list = frames(&outcome);
    assert_eq!(
        (list.len(), outcome.damaged, outcome.resets, outcome.without_break),
        (2, 0, 0, 0)
    );
    // The first frame begins with the touch on the sheet, a rest and a scan of the watch later at most.
    let begun = list[0].time;
    let latest = contact + ((1.25 + 20.0 + 10.0 + 1.0) * 16.0) as u64;
    assert!((contact..=latest).contains(&begun), "{contact} {begun} {latest}");
    println!(
        "contact to the first frame's first sample {:.1} ms, to its end {:.1} ms; {} wakes",
        (begun - contact) as f64 / 16.0 * PERIOD_NS * 1e-6,
        (begun + 416 * 16 - contact) as f64 / 16.0 * PERIOD_NS * 1e-6,
        kinds.len() - 2
    );
    // And shows it, value for value, as the one after the watch's next scan does; but for the first, which may still
    // ring.
    for there in &list {
        let here = &crate::common::in_process_on(touched(), &plan, there.time, 1)[0];
        let different = here.values.iter().zip(&there.values).filter(|(a, b)| a != b).count();
        assert!(different <= 1, "{different} of 208 values differ");
    }
    let scans = outcome.messages.iter().find_map(|(_, m)| match m {
        FromBoard::Counters(c) => Some((c.watch_scans > 128, c.wakes, c.overruns)),
        _ => None,
    });
    assert!(matches!(scans, Some((true, _, 0))), "{scans:?}");
}

#[test]
fn it_starts_from_stored_settings() {
    let stored = Settings {
        autostart: true,
        excitation_permille: 700,
        plan: Plan::sequential_fast(),
        watch: Some(Watch::sequential()),
    };
    // Of two the newer counts, and of the two sectors the first.
    let older = Settings {
        autostart: false,
        ..stored.clone()
    };
    let setup = Setup {
        commands: vec![(AWAKE_NS, ToBoard::GetStatus)],
        flash: vec![(0x0800_8000, crate::common::stored(&[older, stored]))],
        ..Setup::default()
    };
    let outcome = run_in(
        &program("f446"),
        world().touched_at(50_000, touched()),
        setup,
        1,
        2_000_000_000,
    )
    .unwrap();
    let status = outcome.messages.iter().find_map(|(_, m)| match m {
        FromBoard::Status(s) => Some(*s),
        _ => None,
    });
    let expected = Status {
        running: true,
        watching: Watching::Learning,
        autostart: true,
        excitation_permille: 700,
        stored: Stored::InForce,
    };
    assert_eq!(status, Some(expected));
    println!("{} of {} bytes of stack used", outcome.stack, outcome.stack_size);
    assert!(outcome.stack + 256 <= outcome.stack_size);
    // Nobody told it to start, and something touches what it learned.
    let list = frames(&outcome);
    assert_eq!(
        (list.len(), list[0].plan, outcome.damaged),
        (1, Plan::sequential_fast().id, 0)
    );
    assert_eq!(hellos(&outcome)[0].reset, ResetCause::PowerOn);
}

#[test]
fn a_supply_that_sags_restarts_it_and_the_cause_is_told() {
    let sag = 10 * AWAKE_NS;
    let setup = Setup {
        commands: vec![(AWAKE_NS, ToBoard::Start)],
        // For 50 ms.
        supply: vec![(sag, 2900), (sag + 50_000_000, 3300)],
        ..Setup::default()
    };
    let outcome = run_in(&program("f446"), world(), setup, 99, sag + 100_000_000).unwrap();
    let causes: Vec<_> = hellos(&outcome)
        .iter()
        .map(|h| (h.reset, h.last_panic.is_empty()))
        .collect();
    assert_eq!(causes, [(ResetCause::PowerOn, true), (ResetCause::BrownOut, true)]);
    let last = outcome
        .messages
        .iter()
        .rfind(|(_, m)| matches!(m, FromBoard::Hello(_)))
        .unwrap()
        .0;
    // The first start has switched the chip's own brown-out reset on, at its highest level.
    assert_eq!(outcome.brown_out, 0);
    // Only once the supply is back.
    assert!(
        last > sag + 50_000_000 && outcome.resets == 1,
        "{last} {}",
        outcome.resets
    );
}

#[test]
fn a_supply_that_never_is_good_is_told_and_does_not_stop_it() {
    let setup = Setup {
        commands: vec![
            (3 * AWAKE_NS, ToBoard::SaveSettings),
            (4 * AWAKE_NS, ToBoard::SetPlan(Plan::sequential_fast())),
            (5 * AWAKE_NS, ToBoard::Start),
        ],
        supply: vec![(0, 2900)],
        ..Setup::default()
    };
    let outcome = run_in(&program("f446"), world(), setup, 1, 1_000_000_000).unwrap();
    let [hello] = &hellos(&outcome)[..] else {
        panic!("{:?}", outcome.messages);
    };
    assert!(
        hello.last_panic.starts_with("the supply is below"),
        "{}",
        hello.last_panic
    );
    let refused = outcome
        .messages
        .iter()
        .any(|(_, m)| *m == FromBoard::Error(protocol::BoardError::Refused(protocol::Refusal::Store)));
    assert!(refused, "{:?}", outcome.messages);
    assert_eq!((frames(&outcome).len(), outcome.resets), (1, 0));
}

#[test]
fn the_front_end_and_the_clock_keep_their_duties_on_the_chip() {
    let outcome = run_in(&program("laws"), world(), Setup::default(), 1, 250_000_000).unwrap();
    let [hello] = &hellos(&outcome)[..] else {
        panic!("{:?} {}", outcome.messages, outcome.resets);
    };
    assert_eq!((hello.board.as_str(), hello.last_panic.as_str()), ("laws", ""));
    assert_eq!((outcome.resets, outcome.without_break), (0, 0));
}

/// The longest times that the light was on and off, ms, of the whole ones between two commands.
fn light(outcome: &Outcome, from_ns: u64, to_ns: u64) -> (f64, f64) {
    // The emulated chip carries 120 million instructions a second out.
    let ms = |instructions: u64| instructions as f64 / 120e3;
    let (mut on, mut off) = (0.0f64, 0.0f64);
    for pair in outcome.light.windows(2) {
        let [(start, lit), (end, _)] = pair else { continue };
        if ms(*start) < from_ns as f64 * 1e-6 || ms(*end) > to_ns as f64 * 1e-6 {
            continue;
        }
        let longest = if *lit { &mut on } else { &mut off };
        *longest = longest.max(ms(end - start));
    }
    (on, off)
}

#[test]
fn the_light_tells_an_idle_board_from_one_that_measures_and_one_that_failed() {
    const SECOND: u64 = 1_000_000_000;
    // 2^27 processor cycles at 168 MHz.
    let cycle = f64::from(1 << 27) / 168e3;
    let near = |(on, off): (f64, f64), part: f64, of: f64| {
        assert!(
            (on - part * of).abs() < 3.0 && (off - (1.0 - part) * of).abs() < 3.0,
            "{on} {off}"
        );
    };
    let run = |name, start| {
        let setup = Setup {
            commands: vec![(start, ToBoard::Start)],
            ..Setup::default()
        };
        run_in(&program(name), world(), setup, usize::MAX, 5 * SECOND).unwrap()
    };
    let outcome = run("f446", 5 * SECOND / 2);
    near(light(&outcome, 0, 5 * SECOND / 2), 1.0 / 16.0, cycle);
    near(light(&outcome, 11 * SECOND / 4, 5 * SECOND), 0.5, cycle / 2.0);
    // Its source is out of phase: it does not start, and says so.
    let outcome = run("fault-phase", AWAKE_NS);
    near(light(&outcome, SECOND, 5 * SECOND), 7.0 / 8.0, cycle);
}
