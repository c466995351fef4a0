//! Which pins lead where. All twelve address lines are on port B, all eight enable lines on port C.

use crate::multiplexer::Lines;
use crate::pac;

/// Address lines: bit of the lowest of three.
pub const SENSE_MINUS: Lines = Lines { address: 0, enable: 0 };
pub const SENSE_PLUS: Lines = Lines { address: 3, enable: 2 };
pub const DRIVE_PLUS: Lines = Lines { address: 6, enable: 4 };
pub const DRIVE_MINUS: Lines = Lines { address: 12, enable: 6 };

pub const ADDRESS_PINS: u32 = 0b0111_0001_1111_1111;
pub const ENABLE_PINS: u32 = 0xFF;
/// Port A, pin 8: high while the processor works on a block of samples; for an oscilloscope.
pub const BUSY_PIN: u32 = 1 << 8;
/// Port A, pin 5: the Nucleo's green light LD2, on when high.
pub const LIGHT_PIN: u32 = 1 << 5;

/// Processor cycles between two steps of a change: 0.12 us at 168 MHz.
pub const DEAD_CYCLES: u32 = 20;

/// The registers of a port.
pub type Port = pac::gpioa::RegisterBlock;

fn ports() -> [&'static Port; 3] {
    // SAFETY: the addresses are those of the ports' registers, which are the same ones in the same places for every
    // port (RM0390 section 7.4, RM0090 section 8.4). The module `multiplexer`, which is the only one that asks, changes the
    // pins above only: at run time by a register that leaves all others alone, and in `start`, before interrupts are on, by
    // reading, changing and writing the mode register.
    unsafe {
        [
            &*pac::GPIOA::ptr(),
            &*pac::GPIOB::ptr().cast(),
            &*pac::GPIOC::ptr().cast(),
        ]
    }
}

/// The port of the address lines.
pub fn addresses() -> &'static Port {
    ports()[1]
}

/// The port of the enable lines.
pub fn enables() -> &'static Port {
    ports()[2]
}

/// The port of the light and of what is for an oscilloscope.
pub fn signals() -> &'static Port {
    ports()[0]
}

/// Whether there are amplifiers for all pairs of electrodes so far apart: for none.
pub fn senses_all(_step: u8) -> bool {
    false
}
