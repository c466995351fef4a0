//! The program of the sensor board with sixteen channels, for an STM32H743 (NUCLEO-H743ZI2).
//!
//! This crate implements the traits of the library `firmware` with the registers of the chip. The library has all of the
//! logic. What depends on no register is the STM32F4 board's own file.
//!
//! - [docs/architecture.md](../../../docs/architecture.md): what each crate is for, and the way of a frame
//! - [docs/board.md](../../../docs/board.md): pins, circuit, how to build and program the board
//! - [docs/firmware.md](../../../docs/firmware.md): the traits, and what the library does with them
//!
//! `RM0433` in comments is ST's reference manual of the chip, `DS12110` its data sheet, `ES0392` its errata.
#![no_std]
#![no_main]

use stm32h7_pac::stm32h743v as pac;

#[macro_use]
#[path = "../../stm32f4/src/log.rs"]
mod log;

mod chip;
#[path = "../../stm32f4/src/clock_search.rs"]
mod clock_search;
mod clocks;
mod converter;
mod dac;
mod dma;
mod flash;
mod front_end;
#[path = "../../stm32f4/src/identity.rs"]
mod identity;
#[path = "../../stm32f4/src/light.rs"]
mod light;
mod lines;
#[path = "../../stm32f4/src/multiplexer.rs"]
mod multiplexer;
#[path = "../../stm32f4/src/panic_record.rs"]
mod panic_record;
#[path = "../../stm32f4/src/ring.rs"]
mod ring;
mod sampler;
mod serial;
#[path = "../../stm32f4/src/sine.rs"]
mod sine;
#[path = "../../stm32f4/src/source.rs"]
mod source;
mod supply;
#[path = "../../stm32f4/src/timebase.rs"]
mod timebase;

use chip::Chip;
use cortex_m_rt::entry;
use firmware::{Activity, BoardInfo, Controller, Memory};
use front_end::FrontEnd;
use panic_record::{Past, Report};
use protocol::{Plan, PlanError, ResetCause};
use serial::Serial;

/// Everything about the board that never changes.
const INFO: BoardInfo<'static> = BoardInfo {
    name: "skin-stm32h743",
    serial: "",
    git: env!("SKIN_GIT"),
    electrodes: 16,
    channels: 16,
    timer_hz: sampler::TIMER_HZ,
    ticks_per_sample: sampler::TICKS_PER_SAMPLE,
    in_turn: 8,
    skew_ticks: sampler::SKEW_TICKS,
    adc_bits: 16,
    adc_span_uv: 3_300_000,
    excitation_uv: 2_250_000,
    // With the filters' loss; hardware/sixteen.py holds them.
    source_gain_milli: 288,
    gains_milli: [12_600, 588, 0, 0],
    reset: ResetCause::Unknown,
    last_panic: "",
};

const _: () = assert!(INFO.is_sound());
// The filters are for the paper's 3.685 kHz: within 0.05 %.
const _: () = assert!(INFO.excitation_millihertz().abs_diff(3_685_000) <= 3_685_000 / 2000);

/// Which chip the image is for, in words that `skin flash` looks for.
static IMAGE_TAG: &[u8] = b"skin-board-image for chip 0x450";

#[entry]
fn main() -> ! {
    // All that is large. These are statics since the stack has no room for them; `entry` lends them to `main` alone.
    static mut MEMORY: Memory = Memory::new();
    static mut SERIAL_NUMBER: [u8; 24] = [0; 24];
    static mut LAST_PANIC: Option<Report> = None;
    let mut started = start(MEMORY, SERIAL_NUMBER, LAST_PANIC);
    // Lent, not taken out: a copy would cost the stack as much again.
    let Ok(board) = &mut started else {
        panic!("the first plan does not suit the board");
    };
    board.start_up();
    // Nothing reads it here; without this the linker would leave it out.
    core::hint::black_box(IMAGE_TAG);
    panic_record::planted();
    loop {
        #[cfg(feature = "defmt")]
        log::tell(board.counters());
        #[cfg(feature = "fault-hang")]
        panic_record::hang_later(firmware::Clock::now(board.support_mut()));
        if board.poll() == Activity::Idle {
            multiplexer::rest(light::is_on(state(board)));
        }
    }
}

/// What the light tells of the board.
fn state(board: &Board) -> light::State {
    if board.running() {
        light::State::Measuring
    } else if board.counters().front_end_faults > 0 {
        // What failed was told and stopped it; the next start clears nothing, but measures or fails again.
        light::State::Fault
    } else {
        light::State::Alive
    }
}

type Board = Controller<'static, FrontEnd, Serial, Chip, &'static mut Memory>;

/// Once; in a function of its own so that the loop's stack need not hold what it leaves behind.
#[inline(never)]
fn start(
    memory: &'static mut Memory,
    serial_number: &'static mut [u8; 24],
    last_panic: &'static mut Option<Report>,
) -> Result<Board, PlanError> {
    let (Some(mut core), Some(device)) = (cortex_m::Peripherals::take(), pac::Peripherals::take()) else {
        panic!("started twice");
    };
    let started = chip::start(&device, &mut core);
    let mut info = BoardInfo {
        serial: identity::serial_number(serial_number),
        reset: started.cause,
        last_panic: started.note,
        ..INFO
    };
    // Taken only now, so that it stays if the start does not succeed.
    match panic_record::take() {
        Some(Past::Panic(report)) => {
            info.reset = ResetCause::Panic;
            info.last_panic = last_panic.insert(report).text();
        }
        Some(Past::Sag) => info.reset = ResetCause::BrownOut,
        None => {}
    }
    log!(info, "reset: {}; {=str}", info.reset, info.last_panic);
    // All pairs of a drive at once, a period to settle and one to integrate, until the host says otherwise.
    Controller::asleep(info, Plan::fast(), FrontEnd::start(), Serial::start(), Chip, memory)
}
