//! The independent watchdog (RM0433 section 45): a count of the slow clock, at whose end the chip restarts.
//!
//! New values count at once, and no window is modelled: the program sets none.

use rigless::device::{Device, DeviceContext, Level, RegisterFile};
use rigless::soc::stm32h743::generated::iwdg::Register;
use rigless::soc::stm32h743::peripherals::rcc::IWDG_STARTED;
use rigless::time::{EventId, VirtualNanos};

/// What the key register takes.
const START: u64 = 0xCCCC;
const FEED: u64 = 0xAAAA;
const UNLOCK: u64 = 0x5555;

/// The watchdog.
#[derive(Debug)]
pub struct Watchdog {
    /// Its clock, which runs once it is started.
    hz: u64,
    started: bool,
    unlocked: bool,
    /// Prescaler and reload value, as they count.
    prescaler: u64,
    reload: u64,
    /// When the count ends.
    end: VirtualNanos,
    /// The event by which that is looked at, and when it comes. It is fed a million times a second, so that not every load can
    /// have an event.
    look: Option<(EventId, VirtualNanos)>,
}

impl Default for Watchdog {
    fn default() -> Self {
        Self {
            hz: 0,
            started: false,
            unlocked: false,
            prescaler: 0,
            reload: 0xFFF,
            end: VirtualNanos(0),
            look: None,
        }
    }
}

impl Watchdog {
    /// Counts from the reload value again.
    fn load(&mut self, context: &mut DeviceContext<'_>) {
        if !self.started || self.hz == 0 {
            return;
        }
        // RM0433 section 45.4.2: 4 at zero, 256 at six and more.
        let divider = 4 << self.prescaler.min(6);
        let ns = (self.reload + 1) * divider * 1_000_000_000 / self.hz;
        self.end = VirtualNanos(context.now().0 + ns);
        if self.look.is_none_or(|(_, at)| at.0 > self.end.0) {
            self.look_at_end(context);
        }
    }

    fn look_at_end(&mut self, context: &mut DeviceContext<'_>) {
        self.look = Some((context.schedule(self.end), self.end));
    }
}

impl Device for Watchdog {
    type Register = Register;

    fn on_clock(&mut self, hz: u64, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let starts = self.hz == 0;
        self.hz = hz;
        if starts {
            self.load(context);
        }
    }

    fn write(&mut self, register: Register, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        match register {
            Register::Kr => {
                self.unlocked = value == UNLOCK;
                if value == START && !self.started {
                    self.started = true;
                    context.request(IWDG_STARTED, Level::High);
                }
                if value == START || value == FEED {
                    self.load(context);
                }
            }
            Register::Pr if self.unlocked => self.prescaler = value & 7,
            Register::Rlr if self.unlocked => self.reload = value & 0xFFF,
            Register::Pr => registers.set(Register::Pr, self.prescaler),
            Register::Rlr => registers.set(Register::Rlr, self.reload),
            _ => {}
        }
    }

    fn on_event(&mut self, event: EventId, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if self.look.take_if(|(look, _)| *look == event).is_none() {
            return;
        }
        if context.now().0 >= self.end.0 {
            context.request_reset();
        } else {
            self.look_at_end(context);
        }
    }

    fn reset(&mut self) {
        *self = Self::default();
    }
}
