//! The chip's start (watchdog, supply, clocks), and `firmware`'s clock, watchdog, store and word that outlives a reset.

use crate::pac;
use crate::supply::{self, supply_is_good, wait_for_supply};
use crate::{converter, dma, flash, multiplexer, panic_record, sampler};
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

const NO_CLOCK: &str = "no clock of 8 MHz: on the internal one, 1 % off";
const LOW_SUPPLY: &str = "the supply is below 2.85 V: settings cannot be stored";

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
    let found = clocks(device);
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
        note: match (found, supplied) {
            (false, _) => NO_CLOCK,
            (true, false) => LOW_SUPPLY,
            (true, true) => "",
        },
    }
}

/// 400 MHz for the processor, 200 MHz for buses and TIM2, 100 MHz for the serial port and 50 MHz for the converters; from
/// the debugger's clock of 8 MHz (PH0), or from the internal one. Whether the debugger's runs.
fn clocks(device: &pac::Peripherals) -> bool {
    let (rcc, pwr) = (&device.RCC, &device.PWR);
    // The supply is the chip's own linear regulator, told once after power came. Then the voltage that 400 MHz need.
    pwr.cr3()
        .modify(|_, w| w.scuen().set_bit().ldoen().set_bit().bypass().clear_bit());
    while pwr.csr1().read().actvosrdy().bit_is_clear() {}
    // SAFETY: three, scale 1, is a value of the field.
    pwr.d3cr().modify(|_, w| unsafe { w.vos().bits(3) });
    while pwr.d3cr().read().vosrdy().bit_is_clear() {}

    rcc.cr().modify(|_, w| w.hsebyp().bypassed());
    rcc.cr().modify(|_, w| w.hseon().on());
    // Some 0.1 s of the internal oscillator's.
    let mut patience = 1_000_000;
    while !rcc.cr().read().hserdy().is_ready() && patience > 0 {
        patience -= 1;
    }
    let found = rcc.cr().read().hserdy().is_ready();
    // Both loops get 8 MHz.
    rcc.pllckselr().write(|w| {
        if found {
            w.pllsrc().hse().divm1().set(1).divm2().set(1)
        } else {
            w.pllsrc().hsi().divm1().set(8).divm2().set(8)
        }
    });
    rcc.pllcfgr().write(|w| {
        w.pll1rge().range8().pll1vcosel().wide_vco().divp1en().enabled();
        w.pll2rge().range8().pll2vcosel().wide_vco().divp2en().enabled()
    });
    // 8 MHz * 100 / 2 and 8 MHz * 25 / 4: the fields hold one less.
    // SAFETY: all values are ones that the fields take (RM0433 sections 8.7.13 and 8.7.15).
    unsafe {
        rcc.pll1divr().write(|w| w.divn1().bits(99).divp1().bits(1));
        rcc.pll2divr().write(|w| w.divn2().bits(24).divp2().bits(3));
    }
    rcc.cr().modify(|_, w| w.pll1on().on().pll2on().on());
    while !rcc.cr().read().pll1rdy().is_ready() || !rcc.cr().read().pll2rdy().is_ready() {}
    // For 200 MHz on the bus of the flash memory (RM0433 table 17).
    // SAFETY: values that the fields take.
    device
        .FLASH
        .acr()
        .write(|w| unsafe { w.latency().bits(2).wrhighfreq().bits(2) });
    while device.FLASH.acr().read().latency().bits() != 2 {}
    rcc.d1cfgr()
        .modify(|_, w| w.d1cpre().div1().hpre().div2().d1ppre().div2());
    rcc.d2cfgr().modify(|_, w| w.d2ppre1().div2().d2ppre2().div2());
    rcc.d3cfgr().modify(|_, w| w.d3ppre().div2());
    rcc.cfgr().modify(|_, w| w.sw().pll1());
    while !rcc.cfgr().read().sws().is_pll1() {}
    rcc.d3ccipr().modify(|_, w| w.adcsel().pll2_p());
    // From here on a clock that stops is a non-maskable interrupt, not a frequency that silently changes.
    if found {
        rcc.cr().modify(|_, w| w.hsecsson().on());
    }
    found
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
        sampler::now()
    }
}

impl Watchdog for Chip {
    fn feed(&mut self) {
        // Also while nothing is measured: the cycle counter must not come round unseen.
        sampler::keep_up();
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
