//! The chip with the models that it lacks, and a run of a program on it.

use super::cells::{self, Cells};
use super::converter::{Converter, Which};
use super::memory::Memory;
use super::source::Source;
use super::watchdog::Watchdog;
use super::world::{Shared, World};
use crate::board::Wired;
use crate::counter::{Capturing, CounterH743};
use crate::line::Line;
use crate::run::{Emulated, Outcome, Setup, Sign, run_machine};
use crate::timer::TimerH743;
use crate::unused::unused;
use crate::world::locked;
use rigless::device::{Device, ErasedDevice, ResetCause};
use rigless::machine::armv7m::{BranchPrediction, Caches, Config, Core, Fpu, MpuRegions, Variant};
use rigless::machine::{Board, Target};
use rigless::mcu::{Mcu, Operate};
use rigless::snapshot::Store;
use rigless::soc::stm32h743::Stm32h743;
use rigless::soc::stm32h743::generated::flash::{Register as FlashRegister, sr2};
use rigless::soc::stm32h743::generated::rcc::{Register, cfgr, cr};
use rigless::soc::{Bus, Error as SocError, Window};
use rigless::time::VirtualNanos;
use std::collections::BTreeSet;
use std::error::Error;
use std::num::{NonZeroU32, NonZeroU64};
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, Mutex};

/// Instructions a second of virtual time: the clock of 400 MHz at 1.4 cycles an instruction. A Cortex-M7 often does two in a
/// cycle; code from flash memory that is not in the cache takes longer.
pub const INSTRUCTIONS_PER_SECOND: u64 = 285_714_286;

/// The serial port that the Nucleo's debugger is wired to.
const USART3: usize = 2;

/// The chip.
#[derive(Debug)]
pub struct Chip {
    inner: Stm32h743,
    timer: TimerH743,
    converters: [Converter; 3],
    source: Source,
    memory: Memory,
    cells: Cells,
    /// Slot of the cells.
    window: usize,
    watchdog: Watchdog,
    counter: CounterH743,
    slots: [usize; 8],
    unused: Box<[bool]>,
    /// Of the clock controller, and what its input has.
    clocks: usize,
    wired: Wired,
    world: Shared,
}

impl Chip {
    /// Powered up, with this world on its pins, this line on its serial port, and this at its clock input.
    ///
    /// # Errors
    /// rigless's, when the chip does not fit together.
    pub fn new(world: Shared, line: Line, wired: Wired) -> Result<Self, SocError> {
        let mut inner = Stm32h743::new()?;
        let slots = [
            inner.bus().slot("TIM2")?,
            inner.bus().slot("ADC1")?,
            inner.bus().slot("ADC2")?,
            inner.bus().slot("ADC3")?,
            inner.bus().slot("DAC")?,
            inner.bus().slot("Flash")?,
            inner.bus().slot("IWDG")?,
            inner.bus().slot("TIM17")?,
        ];
        let clocks = inner.bus().slot("RCC")?;
        let len = NonZeroU64::new(cells::LEN).unwrap_or(NonZeroU64::MIN);
        let window = inner.bus_mut().add_window(Window::new("Cells", cells::BASE, len))?;
        let shared = cells::Shared::default();
        let layout = inner.bus_mut().slot_mut(window).peripheral().registers;
        inner.rcc.attach_crystals(wired.hz(), 0);
        inner.set_supply(3300);
        inner.set_analog_supply(3300);
        inner.usart[USART3].attach(line);
        let unused = unused(inner.bus(), &["TIM2", "TIM17", "USART3", "DMA1", "DMAMUX1"]);
        Ok(Self {
            inner,
            timer: TimerH743::default(),
            converters: [Which::First, Which::Second, Which::Third].map(|w| Converter::new(w, world.clone())),
            source: Source::new(world.clone()),
            memory: Memory::new(shared.clone()),
            cells: Cells { state: shared, layout },
            window,
            watchdog: Watchdog::default(),
            counter: CounterH743(Capturing::new(64_000_000)),
            slots,
            unused,
            clocks,
            wired,
            world,
        })
    }
}

impl Chip {
    /// Slot of the flash memory's controller.
    fn flash(&self) -> usize {
        self.slots[5]
    }

    /// Sets bits of the second bank's status.
    fn set_flash_status(&mut self, bits: u64) {
        let (_, registers) = self.inner.program();
        let status = registers.get(FlashRegister::Sr2);
        registers.set(FlashRegister::Sr2, status | bits);
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
        Device::reset(&mut self.timer);
        self.converters.iter_mut().for_each(Device::reset);
        Device::reset(&mut self.source);
        Device::reset(&mut self.memory);
        ErasedDevice::reset(&mut self.cells);
        Device::reset(&mut self.watchdog);
        Device::reset(&mut self.counter);
        locked(&self.world).reset();
    }

