//! The serial port to the host, 1 Mbit/s. Bytes go out by DMA from two buffers in turn, and come in by interrupt.
//!
//! The port is USART3 on PD8 (out) and PD9 (in), which the debugger of a Nucleo-144 connects to its USB.

use crate::dma::{self, Stream};
use crate::pac::{self, interrupt};
use crate::ring::Shared;
use core::sync::atomic::{AtomicBool, AtomicU8, AtomicUsize, Ordering};
use embedded_hal_nb::serial;

/// Bytes of each transmit buffer: 2.56 ms.
const CHUNK: usize = 256;
// SAFETY: the section is in memory that DMA reaches; what is sent of it was written before.
#[unsafe(link_section = ".dma.out")]
static OUT: [Shared<u8, CHUNK>; 2] = [Shared::new(0), Shared::new(0)];

/// Bytes received and not taken: 1.28 ms.
const RECEIVED: usize = 128;
static IN: [AtomicU8; RECEIVED] = [const { AtomicU8::new(0) }; RECEIVED];
/// How many were ever put in (by the interrupt) and taken out (by the main loop).
static PUT: AtomicUsize = AtomicUsize::new(0);
static TAKEN: AtomicUsize = AtomicUsize::new(0);
/// A byte was lost or damaged since the last read.
static DAMAGED: AtomicBool = AtomicBool::new(false);

/// 100 MHz / 100.
const DIVISOR: u16 = 100;
/// Pins of port D.
const OUT_PIN: u8 = 8;
const IN_PIN: u8 = 9;

/// The port.
pub struct Serial {
    /// The buffer that is being filled, and how far.
    filling: usize,
    filled: usize,
}

fn registers() -> &'static pac::usart3::RegisterBlock {
    // SAFETY: the address is that of the registers, which are this module's alone.
    unsafe { &*pac::USART3::ptr() }
}

impl Serial {
    /// Sets pins, port and DMA up, and lets bytes in.
    pub fn start() -> Self {
        // SAFETY: the address is that of the port's registers. Both pins are this module's alone. Other modules change the
        // same registers in their `start` only, one after the other, and no interrupt handler does.
        let gpio = unsafe { &*pac::GPIOD::ptr() };
        // Alternate function 7 on both pins, with a pull-up on the receiver's: an open line is idle.
        gpio.afrh()
            .modify(|_, w| w.afr(OUT_PIN - 8).af7().afr(IN_PIN - 8).af7());
        gpio.pupdr().modify(|_, w| w.pupdr(IN_PIN).pull_up());
        gpio.ospeedr().modify(|_, w| w.ospeedr(OUT_PIN).high_speed());
        gpio.moder()
            .modify(|_, w| w.moder(OUT_PIN).alternate().moder(IN_PIN).alternate());
        let usart = registers();
        usart.brr().write(|w| w.brr().set(DIVISOR));
        // DMA for what goes out, an interrupt for every byte that comes in.
        usart.cr3().write(|w| w.dmat().enabled());
        usart
            .cr1()
            .write(|w| w.ue().enabled().rxneie().enabled().te().enabled().re().enabled());
        // SAFETY: everything that the interrupt handler uses is set up, and no critical section relies on this interrupt
        // being off.
        unsafe { cortex_m::peripheral::NVIC::unmask(pac::Interrupt::USART3) };
        Self { filling: 0, filled: 0 }
    }

    /// Sends what was filled, if nothing is on its way.
    fn kick(&mut self) {
        let stream = dma::stream(Stream::Transmitter);
        if self.filled == 0 || stream.cr().read().en().is_enabled() {
            return;
        }
        dma::stop(Stream::Transmitter);
        let buffer = OUT.get(self.filling).unwrap_or(&OUT[0]);
        // The stream will read `filled` bytes of the buffer, which is a static and has as many. They are not written until
        // the stream is off again: the other buffer is filled meanwhile.
        let data = registers().tdr().as_ptr() as u32;
        dma::address(Stream::Transmitter, data, buffer.address());
        stream.ndtr().write(|w| w.ndt().set(self.filled as u16));
        // From memory to the transmitter, byte by byte. Bufferable transfers: errata ES0392 2.20.4.
        stream.cr().write(|w| {
            w.dir().memory_to_peripheral().trbuff().set_bit();
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
        let busy = self.filled > 0
            || dma::stream(Stream::Transmitter).cr().read().en().is_enabled()
            || registers().isr().read().tc().bit_is_clear();
        if busy { Err(nb::Error::WouldBlock) } else { Ok(()) }
    }
}

/// Takes a byte in.
#[interrupt]
fn USART3() {
    let usart = registers();
    let status = usart.isr().read();
    let errors =
        status.pe().bit_is_set() || status.fe().bit_is_set() || status.nf().bit_is_set() || status.ore().bit_is_set();
    if errors {
        usart
            .icr()
            .write(|w| w.pecf().clear().fecf().clear().ncf().clear().orecf().clear());
        DAMAGED.store(true, Ordering::Relaxed);
    }
    if status.rxne().bit_is_clear() {
        return;
    }
    let byte = usart.rdr().read().rdr().bits() as u8;
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
