//! TIM2 as far as a periodic trigger goes: up-counting, update as trigger output (RM0090 section 18, RM0433 section 39). The
//! timers of rigless count as well, but their trigger output reaches no converter.

use rigless::device::{Device, DeviceContext, Level, RegisterFile};
use rigless::soc::{stm32f427, stm32h743};
use rigless::time::{EventId, Run};

/// The request output that is the trigger.
pub const TRIGGER: usize = 0;

/// The timer of an STM32F427.
#[derive(Debug, Default)]
pub struct Timer(Counting);

/// The timer of an STM32H743, which has the same registers.
#[derive(Debug, Default)]
pub struct TimerH743(Counting);

/// What both do.
#[derive(Debug, Default)]
struct Counting {
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

impl Counting {
    fn schedule(&mut self, context: &mut DeviceContext<'_>) {
        let mut run = self.run.unwrap_or(Run::at(context.now()));
        run.extend(self.ticks.into(), self.hz.max(1));
        self.run = Some(run);
        self.next = Some(context.schedule(run.ends));
    }
}

macro_rules! device {
    ($timer:ident, $register:ty) => {
        impl Device for $timer {
            type Register = $register;

            fn on_clock(&mut self, hz: u64, _registers: &mut RegisterFile, _context: &mut DeviceContext<'_>) {
                self.0.hz = hz;
            }

            fn read(
                &mut self,
                register: Self::Register,
                _: &mut RegisterFile,
                context: &mut DeviceContext<'_>,
            ) -> Option<u64> {
                let this = &self.0;
                let (Self::Register::Cnt, Some(run), Some(_)) = (register, this.run, this.next) else {
                    return None;
                };
                let left_ns = run.ends.0.saturating_sub(context.now().0);
                let left = (left_ns * this.hz / 1_000_000_000).min(this.ticks - 1);
                Some(this.ticks - 1 - left)
            }

            fn write(
                &mut self,
                register: Self::Register,
                value: u64,
                registers: &mut RegisterFile,
                context: &mut DeviceContext<'_>,
            ) {
                if register != Self::Register::Cr1 {
                    return;
                }
                let this = &mut self.0;
                let running = this.next.is_some();
                if value & ENABLED == 0 {
                    (this.next, this.run) = (None, None);
                } else if !running {
                    let reload = registers.get(Self::Register::Arr) + 1;
                    this.ticks = (registers.get(Self::Register::Psc) + 1) * reload;
                    this.schedule(context);
                }
            }

            fn on_event(&mut self, event: EventId, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
                if self.0.next != Some(event) {
                    return;
                }
                self.0.updates += 1;
                if registers.get(Self::Register::Cr2) & MASTER_MODE == UPDATE {
                    context.request(TRIGGER, Level::High);
                    context.request(TRIGGER, Level::Low);
                }
                self.0.schedule(context);
            }

            fn reset(&mut self) {
                self.0 = Counting {
                    hz: self.0.hz,
                    ..Counting::default()
                };
            }
        }
    };
}

device!(Timer, stm32f427::generated::tim2::Register);
device!(TimerH743, stm32h743::generated::tim2::Register);