    fn poll(&mut self, now: VirtualNanos) {
        self.inner.poll(now);
    }

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        let [.., counter] = self.slots;
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
        if self.unused.get(slot).copied().unwrap_or(false) {
            return (self.inner.bus_mut(), None);
        }
        if slot == self.window {
            return (self.inner.bus_mut(), Some(&mut self.cells));
        }
        if slot == self.flash() && !self.memory.powered() {
            // A program whose word in the cells was cut off waits for its end until the run ends.
            self.set_flash_status(sr2::QW2.mask());
        }
        let Some(own) = self.slots.iter().position(|s| *s == slot) else {
            return self.inner.split(slot);
        };
        let [first, second, third] = &mut self.converters;
        let models: [&mut dyn ErasedDevice; 8] = [
            &mut self.timer,
            first,
            second,
            third,
            &mut self.source,
            &mut self.memory,
            &mut self.watchdog,
            &mut self.counter,
        ];
        (self.inner.bus_mut(), models.into_iter().nth(own))
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
        "skin-h743"
    }

    fn target_names(&self) -> Vec<&'static str> {
        vec!["stm32h743"]
    }

    fn mcu(&mut self, target: usize) -> Option<&mut dyn Mcu> {
        (target == 0).then_some(&mut self.chip)
    }

    fn targets(&mut self) -> Vec<Target<'_>> {
        let lines = u32::from(self.chip.cpu().interrupt_lines);
        let core = Core {
            variant: Variant::M7,
            clock_hz: NonZeroU64::new(400_000_000).unwrap_or(NonZeroU64::MIN),
            interrupt_lines: NonZeroU32::new(lines).unwrap_or(NonZeroU32::MIN),
            priority_bits: 4,
            refclk_divider: NonZeroU32::new(8).unwrap_or(NonZeroU32::MIN),
            instructions_per_second: NonZeroU64::new(INSTRUCTIONS_PER_SECOND).unwrap_or(NonZeroU64::MIN),
            boot: "flash",
        };
        let mut config = Config::new(core, &rigless::cpu::armv7m::windows(self.chip.bus()));
        config.fpu = Fpu::FpV5Dp;
        config.mpu_regions = MpuRegions::Sixteen;
        // A Cortex-M7 r1p1 with 16 KiB of each cache (PM0253 tables 52, 77 and 81), started from flash memory.
        config.cpuid = 0x411F_C271;
        config.caches = Some(Caches {
            clidr: 0x0900_0003,
            ctr: 0x8303_C003,
            ccsidr: &[0xF00F_E019, 0xF01F_E009],
        });
        config.branch_prediction = BranchPrediction::Always;
        config.vector_table = Some(0x0800_0000);
        let spec = config.spec();
        vec![Target::new("stm32h743", &mut self.chip, spec)]
    }
}

impl Emulated for Machine {
    fn sign(address: u64, value: u64) -> Sign {
        // Port E: pin 1 is the light, pin 14 high while a block is worked on.
        const PORT_E_BSRR: u64 = 0x5802_1018;
        if address == PORT_E_BSRR {
            Sign::of(value, 1, 14)
        } else {
            Sign::default()
        }
    }

    fn supply(&mut self, millivolts: u32) {
        self.chip.inner.set_supply(millivolts);
    }

    fn power_for(&mut self, steps: usize, holds: Vec<(u64, Vec<u8>)>) {
        self.chip.memory.power_for(steps, holds);
    }

    fn powered(&self) -> bool {
        self.chip.memory.powered()
    }

    fn steps(&self) -> usize {
        self.chip.memory.steps()
    }

    fn keeps(&self, address: u64, len: usize) -> Option<Vec<u8>> {
        locked(&self.chip.cells.state).read(address, len)
    }

    fn broken(&self) -> BTreeSet<u64> {
        locked(&self.chip.cells.state).broken()
    }

    fn may_break(address: u64) -> bool {
        // The cells, and the second bank's registers.
        const REGISTERS: Range<u64> = 0x5200_2100..0x5200_2200;
        (cells::BASE..cells::BASE + cells::LEN).contains(&address) || REGISTERS.contains(&address)
    }

    fn found_broken(&mut self) {
        self.chip.set_flash_status(sr2::DBECCERR2.mask());
    }
}

/// Runs a program in a world, as [`crate::run::run_in`] does.
///
/// # Errors
/// The program cannot be read or run.
pub fn run_in(
    program: &Path,
    world: World,
    setup: Setup,
    frames: usize,
    until_ns: u64,
) -> Result<Outcome, Box<dyn Error>> {
    let world: Shared = Arc::new(Mutex::new(world));
    let line = Line::default();
    let machine = Machine {
        chip: Chip::new(world.clone(), line.clone(), setup.clock)?,
    };
    let (outcome, _) = run_machine(machine, line, program, setup, frames, until_ns)?;
    let world = locked(&world);
    Ok(Outcome {
        without_break: world.without_break,
        triggers: world.triggers,
        ..outcome
    })
}
