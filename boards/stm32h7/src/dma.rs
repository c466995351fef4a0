//! The streams of DMA1, and which request each serves.

use crate::pac;

/// A stream, by its number.
#[derive(Clone, Copy)]
pub enum Stream {
    /// ADC1: channels 0 to 7.
    First = 0,
    /// ADC3: channels 8 to 15.
    Second = 1,
    /// ADC2: what one channel sees.
    Third = 2,
    /// The DAC's first channel.
    Dac = 3,
    /// The serial port's transmitter.
    Transmitter = 4,
}

/// Its registers.
pub fn stream(stream: Stream) -> &'static pac::dma1::ST {
    // SAFETY: the address is that of the registers. Each stream is one module's alone.
    let dma = unsafe { &*pac::DMA1::ptr() };
    dma.st(stream as usize)
}

/// Connects each stream to its request; once, before any is enabled.
pub fn start() {
    // SAFETY: the address is that of the registers, which nobody else writes.
    let mux = unsafe { &*pac::DMAMUX1::ptr() };
    mux.ccr(Stream::First as usize).write(|w| w.dmareq_id().adc1_dma());
    mux.ccr(Stream::Second as usize).write(|w| w.dmareq_id().adc3_dma());
    mux.ccr(Stream::Third as usize).write(|w| w.dmareq_id().adc2_dma());
    mux.ccr(Stream::Dac as usize).write(|w| w.dmareq_id().dac_ch1_dma());
    mux.ccr(Stream::Transmitter as usize)
        .write(|w| w.dmareq_id().usart3_tx_dma());
}

/// Stops a stream and clears its flags.
pub fn stop(number: Stream) {
    let registers = stream(number);
    registers.cr().write(|w| w.en().disabled());
    while registers.cr().read().en().is_enabled() {}
    // SAFETY: as in `stream`. Zeros leave the other streams' flags alone.
    let dma = unsafe { &*pac::DMA1::ptr() };
    match number {
        Stream::First => dma.lifcr().write(|w| {
            w.cfeif0().clear().cdmeif0().clear().cteif0().clear();
            w.chtif0().clear().ctcif0().clear()
        }),
        Stream::Second => dma.lifcr().write(|w| {
            w.cfeif1().clear().cdmeif1().clear().cteif1().clear();
            w.chtif1().clear().ctcif1().clear()
        }),
        Stream::Third => dma.lifcr().write(|w| {
            w.cfeif2().clear().cdmeif2().clear().cteif2().clear();
            w.chtif2().clear().ctcif2().clear()
        }),
        Stream::Dac => dma.lifcr().write(|w| {
            w.cfeif3().clear().cdmeif3().clear().cteif3().clear();
            w.chtif3().clear().ctcif3().clear()
        }),
        Stream::Transmitter => dma.hifcr().write(|w| {
            w.cfeif4().clear().cdmeif4().clear().cteif4().clear();
            w.chtif4().clear().ctcif4().clear()
        }),
    };
}

/// Where a stream that is off will read and write: a peripheral's data register, and a buffer in memory that DMA reaches.
/// What it then does to the buffer is the duty of the module that has the stream.
pub fn address(number: Stream, peripheral: u32, memory: u32) {
    let registers = stream(number);
    // SAFETY: the stream does nothing until its owner enables it.
    unsafe {
        registers.par().write(|w| w.pa().bits(peripheral));
        registers.m0ar().write(|w| w.m0a().bits(memory));
    }
}

/// Whether a stream of the converters met an error.
pub fn failed() -> bool {
    // SAFETY: as in `stream`. Only a status register is read.
    let flags = unsafe { &*pac::DMA1::ptr() }.lisr().read();
    flags.teif0().is_error() || flags.teif1().is_error() || flags.teif2().is_error()
}

/// Fills all memory that DMA reaches with zeros, before anything in it is used: it has error correction, and holds anything
/// after power came.
pub fn clear_memory() {
    // SAFETY: the linker makes both, at the ends of a section of words that nothing else names.
    unsafe extern "C" {
        static mut _dma_start: u32;
        static mut _dma_end: u32;
    }
    let (start, end) = (&raw mut _dma_start, &raw mut _dma_end);
    let mut place = start;
    while (place as u32) < end as u32 {
        // SAFETY: the linker has put both marks at multiples of 32, around memory that holds only variables which may be
        // all zeros. No stream is on yet, and nothing has been lent.
        unsafe {
            place.write_volatile(0);
            place = place.add(1);
        }
    }
}
