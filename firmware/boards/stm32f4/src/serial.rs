//! The serial port to the host, 1 Mbit/s: USART1 on PA9 (out) and PA10 (in), where the chip's own bootloader listens too.
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

fn registers() -> (&'static pac::usart1::RegisterBlock, &'static pac::dma2::RegisterBlock) {
    // SAFETY: USART1 and stream 7 of DMA2 are this module's alone; of DMA2 it writes no register that others write, save the
    // flags' clear registers, which do nothing to bits written 0.
    unsafe { (&*pac::USART1::ptr(), &*pac::DMA2::ptr()) }
}

impl Serial {
    /// Sets pins, port and DMA up, and lets bytes in.
    pub fn start() -> Self {
        // SAFETY: these pins are this module's alone; `start` runs before interrupts of it are on.
        let port = unsafe { &*pac::GPIOA::ptr() };
        // Alternate function 7 on PA9 and PA10, with a pull-up on the latter: an open line is idle.
        port.afrh().modify(|r, w| unsafe { w.bits(r.bits() & !0xFF0 | 0x770) });
        port.pupdr()
            .modify(|r, w| unsafe { w.bits(r.bits() & !(3 << 20) | 1 << 20) });
        port.ospeedr().modify(|r, w| unsafe { w.bits(r.bits() | 2 << 18) });
        port.moder()
            .modify(|r, w| unsafe { w.bits(r.bits() & !(0xF << 18) | 0xA << 18) });
        let (usart, dma) = registers();
        // 84 MHz / 84.
        usart.brr().write(|w| unsafe { w.bits(84) });
        // DMA for what goes out.
        usart.cr3().write(|w| unsafe { w.bits(1 << 7) });
        // On, interrupt on reception, transmitter, receiver.
        usart
            .cr1()
            .write(|w| unsafe { w.bits(1 << 13 | 1 << 5 | 1 << 3 | 1 << 2) });
        dma.st(7).par().write(|w| unsafe { w.bits(usart.dr().as_ptr() as u32) });
        // SAFETY: everything that the interrupt uses is set up.
        unsafe { cortex_m::peripheral::NVIC::unmask(pac::Interrupt::USART1) };
        Self { filling: 0, filled: 0 }
    }

    /// Sends what was filled, if nothing is on its way.
    fn kick(&mut self) {
        let (_, dma) = registers();
        let stream = dma.st(7);
        if self.filled == 0 || stream.cr().read().bits() & 1 != 0 {
            return;
        }
        dma.hifcr().write(|w| unsafe { w.bits(0x3D << 22) });
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
        let busy = self.filled > 0 || dma.st(7).cr().read().bits() & 1 != 0 || usart.sr().read().bits() & 1 << 6 == 0;
        if busy { Err(nb::Error::WouldBlock) } else { Ok(()) }
    }
}

#[interrupt]
fn USART1() {
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
