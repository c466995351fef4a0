//! TIM11 of an STM32F427 and TIM17 of an STM32H743 as far as they capture edges of the clock input against the processor's clock
//! (RM0090 section 19, and "Internal/external clock measurement" in section 6.2; RM0433 section 40). rigless's timers capture
//! nothing.

use rigless::device::{Device, DeviceContext, RegisterFile};
use rigless::soc::{stm32f427, stm32h743};
use rigless::time::VirtualNanos;

const ENABLED: u64 = 1;
/// The input is the first one, taken directly; a capture every eighth edge.
const EVERY_EIGHTH: u64 = 1 | 3 << 2;
/// The input selection: `HSE_RTC` of the one, `HSE_1MHz` of the other, which is the same.
const CLOCK_INPUT: u64 = 2;
/// Status: a capture, and one more before the first was read.
const CAPTURED: u64 = 1 << 1;
const AGAIN: u64 = 1 << 9;

/// The timer of an STM32F427.
#[derive(Debug)]
pub struct Counter(pub Capturing);

/// The timer of an STM32H743.
#[derive(Debug)]
pub struct CounterH743(pub Capturing);

/// What both do.
#[derive(Debug)]
pub struct Capturing {
    hz: u64,
    /// The clock at the input and what it is divided by; 0 Hz where none runs.
    pub input: (u64, u64),
    started: Option<VirtualNanos>,
    captures: u64,
    status: u64,
}

impl Capturing {
    /// With the internal oscillator's clock, until another is told.
    pub const fn new(hz: u64) -> Self {
        Self {
            hz,
            input: (0, 1),
            started: None,
            captures: 0,
            status: 0,
        }
    }

    /// Takes in what was captured up to now, the timer set up or not. The value of a new capture.
    fn catch_up(&mut self, now: VirtualNanos, set_up: bool) -> Option<u64> {
        let (hz, divider) = self.input;
        let on = set_up && hz > 0 && divider > 1;
        let started = self.started.filter(|_| on)?;
        let every = u128::from(divider) * 8 * 1_000_000_000;
        let captures = (u128::from(now.0 - started.0) * u128::from(hz) / every) as u64;
        if captures == self.captures {
            return None;
        }
        if self.status & CAPTURED != 0 || captures > self.captures + 1 {
            self.status |= AGAIN;
        }
        self.status |= CAPTURED;
        self.captures = captures;
        let tick = u128::from(captures) * u128::from(divider) * 8 * u128::from(self.hz) / u128::from(hz);
        Some(tick as u64 & 0xFFFF)
    }
}

macro_rules! device {
    ($counter:ident, $register:ty, $selection:ident) => {
        impl Device for $counter {
            type Register = $register;

            fn on_clock(&mut self, hz: u64, _registers: &mut RegisterFile, _context: &mut DeviceContext<'_>) {
                self.0.hz = hz;
            }

            fn read(
                &mut self,
                register: Self::Register,
                registers: &mut RegisterFile,
                context: &mut DeviceContext<'_>,
            ) -> Option<u64> {
                match register {
                    Self::Register::Sr => {
                        // One register with two names, of which rigless keeps one.
                        let mode =
                            registers.get(Self::Register::Ccmr1Input) | registers.get(Self::Register::Ccmr1Output);
                        let set_up = registers.get(Self::Register::$selection) == CLOCK_INPUT
                            && mode == EVERY_EIGHTH
                            && registers.get(Self::Register::Ccer) & ENABLED == 1;
                        if let Some(tick) = self.0.catch_up(context.now(), set_up) {
                            registers.set(Self::Register::Ccr1, tick);
                        }
                        Some(self.0.status)
                    }
                    Self::Register::Ccr1 => {
                        self.0.status &= !CAPTURED;
                        None
                    }
                    _ => None,
                }
            }

            fn write(
                &mut self,
                register: Self::Register,
                value: u64,
                _: &mut RegisterFile,
                context: &mut DeviceContext<'_>,
            ) {
                let this = &mut self.0;
                match register {
                    // Cleared by writing 0.
                    Self::Register::Sr => this.status &= value,
                    Self::Register::Cr1 if value & ENABLED == 0 => this.started = None,
                    Self::Register::Cr1 if this.started.is_none() => {
                        (this.started, this.captures) = (Some(context.now()), 0);
                    }
                    _ => {}
                }
            }

            fn reset(&mut self) {
                self.0 = Capturing::new(self.0.hz);
            }
        }
    };
}

device!(Counter, stm32f427::generated::tim11::Register, Or);
device!(CounterH743, stm32h743::generated::tim17::Register, Tim17Tisel);
