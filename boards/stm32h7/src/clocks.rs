//! The STM32H743's clocks: the counter of the search for one, and the way from what is found to 400 MHz.
//!
//! TIM17 captures edges of `HSE_1MHz`, which is the high-speed input behind the RTC's divider (RM0433 sections 8.5 and 40).

use crate::clock_search::Found;
use crate::pac;

/// What counts the input.
pub type Counter = pac::TIM17;

/// The internal oscillator's frequency, which the processor and the counter have at the start, MHz.
pub const INTERNAL_MHZ: u32 = 64;

/// `HSE_1MHz` in TIM17's input selection.
const HSE_1MHZ: u8 = 2;

/// What both loops multiply, MHz: between 4 and 8, and a whole part of every known clock and of the internal oscillator.
const REFERENCE_MHZ: u32 = 4;
/// The same of 25 MHz, of which 4 are no part.
const OTHER_REFERENCE_MHZ: u32 = 5;

/// Lets the counter see the input.
pub fn counter_on(rcc: &pac::RCC, counter: &Counter) {
    rcc.apb2enr().modify(|_, w| w.tim17en().enabled());
    // SAFETY: the field has four bits, and this value is one of its documented ones.
    counter.tim17_tisel().write(|w| unsafe { w.ti1sel().bits(HSE_1MHZ) });
}

/// The counter is not needed any more.
pub fn counter_off(rcc: &pac::RCC) {
    rcc.apb2enr().modify(|_, w| w.tim17en().disabled());
}

/// The voltage that 400 MHz need; before [`run`].
pub fn raise_voltage(pwr: &pac::PWR) {
    // The supply is the chip's own linear regulator, told once after power came.
    pwr.cr3()
        .modify(|_, w| w.scuen().set_bit().ldoen().set_bit().bypass().clear_bit());
    while pwr.csr1().read().actvosrdy().bit_is_clear() {}
    // SAFETY: three, scale 1, is a value of the field.
    pwr.d3cr().modify(|_, w| unsafe { w.vos().bits(3) });
    while pwr.d3cr().read().vosrdy().bit_is_clear() {}
}

/// 400 MHz for the processor, 200 MHz for buses and TIM2, 100 MHz for the serial port and 50 MHz for the converters; from
/// what was found, or from the internal oscillator.
pub fn run(rcc: &pac::RCC, flash: &pac::FLASH, found: Option<Found>) {
    let mhz = found.map_or(INTERNAL_MHZ, |f| f.mhz);
    let reference = if mhz.is_multiple_of(REFERENCE_MHZ) {
        REFERENCE_MHZ
    } else {
        OTHER_REFERENCE_MHZ
    };
    let divider = (mhz / reference) as u8;
    rcc.pllckselr().write(|w| {
        w.divm1().set(divider).divm2().set(divider);
        match found {
            Some(_) => w.pllsrc().hse(),
            // Good enough for the serial line. The lock-in compares with no other clock.
            None => w.pllsrc().hsi(),
        }
    });
    rcc.pllcfgr().write(|w| {
        w.pll1rge().range4().pll1vcosel().wide_vco().divp1en().enabled();
        w.pll2rge().range4().pll2vcosel().wide_vco().divp2en().enabled()
    });
    // 800 MHz / 2 and 200 MHz / 4: the fields hold one less.
    // SAFETY: all values are ones that the fields take (RM0433 sections 8.7.13 and 8.7.15).
    unsafe {
        rcc.pll1divr()
            .write(|w| w.divn1().bits((800 / reference - 1) as u16).divp1().bits(1));
        rcc.pll2divr()
            .write(|w| w.divn2().bits((200 / reference - 1) as u16).divp2().bits(3));
    }
    rcc.cr().modify(|_, w| w.pll1on().on().pll2on().on());
    while !rcc.cr().read().pll1rdy().is_ready() || !rcc.cr().read().pll2rdy().is_ready() {}
    // For 200 MHz on the bus of the flash memory (RM0433 table 17).
    // SAFETY: values that the fields take.
    flash
        .acr()
        .write(|w| unsafe { w.latency().bits(2).wrhighfreq().bits(2) });
    while flash.acr().read().latency().bits() != 2 {}
    rcc.d1cfgr()
        .modify(|_, w| w.d1cpre().div1().hpre().div2().d1ppre().div2());
    rcc.d2cfgr().modify(|_, w| w.d2ppre1().div2().d2ppre2().div2());
    rcc.d3cfgr().modify(|_, w| w.d3ppre().div2());
    rcc.cfgr().modify(|_, w| w.sw().pll1());
    while !rcc.cfgr().read().sws().is_pll1() {}
    rcc.d3ccipr().modify(|_, w| w.adcsel().pll2_p());
    // From here on a clock that stops is a non-maskable interrupt, not a frequency that silently changes.
    if found.is_some() {
        rcc.cr().modify(|_, w| w.hsecsson().on());
    }
}
