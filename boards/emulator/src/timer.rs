//! TIM2 as far as a periodic trigger goes: up-counting, update as trigger output (RM0090 section 18). rigless's own counts
//! as well but its trigger output reaches no converter.

use rigless::device::{Device, DeviceContext, Level, RegisterFile};
use rigless::soc::stm32f427::generated::tim2::Register;
use rigless::time::{EventId, Run};

/// The request output that is the trigger.
pub const TRIGGER: usize = 0;

/// The timer.
#[derive(Debug, Default)]
pub struct Timer {
    hz: u64,
    run: Option<Run>,
    next: Option<EventId>,
    /// Ticks from one update to the next, while it runs.
    ticks: u64,
    updates: u64,
}

const ENABLED: u64 = 1;
const MASTER_MODE: u64 = 7 << 4;
const UPDATE: u64 = 2 << 4;

impl Timer {
    fn schedule(&mut self, context: &mut DeviceContext<'_>) {
        let mut run = self.run.unwrap_or(Run::at(context.now()));
        run.extend(self.ticks.into(), self.hz.max(1));
        self.run = Some(run);
        self.next = Some(context.schedule(run.ends));
    }
}

impl Device for Timer {
    type Register = Register;

    fn on_clock(&mut self, hz: u64, _registers: &mut RegisterFile, _context: &mut DeviceContext<'_>) {
        self.hz = hz;
    }

    fn read(&mut self, register: Register, _: &mut RegisterFile, context: &mut DeviceContext<'_>) -> Option<u64> {
        let (Register::Cnt, Some(run), Some(_)) = (register, self.run, self.next) else {
            return None;
        };
        let left_ns = run.ends.0.saturating_sub(context.now().0);
        let left = (left_ns * self.hz / 1_000_000_000).min(self.ticks - 1);
        Some(self.ticks - 1 - left)
    }

    fn write(&mut self, register: Register, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if register != Register::Cr1 {
            return;
        }
        let running = self.next.is_some();
        if value & ENABLED == 0 {
            (self.next, self.run) = (None, None);
        } else if !running {
            self.ticks = (registers.get(Register::Psc) + 1) * (registers.get(Register::Arr) + 1);
            self.schedule(context);
        }
    }

    fn on_event(&mut self, event: EventId, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if self.next != Some(event) {
            return;
        }
        self.updates += 1;
        if registers.get(Register::Cr2) & MASTER_MODE == UPDATE {
            context.request(TRIGGER, Level::High);
            context.request(TRIGGER, Level::Low);
        }
        self.schedule(context);
    }

    fn reset(&mut self) {
        *self = Self {
            hz: self.hz,
            ..Self::default()
        };
    }
}
