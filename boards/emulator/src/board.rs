//! The chip with the models that it lacks, and what is around it.

use crate::converter::Converter;
use crate::counter::{Capturing, Counter};
use crate::line::Line;
use crate::source::{DMA_REQUEST, Source};
use crate::timer::Timer;
use crate::unused::unused;
use crate::world::{Shared, locked};
use rigless::device::{Device, ErasedDevice, ResetCause};
use rigless::machine::armv7m::{Core, Fpu, MpuRegions, Variant};
use rigless::machine::{Board, Target};
use rigless::mcu::{Mcu, Operate};
use rigless::snapshot::Store;
use rigless::soc::stm32f427::Stm32f427;
use rigless::soc::stm32f427::generated::flash::{Register as Options, acr, optcr};
use rigless::soc::stm32f427::generated::rcc::{Register, cfgr, cr};
use rigless::soc::stm32f427::peripherals::dma::{Dma, Wire};
use rigless::soc::stm32f427::peripherals::usart::TRANSMIT_REQUEST;
use rigless::soc::{Bus, Error};
use rigless::time::VirtualNanos;
use std::num::{NonZeroU32, NonZeroU64};

/// Instructions a second of virtual time: the clock of 168 MHz at 1.4 cycles an instruction.
const INSTRUCTIONS_PER_SECOND: u64 = 120_000_000;

/// The DAC's first channel asks stream 5 of the first controller, channel 7, and the transmitter of the second serial
/// port stream 6, channel 4 (RM0090 table 42).
static DMA1_WIRES: [Wire; 2] = [
    Wire {
        instance: "DAC",
        request: DMA_REQUEST,
        channel: 7,
        streams: &[5],
    },
    Wire {
        instance: "USART2",
        request: TRANSMIT_REQUEST,
        channel: 4,
        streams: &[6],
    },
];

/// What is soldered to the high-speed clock input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wired {
    /// Nothing, or a dead crystal.
    Nothing,
    /// A crystal of so many Hz.
    Crystal(u64),
    /// A clock of so many Hz from outside, as the debugger of a Nucleo gives.
    Clock(u64),
}

impl Wired {
    /// Its frequency; 0 where there is nothing.
    pub(crate) fn hz(self) -> u64 {
        match self {
            Self::Nothing => 0,
            Self::Crystal(hz) | Self::Clock(hz) => hz,
        }
    }

    /// Whether the input runs when its oscillator is bypassed or is not: a crystal with it only, a clock from outside without
    /// it only.
    pub(crate) fn runs(self, bypassed: bool) -> bool {
        match self {
            Self::Nothing => false,
            Self::Crystal(_) => !bypassed,
            Self::Clock(_) => bypassed,
        }
    }
}

impl Default for Wired {
    /// As on a Nucleo.
    fn default() -> Self {
        Self::Clock(8_000_000)
    }
}

/// The chip.
#[derive(Debug)]
pub struct Chip {
    inner: Stm32f427,
    timer: Timer,
    converter: Converter,
    source: Source,
    counter: Counter,
    slots: [usize; 4],
    unused: Box<[bool]>,
    /// Of the clock controller, and what its input has.
    clocks: usize,
    wired: Wired,
    world: Shared,
}

impl Chip {
    /// Powered up, with this world on its pins and this line on its first two serial ports, of which a program uses
    /// one.
    ///
    /// # Errors
    /// rigless's, when the chip does not fit together.
    pub fn new(world: Shared, line: Line, wired: Wired) -> Result<Self, Error> {
        let mut inner = Stm32f427::new()?;
        let slots = [
            inner.bus().slot("TIM2")?,
            inner.bus().slot("ADC1")?,
            inner.bus().slot("DAC")?,
            inner.bus().slot("TIM11")?,
        ];
        inner.rcc.attach_crystals(wired.hz(), 0);
        inner.set_supply(3300);
        inner.usart[0].attach(line.clone());
        inner.usart[1].attach(line);
        let clocks = inner.bus().slot("RCC")?;
        inner.dma[0] = Dma::new(&DMA1_WIRES, &[], false);
        let used = ["TIM2", "TIM11", "USART1", "USART2", "DMA1", "DMA2"];
        let unused = unused(inner.bus(), &used);
        Ok(Self {
            inner,
            timer: Timer::default(),
            converter: Converter::new(world.clone()),
            source: Source::new(world.clone()),
            counter: Counter(Capturing::new(16_000_000)),
            slots,
            unused,
            clocks,
            wired,
            world,
        })
    }

