//! The STM32F4's clocks: the counter of the search for one, and the way from what is found to 168 MHz.
//!
//! TIM11 captures edges of `HSE_RTC` ("Internal/external clock measurement using TIM5/TIM11" in RM0390 section 6.2, RM0090
//! sections 6.2 and 7.2).

use crate::clock_search::{Found, Origin};
use crate::pac;
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::rcc::Config;

/// What counts the input.
pub type Counter = pac::TIM11;

/// The internal oscillator's frequency, which the processor and the counter have at the start, MHz.
pub const INTERNAL_MHZ: u32 = 16;

/// `HSE_RTC` in TIM11's option register, TI1_RMP.
const HSE_RTC: u8 = 2;

/// Lets the counter see the input.
pub fn counter_on(rcc: &pac::RCC, counter: &Counter) {
    rcc.apb2enr().modify(|_, w| w.tim11en().enabled());
    // SAFETY: the field has two bits, and this value is one of its documented ones.
    counter.or().write(|w| unsafe { w.rmp().bits(HSE_RTC) });
}

/// The counter is not needed any more.
pub fn counter_off(rcc: &pac::RCC) {
    rcc.apb2enr().modify(|_, w| w.tim11en().disabled());
}

/// What makes 168 MHz of it.
pub fn config(found: Option<Found>) -> Config {
    let source = match found {
        Some(Found { origin, mhz }) => {
            let config = Config::hse(mhz.MHz());
            match origin {
                Origin::Outside => config.bypass_hse_oscillator(),
                Origin::Crystal => config,
            }
        }
        // Good enough for the serial line. The lock-in compares with no other clock.
        None => Config::hsi(),
    };
    source.sysclk(168.MHz()).pclk1(42.MHz()).pclk2(84.MHz())
}
