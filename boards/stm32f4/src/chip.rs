//! What has to be set up once, and what is left over: clocks, pins, watchdog, supply, time.

use crate::flash;
use crate::multiplexer;
use crate::panic_record;
use crate::sampler;
use crate::supply::{self, supply_is_good, wait_for_supply};
use firmware::{Clock, Sector, Store, Watchdog};
use protocol::ResetCause;
use stm32f4xx_hal::pac;
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::rcc::Config;

/// What the chip says as it starts.
pub struct Started {
    /// Why.
    pub cause: ResetCause,
    /// What is not as it should be; empty when all is.
    pub note: &'static str,
}

const NO_CRYSTAL: &str = "no 8 MHz clock: on the internal one, up to 1 % off";
const LOW_SUPPLY: &str = "the supply is below 3.0 V: settings cannot be stored";

/// Sets the chip up: watchdog first, then clocks and pins.
pub fn start(device: pac::Peripherals, mut core: cortex_m::Peripherals) -> Started {
    // A program that is being debugged is not bitten.
    device
        .DBGMCU
        .apb1_fz()
        .modify(|r, w| unsafe { w.bits(r.bits() | 1 << 12) });
    // 32 kHz / 64: 1000 of these are 2 s. Erasing a sector of the settings takes half a second at most.
    device.IWDG.kr().write(|w| unsafe { w.bits(0xCCCC) });
    device.IWDG.kr().write(|w| unsafe { w.bits(0x5555) });
    device.IWDG.pr().write(|w| unsafe { w.bits(4) });
    device.IWDG.rlr().write(|w| unsafe { w.bits(1000) });
    // They count once the slow clock has taken them over; then from the new value.
    while device.IWDG.sr().read().bits() != 0 {}
    device.IWDG.kr().write(|w| unsafe { w.bits(0xAAAA) });

    let cause = reset_cause(device.RCC.csr().read().bits());
    device.RCC.csr().modify(|r, w| unsafe { w.bits(r.bits() | 1 << 24) });
    // Ports A, B and C, both DMA controllers; TIM2, power control, DAC; ADC1, USART1.
    device
        .RCC
        .ahb1enr()
        .modify(|r, w| unsafe { w.bits(r.bits() | 0b111 | 0b11 << 21) });
    device
        .RCC
        .apb1enr()
        .modify(|r, w| unsafe { w.bits(r.bits() | 1 | 1 << 28 | 1 << 29 | u32::from(ST_LINK) << 17) });
    device
        .RCC
        .apb2enr()
        .modify(|r, w| unsafe { w.bits(r.bits() | 1 << 8 | u32::from(!ST_LINK) << 4) });
    let supplied = wait_for_supply(&device.PWR);
    if supplied {
        reset_below_2_7_volt(&device.FLASH);
    }

    let crystal = hse_runs(&device.RCC);
    let clock = match (crystal, NUCLEO) {
        (true, false) => Config::hse(8.MHz()),
        (true, true) => Config::hse(8.MHz()).bypass_hse_oscillator(),
        // Its serial line works and so does the lock-in, which has no other clock to compare with.
        (false, _) => Config::hsi(),
    };
    let rcc = device
        .RCC
        .freeze(clock.sysclk(168.MHz()).pclk1(42.MHz()).pclk2(84.MHz()));
    // From here on a crystal that stops is a non-maskable interrupt, not a frequency that silently changes.
    // SAFETY: one bit of a register that nothing else writes any more.
    let registers = unsafe { &*pac::RCC::ptr() };
    if crystal {
        registers.cr().modify(|r, w| unsafe { w.bits(r.bits() | 1 << 19) });
    }
    drop(rcc);

    core.DCB.enable_trace();
    // A reset does not clear it, and the samples' time begins at 0.
    core.DWT.set_cycle_count(0);
    core.DWT.enable_cycle_counter();
    multiplexer::start();
    // Analog: PA0, PA1 and PA6 to the converter, PA4 from the DAC.
    device
        .GPIOA
        .moder()
        .modify(|r, w| unsafe { w.bits(r.bits() | 0b11 << 12 | 0b11 << 8 | 0b1111) });
    // The converters' clock is 84 MHz / 4.
    device
        .ADC_COMMON
        .ccr()
        .modify(|r, w| unsafe { w.bits(r.bits() & !(3 << 16) | 1 << 16) });
    let note = match (crystal, supplied) {
        (false, _) => NO_CRYSTAL,
        (true, false) => LOW_SUPPLY,
        (true, true) => "",
    };
    Started { cause, note }
}

