//! The excitation: a sine of sixteen steps from the first DAC channel (PA4).
//!
//! The sampling timer itself steps the DAC, which fixes the phase of the sine at every sample. DMA reads a table in
//! memory round and round. Switching on and off and setting the amplitude write the table.

use crate::ring::Shared;
use crate::sine;
use firmware::{ErrorKind, SAMPLES_PER_PERIOD};
use stm32f4xx_hal::pac;

/// How often the source is armed at most: the second time no request can be left over.
const ARMINGS: usize = 3;
/// Processor cycles in which a waiting request of the DAC has been served: 0.6 us.
const SERVED_CYCLES: u32 = 100;

/// What the DMA channel reads. The entry for the first sample is last: the DAC holds one value ahead.
static TABLE: Shared<u16, SAMPLES_PER_PERIOD> = Shared::new(sine::MIDDLE as u16);

/// The source.
pub struct Source {
    on: bool,
    permille: u16,
}

impl Source {
    pub const fn new() -> Self {
        Self {
            on: false,
            permille: 1000,
        }
    }

    /// Makes DAC and DMA ready; they wait for the timer, which stands still. The first step of the timer puts out phase 0.
    ///
    /// A request of the run before may be served at once, since nothing takes it back (ES0298 2.7.1, ES0206 2.6.1). The
    /// sine would then run one entry, 22.5 degrees, ahead for ever. Its mark is a stream that has moved although no step
    /// came. The request is used up then, and the second arming finds none.
    pub fn arm(&self) {
        self.fill();
        for _ in 0..ARMINGS {
            let left = self.arm_once();
            if left == SAMPLES_PER_PERIOD as u16 || cfg!(feature = "fault-request") {
                break;
            }
        }
    }

    /// Arms, and returns how many entries of the table the stream has still to read.
    fn arm_once(&self) -> u16 {
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
        dac.dhr12r1().write(|w| w.daccdhr().set(self.code(0)));
        dac.cr().write(|w| {
            w.dmaen1().enabled().tsel1().tim2trgo();
            w.ten1().enabled().en1().enabled()
        });
        // A request that waits is served within some ten cycles.
        cortex_m::asm::delay(SERVED_CYCLES);
        stream.ndtr().read().ndt().bits()
    }

    /// Whether the DAC ran out of values, which would have put it out of step.
    pub fn underrun(&self) -> bool {
        // SAFETY: the address is that of the DAC's registers. Only the status register is read, which has no side
        // effect.
        let dac = unsafe { &*pac::DAC::ptr() };
        dac.sr().read().dmaudr1().is_underrun()
    }

    pub fn set(&mut self, on: bool) {
        self.on = on;
        self.fill();
    }

    /// # Errors
    /// An amplitude that the source has not.
    pub fn set_amplitude(&mut self, permille: u16) -> Result<(), ErrorKind> {
        if !(1..=1000).contains(&permille) {
            return Err(ErrorKind::Other);
        }
        self.permille = permille;
        self.fill();
        Ok(())
    }

    fn code(&self, phase: usize) -> u16 {
        sine::code(phase, if self.on { self.permille } else { 0 })
    }

    fn fill(&self) {
        for phase in 0..SAMPLES_PER_PERIOD {
            TABLE.write((phase + SAMPLES_PER_PERIOD - 1) % SAMPLES_PER_PERIOD, self.code(phase));
        }
    }
}

/// From the table to the DAC (channel 7) for ever, 16 bits at a time; not enabled.
fn round_the_table(w: &mut pac::dma2::st::cr::W) -> &mut pac::dma2::st::cr::W {
    w.chsel().set(7).dir().memory_to_peripheral();
    w.psize().bits16().msize().bits16();
    w.minc().incremented().circ().enabled()
}
