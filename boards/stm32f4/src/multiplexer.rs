//! The four 16-way multiplexers, each two 74HCT4051: three address lines and an enable line for each half.
//!
//! All twelve address lines are on port B and all eight enable lines (low: connected) on port C, so that each group changes in one
//! write. Every change is: all enables off, dead time, addresses, enables on.

use firmware::{ErrorKind, Route, Sense};
use stm32f4xx_hal::pac;

/// Address lines: bit of the lowest of three, on port B.
const SENSE_MINUS: Lines = Lines { address: 0, enable: 0 };
const SENSE_PLUS: Lines = Lines { address: 3, enable: 2 };
const DRIVE_PLUS: Lines = Lines { address: 6, enable: 4 };
const DRIVE_MINUS: Lines = Lines { address: 12, enable: 6 };

const ADDRESS_PINS: u32 = 0b0111_0001_1111_1111;
const ENABLE_PINS: u32 = 0xFF;
/// Port A, pin 8: high while the processor works on a block of samples; for an oscilloscope.
const BUSY_PIN: u32 = 1 << 8;

/// A 4051 lets go within 60 ns and connects within 70 ns at 4.5 V (its data sheet's longest at 25 degrees are 47 and 55):
/// 0.12 us of doing nothing between the steps.
const DEAD_CYCLES: u32 = 20;

/// Electrodes that the multiplexers have.
const ELECTRODES: u8 = 16;

/// Where one multiplexer is wired to.
#[derive(Clone, Copy)]
struct Lines {
    /// Port B, lowest of three.
    address: u32,
    /// Port C: the half with electrodes 0 to 7; the other half is the next pin.
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

/// Makes the pins outputs, with nothing connected.
pub fn start() {
    // SAFETY: this module and `start` of the others are the ports' only users, each of its own pins, before interrupts are on.
    let (a, b, c) = unsafe { (&*pac::GPIOA::ptr(), &*pac::GPIOB::ptr(), &*pac::GPIOC::ptr()) };
    c.bsrr().write(|w| unsafe { w.bits(ENABLE_PINS) });
    c.moder()
        .modify(|r, w| unsafe { w.bits(r.bits() & !spread(ENABLE_PINS, 3) | spread(ENABLE_PINS, 1)) });
    b.moder()
        .modify(|r, w| unsafe { w.bits(r.bits() & !spread(ADDRESS_PINS, 3) | spread(ADDRESS_PINS, 1)) });
    a.moder()
        .modify(|r, w| unsafe { w.bits(r.bits() & !spread(BUSY_PIN, 3) | spread(BUSY_PIN, 1)) });
}

/// Two bits for every pin.
const fn spread(pins: u32, value: u32) -> u32 {
    let (mut out, mut pin) = (0, 0);
    while pin < 16 {
        if pins >> pin & 1 == 1 {
            out |= value << (2 * pin);
        }
        pin += 1;
    }
    out
}

/// Connects a route and nothing else.
///
/// # Errors
/// An electrode that is not there, or a way of sensing that this board has not.
pub fn select(route: &Route) -> Result<(), ErrorKind> {
    let Route { drive, sense, .. } = *route;
    if drive.plus >= ELECTRODES || drive.minus >= ELECTRODES {
        return Err(ErrorKind::Route);
    }
    let mut address = DRIVE_PLUS.address_bits(drive.plus) | DRIVE_MINUS.address_bits(drive.minus);
    let mut enable = DRIVE_PLUS.enable_bit(drive.plus) | DRIVE_MINUS.enable_bit(drive.minus);
    match sense {
        Sense::One(pair) if pair.plus < ELECTRODES && pair.minus < ELECTRODES => {
            #[cfg(feature = "fault-routing")]
            let pair = protocol::Pair {
                plus: pair.plus ^ u8::from(pair.minus == 9),
                ..pair
            };
            address |= SENSE_PLUS.address_bits(pair.plus) | SENSE_MINUS.address_bits(pair.minus);
            enable |= SENSE_PLUS.enable_bit(pair.plus) | SENSE_MINUS.enable_bit(pair.minus);
        }
        Sense::Source => {}
        _ => return Err(ErrorKind::Route),
    }
    // SAFETY: set and reset registers change nothing but these pins.
    let (b, c) = unsafe { (&*pac::GPIOB::ptr(), &*pac::GPIOC::ptr()) };
    if !cfg!(feature = "fault-break") {
        c.bsrr().write(|w| unsafe { w.bits(ENABLE_PINS) });
    }
    cortex_m::asm::delay(DEAD_CYCLES);
    b.bsrr()
        .write(|w| unsafe { w.bits(address | (ADDRESS_PINS & !address) << 16) });
    cortex_m::asm::delay(DEAD_CYCLES);
    c.bsrr()
        .write(|w| unsafe { w.bits(ENABLE_PINS & !enable | enable << 16) });
    Ok(())
}

/// Disconnects everything.
pub fn release() {
    // SAFETY: as in `select`.
    let c = unsafe { &*pac::GPIOC::ptr() };
    c.bsrr().write(|w| unsafe { w.bits(ENABLE_PINS) });
}

/// Says that work on a block begins.
pub fn work() {
    // SAFETY: as in `select`.
    let a = unsafe { &*pac::GPIOA::ptr() };
    a.bsrr().write(|w| unsafe { w.bits(BUSY_PIN) });
}

/// Says that there is nothing to do.
pub fn rest() {
    // SAFETY: as in `select`.
    let a = unsafe { &*pac::GPIOA::ptr() };
    a.bsrr().write(|w| unsafe { w.bits(BUSY_PIN << 16) });
}
