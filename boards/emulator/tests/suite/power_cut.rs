//! The power of the board with sixteen channels is cut before and within every step of a saving of its settings: every word
//! that is written, and the erasure of a sector. `tests/boards.sh` builds the program and says where it is.

use crate::common::program;
use crate::common::sixteen::{AWAKE_NS, SECTOR_LEN, SECTORS, WORD_LEN, Words, world};
use emulator::h743::chip::run_in;
use emulator::run::{Life, Lived, Setup};
use firmware::settings::{self, Settings};
use protocol::{Command, FromBoard, Plan, Status, Stored, ToBoard, Watch};

/// Amplitude of the settings before, of those whose saving is cut, and of those that are saved after it.
const OLD: u16 = 500;
const NEW: u16 = 900;
const LATER: u16 = 800;

fn settings(permille: u16) -> Settings {
    Settings {
        autostart: false,
        excitation_permille: permille,
        plan: Plan::fast(),
        watch: Some(Watch::paper()),
    }
}

fn permille(memory: &Words) -> Option<u16> {
    let found = settings::load(&mut memory.clone()).unwrap();
    found.map(|s| s.excitation_permille)
}

/// What the memory holds before the first step of a saving and after each, by the same library in process.
fn states(start: &Words) -> Vec<Words> {
    let mut memory = start.clone();
    memory.steps.clear();
    settings::save(&mut memory, &settings(NEW)).unwrap();
    let after = memory.steps.into_iter().map(Words::holding);
    std::iter::once(start.clone()).chain(after).collect()
}

/// What a memory may hold when the power went within the step from one state to the next: what changes has changed by half,
/// is zero (what the program reads in place of a word whose check bits are wrong), or has bits of both.
fn torn(before: &Words, after: &Words) -> Vec<Words> {
    let changed: Vec<(usize, usize)> = (0..2)
        .flat_map(|s| (0..SECTOR_LEN).map(move |k| (s, k)))
        .filter(|(s, k)| {
            before.sectors[*s][k / WORD_LEN * WORD_LEN..][..WORD_LEN]
                != after.sectors[*s][k / WORD_LEN * WORD_LEN..][..WORD_LEN]
        })
        .collect();
    let with = |byte: &dyn Fn(usize, u8, u8) -> u8| {
        let mut out = before.clone();
        for (n, (s, k)) in changed.iter().copied().enumerate() {
            out.sectors[s][k] = byte(n, before.sectors[s][k], after.sectors[s][k]);
        }
        out
    };
    let half = changed.len() / 2;
    vec![
        with(&|n, old, new| if n < half { new } else { old }),
        with(&|_, _, _| 0),
        with(&|n, old, new| {
            let mask = (n as u8).wrapping_mul(0x9D) ^ 0x5A;
            old & mask | new & !mask
        }),
    ]
}

/// A board on this memory is asked for its state, and saves another amplitude, with power for so many steps.
fn life(memory: &Words, permille: u16, power: Option<usize>) -> Life {
    Life {
        commands: vec![
            (AWAKE_NS, ToBoard::GetStatus),
            (AWAKE_NS, ToBoard::SetExcitation(permille)),
            (AWAKE_NS + 2_000_000, ToBoard::SaveSettings),
        ],
        flash: memory.placed(),
        power,
    }
}

/// The board's lives one after the other.
fn live(mut lives: Vec<Life>) -> Vec<Lived> {
    let first = lives.remove(0);
    let setup = Setup {
        commands: first.commands,
        flash: first.flash,
        power: first.power,
        lives,
        read_back: SECTORS.map(|s| (s, SECTOR_LEN)).to_vec(),
        last: Some(FromBoard::Ack(Command::SaveSettings)),
        ..Setup::default()
    };
    // Erasing takes a second or two.
    let outcome = run_in(&program("h743"), world(), setup, usize::MAX, AWAKE_NS + 4_000_000_000).unwrap();
    let mut lived = outcome.lived;
    lived.push(Lived {
        messages: outcome.messages,
        memory: outcome.memory,
        steps: outcome.steps,
    });
    lived
}

fn status(lived: &Lived) -> &Status {
    let found = lived.messages.iter().find_map(|(_, m)| match m {
        FromBoard::Status(s) => Some(s),
        _ => None,
    });
    found.unwrap_or_else(|| panic!("{:?}", lived.messages))
}

fn acknowledged(lived: &Lived) -> bool {
    let ack = FromBoard::Ack(Command::SaveSettings);
    lived.messages.iter().any(|(_, m)| *m == ack)
}

/// Cuts a saving before and within every step.
///
/// Within the first `torn_steps` of them what the step changes is torn as well.
fn cut_everywhere(start: &Words, torn_steps: usize) {
    let states = states(start);
    let steps = states.len() - 1;
    let cuts = live((0..=steps).map(|k| life(start, NEW, Some(k))).collect());
    for (k, (lived, state)) in cuts.iter().zip(&states).enumerate() {
        // The power went at the beginning of the next step, if there is one.
        assert_eq!(
            (lived.steps, acknowledged(lived)),
            ((k + 1).min(steps), k == steps),
            "{k}"
        );
        assert!(lived.memory == state.sectors, "{k}");
    }
    // The law after any cut: the board starts with the old settings or the new, and saves others.
    let within = states
        .windows(2)
        .take(torn_steps)
        .flat_map(|pair| torn(&pair[0], &pair[1]));
    let memories: Vec<Words> = states.iter().cloned().chain(within).collect();
    let after = live(memories.iter().map(|m| life(m, LATER, None)).collect());
    assert_eq!(after.len(), memories.len());
    let mut olds = 0;
    for (k, (memory, lived)) in memories.iter().zip(&after).enumerate() {
        let found = status(lived);
        assert_eq!(found.stored, Stored::InForce, "{k}");
        assert_eq!(Some(found.excitation_permille), permille(memory), "{k}");
        let old = found.excitation_permille == OLD;
        assert!(old || found.excitation_permille == NEW, "{k}: {found:?}");
        // Between steps the last one alone makes the record count.
        assert!(k > steps || old == (k < steps), "{k}");
        assert!(acknowledged(lived), "{k}: {:?}", lived.messages);
        assert_eq!(permille(&Words::read_back(&lived.memory)), Some(LATER), "{k}");
        olds += usize::from(old);
    }
    println!(
        "{steps} steps, {} states of the memory, {olds} with the old settings",
        memories.len()
    );
}

#[test]
fn a_power_cut_at_any_word_of_a_record_leaves_the_old_settings_or_the_new() {
    let mut memory = Words::erased();
    settings::save(&mut memory, &settings(OLD)).unwrap();
    cut_everywhere(&memory, usize::MAX);
}

#[test]
fn a_power_cut_at_any_step_with_an_erasure_leaves_the_old_settings_or_the_new() {
    // The sector of the last record is full, and the other one has old records: it is erased for the next.
    let used = |m: &Words| m.sectors.iter().flatten().filter(|b| **b != 0xFF).count();
    let (mut memory, mut next) = (Words::erased(), Words::erased());
    while used(&next) >= used(&memory) {
        memory = next.clone();
        settings::save(&mut next, &settings(OLD)).unwrap();
    }
    // The words behind the erasure are as those of the other test.
    cut_everywhere(&memory, 1);
}
