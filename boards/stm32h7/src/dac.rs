//! The DAC's first channel (PA4), stepped by TIM2 and fed by DMA.

use crate::dma::{self, Stream};
use crate::pac;
use crate::ring::Shared;
use firmware::SAMPLES_PER_PERIOD;

/// Processor cycles in which a waiting request of the DAC has been served: 0.6 us.
const SERVED_CYCLES: u32 = 240;

/// What the DMA channel reads. The entry for the first sample is last: the DAC holds one value ahead.
// SAFETY: the section is in memory that DMA reaches; `fill` writes all of it before it is read.
#[unsafe(link_section = ".dma.table")]
pub static TABLE: Shared<u16, SAMPLES_PER_PERIOD> = Shared::new(0);

/// Arms DAC and stream with the code of phase 0, and returns how many entries of the table the stream has still to read.
pub fn arm(first: u16) -> u16 {
    // SAFETY: the address is that of the DAC's registers, which are this module's alone.
    let dac = unsafe { &*pac::DAC::ptr() };
    dac.cr().write(|w| w.en1().disabled());
    // An underrun of before: cleared by writing 1.
    dac.sr().write(|w| w.dmaudr1().set_bit());
    dma::stop(Stream::Dac);
    // From the table to the DAC for ever, 16 bits at a time.
    dma::address(Stream::Dac, dac.dhr12r1().as_ptr() as u32, TABLE.address());
    dma::stream(Stream::Dac)
        .ndtr()
        .write(|w| w.ndt().set(SAMPLES_PER_PERIOD as u16));
    dma::stream(Stream::Dac).cr().write(|w| {
        w.dir().memory_to_peripheral().psize().bits16().msize().bits16();
        w.minc().incremented().circ().enabled().en().enabled()
    });
    dac.dhr12r1().write(|w| w.daccdhr().set(first));
    // The output is buffered, and on its pin alone.
    dac.mcr().write(|w| w.mode1().set(0));
    dac.cr().write(|w| {
        w.dmaen1().enabled().tsel1().tim2trgo();
        w.ten1().enabled().en1().enabled()
    });
    cortex_m::asm::delay(SERVED_CYCLES);
    dma::stream(Stream::Dac).ndtr().read().ndt().bits()
}

/// Whether the DAC ran out of values, which would have put it out of step.
pub fn underrun() -> bool {
    // SAFETY: the address is that of the DAC's registers. Only the status register is read, which has no side
    // effect.
    let dac = unsafe { &*pac::DAC::ptr() };
    dac.sr().read().dmaudr1().bit_is_set()
}