/// A Nucleo gets its 8 MHz from the debugger on it, without a crystal.
const NUCLEO: bool = cfg!(feature = "f446");
const ST_LINK: bool = cfg!(feature = "st-link");

/// Sets the chip's own brown-out reset to its highest level (3, some 2.8 V) where it is not: as delivered it is off, and
/// between 1.8 V and there the processor may do anything. One of the option bytes, kept for ever, so written once in a
/// chip's life.
fn reset_below_2_7_volt(flash: &pac::FLASH) {
    const LEVEL: u32 = 3 << 2;
    if flash.optcr().read().bits() & LEVEL == 0 {
        return;
    }
    // A reset in the middle would leave the option bytes half written.
    let finish = || {
        while flash.sr().read().bits() & 1 << 16 != 0 {
            feed();
        }
    };
    flash.optkeyr().write(|w| unsafe { w.bits(0x0819_2A3B) });
    flash.optkeyr().write(|w| unsafe { w.bits(0x4C5D_6E7F) });
    finish();
    // All other bits stay as they are; level 3 is 0. Then the start bit.
    flash.optcr().modify(|r, w| unsafe { w.bits(r.bits() & !LEVEL) });
    flash.optcr().modify(|r, w| unsafe { w.bits(r.bits() | 1 << 1) });
    finish();
    flash.optcr().modify(|r, w| unsafe { w.bits(r.bits() | 1) });
}

/// Feeds the watchdog.
fn feed() {
    // SAFETY: a key register, for writing only.
    let watchdog = unsafe { &*pac::IWDG::ptr() };
    watchdog.kr().write(|w| unsafe { w.bits(0xAAAA) });
}

/// Starts the oscillator of the crystal, or the input for the Nucleo's clock; whether it runs after 50 ms at most.
fn hse_runs(rcc: &pac::RCC) -> bool {
    let on = 1 << 16 | u32::from(NUCLEO) << 18;
    rcc.cr()
        .modify(|r, w| unsafe { w.bits(r.bits() & !(1 << 16) | on & 1 << 18) });
    rcc.cr().modify(|r, w| unsafe { w.bits(r.bits() | on) });
    let runs = || rcc.cr().read().bits() & 1 << 17 != 0;
    let mut patience = 100_000;
    while !runs() && patience > 0 {
        patience -= 1;
    }
    let found = runs();
    if !found {
        rcc.cr().modify(|r, w| unsafe { w.bits(r.bits() & !on) });
    }
    found
}

fn reset_cause(flags: u32) -> ResetCause {
    let set = |bit: u32| flags >> bit & 1 == 1;
    if set(29) || set(30) {
        ResetCause::Watchdog
    } else if set(28) {
        ResetCause::Software
    } else if set(27) {
        ResetCause::PowerOn
    } else if set(25) {
        ResetCause::BrownOut
    } else if set(26) {
        ResetCause::Pin
    } else {
        ResetCause::Unknown
    }
}

#[cortex_m_rt::exception]
unsafe fn NonMaskableInt() {
    panic!("the crystal stopped");
}

/// Clock, watchdog and store.
pub struct Chip;

impl Clock for Chip {
    fn now(&mut self) -> u64 {
        sampler::now()
    }
}

impl Watchdog for Chip {
    fn feed(&mut self) {
        // However long nobody measures, the time is asked before the cycle counter came round: every tenth of a second.
        sampler::keep_up();
        feed();
        if supply::sags() {
            // What is measured now is wrong, and worse may come: the sheet without voltage until the supply is back, or until the
            // brown-out reset.
            multiplexer::release();
            while !supply_is_good() {
                feed();
            }
            panic_record::restart_after_a_sag();
        }
    }
}

impl Store for Chip {
    type Error = flash::FlashError;

    fn sector_len(&self) -> u32 {
        flash::SECTOR_LEN
    }

    fn read(&mut self, sector: Sector, offset: u32, out: &mut [u8]) -> Result<(), Self::Error> {
        flash::read(sector, offset, out)
    }

    fn write(&mut self, sector: Sector, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        flash::write(sector, offset, bytes)
    }

    fn erase(&mut self, sector: Sector) -> Result<(), Self::Error> {
        flash::erase(sector)
    }
}
