//! The chip's start (watchdog, clocks, analogue pins), and `firmware`'s clock, watchdog, store and word that outlives a
//! reset.

use crate::clock_search::{self, NO_CLOCK};
use crate::clocks;
use crate::flash;
use crate::multiplexer;
use crate::panic_record;
use crate::supply::{self, supply_is_good, wait_for_supply};
use crate::timebase;
use core::sync::atomic::{AtomicU32, Ordering};
use firmware::{Clock, Scratch, Sector, Store, Watchdog};
use protocol::ResetCause;
use stm32f4xx_hal::pac;
use stm32f4xx_hal::rcc::RccExt;

/// What was found at the start.
pub struct Started {
    /// Why the chip started.
    pub cause: ResetCause,
    /// What is wrong, in words; empty when nothing is.
    pub note: &'static str,
}

const LOW_SUPPLY: &str = "the supply is below 3.0 V: settings cannot be stored";

/// The chip's number, three words (RM0390 section 34.1, RM0090 section 39.1).
pub const UNIQUE_ID: *const u32 = 0x1FFF_7A10 as *const u32;

/// Processor cycles from one flash of the light to the next, 0.8 s. The cycle counter comes round after a whole number of
/// these.
pub const LIGHT_CYCLE: u32 = 1 << 27;

/// What the watchdog counts down from, at 32 kHz / 64: 2 s. Erasing a sector of the settings takes half a second at
/// most.
const WATCHDOG_COUNTS: u16 = 1000;

/// Sets the chip up: watchdog first, then clocks and pins.
pub fn start(device: pac::Peripherals, mut core: cortex_m::Peripherals) -> Started {
    // The watchdog stands still while a debugger has halted the processor.
    device.DBGMCU.apb1_fz().modify(|_, w| w.dbg_iwdg_stop().set_bit());
    device.IWDG.kr().write(|w| w.key().start());
    device.IWDG.kr().write(|w| w.key().unlock());
    device.IWDG.pr().write(|w| w.pr().divide_by64());
    device.IWDG.rlr().write(|w| w.rl().set(WATCHDOG_COUNTS));
    // Both registers count once the slow clock has taken them over. The feed then loads the new value.
    while device.IWDG.sr().read().bits() != 0 {}
    device.IWDG.kr().write(|w| w.key().feed());

    let cause = reset_cause(&device.RCC.csr().read());
    device.RCC.csr().modify(|_, w| w.rmvf().clear());
    device.RCC.ahb1enr().modify(|_, w| {
        w.gpioaen().enabled().gpioben().enabled().gpiocen().enabled();
        w.dma1en().enabled().dma2en().enabled()
    });
    device.RCC.apb1enr().modify(|_, w| {
        w.tim2en().enabled().pwren().enabled().dacen().enabled();
        if ST_LINK { w.usart2en().enabled() } else { w }
    });
    device.RCC.apb2enr().modify(|_, w| {
        w.adc1en().enabled();
        if ST_LINK { w } else { w.usart1en().enabled() }
    });
    let supplied = wait_for_supply(&device.PWR);
    if supplied {
        reset_below_2_7_volt(&device.FLASH);
    }

    let clock = clock_search::find(&device.RCC, &device.TIM11);
    log!(info, "clock: {}; supply good: {=bool}", clock, supplied);
    let rcc = device.RCC.freeze(clocks::config(clock));
    // From here on a clock that stops is a non-maskable interrupt, not a frequency that silently changes.
    if clock.is_some() {
        rcc.cr().modify(|_, w| w.csson().on());
    }
    // `freeze` switches the prefetch of instructions on, which disturbs the converter on every STM32F4 (ES0298 and
    // ES0206, 2.2.8), and does not work at all in the STM32F405's revision A (ES0182). Off on all of them, whatever the
    // revision: the caches serve the loops, and the rest has time.
    device.FLASH.acr().modify(|_, w| w.prften().disabled());

    core.DCB.enable_trace();
    // A reset does not clear the counter, and the time of the samples begins at 0.
    core.DWT.set_cycle_count(0);
    core.DWT.enable_cycle_counter();
    multiplexer::start();
    // Analog: PA0, PA1 and PA6 to the converter, PA4 from the DAC.
    device.GPIOA.moder().modify(|_, w| {
        w.moder0().analog().moder1().analog();
        w.moder4().analog().moder6().analog()
    });
    // The converters' clock is 84 MHz / 4.
    device.ADC_COMMON.ccr().modify(|_, w| w.adcpre().div4());
    let note = match (clock, supplied) {
        (None, _) => NO_CLOCK,
        (Some(_), false) => LOW_SUPPLY,
        (Some(_), true) => "",
    };
    Started { cause, note }
}

