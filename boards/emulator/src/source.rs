//! The DAC's first channel, stepped by TIM2 and fed by DMA (RM0090 section 14).
//!
//! rigless gives the DAC no timer's trigger. The model of the converter passes the trigger on instead: it writes to the
//! register of the software trigger, with a reserved bit that no program sets.

use crate::world::{Shared, locked};
use rigless::device::{Device, DeviceContext, Level, RegisterFile};
use rigless::soc::stm32f427::generated::dac::Register;

/// What the converter writes to the software trigger register when the timer steps the DAC.
pub const BY_TIMER: u64 = 1 << 31;

/// Status bit: a step of the timer found no new value.
const UNDERRUN: u64 = 1 << 13;

/// Control bits: the channel is on, and asks for values by DMA.
const ON: u64 = 1 | 1 << 12;

/// The request output that asks for the next value.
pub const DMA_REQUEST: usize = 0;

/// The DAC.
#[derive(Debug)]
pub struct Source {
    world: Shared,
    asking: bool,
    underrun: bool,
}

impl Source {
    /// One on this world's pins.
    pub fn new(world: Shared) -> Self {
        Self {
            world,
            asking: false,
            underrun: false,
        }
    }
}

impl Device for Source {
    type Register = Register;

    fn write(&mut self, register: Register, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let control = registers.get(Register::Cr);
        match register {
            Register::Dhr12r1 if self.asking => {
                self.asking = false;
                context.request(DMA_REQUEST, Level::Low);
            }
            Register::Cr if control & ON == ON && !self.asking => {
                // Errata ES0206, 2.6.1: a request of before the stop is served as soon as the DAC is started again.
                let mut world = locked(&self.world);
                let triggers = world.triggers;
                if world.stale_request_at.take_if(|at| *at <= triggers).is_some() {
                    self.asking = true;
                    context.request(DMA_REQUEST, Level::High);
                }
            }
            Register::Sr => {
                // Cleared by writing 1; the hardware alone sets it.
                self.underrun &= value & UNDERRUN == 0;
                registers.set(Register::Sr, if self.underrun { UNDERRUN } else { 0 });
            }
            Register::Swtrigr => {
                // On, trigger on, and it is TIM2.
                if value != BY_TIMER || control & 5 != 5 || control >> 3 & 7 != 4 {
                    return;
                }
                let code = registers.get(Register::Dhr12r1) & 0xFFF;
                registers.set(Register::Dor1, code);
                locked(&self.world).step(code as u16);
                if control & 1 << 12 != 0 {
                    if self.asking {
                        // The value before was never fetched.
                        self.underrun = true;
                        registers.set(Register::Sr, UNDERRUN);
                    }
                    self.asking = true;
                    context.request(DMA_REQUEST, Level::High);
                }
            }
            _ => {}
        }
    }

    fn reset(&mut self) {
        (self.asking, self.underrun) = (false, false);
    }
}
