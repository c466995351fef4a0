//! The traits of the library `firmware` on QEMU's machine `mps2-an386`, a Cortex-M4F. The programs of this crate run the
//! firmware in emulation, with the simulated skin of the PC as their front end.
//!
//! Routes, windows and samples go through two named pipes by semihosting, one block at a time. The serial line is the machine's
//! first UART. Simulated time passes only while the board waits for a block: the frames are the same however slow the PC is.
//!
//! - [docs/architecture.md](../../../docs/architecture.md): what each crate is for, and the way of a frame
//! - [docs/firmware.md](../../../docs/firmware.md): the traits, and what the library does with them
//! - [docs/board.md](../../../docs/board.md): the board that can be built, which is the crate `stm32f4`
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
