//! The serial port to the host, 1 Mbit/s: USART1 on PA9 (out) and PA10 (in), where the chip's own bootloader listens too; with
//! the feature `st-link` USART2 on PA2 and PA3, which a Nucleo's debugger makes a serial port of its USB.
//! Bytes go out by DMA from two buffers in turn and come in by interrupt.

use crate::ring::Shared;
use core::sync::atomic::{AtomicBool, AtomicU8, AtomicUsize, Ordering};
use embedded_hal_nb::serial;
use stm32f4xx_hal::interrupt;
use stm32f4xx_hal::pac;

/// Bytes of each transmit buffer: 0.64 ms.
const CHUNK: usize = 64;
static OUT: [Shared<u8, CHUNK>; 2] = [Shared::new(0), Shared::new(0)];

/// Bytes received and not taken: 1.28 ms.
const RECEIVED: usize = 128;
static IN: [AtomicU8; RECEIVED] = [const { AtomicU8::new(0) }; RECEIVED];
/// How many were ever put in (by the interrupt) and taken out (by the main loop).
static PUT: AtomicUsize = AtomicUsize::new(0);
static TAKEN: AtomicUsize = AtomicUsize::new(0);
/// A byte was lost or damaged since the last read.
static DAMAGED: AtomicBool = AtomicBool::new(false);

/// The port.
pub struct Serial {
    /// The buffer that is being filled, and how far.
    filling: usize,
    filled: usize,
}

/// Which port: its registers, and how it is wired inside the chip.
#[cfg(not(feature = "st-link"))]
mod port {
    pub use super::pac::{DMA2 as Dma, USART1 as Usart};
    /// The interrupt.
    pub const INTERRUPT: super::pac::Interrupt = super::pac::Interrupt::USART1;
    /// Stream of the transmitter, and where its flags begin in the upper flag register. Its channel is 4.
    pub const STREAM: usize = 7;
    pub const FLAGS: u32 = 22;
    /// 84 MHz / 84.
    pub const DIVISOR: u16 = 84;
    /// Pin of port A that transmits; the next one receives.
    pub const PIN: u32 = 9;
}

/// Which port: its registers, and how it is wired inside the chip.
#[cfg(feature = "st-link")]
mod port {
    pub use super::pac::{DMA1 as Dma, USART2 as Usart};
    /// The interrupt.
    pub const INTERRUPT: super::pac::Interrupt = super::pac::Interrupt::USART2;
    /// Stream of the transmitter, and where its flags begin in the upper flag register. Its channel is 4.
    pub const STREAM: usize = 6;
    pub const FLAGS: u32 = 16;
    /// 42 MHz / 42.
    pub const DIVISOR: u16 = 42;
    /// Pin of port A that transmits; the next one receives.
    pub const PIN: u32 = 2;
}

fn registers() -> (&'static pac::usart1::RegisterBlock, &'static pac::dma2::RegisterBlock) {
    // SAFETY: the port and the stream are this module's alone; of the controller it writes no register that others write, save
    // the flags' clear registers, which do nothing to bits written 0.
    unsafe { (&*port::Usart::ptr(), &*port::Dma::ptr()) }
}

impl Serial {
    /// Sets pins, port and DMA up, and lets bytes in.
    pub fn start() -> Self {
        // SAFETY: these pins are this module's alone; `start` runs before interrupts of it are on.
        let gpio = unsafe { &*pac::GPIOA::ptr() };
        // Alternate function 7 on both pins, with a pull-up on the receiver's: an open line is idle.
        let function = |bits: u32| {
            let shift = 4 * (port::PIN % 8);
            bits & !(0xFF << shift) | 0x77 << shift
        };
        if port::PIN < 8 {
            gpio.afrl().modify(|r, w| unsafe { w.bits(function(r.bits())) });
        } else {
            gpio.afrh().modify(|r, w| unsafe { w.bits(function(r.bits())) });
        }
        let two = 2 * port::PIN;
        gpio.pupdr()
            .modify(|r, w| unsafe { w.bits(r.bits() & !(0xF << two) | 0b0100 << two) });
        gpio.ospeedr()
            .modify(|r, w| unsafe { w.bits(r.bits() & !(3 << two) | 2 << two) });
        gpio.moder()
            .modify(|r, w| unsafe { w.bits(r.bits() & !(0xF << two) | 0b1010 << two) });
        let (usart, dma) = registers();
        usart.brr().write(|w| unsafe { w.bits(port::DIVISOR) });
        // DMA for what goes out.
        usart.cr3().write(|w| unsafe { w.bits(1 << 7) });
        // On, interrupt on reception, transmitter, receiver.
        usart
            .cr1()
            .write(|w| unsafe { w.bits(1 << 13 | 1 << 5 | 1 << 3 | 1 << 2) });
        dma.st(port::STREAM)
            .par()
            .write(|w| unsafe { w.bits(usart.dr().as_ptr() as u32) });
        // SAFETY: everything that the interrupt uses is set up.
        unsafe { cortex_m::peripheral::NVIC::unmask(port::INTERRUPT) };
        Self { filling: 0, filled: 0 }
    }

