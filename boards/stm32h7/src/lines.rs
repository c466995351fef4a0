//! Which pins lead where. All twelve address lines are on port E, all eight enable lines on port D.

use crate::multiplexer::Lines;
use crate::pac;

/// Address lines: bit of the lowest of three.
pub const SENSE_MINUS: Lines = Lines { address: 2, enable: 0 };
pub const SENSE_PLUS: Lines = Lines { address: 5, enable: 2 };
pub const DRIVE_PLUS: Lines = Lines { address: 8, enable: 4 };
pub const DRIVE_MINUS: Lines = Lines { address: 11, enable: 6 };

pub const ADDRESS_PINS: u32 = 0b0011_1111_1111_1100;
pub const ENABLE_PINS: u32 = 0xFF;
/// Port E, pin 14: high while the processor works on a block of samples; for an oscilloscope.
pub const BUSY_PIN: u32 = 1 << 14;
/// Port E, pin 1: the Nucleo's yellow light LD2, on when high.
pub const LIGHT_PIN: u32 = 1 << 1;

/// Processor cycles between two steps of a change: 0.12 us at 400 MHz.
pub const DEAD_CYCLES: u32 = 48;

/// The registers of a port.
pub type Port = pac::gpioe::RegisterBlock;

/// The port of the address lines.
pub fn addresses() -> &'static Port {
    // SAFETY: the address is that of the port's registers. The module `multiplexer`, which is the only one that asks, changes
    // the pins above only: at run time by a register that leaves all others alone, and in `start`, before interrupts are on,
    // by reading, changing and writing the mode register.
    unsafe { &*pac::GPIOE::ptr() }
}

/// The port of the enable lines.
pub fn enables() -> &'static Port {
    // SAFETY: as of `addresses`.
    unsafe { &*pac::GPIOD::ptr() }
}

/// The port of the light and of what is for an oscilloscope.
pub fn signals() -> &'static Port {
    addresses()
}

/// Whether there are amplifiers for all pairs of electrodes so far apart: for neighbours alone.
pub fn senses_all(step: u8) -> bool {
    step == 1
}
