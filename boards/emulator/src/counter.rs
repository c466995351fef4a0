//! TIM11 as far as it captures edges of the clock input against the processor's clock (RM0090 section 19, and
//! "Internal/external clock measurement" in section 6.2). rigless's timers capture nothing.

use rigless::device::{Device, DeviceContext, RegisterFile};
use rigless::soc::stm32f427::generated::tim11::Register;
use rigless::time::VirtualNanos;

const ENABLED: u64 = 1;
/// The input is the first one, taken directly; a capture every eighth edge.
const EVERY_EIGHTH: u64 = 1 | 3 << 2;
/// The option register: `HSE_RTC`.
const HSE_RTC: u64 = 2;
/// Status: a capture, and one more before the first was read.
const CAPTURED: u64 = 1 << 1;
const AGAIN: u64 = 1 << 9;

/// The timer.
#[derive(Debug)]
pub struct Counter {
    hz: u64,
    /// The clock at the input and what it is divided by; 0 Hz where none runs.
    pub input: (u64, u64),
    started: Option<VirtualNanos>,
    captures: u64,
    status: u64,
}

impl Default for Counter {
    fn default() -> Self {
        Self {
            // The internal oscillator's, until another is told.
            hz: 16_000_000,
            input: (0, 1),
            started: None,
            captures: 0,
            status: 0,
        }
    }
}

impl Counter {
    /// Takes in what was captured up to now.
    fn catch_up(&mut self, now: VirtualNanos, registers: &mut RegisterFile) {
        // One register with two names, of which rigless keeps one.
        let mode = registers.get(Register::Ccmr1Input) | registers.get(Register::Ccmr1Output);
        let wired = registers.get(Register::Or) == HSE_RTC && mode == EVERY_EIGHTH;
        let (hz, divider) = self.input;
        let on = registers.get(Register::Ccer) & ENABLED == 1 && wired && hz > 0 && divider > 1;
        let Some(started) = self.started.filter(|_| on) else {
            return;
        };
        let every = u128::from(divider) * 8 * 1_000_000_000;
        let captures = (u128::from(now.0 - started.0) * u128::from(hz) / every) as u64;
        if captures == self.captures {
            return;
        }
        if self.status & CAPTURED != 0 || captures > self.captures + 1 {
            self.status |= AGAIN;
        }
        self.status |= CAPTURED;
        self.captures = captures;
        let tick = u128::from(captures) * u128::from(divider) * 8 * u128::from(self.hz) / u128::from(hz);
        registers.set(Register::Ccr1, tick as u64 & 0xFFFF);
    }
}

impl Device for Counter {
    type Register = Register;

    fn on_clock(&mut self, hz: u64, _registers: &mut RegisterFile, _context: &mut DeviceContext<'_>) {
        self.hz = hz;
    }

    fn read(
        &mut self,
        register: Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        match register {
            Register::Sr => {
                self.catch_up(context.now(), registers);
                Some(self.status)
            }
            Register::Ccr1 => {
                self.status &= !CAPTURED;
                None
            }
            _ => None,
        }
    }

    fn write(&mut self, register: Register, value: u64, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        match register {
            // Cleared by writing 0.
            Register::Sr => self.status &= value,
            Register::Cr1 if value & ENABLED == 0 => self.started = None,
            Register::Cr1 if self.started.is_none() => (self.started, self.captures) = (Some(context.now()), 0),
            _ => {}
        }
    }

    fn reset(&mut self) {
        *self = Self {
            hz: self.hz,
            ..Self::default()
        };
    }
}