    /// The brown-out reset's level in the option bytes: 3 is off, 0 the highest.
    pub fn brown_out(&self) -> u64 {
        let registers = self.inner.bus().registers("FLASH");
        registers.map_or(3, |r| optcr::BOR_LEV.get(r.get(Options::Optcr)))
    }

    /// Whether the flash memory's prefetch is on.
    pub fn prefetch(&self) -> bool {
        let registers = self.inner.bus().registers("FLASH");
        registers.is_some_and(|r| acr::PRFTEN.is_set(r.get(Options::Acr)))
    }

    /// The supply is so many millivolts from now on.
    pub fn supply(&mut self, millivolts: u32) {
        self.inner.set_supply(millivolts);
    }
}

impl Mcu for Chip {
    fn bus(&self) -> &Bus {
        self.inner.bus()
    }

    fn bus_mut(&mut self) -> &mut Bus {
        self.inner.bus_mut()
    }

    fn reset(&mut self, at: VirtualNanos, cause: ResetCause) {
        self.inner.reset(at, cause);
        self.inner.dma[0] = Dma::new(&DMA1_WIRES, &[], false);

        Device::reset(&mut self.timer);
        Device::reset(&mut self.converter);
        Device::reset(&mut self.source);
        Device::reset(&mut self.counter);
        locked(&self.world).reset();
    }

    fn poll(&mut self, now: VirtualNanos) {
        self.inner.poll(now);
    }

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        let [timer, converter, source, counter] = self.slots;
        if slot == self.clocks || slot == counter {
            let (_, registers) = self.inner.clocks();
            let control = registers.get(Register::Cr);
            if !self.wired.runs(cr::HSEBYP.is_set(control)) {
                // rigless's oscillator is ready some time after it was switched on, whatever is soldered to it.
                registers.set(Register::Cr, cr::HSERDY.set(control, 0));
            }
            let ready = cr::HSERDY.is_set(registers.get(Register::Cr));
            let divider = cfgr::RTCPRE.get(registers.get(Register::Cfgr));
            self.counter.0.input = (if ready { self.wired.hz() } else { 0 }, divider);
        }
        let own: &mut dyn ErasedDevice = if slot == timer {
            &mut self.timer
        } else if slot == converter {
            &mut self.converter
        } else if slot == source {
            &mut self.source
        } else if slot == counter {
            &mut self.counter
        } else if self.unused.get(slot).copied().unwrap_or(false) {
            return (self.inner.bus_mut(), None);
        } else {
            return self.inner.split(slot);
        };
        (self.inner.bus_mut(), Some(own))
    }
}

/// The chip as a machine that rigless runs.
#[derive(Debug)]
pub struct Machine {
    /// The chip.
    pub chip: Chip,
}

/// Snapshots are not taken.
impl Store for Machine {}

impl Board for Machine {
    fn name(&self) -> &'static str {
        "skin"
    }

    fn target_names(&self) -> Vec<&'static str> {
        vec!["stm32f427"]
    }

    fn mcu(&mut self, target: usize) -> Option<&mut dyn Mcu> {
        (target == 0).then_some(&mut self.chip)
    }

    fn targets(&mut self) -> Vec<Target<'_>> {
        let lines = u32::from(self.chip.cpu().interrupt_lines);
        let core = Core {
            variant: Variant::M4,
            clock_hz: NonZeroU64::new(168_000_000).unwrap_or(NonZeroU64::MIN),
            interrupt_lines: NonZeroU32::new(lines).unwrap_or(NonZeroU32::MIN),
            priority_bits: 4,
            refclk_divider: NonZeroU32::new(8).unwrap_or(NonZeroU32::MIN),
            instructions_per_second: NonZeroU64::new(INSTRUCTIONS_PER_SECOND).unwrap_or(NonZeroU64::MIN),
            boot: "flash",
        }
        .spec_with_parts(
            &rigless::cpu::armv7m::windows(self.chip.bus()),
            Fpu::FpV4Sp,
            MpuRegions::Eight,
        );
        vec![Target::new("stm32f427", &mut self.chip, core)]
    }
}