    /// Sends what was filled, if nothing is on its way.
    fn kick(&mut self) {
        let (_, dma) = registers();
        let stream = dma.st(port::STREAM);
        if self.filled == 0 || stream.cr().read().bits() & 1 != 0 {
            return;
        }
        dma.hifcr().write(|w| unsafe { w.bits(0x3D << port::FLAGS) });
        let buffer = OUT.get(self.filling).unwrap_or(&OUT[0]);
        stream.m0ar().write(|w| unsafe { w.bits(buffer.address()) });
        stream.ndtr().write(|w| unsafe { w.bits(self.filled as u32) });
        // Channel 4, bytes, memory incremented, from memory; enabled.
        stream.cr().write(|w| unsafe { w.bits(4 << 25 | 1 << 10 | 1 << 6 | 1) });
        self.filling ^= 1;
        self.filled = 0;
    }
}

impl serial::ErrorType for Serial {
    type Error = serial::ErrorKind;
}

impl serial::Read for Serial {
    fn read(&mut self) -> nb::Result<u8, serial::ErrorKind> {
        // Asked in every round of the main loop: what is filled by halves leaves when the line is free.
        self.kick();
        let taken = TAKEN.load(Ordering::Relaxed);
        if taken == PUT.load(Ordering::Acquire) {
            if DAMAGED.swap(false, Ordering::Relaxed) {
                return Err(nb::Error::Other(serial::ErrorKind::Overrun));
            }
            return Err(nb::Error::WouldBlock);
        }
        let byte = IN.get(taken % RECEIVED).map_or(0, |b| b.load(Ordering::Relaxed));
        TAKEN.store(taken.wrapping_add(1), Ordering::Release);
        Ok(byte)
    }
}

impl serial::Write for Serial {
    fn write(&mut self, byte: u8) -> nb::Result<(), serial::ErrorKind> {
        if self.filled >= CHUNK {
            self.kick();
        }
        if self.filled >= CHUNK {
            return Err(nb::Error::WouldBlock);
        }
        if let Some(buffer) = OUT.get(self.filling) {
            buffer.write(self.filled, byte);
        }
        self.filled += 1;
        Ok(())
    }

    fn flush(&mut self) -> nb::Result<(), serial::ErrorKind> {
        self.kick();
        let (usart, dma) = registers();
        let busy = self.filled > 0
            || dma.st(port::STREAM).cr().read().bits() & 1 != 0
            || usart.sr().read().bits() & 1 << 6 == 0;
        if busy { Err(nb::Error::WouldBlock) } else { Ok(()) }
    }
}

#[cfg(not(feature = "st-link"))]
#[interrupt]
fn USART1() {
    received();
}

#[cfg(feature = "st-link")]
#[interrupt]
fn USART2() {
    received();
}

/// Takes a byte in.
#[inline]
fn received() {
    let (usart, _) = registers();
    // Reading status and data in this order takes the byte and clears every error.
    let status = usart.sr().read().bits();
    let byte = usart.dr().read().bits() as u8;
    const RECEIVED_ONE: u16 = 1 << 5;
    const ERRORS: u16 = 0b1111;
    if status & ERRORS != 0 {
        DAMAGED.store(true, Ordering::Relaxed);
    }
    if status & RECEIVED_ONE == 0 {
        return;
    }
    let put = PUT.load(Ordering::Relaxed);
    if put.wrapping_sub(TAKEN.load(Ordering::Acquire)) >= RECEIVED {
        DAMAGED.store(true, Ordering::Relaxed);
        return;
    }
    if let Some(place) = IN.get(put % RECEIVED) {
        place.store(byte, Ordering::Relaxed);
    }
    PUT.store(put.wrapping_add(1), Ordering::Release);
}
