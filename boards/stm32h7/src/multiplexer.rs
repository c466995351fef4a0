//! The four 16-way multiplexers, each two 74HCT4051: three address lines and an enable line for each half. The sixteen
//! amplifiers of the electrodes' neighbouring pairs need none.
//!
//! All twelve address lines are on port E. All eight enable lines (low: connected) are on port D. Each group therefore
//! changes in one write. Every change of route is: all enables off, dead time, addresses, dead time, enables on.

use crate::pac;
use firmware::{ErrorKind, Route, Sense};

/// Address lines: bit of the lowest of three, on port E.
const SENSE_MINUS: Lines = Lines { address: 2, enable: 0 };
const SENSE_PLUS: Lines = Lines { address: 5, enable: 2 };
const DRIVE_PLUS: Lines = Lines { address: 8, enable: 4 };
const DRIVE_MINUS: Lines = Lines { address: 11, enable: 6 };

const ADDRESS_PINS: u32 = 0b0011_1111_1111_1100;
const ENABLE_PINS: u32 = 0xFF;
/// Port E, pin 14: high while the processor works on a block of samples; for an oscilloscope.
const BUSY_PIN: u32 = 1 << 14;
/// Port E, pin 1: the Nucleo's yellow light LD2, on when high.
const LIGHT_PIN: u32 = 1 << 1;

/// Processor cycles between two steps of a change: 0.12 us.
///
/// A 74HCT4051 lets go within 60 ns and connects within 70 ns at 4.5 V. The longest times in its data sheet are 47 ns
/// and 55 ns, at 25 degrees.
const DEAD_CYCLES: u32 = 48;

/// Electrodes that the multiplexers have.
const ELECTRODES: u8 = 16;

/// Where one multiplexer is wired to.
#[derive(Clone, Copy)]
struct Lines {
    /// Port E, lowest of three.
    address: u32,
    /// Port D: the half with electrodes 0 to 7; the other half is the next pin.
    enable: u32,
}

impl Lines {
    fn address_bits(self, electrode: u8) -> u32 {
        u32::from(electrode & 7) << self.address
    }

    fn enable_bit(self, electrode: u8) -> u32 {
        1 << (self.enable + u32::from(electrode >> 3))
    }
}

/// The registers of ports D and E.
type Port = pac::gpioe::RegisterBlock;

/// Ports D and E.
fn ports() -> [&'static Port; 2] {
    // SAFETY: the addresses are those of the ports' registers. This module changes its own pins only: at run time by a
    // register that leaves all others alone, and in `start`, before interrupts are on, by reading, changing and writing
    // the mode register.
    unsafe { [&*pac::GPIOD::ptr(), &*pac::GPIOE::ptr()] }
}

/// Makes the pins outputs, with nothing connected.
pub fn start() {
    let [d, e] = ports();
    set_levels(d, ENABLE_PINS, 0);
    make_outputs(d, ENABLE_PINS);
    make_outputs(e, ADDRESS_PINS | BUSY_PIN | LIGHT_PIN);
}

/// Sets some pins of a port and resets others, in one write.
fn set_levels(port: &Port, set: u32, reset: u32) {
    // SAFETY: the register takes any value. A one in its lower half sets a pin, in its upper half it resets one; zeros
    // do nothing (RM0433 section 11.4.7).
    port.bsrr().write(|w| unsafe { w.bits(set | reset << 16) });
}

fn make_outputs(port: &Port, pins: u32) {
    port.moder().modify(|_, w| {
        (0..16)
            .filter(|pin| pins >> pin & 1 == 1)
            .fold(w, |w, pin| w.moder(pin).output())
    });
}

/// Whether the sixteen amplifiers are wired to pairs of electrodes so far apart: neighbours alone.
pub fn senses_all(step: u8) -> bool {
    step == 1
}

/// Connects a route and nothing else.
///
/// # Errors
/// An electrode that is not there, or a way of sensing that this board has not: its sixteen amplifiers are wired to
/// neighbours.
pub fn select(route: &Route) -> Result<(), ErrorKind> {
    let Route { drive, sense, .. } = *route;
    #[cfg(feature = "fault-routing")]
    let drive = protocol::Pair {
        plus: drive.plus ^ u8::from(drive.minus == 9),
        ..drive
    };
    if drive.plus >= ELECTRODES || drive.minus >= ELECTRODES {
        return Err(ErrorKind::Route);
    }
    let mut address = DRIVE_PLUS.address_bits(drive.plus) | DRIVE_MINUS.address_bits(drive.minus);
    let mut enable = DRIVE_PLUS.enable_bit(drive.plus) | DRIVE_MINUS.enable_bit(drive.minus);
    match sense {
        Sense::One(pair) if pair.plus < ELECTRODES && pair.minus < ELECTRODES => {
            address |= SENSE_PLUS.address_bits(pair.plus) | SENSE_MINUS.address_bits(pair.minus);
            enable |= SENSE_PLUS.enable_bit(pair.plus) | SENSE_MINUS.enable_bit(pair.minus);
        }
        Sense::Source => {}
        Sense::All { step } if senses_all(step) => {}
        _ => return Err(ErrorKind::Route),
    }
    let [d, e] = ports();
    if !cfg!(feature = "fault-break") {
        set_levels(d, ENABLE_PINS, 0);
    }
    cortex_m::asm::delay(DEAD_CYCLES);
    set_levels(e, address, ADDRESS_PINS & !address);
    cortex_m::asm::delay(DEAD_CYCLES);
    set_levels(d, ENABLE_PINS & !enable, enable);
    Ok(())
}

/// Disconnects everything.
pub fn release() {
    let [d, _] = ports();
    set_levels(d, ENABLE_PINS, 0);
}

/// Says that work on a block begins.
pub fn work() {
    let [_, e] = ports();
    set_levels(e, BUSY_PIN, 0);
}

/// Says that there is nothing to do, and switches the light.
pub fn rest(light: bool) {
    let [_, e] = ports();
    if light {
        set_levels(e, LIGHT_PIN, BUSY_PIN);
    } else {
        set_levels(e, 0, BUSY_PIN | LIGHT_PIN);
    }
}
