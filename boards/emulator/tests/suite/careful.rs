//! The board's program after faults of its own, and with a memory that is hostile or keeps nothing, on the emulated chip.
//! `tests/boards.sh` builds the programs and says where they are.

use crate::common::{AWAKE_NS, frames, hellos, program, sheet, stored};
use emulator::run::{Setup, run_in};
use emulator::world::World;
use firmware::settings::Settings;
use hil_sim::Electronics;
use protocol::{BoardError, FromBoard, Notice, Plan, Refusal, ResetCause, Stored, ToBoard};

/// The settings' two sectors.
const SETTINGS: u64 = 0x0800_8000;

fn world() -> World {
    World::new(Electronics::drawn_board(), sheet())
}

#[test]
fn a_program_that_hangs_is_restarted_by_the_watchdog_and_does_less_each_time() {
    let kept = Settings {
        autostart: true,
        excitation_permille: 700,
        plan: Plan::sequential_fast(),
        watch: None,
    };
    // It hangs 0.34 s after each start, and the watchdog waits for 2 s.
    let life_ns = 2_345_000_000;
    let setup = Setup {
        commands: (0..4)
            .map(|k| (k * life_ns + 200_000_000, ToBoard::GetStatus))
            .collect(),
        flash: vec![(SETTINGS, stored(&[kept]))],
        ..Setup::default()
    };
    let outcome = run_in(
        &program("fault-hang"),
        world(),
        setup,
        usize::MAX,
        4 * life_ns - 100_000_000,
    )
    .unwrap();
    let causes: Vec<ResetCause> = hellos(&outcome).iter().map(|h| h.reset).collect();
    let watchdog = ResetCause::Watchdog;
    assert_eq!(
        causes,
        [ResetCause::PowerOn, watchdog, watchdog, watchdog],
        "{:?}",
        outcome.messages
    );
    let times = outcome
        .messages
        .iter()
        .filter(|(_, m)| matches!(m, FromBoard::Hello(_)));
    println!(
        "lives begin at {:?} ms",
        times.map(|(at, _)| at / 1_000_000).collect::<Vec<_>>()
    );
    let status = outcome.messages.iter().filter_map(|(_, m)| match m {
        FromBoard::Status(s) => Some((s.running, s.autostart, s.excitation_permille, s.stored)),
        _ => None,
    });
    let as_told = (false, true, 700, Stored::InForce);
    assert_eq!(
        status.collect::<Vec<_>>(),
        [
            (true, true, 700, Stored::InForce),
            as_told,
            as_told,
            (false, false, 1000, Stored::Unread)
        ]
    );
    // At each start, and before each answer.
    let said = outcome.messages.iter().filter_map(|(_, m)| match m {
        FromBoard::Notice(n) => Some(*n),
        _ => None,
    });
    let careful = |resets| Notice::Careful {
        resets,
        settings: resets < 3,
    };
    assert_eq!(said.collect::<Vec<_>>(), [1, 1, 2, 2, 3, 3].map(careful));
    // Only the first life measured by itself.
    let last = outcome.messages.iter().rfind(|(_, m)| matches!(m, FromBoard::Frame(_)));
    assert!(frames(&outcome).len() > 1 && last.unwrap().0 < 500_000_000);
}

#[test]
fn a_hostile_memory_does_not_make_the_watchdog_bite() {
    // What looks like the beginning of a record of 421 bytes, at every second byte.
    let hostile = [0xA5, 0x01].repeat(16 * 1024);
    let setup = Setup {
        flash: vec![(SETTINGS, hostile)],
        ..Setup::default()
    };
    let outcome = run_in(&program("f446"), world(), setup, usize::MAX, 6_000_000_000).unwrap();
    let up = outcome.messages.iter().find(|(_, m)| matches!(m, FromBoard::Hello(_)));
    println!("up after {} ms", up.map_or(0, |(at, _)| at / 1_000_000));
    assert_eq!(
        (outcome.resets, hellos(&outcome).len()),
        (0, 1),
        "{:?}",
        outcome.messages
    );
}

#[test]
fn a_memory_that_keeps_nothing_is_told_when_it_is_read_back() {
    // The emulated flash memory takes what is written and keeps nothing of it.
    let setup = Setup {
        commands: vec![(AWAKE_NS, ToBoard::SaveSettings)],
        ..Setup::default()
    };
    let outcome = run_in(&program("f446"), world(), setup, usize::MAX, 10 * AWAKE_NS).unwrap();
    let refused = FromBoard::Error(BoardError::Refused(Refusal::ReadBack));
    assert!(
        outcome.messages.iter().any(|(_, m)| *m == refused),
        "{:?}",
        outcome.messages
    );
}
