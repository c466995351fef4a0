//! The excitation: a sine of sixteen steps from the first DAC channel (PA4).
//!
//! The sampling timer itself steps the DAC, which fixes the phase of the sine at every sample. DMA reads a table in
//! memory round and round. Switching on and off and setting the amplitude write the table. The registers are in `dac`.

use crate::dac::{self, TABLE};
use crate::sine;
use firmware::{ErrorKind, SAMPLES_PER_PERIOD};

/// How often the source is armed at most: the second time no request can be left over.
const ARMINGS: usize = 3;

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
    /// came. The request is used up then, and the second arming finds none. The STM32H743's errata know of none; its DAC is
    /// not trusted more.
    pub fn arm(&self) {
        self.fill();
        for _ in 0..ARMINGS {
            let left = dac::arm(self.code(0));
            if left == SAMPLES_PER_PERIOD as u16 || cfg!(feature = "fault-request") {
                break;
            }
        }
    }

    /// Whether the DAC ran out of values, which would have put it out of step.
    pub fn underrun(&self) -> bool {
        dac::underrun()
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
