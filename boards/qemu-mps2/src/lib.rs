//! The firmware's traits on QEMU's `mps2-an386` machine. Routes, windows and samples go through two named pipes by
//! semihosting, a block at a time; the serial line is the machine's first UART.
//!
//! Simulated time passes only while the board waits for a block: however slow the PC is, the frames are the same.
#![no_std]

mod chip;
mod front_end;
mod pipe;
mod uart;

pub use chip::Chip;
pub use front_end::RemoteFrontEnd;
pub use pipe::{Pipe, PipeError};
pub use uart::Uart;

use cortex_m_semihosting::{debug, hprintln};

/// A panic ends the machine with an error, after saying where.
#[panic_handler]
fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
    hprintln!("{}", info);
    loop {
        debug::exit(debug::EXIT_FAILURE);
    }
}
