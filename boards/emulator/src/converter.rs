//! ADC1 as far as single conversions started by TIM2 and taken by DMA go (RM0090 section 13).

use crate::timer::TRIGGER;
use crate::world::{Shared, locked};
use rigless::device::{Device, DeviceContext, Level, RegisterFile, RequestChange};
use rigless::soc::Width;
use rigless::soc::stm32f427::generated::adc1::Register;
use rigless::soc::stm32f427::peripherals::adc::DMA_REQUEST;
use rigless::time::{EventId, Run};

/// Where the DAC is triggered by software; see [`crate::source`] for why.
const DAC_TRIGGER: u64 = 0x4000_7404;

/// Status bits.
const END: u64 = 1 << 1;
const OVERRUN: u64 = 1 << 5;

/// The converter.
#[derive(Debug)]
pub struct Converter {
    world: Shared,
    hz: u64,
    ending: Option<EventId>,
    status: u64,
    unread: bool,
}

impl Converter {
    /// One on this world's pins.
    pub fn new(world: Shared) -> Self {
        Self {
            world,
            hz: 0,
            ending: None,
            status: 0,
            unread: false,
        }
    }

    /// On, started by the rising edge of TIM2's trigger.
    fn listens(registers: &RegisterFile) -> bool {
        let control = registers.get(Register::Cr2);
        control & 1 == 1 && control >> 28 & 3 == 1 && control >> 24 & 15 == 6
    }

    fn drive(&self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        registers.set(Register::Sr, self.status);
        let by_dma = registers.get(Register::Cr2) & 1 << 8 != 0;
        let wanted = by_dma && self.unread && self.status & OVERRUN == 0;
        context.request(DMA_REQUEST, if wanted { Level::High } else { Level::Low });
    }
}

impl Device for Converter {
    type Register = Register;

    fn on_clock(&mut self, hz: u64, _registers: &mut RegisterFile, _context: &mut DeviceContext<'_>) {
        self.hz = hz;
    }

    fn on_request(&mut self, change: RequestChange, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let high = change.level == Level::High;
        if change.instance != "TIM2" {
            locked(&self.world).pin(change.instance, change.request, high);
            return;
        }
        if change.request != TRIGGER || !high {
            return;
        }
        locked(&self.world).triggers += 1;
        context.write_to(DAC_TRIGGER, Width::W32, crate::source::BY_TIMER, 0);
        if Self::listens(registers) && self.ending.is_none() && self.status & OVERRUN == 0 && self.hz > 0 {
            const SAMPLING: [u128; 8] = [3, 15, 28, 56, 84, 112, 144, 480];
            let channel = registers.get(Register::Sqr3) & 31;
            let code = registers.get(Register::Smpr2) >> (3 * channel.min(9)) & 7;
            let mut run = Run::at(context.now());
            run.extend(SAMPLING[code as usize] + 12, self.hz);
            self.ending = Some(context.schedule(run.ends));
        }
    }

    fn on_event(&mut self, event: EventId, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if self.ending != Some(event) {
            return;
        }
        self.ending = None;
        let planned = {
            let mut world = locked(&self.world);
            let triggers = world.triggers;
            world.overrun_at.take_if(|at| *at <= triggers).is_some()
        };
        if self.unread || planned {
            self.status |= OVERRUN;
        } else {
            let mut world = locked(&self.world);
            let time = world.triggers - 1;
            registers.set(Register::Dr, world.sample(time).into());
            self.unread = true;
            self.status |= END;
        }
        self.drive(registers, context);
    }

    fn read(
        &mut self,
        register: Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        if register != Register::Dr {
            return None;
        }
        self.unread = false;
        self.status &= !END;
        self.drive(registers, context);
        Some(registers.get(Register::Dr))
    }

    fn write(&mut self, register: Register, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        match register {
            Register::Sr => {
                self.status &= value;
                self.unread &= self.status & END != 0;
            }
            Register::Cr2 if value & 1 == 0 => (self.ending, self.unread) = (None, false),
            Register::Sqr3 => {
                // A conversion under way is thrown away.
                self.ending = None;
                locked(&self.world).select_input(value as u32 & 31);
            }
            _ => {}
        }
        self.drive(registers, context);
    }

    fn reset(&mut self) {
        *self = Self {
            hz: self.hz,
            ..Self::new(self.world.clone())
        };
    }
}
