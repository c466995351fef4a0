//! The DAC's first channel, stepped by TIM2 and fed by DMA (RM0433 section 26). A converter passes the trigger on.

use super::converter::BY_TIMER;
use super::world::Shared;
use crate::world::locked;
use rigless::device::{Device, DeviceContext, Level, RegisterFile};
use rigless::soc::stm32h743::generated::dac::Register;

/// Status bit: a step of the timer found no new value.
const UNDERRUN: u64 = 1 << 13;
/// Control bit: values come by DMA.
const BY_DMA: u64 = 1 << 12;
/// Control bits: the channel is on, and asks for values by DMA.
const ON: u64 = 1 | BY_DMA;
/// The request output that asks for the next value.
const DMA_REQUEST: usize = 0;

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
                // A request of before the stop is served as soon as the DAC is started again, as on the STM32F4.
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
            Register::Swtrgr => {
                // On, trigger on, it is TIM2, and the output goes to the pin through the buffer.
                let tim2 = control & 3 == 3 && control >> 2 & 15 == 2 && registers.get(Register::Mcr) & 7 == 0;
                if value != BY_TIMER || !tim2 {
                    return;
                }
                let code = registers.get(Register::Dhr12r1) & 0xFFF;
                registers.set(Register::Dor1, code);
                locked(&self.world).step(code as u16);
                if control & BY_DMA != 0 {
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
