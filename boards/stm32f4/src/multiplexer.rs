//! The four 16-way multiplexers, each two 74HCT4051: three address lines and an enable line for each half.
//!
//! All twelve address lines are on one port, all eight enable lines (low: connected) on another: `lines` says which. Each group
//! therefore changes in one write. Every change of route is: all enables off, dead time, addresses, dead time, enables on.
//! Amplifiers that are always connected to their pairs need none.
//!
//! A 74HCT4051 lets go within 60 ns and connects within 70 ns at 4.5 V. The longest times in its data sheet are 47 ns and 55 ns,
//! at 25 degrees.

use crate::lines::{
    ADDRESS_PINS, BUSY_PIN, DEAD_CYCLES, DRIVE_MINUS, DRIVE_PLUS, ENABLE_PINS, LIGHT_PIN, Port, SENSE_MINUS,
    SENSE_PLUS, addresses, enables, senses_all, signals,
};
use firmware::{ErrorKind, Route, Sense};

/// Electrodes that the multiplexers have.
const ELECTRODES: u8 = 16;

/// Where one multiplexer is wired to.
#[derive(Clone, Copy)]
pub struct Lines {
    /// The lowest of three address lines.
    pub address: u32,
    /// Enable line of the half with electrodes 0 to 7; the other half is the next pin.
    pub enable: u32,
}

impl Lines {
    fn address_bits(self, electrode: u8) -> u32 {
        u32::from(electrode & 7) << self.address
    }

    fn enable_bit(self, electrode: u8) -> u32 {
        1 << (self.enable + u32::from(electrode >> 3))
    }
}

/// Makes the pins outputs, with nothing connected.
pub fn start() {
    set_levels(enables(), ENABLE_PINS, 0);
    make_outputs(enables(), ENABLE_PINS);
    make_outputs(addresses(), ADDRESS_PINS);
    make_outputs(signals(), BUSY_PIN | LIGHT_PIN);
}

/// Sets some pins of a port and resets others, in one write.
fn set_levels(port: &Port, set: u32, reset: u32) {
    // SAFETY: the register takes any value. A one in its lower half sets a pin, in its upper half it resets one; zeros
    // do nothing (RM0390 section 7.4.7, RM0090 section 8.4.7, RM0433 section 11.4.7).
    port.bsrr().write(|w| unsafe { w.bits(set | reset << 16) });
}

fn make_outputs(port: &Port, pins: u32) {
    port.moder().modify(|_, w| {
        (0..16)
            .filter(|pin| pins >> pin & 1 == 1)
            .fold(w, |w, pin| w.moder(pin).output())
    });
}

/// Connects a route and nothing else.
///
/// # Errors
/// An electrode that is not there, or a way of sensing that this board has not.
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
    if !cfg!(feature = "fault-break") {
        set_levels(enables(), ENABLE_PINS, 0);
    }
    cortex_m::asm::delay(DEAD_CYCLES);
    set_levels(addresses(), address, ADDRESS_PINS & !address);
    cortex_m::asm::delay(DEAD_CYCLES);
    set_levels(enables(), ENABLE_PINS & !enable, enable);
    Ok(())
}

/// Disconnects everything.
pub fn release() {
    set_levels(enables(), ENABLE_PINS, 0);
}

/// Says that work on a block begins.
pub fn work() {
    set_levels(signals(), BUSY_PIN, 0);
}

/// Says that there is nothing to do, and switches the light.
pub fn rest(light: bool) {
    if light {
        set_levels(signals(), LIGHT_PIN, BUSY_PIN);
    } else {
        set_levels(signals(), 0, BUSY_PIN | LIGHT_PIN);
    }
}
