//! The log over the debug probe, read as a probe reads it: from the memory of the emulated chip. `tests/boards.sh` builds
//! the program and says where it is.

use crate::common::{AWAKE_NS, program, sheet};
use emulator::run::{Outcome, Setup, run_in};
use emulator::world::World;
use hil_sim::Electronics;
use object::{Object, ObjectSymbol};
use protocol::{Plan, ToBoard};
use std::collections::BTreeMap;

/// Where the log's control block is, and the texts of the program's messages by their numbers.
///
/// `defmt` keeps the texts out of the chip: a message's number is the address of a symbol whose name has the text.
fn texts(name: &str) -> (u64, BTreeMap<u64, String>) {
    let bytes = std::fs::read(program(name)).unwrap();
    let file = object::File::parse(&*bytes).unwrap();
    let mut block = None;
    let mut texts = BTreeMap::new();
    for symbol in file.symbols() {
        let name = symbol.name().unwrap_or_default();
        if name == "_SEGGER_RTT" {
            block = Some(symbol.address());
        } else if name.contains("\"tag\":\"defmt_")
            && let Some((_, text)) = name.split_once("\"data\":\"")
        {
            let text = text.split_once("\",").map_or(text, |(text, _)| text);
            texts.insert(symbol.address(), text.to_owned());
        }
    }
    (block.expect("no log in the program"), texts)
}

/// A frame of reverse-zero-compressing COBS, which is read from its end (the encoding's documentation, `rzcobs`).
fn decoded(frame: &[u8]) -> Option<Vec<u8>> {
    let (mut out, mut bytes) = (Vec::new(), frame.iter().rev());
    while let Some(head) = bytes.next() {
        match *head {
            0 => return None,
            head @ 1..=0x7F => {
                for bit in (0..7).rev() {
                    out.push(if head >> bit & 1 == 0 { *bytes.next()? } else { 0 });
                }
            }
            0xFF => {
                for _ in 0..134 {
                    out.push(*bytes.next()?);
                }
            }
            head => {
                out.push(0);
                for _ in 0..(head & 0x7F) + 7 {
                    out.push(*bytes.next()?);
                }
            }
        }
    }
    out.reverse();
    Some(out)
}

/// Text and arguments of every message, in order.
fn messages(log: &[u8], texts: &BTreeMap<u64, String>) -> Vec<(String, Vec<u8>)> {
    let frames = log.split(|b| *b == 0).filter(|f| !f.is_empty());
    let message = |frame: &[u8]| {
        let bytes = decoded(frame).expect("a damaged frame");
        let number = u64::from(u16::from_le_bytes([bytes[0], bytes[1]]));
        (texts[&number].clone(), bytes[2..].to_vec())
    };
    frames.map(message).collect()
}

/// A plan that is refused, and then a start.
fn commands() -> Vec<(u64, ToBoard)> {
    let mut empty = Plan::sequential();
    empty.slots.clear();
    vec![(4 * AWAKE_NS, ToBoard::SetPlan(empty)), (5 * AWAKE_NS, ToBoard::Start)]
}

/// What every board logs of a start, a refused command and lost samples.
const TOLD: [&str; 6] = [
    "clock: {}; supply good: {=bool}",
    "reset: {}; {=str}",
    "settings: {}",
    "resets by faults of its own, in a row: {=u8}",
    "refused: {}",
    "overruns: {=u32}",
];

/// Holds what was logged against these texts; the last has to say that samples were lost once.
fn tells(outcome: &Outcome, texts: &BTreeMap<u64, String>, expected: &[&str]) {
    let log = messages(&outcome.log, texts);
    let said: Vec<&str> = log.iter().map(|(text, _)| text.as_str()).collect();
    assert_eq!(said, expected);
    assert_eq!(
        log.last().unwrap().1.first_chunk(),
        Some(&1u32.to_le_bytes()),
        "{log:?}"
    );
    assert_eq!((outcome.damaged, outcome.resets), (0, 0));
}

#[test]
fn the_log_tells_the_start_what_was_refused_and_what_was_lost() {
    let (block, texts) = texts("defmt");
    let mut world = World::new(Electronics::drawn_board(), sheet());
    // Within the first frame, which takes 6656 samples from the 6600th on.
    world.overrun_at = Some(9000);
    let setup = Setup {
        commands: commands(),
        log_at: Some(block),
        ..Setup::default()
    };
    let outcome = run_in(&program("defmt"), world, setup, 1, 1_000_000_000).unwrap();
    let expected = [&["option bytes: brown-out reset to level 3"][..], &TOLD].concat();
    tells(&outcome, &texts, &expected);
    // The log costs no frame but the one that was lost.
    assert_eq!(crate::common::frames(&outcome).len(), 1);
}

#[test]
fn the_board_with_sixteen_channels_tells_the_same() {
    let (block, texts) = texts("h743-defmt");
    let mut world = crate::common::sixteen::world();
    // Frames of 512 samples begin with some 5500th: within the windows of one, since all of them follow one another.
    world.overrun_at = Some(8008);
    let setup = Setup {
        commands: commands(),
        log_at: Some(block),
        ..Setup::default()
    };
    let outcome = emulator::h743::chip::run_in(&program("h743-defmt"), world, setup, 30, 1_000_000_000).unwrap();
    tells(&outcome, &texts, &TOLD);
    assert_eq!(crate::common::frames(&outcome).len(), 30);
}

#[test]
fn a_program_without_it_has_nothing_of_it() {
    for name in ["f446", "h743"] {
        let bytes = std::fs::read(program(name)).unwrap();
        let file = object::File::parse(&*bytes).unwrap();
        let of_log = |name: &str| name.contains("defmt") || name.contains("SEGGER");
        assert!(!file.symbols().any(|s| s.name().is_ok_and(of_log)));
        assert!(!bytes.windows(10).any(|w| w == b"SEGGER RTT"));
    }
}
