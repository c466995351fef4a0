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
#[path = "../clock_search.rs"]
mod clock_search;
#[path = "../clocks.rs"]
mod clocks;
#[path = "../dac.rs"]
mod dac;
#[path = "../duties.rs"]
mod duties;
#[path = "../flash.rs"]
mod flash;
#[path = "../front_end.rs"]
mod front_end;
#[path = "../identity.rs"]
mod identity;
#[path = "../lines.rs"]
mod lines;
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
#[path = "../timebase.rs"]
mod timebase;

use chip::Chip;
use duties::Both;
use firmware::{BoardInfo, Route, Sense};
use front_end::FrontEnd;
use protocol::{Pair, PanicText, ResetCause};
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

#[cortex_m_rt::entry]
fn main() -> ! {
    let (Some(core), Some(device)) = (cortex_m::Peripherals::take(), pac::Peripherals::take()) else {
        panic!("started twice");
    };
    chip::start(device, core);
    let mut both = Both(FrontEnd::start(), Chip);
    let mut link = Serial::start();
    let mut found = PanicText::new();
    // The source itself: the strongest signal, in phase whatever is on the sheet.
    let route = Route {
        drive: Pair { plus: 0, minus: 1 },
        sense: Sense::Source,
        gain: 0,
    };
    duties::front_end(&mut both, &route, &INFO, STALL_CYCLES, &mut found);
    duties::clock(&mut both, &mut found);
    let info = BoardInfo {
        last_panic: &found,
        ..INFO
    };
    duties::say(&info, &mut link);
    loop {
        firmware::Watchdog::feed(&mut both.1);
    }
}
