//! The DAC's first channel (PA4), stepped by TIM2 and fed by stream 5 of DMA1.

use crate::pac;
use crate::ring::Shared;
use crate::sine;
use firmware::SAMPLES_PER_PERIOD;

/// Processor cycles in which a waiting request of the DAC has been served: 0.6 us.
const SERVED_CYCLES: u32 = 100;

/// What the DMA channel reads. The entry for the first sample is last: the DAC holds one value ahead.
pub static TABLE: Shared<u16, SAMPLES_PER_PERIOD> = Shared::new(sine::MIDDLE as u16);

/// Arms DAC and stream with the code of phase 0, and returns how many entries of the table the stream has still to read.
pub fn arm(first: u16) -> u16 {
    // SAFETY: the addresses are those of the registers. The DAC and stream 5 of DMA1 are this module's alone. Of
    // DMA1 it writes no register that others write but one that clears flags; zeros there do nothing.
    let (dac, dma) = unsafe { (&*pac::DAC::ptr(), &*pac::DMA1::ptr()) };
    dac.cr().write(|w| w.en1().disabled());
    // An underrun of before: cleared by writing 1.
    dac.sr().write(|w| w.dmaudr1().set_bit());
    let stream = dma.st(5);
    stream.cr().write(|w| w.en().disabled());
    while stream.cr().read().en().is_enabled() {}
    dma.hifcr().write(|w| {
        w.cfeif5().clear().cdmeif5().clear().cteif5().clear();
        w.chtif5().clear().ctcif5().clear()
    });
    // SAFETY: from here the stream reads the table, a static of as many codes as `ndtr` says, and writes the DAC's
    // data register. The processor changes the table one whole code at a time.
    unsafe {
        stream.par().write(|w| w.pa().bits(dac.dhr12r1().as_ptr() as u32));
        stream.m0ar().write(|w| w.m0a().bits(TABLE.address()));
    }
    stream.ndtr().write(|w| w.ndt().set(SAMPLES_PER_PERIOD as u16));
    stream.cr().write(round_the_table);
    stream.cr().write(|w| round_the_table(w).en().enabled());
    dac.dhr12r1().write(|w| w.daccdhr().set(first));
    dac.cr().write(|w| {
        w.dmaen1().enabled().tsel1().tim2trgo();
        w.ten1().enabled().en1().enabled()
    });
    // A request that waits is served within some ten cycles.
    cortex_m::asm::delay(SERVED_CYCLES);
    stream.ndtr().read().ndt().bits()
}

/// Whether the DAC ran out of values, which would have put it out of step.
pub fn underrun() -> bool {
    // SAFETY: the address is that of the DAC's registers. Only the status register is read, which has no side
    // effect.
    let dac = unsafe { &*pac::DAC::ptr() };
    dac.sr().read().dmaudr1().is_underrun()
}

/// From the table to the DAC (channel 7) for ever, 16 bits at a time; not enabled.
fn round_the_table(w: &mut pac::dma2::st::cr::W) -> &mut pac::dma2::st::cr::W {
    w.chsel().set(7).dir().memory_to_peripheral();
    w.psize().bits16().msize().bits16();
    w.minc().incremented().circ().enabled()
}
