//! The excitation: a sine of sixteen steps from the first DAC channel (PA4).
//!
//! The sampling timer itself steps the DAC, which fixes the phase of the sine at every sample. DMA reads a table in
//! memory round and round. Switching on and off and setting the amplitude write the table.

use crate::dma::{self, Stream};
use crate::pac;
use crate::ring::Shared;
use crate::sine;
use firmware::{ErrorKind, SAMPLES_PER_PERIOD};

/// How often the source is armed at most: the second time no request can be left over.
const ARMINGS: usize = 3;
/// Processor cycles in which a waiting request of the DAC has been served: 0.6 us.
const SERVED_CYCLES: u32 = 240;

/// What the DMA channel reads. The entry for the first sample is last: the DAC holds one value ahead.
// SAFETY: the section is in memory that DMA reaches; `fill` writes all of it before it is read.
#[unsafe(link_section = ".dma.table")]
static TABLE: Shared<u16, SAMPLES_PER_PERIOD> = Shared::new(0);

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
    /// A request of the run before may be served at once, as on the STM32F4. The sine would then run one entry, 22.5
    /// degrees, ahead for ever. Its mark is a stream that has moved although no step came. The request is used up then, and
    /// the second arming finds none.
    pub fn arm(&self) {
        self.fill();
        for _ in 0..ARMINGS {
            if self.arm_once() == SAMPLES_PER_PERIOD as u16 {
                break;
            }
        }
    }

    /// Arms, and returns how many entries of the table the stream has still to read.
    fn arm_once(&self) -> u16 {
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
        dac.dhr12r1().write(|w| w.daccdhr().set(self.code(0)));
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
    pub fn underrun(&self) -> bool {
        // SAFETY: the address is that of the DAC's registers. Only the status register is read, which has no side
        // effect.
        let dac = unsafe { &*pac::DAC::ptr() };
        dac.sr().read().dmaudr1().bit_is_set()
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
