//! The chip's start (watchdog, supply, clocks), and `firmware`'s clock, watchdog, store and word that outlives a reset.

use crate::clock_search::{self, NO_CLOCK};
use crate::clocks;
use crate::pac;
use crate::supply::{self, supply_is_good, wait_for_supply};
use crate::timebase;
use crate::{converter, dma, flash, multiplexer, panic_record};
use core::sync::atomic::{AtomicU32, Ordering};
use firmware::{Clock, Scratch, Sector, Store, Watchdog};
use protocol::ResetCause;

/// What was found at the start.
pub struct Started {
    /// Why the chip started.
    pub cause: ResetCause,
    /// What is wrong, in words; empty when nothing is.
    pub note: &'static str,
}

const LOW_SUPPLY: &str = "the supply is below 2.85 V: settings cannot be stored";

/// The chip's number, three words (RM0433 section 61.1).
pub const UNIQUE_ID: *const u32 = 0x1FF1_E800 as *const u32;

/// Processor cycles from one flash of the light to the next, 0.7 s. The cycle counter comes round after a whole number of
/// these.
pub const LIGHT_CYCLE: u32 = 1 << 28;

/// What the watchdog counts down from, at 32 kHz / 256: 8 s. Erasing a sector of the settings takes 4 s at most.
/// In the program that hangs on purpose it is 1 s: more takes minutes to emulate.
const WATCHDOG_COUNTS: u16 = if cfg!(feature = "fault-hang") { 125 } else { 1000 };

/// Sets the chip up: watchdog first, then supply, clocks, converters and pins.
pub fn start(device: &pac::Peripherals, core: &mut cortex_m::Peripherals) -> Started {
    device.IWDG.kr().write(|w| w.key().start());
    device.IWDG.kr().write(|w| w.key().unlock());
    device.IWDG.pr().write(|w| w.pr().divide_by256());
    device.IWDG.rlr().write(|w| w.rl().set(WATCHDOG_COUNTS));
    // The registers count once the slow clock has taken them over. The feed then loads the new value.
    while device.IWDG.sr().read().bits() != 0 {}
    feed();

    let cause = reset_cause(&device.RCC.rsr().read());
    device.RCC.rsr().modify(|_, w| w.rmvf().set_bit());
    let supplied = wait_for_supply(&device.PWR);
    clocks::raise_voltage(&device.PWR);
    let clock = clock_search::find(&device.RCC, &device.TIM17);
    log!(info, "clock: {}; supply good: {=bool}", clock, supplied);
    clocks::run(&device.RCC, &device.FLASH, clock);
    device
        .RCC
        .ahb1enr()
        .modify(|_, w| w.dma1en().enabled().adc12en().enabled());
    device.RCC.ahb4enr().modify(|_, w| {
        w.gpioaen().enabled().gpioben().enabled().gpiocen().enabled();
        w.gpioden().enabled().gpioeen().enabled().gpiofen().enabled();
        w.adc3en().enabled()
    });
    device
        .RCC
        .apb1lenr()
        .modify(|_, w| w.tim2en().enabled().dac12en().enabled().usart3en().enabled());

    // Instructions come from the flash memory by the cache. Data are in memory that needs none, or that DMA shares.
    core.SCB.enable_icache();
    core.DCB.enable_trace();
    cortex_m::peripheral::DWT::unlock();
    // A reset does not clear the counter, and the time of the samples begins at 0.
    core.DWT.set_cycle_count(0);
    core.DWT.enable_cycle_counter();
    multiplexer::start();
    dma::clear_memory();
    dma::start();
    // All inputs and the DAC's output are analog from reset on.
    converter::start();
    Started {
        cause,
        note: match (clock, supplied) {
            (None, _) => NO_CLOCK,
            (Some(_), false) => LOW_SUPPLY,
            (Some(_), true) => "",
        },
    }
}

/// Feeds the watchdog.
fn feed() {
    // SAFETY: the address is that of the watchdog's registers. The one write restarts its count, which any code may do.
    let watchdog = unsafe { &*pac::IWDG::ptr() };
    watchdog.kr().write(|w| w.key().feed());
}

fn reset_cause(flags: &pac::rcc::rsr::R) -> ResetCause {
    if flags.iwdg1rstf().bit_is_set() || flags.wwdg1rstf().bit_is_set() {
        ResetCause::Watchdog
    } else if flags.sftrstf().bit_is_set() {
        ResetCause::Software
    } else if flags.porrstf().bit_is_set() {
        ResetCause::PowerOn
    } else if flags.borrstf().bit_is_set() {
        ResetCause::BrownOut
    } else if flags.pinrstf().bit_is_set() {
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
        // Also while nothing is measured: the cycle counter must not come round unseen.
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

    fn write_len(&self) -> u32 {
        flash::WORD_LEN
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
