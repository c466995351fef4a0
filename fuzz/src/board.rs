//! The board's commands and its store.

use crate::fake::{Chip, ELECTRODES, Fake, Flaw, SKEW_TICKS, SOURCE_GAIN_MILLI, TICKS_PER_SAMPLE, Wire};
use firmware::settings::{Settings, load, save};
use firmware::{BoardInfo, Controller, ErrorKind, Memory};
use hil_sim::{Flash, Torn};
use protocol::{Decoder, FromBoard, MAX_FROM_BOARD_LEN, MAX_TO_BOARD_LEN, Plan, ResetCause, ToBoard, encode};

const INFO: BoardInfo<'static> = BoardInfo {
    name: "fake",
    serial: "1",
    git: "0123456",
    electrodes: ELECTRODES,
    channels: 16,
    timer_hz: 84_000_000,
    ticks_per_sample: TICKS_PER_SAMPLE,
    in_turn: 16,
    skew_ticks: SKEW_TICKS,
    adc_bits: 12,
    adc_span_uv: 3_300_000,
    excitation_uv: 2_250_000,
    source_gain_milli: SOURCE_GAIN_MILLI,
    gains_milli: [1000, 0, 0, 0],
    reset: ResetCause::PowerOn,
    last_panic: "",
};

const FLAWS: [Flaw; 9] = [
    Flaw::Late,
    Flaw::Skips,
    Flaw::Repeats,
    Flaw::Hasty,
    Flaw::Cut,
    Flaw::Surplus,
    Flaw::Silent,
    Flaw::Reversed,
    Flaw::Mute,
];
const FAULTS: [ErrorKind; 3] = [ErrorKind::Route, ErrorKind::Overrun, ErrorKind::Other];

/// A script of commands, noise, faults and clock jumps: whatever comes, the board says nothing that is damaged.
pub fn commands(script: &[u8]) {
    let Some((first, mut rest)) = script.split_first() else {
        return;
    };
    let wire = Wire::default();
    let (front, mut chip) = (Fake::new(), Chip::new());
    // The chip's clock goes with the samples, unless it is broken.
    if first & 1 == 0 {
        chip.clock = front.clock.clone();
    }
    let mut board = Controller::new(INFO, Plan::fast(), front, wire.clone(), chip, Box::<Memory>::default())
        .expect("the board's own plan");
    let mut decoder = Decoder::<MAX_FROM_BOARD_LEN>::new();
    while let Some(([what, much], after)) = rest.split_first_chunk::<2>() {
        let (piece, next) = after.split_at((usize::from(*much)).min(after.len()));
        rest = after;
        match what % 8 {
            // A command of any content.
            0..=2 => {
                rest = next;
                if let Ok(command) = postcard::from_bytes::<ToBoard>(piece) {
                    let mut buffer = [0; MAX_TO_BOARD_LEN];
                    let bytes = encode(&command, &mut buffer).expect("every command fits");
                    wire.to_board.borrow_mut().extend(bytes);
                }
            }
            // Noise.
            3 => {
                rest = next;
                wire.to_board.borrow_mut().extend(piece);
            }
            4 => board.front_mut().fault = Some(FAULTS[usize::from(*much) % FAULTS.len()]),
            5 => board.front_mut().flaw = FLAWS.get(usize::from(*much) % (FLAWS.len() + 1)).copied(),
            6 => {
                let clock = board.support_mut().clock.clone();
                clock.set(clock.get().wrapping_add(1 << (much % 40)));
            }
            _ => board.support_mut().broken = much & 1 == 1,
        }
        // A transmitter that takes all, some or nothing.
        wire.room.set(usize::from(*much) << (what / 32));
        for _ in 0..32 {
            board.poll();
        }
        read(&wire, &mut decoder);
    }
    wire.room.set(usize::MAX);
    for _ in 0..64 {
        board.poll();
    }
    read(&wire, &mut decoder);
}

fn read(wire: &Wire, decoder: &mut Decoder<MAX_FROM_BOARD_LEN>) {
    let bytes = std::mem::take(&mut *wire.from_board.borrow_mut());
    decoder.push::<FromBoard>(&bytes, |message| drop(message.expect("what the board sends is whole")));
}

/// A store of any content: loading ends, and what is saved then is read back. A power cut at any byte leaves the old or the
/// new.
pub fn settings(data: &[u8]) {
    let Some(([savings, cut], content)) = data.split_first_chunk::<2>() else {
        return;
    };
    let any = postcard::from_bytes::<Settings>(content).unwrap_or(Settings::NONE);
    let other = |k: u8| Settings {
        excitation_permille: k.into(),
        ..any.clone()
    };
    let mut chip = Chip::new();
    for (sector, piece) in chip.store.iter_mut().zip(content.chunks(2048)) {
        sector[..piece.len()].copy_from_slice(piece);
    }
    load(&mut chip).expect("a store that answers");
    for k in 0..=savings % 8 {
        save(&mut chip, &other(k)).expect("a store that works");
        assert_eq!(load(&mut chip).expect("a store that answers"), Some(other(k)));
    }

    let mut flash = Flash::new(1024);
    for k in 0..savings % 32 {
        save(&mut flash, &other(k)).expect("a store that works");
    }
    let before = load(&mut flash).expect("a store that answers");
    flash.cut_after(
        u64::from(*cut) * 5,
        [Torn::Before, Torn::Mixed, Torn::After][content.len() % 3],
    );
    let saved = save(&mut flash, &any).is_ok();
    flash.power_on();
    let now = load(&mut flash).expect("a store that answers");
    assert!(
        now == Some(any.clone()) || (!saved && now == before),
        "neither the old nor the new"
    );
    save(&mut flash, &any).expect("a store that works");
    assert_eq!(load(&mut flash).expect("a store that answers"), Some(any));
}