const ST_LINK: bool = cfg!(feature = "st-link");

/// The two keys that open the option bytes, in this order (RM0390 section 3.6.2, RM0090 section 3.7.2).
const OPTION_KEY_1: u32 = 0x0819_2A3B;
const OPTION_KEY_2: u32 = 0x4C5D_6E7F;
/// The highest level of the brown-out reset in the field BOR_LEV: it counts downwards from 3, which is off (RM0390
/// section 3.8, RM0090 section 3.9). The names that the register crate has for the levels are the wrong way round.
const BROWN_OUT_LEVEL_3: u8 = 0;

/// Sets the chip's own brown-out reset to its highest level, some 2.8 V, unless it is set already.
///
/// As delivered it is off, and between 1.8 V and 2.7 V the processor may do anything. The level is an option byte,
/// which the chip keeps without power: this writes once in a chip's life.
fn reset_below_2_7_volt(flash: &pac::FLASH) {
    if flash.optcr().read().bor_lev().bits() == BROWN_OUT_LEVEL_3 {
        return;
    }
    log!(info, "option bytes: brown-out reset to level 3");
    // A reset in the middle would leave the option bytes half written.
    let finish = || {
        while flash.sr().read().bsy().is_busy() {
            feed();
        }
    };
    flash.optkeyr().write(|w| w.optkeyr().set(OPTION_KEY_1));
    flash.optkeyr().write(|w| w.optkeyr().set(OPTION_KEY_2));
    finish();
    // All other bits stay as they are. Then the start bit.
    flash.optcr().modify(|_, w| w.bor_lev().set(BROWN_OUT_LEVEL_3));
    flash.optcr().modify(|_, w| w.optstrt().set_bit());
    finish();
    flash.optcr().modify(|_, w| w.optlock().set_bit());
}

/// Feeds the watchdog.
fn feed() {
    // SAFETY: the address is that of the watchdog's registers. The one write restarts its count, which any code may do.
    let watchdog = unsafe { &*pac::IWDG::ptr() };
    watchdog.kr().write(|w| w.key().feed());
}

fn reset_cause(flags: &pac::rcc::csr::R) -> ResetCause {
    if flags.wdgrstf().is_reset() || flags.wwdgrstf().is_reset() {
        ResetCause::Watchdog
    } else if flags.sftrstf().is_reset() {
        ResetCause::Software
    } else if flags.porrstf().is_reset() {
        ResetCause::PowerOn
    } else if flags.borrstf().is_reset() {
        ResetCause::BrownOut
    } else if flags.padrstf().is_reset() {
        ResetCause::Pin
    } else {
        ResetCause::Unknown
    }
}

// SAFETY: shares nothing with what it interrupts, and does not return to it.
#[cortex_m_rt::exception]
unsafe fn NonMaskableInt() {
    panic!("the clock stopped");
}

/// The word that outlives a reset, in memory that no start clears.
// SAFETY: the section holds variables that are not given a first value, which any word is good for.
#[unsafe(link_section = ".uninit.scratch")]
static SCRATCH: AtomicU32 = AtomicU32::new(0);

/// Clock, watchdog, store and that word.
pub struct Chip;

impl Clock for Chip {
    fn now(&mut self) -> u64 {
        timebase::now()
    }
}

impl Watchdog for Chip {
    fn feed(&mut self) {
        // Reads the time every tenth of a second, also while nothing is measured: the cycle counter must not come round
        // unseen.
        timebase::keep_up();
        feed();
        if supply::sags() {
            // Measurements are wrong now, and the supply may fall further. The sheet stays without voltage until the
            // supply is back or the brown-out reset comes.
            multiplexer::release();
            while !supply_is_good() {
                feed();
            }
            panic_record::restart_after_a_sag();
        }
    }
}

impl Scratch for Chip {
    fn recall(&mut self) -> u32 {
        SCRATCH.load(Ordering::Relaxed)
    }

    fn keep(&mut self, word: u32) {
        SCRATCH.store(word, Ordering::Relaxed);
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
