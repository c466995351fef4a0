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
    use super::pac::dma2::hifcr::W as Flags;
    pub use super::pac::{DMA2 as Dma, USART1 as Usart};
    /// The interrupt.
    pub const INTERRUPT: super::pac::Interrupt = super::pac::Interrupt::USART1;
    /// Stream of the transmitter. Its channel is 4.
    pub const STREAM: usize = 7;
    /// 84 MHz / 84.
    pub const DIVISOR: u16 = 84;
    /// Pin of port A that transmits; the next one receives.
    pub const PIN: u8 = 9;

    /// Clears all flags of the stream.
    pub fn clear(w: &mut Flags) -> &mut Flags {
        w.cfeif7().clear().cdmeif7().clear().cteif7().clear();
        w.chtif7().clear().ctcif7().clear()
    }
}

/// Which port: its registers, and how it is wired inside the chip.
#[cfg(feature = "st-link")]
mod port {
    use super::pac::dma2::hifcr::W as Flags;
    pub use super::pac::{DMA1 as Dma, USART2 as Usart};
    /// The interrupt.
    pub const INTERRUPT: super::pac::Interrupt = super::pac::Interrupt::USART2;
    /// Stream of the transmitter. Its channel is 4.
    pub const STREAM: usize = 6;
    /// 42 MHz / 42.
    pub const DIVISOR: u16 = 42;
    /// Pin of port A that transmits; the next one receives.
    pub const PIN: u8 = 2;

    /// Clears all flags of the stream.
    pub fn clear(w: &mut Flags) -> &mut Flags {
        w.cfeif6().clear().cdmeif6().clear().cteif6().clear();
        w.chtif6().clear().ctcif6().clear()
    }
}

fn registers() -> (&'static pac::usart1::RegisterBlock, &'static pac::dma2::RegisterBlock) {
    // SAFETY: the addresses are those of the registers. The port and the stream are this module's alone. Of the DMA controller
    // it writes no register that others write but one that clears flags; zeros there do nothing.
    unsafe { (&*port::Usart::ptr(), &*port::Dma::ptr()) }
}

impl Serial {
    /// Sets pins, port and DMA up, and lets bytes in.
    pub fn start() -> Self {
        // SAFETY: the address is that of the port's registers. Both pins are this module's alone. Other modules change the same
        // registers in their `start` only, one after the other, and no interrupt handler does.
        let gpio = unsafe { &*pac::GPIOA::ptr() };
        // Alternate function 7 on both pins, with a pull-up on the receiver's: an open line is idle.
        const OUT_PIN: u8 = port::PIN;
        const IN_PIN: u8 = port::PIN + 1;
        if OUT_PIN < 8 {
            gpio.afrl()
                .modify(|_, w| w.afr(OUT_PIN % 8).af7().afr(IN_PIN % 8).af7());
        } else {
            gpio.afrh()
                .modify(|_, w| w.afr(OUT_PIN % 8).af7().afr(IN_PIN % 8).af7());
        }
        gpio.pupdr()
            .modify(|_, w| w.pupdr(OUT_PIN).floating().pupdr(IN_PIN).pull_up());
        gpio.ospeedr().modify(|_, w| w.ospeedr(OUT_PIN).high_speed());
        gpio.moder()
            .modify(|_, w| w.moder(OUT_PIN).alternate().moder(IN_PIN).alternate());
        let (usart, dma) = registers();
        usart.brr().write(|w| {
            w.div_mantissa()
                .set(port::DIVISOR / 16)
                .div_fraction()
                .set((port::DIVISOR % 16) as u8)
        });
        // DMA for what goes out, an interrupt for every byte that comes in.
        usart.cr3().write(|w| w.dmat().enabled());
        usart
            .cr1()
            .write(|w| w.ue().enabled().rxneie().enabled().te().enabled().re().enabled());
        // SAFETY: the stream, off until `kick`, will write the transmitter's data register, which takes any byte.
        dma.st(port::STREAM)
            .par()
            .write(|w| unsafe { w.pa().bits(usart.dr().as_ptr() as u32) });
        // SAFETY: everything that the interrupt handler uses is set up, and no critical section relies on this interrupt being off.
        unsafe { cortex_m::peripheral::NVIC::unmask(port::INTERRUPT) };
        Self { filling: 0, filled: 0 }
    }

    /// Sends what was filled, if nothing is on its way.
    fn kick(&mut self) {
        let (_, dma) = registers();
        let stream = dma.st(port::STREAM);
        if self.filled == 0 || stream.cr().read().en().is_enabled() {
            return;
        }
        dma.hifcr().write(port::clear);
        let buffer = OUT.get(self.filling).unwrap_or(&OUT[0]);
        // SAFETY: the stream will read `filled` bytes of the buffer, which is a static and has as many. They are not written until
        // the stream is off again: the other buffer is filled meanwhile.
        stream.m0ar().write(|w| unsafe { w.m0a().bits(buffer.address()) });
        stream.ndtr().write(|w| w.ndt().set(self.filled as u16));
        // From memory to the transmitter, byte by byte.
        stream.cr().write(|w| {
            w.chsel().set(4).dir().memory_to_peripheral();
            w.minc().incremented().en().enabled()
        });
        self.filling ^= 1;
        self.filled = 0;
    }
}

impl serial::ErrorType for Serial {
    type Error = serial::ErrorKind;
}

impl serial::Read for Serial {
    fn read(&mut self) -> nb::Result<u8, serial::ErrorKind> {
        // The main loop reads in every round. A buffer that is not full yet leaves as soon as the line is free.
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
            || dma.st(port::STREAM).cr().read().en().is_enabled()
            || usart.sr().read().tc().is_tx_not_complete();
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
    let status = usart.sr().read();
    let byte = usart.dr().read().dr().bits() as u8;
    if status.pe().is_error() || status.fe().is_error() || status.nf().is_noise() || status.ore().is_overrun() {
        DAMAGED.store(true, Ordering::Relaxed);
    }
    if status.rxne().is_no_data() {
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
