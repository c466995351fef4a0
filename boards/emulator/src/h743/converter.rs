//! A converter as far as regular sequences started by TIM2 and taken by DMA go (RM0433 section 25).

use super::world::{Shared, Wire};
use crate::timer::TRIGGER;
use crate::world::locked;
use rigless::device::{Device, DeviceContext, Level, RegisterFile, RequestChange};
use rigless::soc::Width;
use rigless::soc::stm32h743::generated::adc3::Register;
use rigless::soc::stm32h743::peripherals::adc::DMA_REQUEST;
use rigless::time::{EventId, Run};
use std::collections::VecDeque;

/// Where the third converter, the only one that hears the timer, passes the trigger on: the status registers of the other
/// two, and the DAC's software trigger.
const PASSED_ON: [u64; 3] = [0x4002_2000, 0x4002_2100, 0x4000_7404];
/// What it writes there: a reserved bit that no program sets.
pub const BY_TIMER: u64 = 1 << 31;

/// Status bits: ready, end of a conversion, overrun, the regulator is ready.
const READY: u64 = 1;
const END: u64 = 1 << 2;
const OVERRUN: u64 = 1 << 4;
const REGULATOR: u64 = 1 << 12;
/// Control bits: on, started, stop, regulator on, calibrate.
const ON: u64 = 1;
const STARTED: u64 = 1 << 2;
const STOP: u64 = 1 << 4;
const POWERED: u64 = 1 << 28;
const CALIBRATE: u64 = 1 << 31;
/// Codes that wait for DMA at most.
const QUEUE: usize = 8;

/// Which converter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Which {
    /// ADC1.
    First,
    /// ADC2.
    Second,
    /// ADC3.
    Third,
}

/// A converter.
#[derive(Debug)]
pub struct Converter {
    which: Which,
    world: Shared,
    hz: u64,
    ending: Option<(EventId, Run)>,
    position: usize,
    status: u64,
    queue: VecDeque<u16>,
}

impl Converter {
    /// One on this world's pins.
    pub fn new(which: Which, world: Shared) -> Self {
        Self {
            which,
            world,
            hz: 0,
            ending: None,
            position: 0,
            status: 0,
            queue: VecDeque::new(),
        }
    }

    /// What an input leads to, as wired in docs/board.md.
    fn wire(&self, input: u64) -> Option<Wire> {
        let place = |inputs: &[u64]| inputs.iter().position(|i| *i == input).map(|k| k as u8);
        match self.which {
            Which::First => place(&[16, 2, 6, 15, 19, 3, 5, 10]).map(Wire::Amplifier),
            Which::Third => place(&[5, 9, 4, 8, 3, 7, 2, 6]).map(|k| Wire::Amplifier(8 + k)),
            Which::Second => match input {
                2 => Some(Wire::Behind(0)),
                6 => Some(Wire::Behind(1)),
                11 => Some(Wire::Source),
                _ => None,
            },
        }
    }

    /// The input that is converted at a place of the sequence.
    fn input(registers: &RegisterFile, place: usize) -> u64 {
        // Four in the first register behind the length, five in each of the others.
        let (register, field) = match place {
            0..4 => (Register::Sqr1, place + 1),
            4..9 => (Register::Sqr2, place - 4),
            _ => (Register::Sqr3, place - 9),
        };
        registers.get(register) >> (6 * field) & 31
    }

    fn trigger(&mut self, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        let (control, configuration) = (registers.get(Register::Cr), registers.get(Register::Cfgr));
        let listens = control & (ON | STARTED) == ON | STARTED
            && configuration >> 10 & 3 == 1
            && configuration >> 5 & 31 == 11
            && configuration >> 2 & 7 == 0;
        if listens && self.ending.is_none() && self.status & OVERRUN == 0 && self.hz > 0 {
            self.position = 0;
            self.convert(registers, context, Run::at(context.now()));
        }
    }

    fn convert(&mut self, registers: &RegisterFile, context: &mut DeviceContext<'_>, mut run: Run) {
        // Half cycles of sampling; 8.5 cycles are the conversion to 16 bits.
        const SAMPLING: [u128; 8] = [3, 5, 17, 33, 65, 129, 775, 1621];
        let input = Self::input(registers, self.position);
        let code = if input < 10 {
            registers.get(Register::Smpr1) >> (3 * input) & 7
        } else {
            registers.get(Register::Smpr2) >> (3 * (input - 10)) & 7
        };
        run.extend(SAMPLING[code as usize] + 17, 2 * self.hz);
        self.ending = Some((context.schedule(run.ends), run));
    }

    fn drive(&self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        registers.set(Register::Isr, self.status);
        if let Some(code) = self.queue.front() {
            registers.set(Register::Dr, u64::from(*code));
        }
        let by_dma = registers.get(Register::Cfgr) & 3 == 3;
        let wanted = by_dma && !self.queue.is_empty() && self.status & OVERRUN == 0;
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
        for address in PASSED_ON {
            context.write_to(address, Width::W32, BY_TIMER, 0);
        }
        self.trigger(registers, context);
    }

    fn on_event(&mut self, event: EventId, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let Some((_, run)) = self.ending.take_if(|(id, _)| *id == event) else {
            return;
        };
        let mut world = locked(&self.world);
        let time = world.triggers - 1;
        let planned = world.overrun_at.take_if(|at| *at <= time).is_some();
        let input = Self::input(registers, self.position);
        let chosen = registers.get(Register::Pcsel) >> input & 1 == 1;
        let wire = self.wire(input).filter(|_| chosen);
        let code = wire.map_or(0, |wire| world.sample(time, wire));
        drop(world);
        if planned || self.queue.len() >= QUEUE {
            self.status |= OVERRUN;
        } else {
            self.queue.push_back(code);
            self.status |= END;
        }
        self.position += 1;
        if self.position <= (registers.get(Register::Sqr1) & 15) as usize {
            self.convert(registers, context, run);
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
        let code = self.queue.pop_front();
        if self.queue.is_empty() {
            self.status &= !END;
        }
        self.drive(registers, context);
        Some(code.map_or(registers.get(Register::Dr), u64::from))
    }

    fn write(&mut self, register: Register, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        match register {
            Register::Isr if value & BY_TIMER != 0 => {
                registers.set(Register::Isr, self.status);
                return self.trigger(registers, context);
            }
            // Cleared by writing 1, but what the regulator says.
            Register::Isr => {
                self.status &= !value | REGULATOR;
                if value & END != 0 {
                    self.queue.clear();
                }
            }
            Register::Cr => {
                let mut control = registers.get(Register::Cr);
                if control & POWERED != 0 {
                    self.status |= REGULATOR;
                }
                // Over at once.
                control &= !CALIBRATE;
                if control & ON != 0 {
                    self.status |= READY;
                }
                if control & STOP != 0 {
                    control &= !(STOP | STARTED);
                    self.ending = None;
                }
                registers.set(Register::Cr, control);
            }
            _ => {}
        }
        self.drive(registers, context);
    }

    fn reset(&mut self) {
        *self = Self {
            hz: self.hz,
            ..Self::new(self.which, self.world.clone())
        };
    }
}
