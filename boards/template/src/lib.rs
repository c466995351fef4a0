//! A board to begin a port with: every trait of `firmware`, on the parts of `parts`. docs/port.md says in which order its
//! files become yours.
//!
//! | file | what it has | as it is |
//! |---|---|---|
//! | `pins` | outputs to the multiplexers | a word in memory |
//! | `front_end` | switches, converter and source | four 74HC4067 on those pins, a ring of sixteen equal resistors, computed |
//! | `support` | time, watchdog, settings | time passes with polls; a memory in RAM |
//! | `serial` | the serial port | the UART of QEMU's mps2-an386 |
//!
//! As it is, it keeps every law (`template-laws`) and answers the PC (`template-board`), in QEMU.
#![no_std]

mod front_end;
mod pins;
mod serial;
mod support;

pub use front_end::FrontEnd;
pub use pins::{Pin, Port};
pub use serial::Uart;
pub use support::{Chip, Ram};

use cortex_m_semihosting::{debug, hprintln};
use firmware::BoardInfo;
use protocol::ResetCause;

/// Everything about the board that never changes. docs/port.md explains the numbers.
pub const INFO: BoardInfo<'static> = BoardInfo {
    name: "skin-template",
    serial: "",
    git: "",
    electrodes: 16,
    channels: 1,
    timer_hz: 84_000_000,
    ticks_per_sample: 1425,
    in_turn: 1,
    skew_ticks: 0,
    adc_bits: 12,
    adc_span_uv: 3_300_000,
    excitation_uv: 2_250_000,
    source_gain_milli: 500,
    gains_milli: [1_000, 0, 0, 0],
    reset: ResetCause::PowerOn,
    last_panic: "",
};

const _: () = assert!(INFO.is_sound());

/// A panic ends the machine with an error, after saying where. A board of yours opens its switches here.
#[panic_handler]
fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
    hprintln!("{}", info);
    loop {
        debug::exit(debug::EXIT_FAILURE);
    }
}
