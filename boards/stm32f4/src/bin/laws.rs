//! The duties of the front end and of the clock (`firmware::laws`), tested on the chip itself.
//!
//! The outcome is in a `Hello`, in the place of the last panic. It is empty when every duty is kept.
#![no_std]
#![no_main]
#![allow(dead_code, reason = "parts of the board")]

#[macro_use]
#[path = "../log.rs"]
mod log;

#[path = "../chip.rs"]
mod chip;
#[path = "../clocks.rs"]
mod clocks;
#[path = "../flash.rs"]
mod flash;
#[path = "../front_end.rs"]
mod front_end;
#[path = "../identity.rs"]
mod identity;
#[path = "../multiplexer.rs"]
mod multiplexer;
#[path = "../panic_record.rs"]
mod panic_record;
#[path = "../ring.rs"]
mod ring;
#[path = "../sampler.rs"]
mod sampler;
#[path = "../serial.rs"]
mod serial;
#[path = "../sine.rs"]
mod sine;
#[path = "../source.rs"]
mod source;
#[path = "../supply.rs"]
mod supply;

use chip::Chip;
use core::fmt::Write;
use embedded_hal_nb::serial::Write as _;
use firmware::{Blocking, BoardInfo, Excitation, Route, Sense, Window, laws};
use front_end::FrontEnd;
use protocol::{Outgoing, Pair, PanicText, ResetCause};
use serial::Serial;
use stm32f4xx_hal::pac;

/// Of the introduction only what was found counts.
const INFO: BoardInfo<'static> = BoardInfo {
    name: "laws",
    serial: "",
    git: "",
    electrodes: 16,
    channels: 1,
    timer_hz: sampler::TIMER_HZ,
    ticks_per_sample: sampler::TICKS_PER_SAMPLE,
    in_turn: 1,
    skew_ticks: 0,
    adc_bits: 12,
    adc_span_uv: 3_300_000,
    excitation_uv: 2_250_000,
    // Of docs/board.md, with the filters' loss; hardware/check.py holds them.
    source_gain_milli: 285,
    gains_milli: [12_600, 584, 0, 0],
    reset: ResetCause::Unknown,
    last_panic: "",
};

/// More than the ring of four periods holds: 2 ms.
const STALL_CYCLES: u32 = 336_000;

struct Both(FrontEnd, Chip);

#[cortex_m_rt::entry]
fn main() -> ! {
    let (Some(core), Some(device)) = (cortex_m::Peripherals::take(), pac::Peripherals::take()) else {
        panic!("started twice");
    };
    chip::start(device, core);
    let mut both = Both(FrontEnd::start(), Chip);
    let mut link = Serial::start();
    let mut found = PanicText::new();
    front_end(&mut both, &mut found);
    clock(&mut both, &mut found);
    let info = BoardInfo {
        last_panic: &found,
        ..INFO
    };
    say(&info, &mut link);
    loop {
        firmware::Watchdog::feed(&mut both.1);
    }
}

#[inline(never)]
fn front_end(both: &mut Both, found: &mut PanicText) {
    // The source itself: the strongest signal, in phase whatever is on the sheet. Then a pair of the sheet.
    let drive = Pair { plus: 0, minus: 1 };
    let route = Route {
        drive,
        sense: Sense::Source,
        gain: 0,
    };
    // The filter behind the DAC has to swing in before its phase can be tried.
    let settle = Window {
        settle_quarters: 8,
        periods: 1,
        channels: 1,
    };
    if let Err(e) = both
        .0
        .switch_on()
        .and_then(|()| Blocking(&mut both.0).capture(settle, |_| {}))
    {
        let _ = write!(found, "{e:?}");
    }
    // The watchdog must not bite: a stall is short, all else polls.
    if let Err(e) = laws::check(&mut both.0, &route, 1, |_| cortex_m::asm::delay(STALL_CYCLES)) {
        let _ = write!(found, "{e:?}");
    }
}

#[inline(never)]
fn clock(both: &mut Both, found: &mut PanicText) {
    if let Err(e) = laws::clock(both, |b| &mut b.0, |b| &mut b.1) {
        let _ = write!(found, "{e:?}");
    }
}

#[inline(never)]
fn say(info: &BoardInfo<'_>, link: &mut Serial) {
    let hello = info.hello();
    let mut bytes = [0; 256];
    if let Ok(framed) = protocol::encode(&Outgoing::Hello(&hello), &mut bytes) {
        for byte in [0].iter().chain(framed.iter()) {
            while link.write(*byte).is_err() {}
        }
        while link.flush().is_err() {}
    }
}
