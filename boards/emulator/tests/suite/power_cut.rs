//! The power of the board with sixteen channels is cut before and within every step of a saving of its settings: every word
//! that is written, and the erasure of a sector. `tests/boards.sh` builds the program and says where it is.

use crate::common::program;
use crate::common::sixteen::{AWAKE_NS, SECTOR_LEN, SECTORS, WORD_LEN, Words, world};
use emulator::h743::cells;
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

/// What a memory may hold when the power went within the step from one state to the next, and its check bits happen to be
/// right: what changes has changed by half, or has bits of both.
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
fn live(lives: Vec<Life>) -> Vec<Lived> {
    // Erasing takes a second or two.
    live_as("h743", SECTORS, AWAKE_NS + 4_000_000_000, lives)
}

/// Those of a program with its settings in these sectors, of so many ns each at most.
fn live_as(name: &str, sectors: [u64; 2], life_ns: u64, mut lives: Vec<Life>) -> Vec<Lived> {
    let first = lives.remove(0);
    let setup = Setup {
        commands: first.commands,
        flash: first.flash,
        power: first.power,
        lives,
        read_back: sectors.map(|s| (s, SECTOR_LEN)).to_vec(),
        last: Some(FromBoard::Ack(Command::SaveSettings)),
        ..Setup::default()
    };
    let outcome = run_in(&program(name), world(), setup, usize::MAX, life_ns).unwrap();
    let mut lived = outcome.lived;
    lived.push(Lived {
        messages: outcome.messages,
        memory: outcome.memory,
        steps: outcome.steps,
    });
    lived
}

fn told(lived: &Lived) -> Option<&Status> {
    lived.messages.iter().find_map(|(_, m)| match m {
        FromBoard::Status(s) => Some(s),
        _ => None,
    })
}

fn status(lived: &Lived) -> &Status {
    told(lived).unwrap_or_else(|| panic!("{:?}", lived.messages))
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

/// A memory whose next saving erases a sector.
fn before_an_erasure() -> Words {
    // The sector of the last record is full, and the other one has old records: it is erased for the next.
    let used = |m: &Words| m.sectors.iter().flatten().filter(|b| **b != 0xFF).count();
    let (mut memory, mut next) = (Words::erased(), Words::erased());
    while used(&next) >= used(&memory) {
        memory = next.clone();
        settings::save(&mut next, &settings(OLD)).unwrap();
    }
    memory
}

#[test]
fn a_power_cut_at_any_step_with_an_erasure_leaves_the_old_settings_or_the_new() {
    // The words behind the erasure are as those of the other test.
    cut_everywhere(&before_an_erasure(), 1);
}

/// Cuts these steps of a saving on memory with check bits, and lives on with what that left: a word, or a sector, that reads as
/// a bus fault. The second life of each.
fn cut_with_check_bits(name: &str, start: &Words, cuts: &[usize]) -> Vec<Lived> {
    let sectors = [cells::BASE, cells::BASE + cells::SECTOR_LEN];
    let lives = cuts.iter().flat_map(|k| {
        let before = Life {
            flash: sectors.into_iter().zip(start.sectors.clone()).collect(),
            ..life(start, NEW, Some(*k))
        };
        let after = Life {
            flash: Vec::new(),
            ..life(start, LATER, None)
        };
        [before, after]
    });
    // On these cells an erasure is over at once.
    let lived = live_as(name, sectors, 4 * AWAKE_NS, lives.collect());
    let steps = states(start).len() - 1;
    for (k, cut) in cuts.iter().zip(lived.iter().step_by(2)) {
        assert_eq!(acknowledged(cut), *k == steps, "{k}: {:?}", cut.messages);
        assert_eq!(cut.steps, (k + 1).min(steps), "{k}");
    }
    lived.into_iter().skip(1).step_by(2).collect()
}

/// The law after a cut: old settings or new, and others can be saved.
fn keeps_the_law(lived: &Lived, wanted: u16) {
    let found = status(lived);
    assert_eq!((found.stored, found.excitation_permille), (Stored::InForce, wanted));
    assert!(acknowledged(lived), "{:?}", lived.messages);
    assert_eq!(permille(&Words::read_back(&lived.memory)), Some(LATER));
}

#[test]
fn a_word_that_reads_as_a_bus_fault_leaves_the_old_settings() {
    let mut memory = Words::erased();
    settings::save(&mut memory, &settings(OLD)).unwrap();
    let steps = states(&memory).len() - 1;
    let cuts: Vec<usize> = (0..steps).collect();
    for lived in cut_with_check_bits("h743-check-bits", &memory, &cuts) {
        keeps_the_law(&lived, OLD);
    }
    // A program that does not expect such a fault lives until it meets one, and then never says a word.
    let planted = cut_with_check_bits("h743-fault-read", &memory, &[steps, 2]);
    keeps_the_law(&planted[0], NEW);
    assert_eq!(told(&planted[1]), None, "{:?}", planted[1].messages);
}

#[test]
fn a_sector_that_reads_as_a_bus_fault_leaves_the_old_settings() {
    for lived in cut_with_check_bits("h743-check-bits", &before_an_erasure(), &[0, 1]) {
        keeps_the_law(&lived, OLD);
    }
}
